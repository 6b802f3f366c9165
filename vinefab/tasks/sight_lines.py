"""Lines across the free space, for the area that sensors see past walls, many times a second."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.model.checked import Floats, Ints
from vinefab.tasks.cells import TOUCHING_MM, WallCells
from vinefab.tasks.sight import NUDGE_MM

LINES_PER_RADIUS = 40
"""Lines per radius of the discs of sight."""

LEAST_LINES = 160
"""Lines across a square map that is smaller than the discs."""

DIRECTIONS = 16
"""Directions between which that of the lines is chosen."""

MOST_LINES = 1_000_000
"""More would not pay: every growth looks at all of them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SightLines:
    """The walls of a free space, by cells of the sensors that they can hide something from.

    Everything is turned, so that the lines run along x.

    Parameters
    ----------
    radius_mm
        How far sensors see.
    direction
        Cosine and sine of the angle between x and the lines on the map.
    cells
        Walls that come within the radius of each cell, with free space on their left, turned.
    line
        Lower side of the lowest strip and how high each is, mm; shape (2,).
    lines
        How many there are, each in the middle of its strip.
    """

    radius_mm: float
    direction: tuple[float, float]
    cells: WallCells
    line: Floats
    lines: int

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "SightLines | None":
        """Return the lines on a free space, or None if it is too large for such discs.

        Parameters
        ----------
        edges_mm
            Directed edges with the free space on their left, shape (e, 2, 2).
        radius_mm
            How far sensors see.
        """
        # What walls hide is as fine as the map, however far sensors see.
        side_mm = math.sqrt(np.ptp(edges_mm.reshape(-1, 2), axis=0).prod())
        step_mm = min(radius_mm / LINES_PER_RADIUS, side_mm / LEAST_LINES)
        direction = _direction(edges_mm, step_mm)
        walls_mm = _turned(edges_mm, direction)
        low_mm, high_mm = float(walls_mm[..., 1].min()), float(walls_mm[..., 1].max())
        lines = max(1, math.ceil((high_mm - low_mm) / step_mm))
        if lines > MOST_LINES:
            return None
        # Sensors that lie outside by rounding have the walls of the nearest cell.
        reach_mm = radius_mm + 2.0 * TOUCHING_MM
        cells = WallCells.of(walls_mm.reshape(-1, 4), radius_mm, reach_mm)
        if cells is None:
            return None
        return cls(
            radius_mm=radius_mm,
            direction=direction,
            cells=cells,
            line=np.array([low_mm, step_mm]),
            lines=lines,
        )

    def covered_mm2(self, tips_mm: Floats, first: Ints) -> tuple[Floats, Floats]:
        """Return the area that sensors see together, and the sum of what each sees.

        On every line, what is seen is exact; its length stands for the strip about the line. In a
        strip, the seen length differs from that on its line by no more than the outline of what is
        seen runs along the lines in between. The result is therefore off by less than half a
        strip, at most an eightieth of the radius, times the length of the outline. That bound is
        far from reached, because errors have either sign and arise only where the outline runs
        along the lines, whose direction is the one that the walls run along the least:
        `tests/tasks/errors.py` measures it on random deployments.

        Parameters
        ----------
        tips_mm
            All sensors, in free space or on its border, set after set, shape (m, 2).
        first
            Where each set begins, with the total at the end, shape (j + 1,).

        Returns
        -------
        seen_mm2, summed_mm2
            Shape (j,) each.
        """
        from vinefab.tasks import sight_kernel  # noqa: PLC0415  numba takes a second to import

        tips_mm = _turned(tips_mm, self.direction)
        sensors = int(np.diff(first).max(initial=0))
        number = np.concatenate([[0], np.cumsum(self.cells.numbers_at(tips_mm))])
        walls = int(np.diff(number[first]).max(initial=0))
        seen, summed = np.zeros((2, len(first) - 1))
        sight_kernel.see(
            tips_mm,
            first,
            np.array([self.radius_mm, TOUCHING_MM, NUDGE_MM]),
            self.cells.walls_mm,
            self.cells.grid,
            self.cells.first,
            self.cells.item,
            self.line,
            np.empty((walls, 4)),
            np.empty((4, sensors + 1), dtype=np.int64),
            np.empty(self.lines, dtype=np.int64),
            np.empty((2, walls + sensors)),
            seen,
            summed,
        )
        return seen, summed


def _turned(points_mm: Floats, direction: tuple[float, float]) -> Floats:
    """Return points in a frame whose x runs in a direction, shape (..., 2)."""
    x, y = points_mm[..., 0], points_mm[..., 1]
    cosine, sine = direction
    return np.stack([x * cosine + y * sine, y * cosine - x * sine], axis=-1)


def _direction(edges_mm: Floats, step_mm: float) -> tuple[float, float]:
    """Return the direction for lines in which walls run along them the least.

    How far a wall runs between two neighbouring lines is what the result can be wrong by.
    """
    runs = edges_mm[:, 1] - edges_mm[:, 0]
    best, least = (1.0, 0.0), math.inf
    for k in range(DIRECTIONS):
        direction = math.cos(math.pi * k / DIRECTIONS), math.sin(math.pi * k / DIRECTIONS)
        along, across = np.abs(_turned(runs, direction)).T
        flat = across <= step_mm
        cost = along[flat].sum() + (along[~flat] * step_mm / across[~flat]).sum()
        if cost < least:
            best, least = direction, float(cost)
    return best
