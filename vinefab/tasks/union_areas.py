"""Areas of unions of polygons within a free space: for many growths at once, by compiled code."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.compiling import imported_later
from vinefab.core.validation import Floats, Ints

if TYPE_CHECKING:
    from vinefab.tasks.kernels import union_kernel
else:
    union_kernel = imported_later("vinefab.tasks.kernels.union_kernel")

GRID = 2.0**-43
"""Corners are rounded to the map's size (a power of two) times this, 6e-11 mm for half a metre:
what differs by rounding alone falls together, and what does not is apart by much more than it."""

CLOSED = 2.0**-43
"""An outline that is open by more than this share of the map's size is not taken."""

RUN = 8
"""As in the kernel."""

EDGES_PER_ROW = 8
"""Edges of the free space are listed in rows of about so many."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeRows:
    """Edges of a free space that are not level, row by row of the plane."""

    edges: Floats  # lower end, upper end, x per y and step; see the kernel
    first: Ints  # where the edges of each row begin, with the total at the end
    box: Floats  # lower end and height of the rows, mm
    size_mm: float  # the map's size, a power of two

    @classmethod
    def of(cls, edges_mm: Floats) -> "FreeRows":
        """Return the rows of directed edges with the free space on their left, shape (e, 2, 2)."""
        size_mm = float(2.0 ** np.ceil(np.log2(np.abs(edges_mm).max())))
        ends = _rounded(edges_mm, size_mm)
        ends = ends[ends[:, 0, 1] != ends[:, 1, 1]]
        up = ends[:, 1, 1] > ends[:, 0, 1]
        ends = np.where(up[:, None, None], ends, ends[:, ::-1])
        run = ends[:, 1] - ends[:, 0]
        edges = np.column_stack([ends.reshape(-1, 4), run[:, 0] / run[:, 1], 1.0 - 2.0 * up])
        rows = max(1, len(edges) // EDGES_PER_ROW)
        low_mm, high_mm = edges[:, 1].min(), edges[:, 3].max()
        box = np.array([low_mm, (high_mm - low_mm) / rows])
        begin, end = (
            np.clip(((y - box[0]) / box[1]).astype(np.int64), 0, rows - 1)
            for y in (edges[:, 1], edges[:, 3])
        )
        count = end - begin + 1
        which = np.repeat(np.arange(len(edges)), count)
        row = begin[which] + np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        order = np.argsort(row, kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=rows))])
        return cls(edges=edges[which[order]], first=first, box=box, size_mm=size_mm)

    def areas_mm2(
        self, polygons: NDArray[np.object_], begins: Ints, lines: Floats, line_first: Ints,
        radius_mm: float,
    ) -> Floats:  # fmt: skip
        """Return the area within the free space of unions of polygons, shape (j,).

        NaN where rounding left an outline open, which is very rare.

        Parameters
        ----------
        polygons
            What is within about a distance of each line.
        begins
            Where the polygons of each union begin, with the total at the end, shape (j + 1,).
        lines, line_first
            Corners of the lines, mm, and where those of each begin, with the total at the end.
        radius_mm
            The distance.
        """
        rings, owner = shapely.get_rings(polygons, return_index=True)
        corners, which = shapely.get_coordinates(rings, return_index=True)
        ring = np.searchsorted(which, np.arange(len(rings) + 1))
        polygon = np.searchsorted(owner, np.arange(len(polygons) + 1))
        together = int(np.diff(begins).max(initial=0))
        # The edges of each polygon are filled up to whole runs.
        most = int(np.diff(ring[polygon[begins]]).max(initial=0)) // RUN + together + 1
        out = np.zeros((len(begins), 4))
        out[:, 0] = begins
        union_kernel.union_areas(
            _rounded(corners, self.size_mm), ring, polygon, lines, line_first, radius_mm,
            self.edges, self.first, self.box,
            np.empty((most * RUN, 6)),
            np.empty(together + 1, dtype=np.int64),
            np.empty((together, 4)),
            np.empty((most, 3)),
            np.empty((2 * (most * RUN + len(self.edges)) + 1, 2)),
            out,
        )  # fmt: skip
        areas_mm2, open_mm, open_mm2 = out[:-1, 1:].T
        closed_mm = CLOSED * self.size_mm
        closed = (np.abs(open_mm) <= closed_mm) & (np.abs(open_mm2) <= closed_mm * self.size_mm)
        return np.where(closed, areas_mm2, np.nan)


def _rounded(points_mm: Floats, size_mm: float) -> Floats:
    grid_mm = GRID * size_mm
    return np.round(points_mm / grid_mm) * grid_mm
