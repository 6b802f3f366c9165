"""Walls by the cells of a square grid, so that only those near a place are looked at."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats, Ints

TOUCHING_MM = 1e-6
"""A wall so near to a tip or sensor is one that it lies on; tips are right to about 1e-9 mm."""

MOST_CELLS = 1_000_000
MOST_ENTRIES = 20_000_000
"""Larger indexes would not pay: 160 MB. One cell with all the walls is never too large."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WallCells:
    """Walls, and which of them come near each cell."""

    walls_mm: Floats  # both ends of each wall, shape (e, 4)
    # lower left corner and side of the cells, mm, and how many columns and rows there are; shape
    grid: Floats
    # where the walls of each cell begin in ``item``, row by row, with the total at the end
    first: Ints
    # walls that come near each cell, and perhaps some a little further off, in rising order
    item: Ints

    @classmethod
    def of(cls, walls_mm: Floats, side_mm: float, reach_mm: float) -> "WallCells | None":
        """Return the index of some walls, or None if it would take too much memory.

        Parameters
        ----------
        walls_mm
            Both ends of each wall, at least one, shape (e, 4).
        """
        from vinefab.tasks.kernels import sight_kernel  # noqa: PLC0415  numba takes a second to import

        ends = walls_mm.reshape(-1, 2)
        low, size = ends.min(axis=0), np.ptp(ends, axis=0)
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        if columns * rows > MOST_CELLS:
            return None
        grid = np.array([*low, side_mm, columns, rows])
        number = np.zeros(columns * rows, dtype=np.int64)
        sight_kernel.count_walls(walls_mm, grid, reach_mm, number)
        first = np.concatenate([[0], np.cumsum(number)])
        if first[-1] > max(MOST_ENTRIES, len(walls_mm)):
            return None
        item = np.empty(first[-1], dtype=np.int64)
        sight_kernel.place_walls(walls_mm, grid, reach_mm, first[:-1].copy(), item)
        return cls(walls_mm=walls_mm, grid=grid, first=first, item=item)

    def numbers_at(self, places_mm: Floats) -> Ints:
        """Return how many walls are listed where some places are, shape (m,).

        Places outside count to the nearest cell.
        """
        low, side_mm, shape = self.grid[:2], self.grid[2], self.grid[3:].astype(np.int64)
        column, row = np.clip(((places_mm - low) / side_mm).astype(np.int64), 0, shape - 1).T
        cell = row * shape[0] + column
        return np.asarray(self.first[cell + 1] - self.first[cell])
