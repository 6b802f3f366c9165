"""Edges of a plan, and what it costs to cut through them."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.model.checked import Floats
from vinefab.rig.clean import Pieces

_GUARD_MM = 2.0
_CORNER_COST_MM = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Edges:
    """Edges of polygons, solid on their left.

    Parameters
    ----------
    start_mm, end_mm
        Their ends, shape (n, 2).
    """

    start_mm: Floats
    end_mm: Floats

    @classmethod
    def of(cls, solids: Pieces) -> "Edges":
        """Return the edges of all rings of polygons that do not overlap."""
        rings = shapely.get_rings(shapely.orient_polygons(solids))
        points, ring = shapely.get_coordinates(rings, return_index=True)
        same = ring[1:] == ring[:-1]
        return cls(start_mm=points[:-1][same], end_mm=points[1:][same])

    def turned(self) -> "Edges":
        """Swap x and y; reversing the edges keeps the solid on their left."""
        return Edges(start_mm=self.end_mm[:, ::-1], end_mm=self.start_mm[:, ::-1])

    def costs_mm(self, lines_mm: Floats, even_mm: float) -> Floats:
        """Return what it costs to cut along upright lines, in millimetres of cut obstacle.

        A corner within 2 mm of the line counts like 20 mm of obstacle, because a thin tip would
        be cut off; between equals the more even cut is cheaper.

        Parameters
        ----------
        lines_mm
            Their x, shape (m,).
        even_mm
            Where the tiles would be even.
        """
        near = np.sort(self.start_mm[:, 0])
        corners = np.searchsorted(near, lines_mm + _GUARD_MM, side="right")
        corners = corners - np.searchsorted(near, lines_mm - _GUARD_MM)
        crossed_mm = np.array([self.length_mm(x_mm) for x_mm in lines_mm])
        uneven_mm = 1e-3 * np.abs(lines_mm - even_mm)
        return np.asarray(crossed_mm + _CORNER_COST_MM * corners + uneven_mm, dtype=np.float64)

    def length_mm(self, x_mm: float) -> float:
        """Return the length of the upright line x = x_mm in the solids.

        Along the line, an edge that runs to the right has the solid above it, one that runs to
        the left has it below: the lengths add up as signed heights, without any sorting.
        """
        start_x, end_x = self.start_mm[:, 0], self.end_mm[:, 0]
        crossing: NDArray[np.bool_] = (start_x <= x_mm) != (end_x <= x_mm)
        start, end = self.start_mm[crossing], self.end_mm[crossing]
        share = (x_mm - start[:, 0]) / (end[:, 0] - start[:, 0])
        y_mm = start[:, 1] + share * (end[:, 1] - start[:, 1])
        return float(-(np.sign(end[:, 0] - start[:, 0]) * y_mm).sum())
