"""Free space as thin strips, for the area that discs or bodies reach, many times a second."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vinefab.core.validation import Floats, Ints

STRIPS_PER_RADIUS = 10
"""Strips, and cells along them, per radius of the discs."""

MOST_CELLS = 4_000_000
"""Larger rasters would not pay: 32 MB."""

TABLE_STEPS = 1024
"""Entries of the table of circular segments: linear in between, within 1e-5 of the disc's area."""


class Chains(NamedTuple):
    """The bodies of several growths, one after the other, j of them."""

    points_mm: Floats  # chain points, shape (p, 2)
    # index of each branch's first chain point within its growth, with the total at the end of every
    # growth: one entry more per growth than it has branches
    first_point: Ints
    # where the branches of each growth begin, with the total at the end, shape (j + 1,)
    branch: Ints
    room: Ints  # where the chain points of each growth begin, shape (j + 1,) or (j,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Raster:
    """The free area of each strip to the left of each abscissa."""

    box: Floats  # lower left corner and the side of the cells, mm; shape (3,)
    # free area of each strip to the left of each cell's sides, shape (rows, columns + 1)
    free_mm2: Floats
    radius_mm: float  # radius of the discs that it was made for
    segments: Floats  # area of the unit disc below heights evenly spaced from -1 to 1

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "Raster | None":
        """Return the raster of a free space, or None if it would take too many cells.

        Parameters
        ----------
        edges_mm
            Directed edges with the free space on their left, shape (e, 2, 2).
        """
        from vinefab.tasks.kernels import areas_kernel as area_kernel  # noqa: PLC0415  numba takes a second to import

        low = edges_mm.min(axis=(0, 1))
        size = edges_mm.max(axis=(0, 1)) - low
        side_mm = radius_mm / STRIPS_PER_RADIUS
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        if columns * rows > MOST_CELLS:
            return None
        free = np.zeros((rows, columns + 1))
        box = np.array([*low, side_mm])
        area_kernel.fill_strips(edges_mm, box, free, np.zeros_like(free))
        return cls(box=box, free_mm2=free, radius_mm=radius_mm, segments=segment_table())

    def covered_mm2(self, tips_mm: Floats, first: Ints) -> tuple[Floats, Floats]:
        """Return the free area that discs cover together, and the sum of what each covers.

        In each strip a rectangle of the same area stands for a disc. The two differ on less than
        4 % of the disc, and free area between two sides of a cell is taken as evenly spread, which
        moves less than 4 %: the result is off by less than 8 % of the sum, whatever the map. That
        bound is far from reached, because whole discs are exact and errors arise, with either
        sign, only where an outline meets a wall or another disc: over 1000 random deployments in
        four environments the area is within 0.6 % (0.05 to 0.09 % in the mean square) of the exact
        one, as `tests/tasks/errors.py` measures.

        Parameters
        ----------
        tips_mm
            Centres of all discs, set after set, shape (m, 2).
        first
            Where each set begins, with the total at the end, shape (j + 1,).
        """
        from vinefab.tasks.kernels import areas_kernel as area_kernel  # noqa: PLC0415  as above

        largest = int(np.diff(first).max(initial=1))
        seen, summed = np.zeros((2, len(first) - 1))
        work = np.empty((5, largest))
        index = np.empty((3, largest), dtype=np.int64)
        begins = np.empty(len(self.free_mm2), dtype=np.int64)
        area_kernel.cover_areas(
            tips_mm,
            first,
            self.radius_mm,
            self.segments,
            self.free_mm2,
            self.box,
            work,
            index,
            begins,
            seen,
            summed,
        )
        return seen, summed

    def reached_mm2(self, chains: Chains) -> Floats:
        """Return the free area within the radius of each body, shape (j,).

        Every cell stands with its free area for its centre: a cell whose centre lies half a
        diagonal inside the edge of what is reached is reached as a whole, one half a diagonal
        outside not at all, and only cells between the two can be wrong, with either sign. The
        result is therefore off by less than the free area of that band, 0.14 radii wide along the
        edge, whatever the map. That bound is far from reached: `tests/tasks/errors.py` measures
        it on random deployments.
        """
        from vinefab.tasks.kernels import areas_kernel as area_kernel  # noqa: PLC0415  as above

        weight = np.diff(self.free_mm2, axis=1)
        out = np.zeros(len(chains.branch) - 1)
        level, mark = np.empty(weight.shape), np.zeros(weight.shape, dtype=np.int64)
        area_kernel.reach_areas(*chains, self.radius_mm, weight, self.box, level, mark, out)
        return out


def segment_table() -> Floats:
    """Return the area of the unit disc below heights evenly spaced from -1 to 1."""
    y = np.linspace(-1.0, 1.0, TABLE_STEPS + 1)
    table: Floats = 0.5 * math.pi + y * np.sqrt(1.0 - y * y) + np.arcsin(y)
    return table
