"""Areas that sensors and bodies reach, measured fast: on strips, cells and lines of free space.

Errors are bounded, and measured by `tests/tasks/measure_area_errors.py`;
`vinefab.tasks.exact_areas` is the reference.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vinefab.core.compiling import imported_later
from vinefab.core.validation import Floats, Ints
from vinefab.tasks.exact_areas import NUDGE_MM, TOUCHING_MM

if TYPE_CHECKING:
    from vinefab.tasks.kernels import areas_kernel, sight_kernel
else:
    areas_kernel = imported_later("vinefab.tasks.kernels.areas_kernel")
    sight_kernel = imported_later("vinefab.tasks.kernels.sight_kernel")

# --- Strips of free space: discs and bodies -----------------------------------------------------

STRIPS_PER_RADIUS = 10
"""Strips, and cells along them, per radius of the discs."""

MOST_RASTER_CELLS = 4_000_000
"""Limit of a raster's size: 32 MB; polygons are used beyond it."""

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
class FreeArea:
    """The free area of each strip to the left of each abscissa."""

    box: Floats  # lower left corner and the side of the cells, mm; shape (3,)
    # free area of each strip to the left of each cell's sides, shape (rows, columns + 1)
    free_mm2: Floats
    radius_mm: float  # radius of the discs
    segments: Floats  # area of the unit disc below heights evenly spaced from -1 to 1

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "FreeArea | None":
        """Return the raster of a free space, None above `MOST_RASTER_CELLS`.

        Parameters
        ----------
        edges_mm
            Directed edges with the free space on their left, shape (e, 2, 2).
        """
        low = edges_mm.min(axis=(0, 1))
        size = edges_mm.max(axis=(0, 1)) - low
        side_mm = radius_mm / STRIPS_PER_RADIUS
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        if columns * rows > MOST_RASTER_CELLS:
            return None
        free = np.zeros((rows, columns + 1))
        box = np.array([*low, side_mm])
        areas_kernel.fill_strips(edges_mm, box, free, np.zeros_like(free))
        return cls(box=box, free_mm2=free, radius_mm=radius_mm, segments=segment_table())

    def covered_mm2(self, tips_mm: Floats, first: Ints) -> tuple[Floats, Floats]:
        """Return the free area that discs cover together, and the sum of each disc's free area.

        In each strip a rectangle of the same area stands for a disc. The two differ on less than
        4 % of the disc, and free area between two sides of a cell is taken as evenly spread, which
        moves less than 4 %: the error is below 8 % of the sum, whatever the map. In practice it is
        far smaller, because whole discs are exact and errors arise, with either sign, only where an
        outline meets a wall or another disc: over 1000 random deployments in four environments the
        area is within 0.6 % (0.05 to 0.09 % RMS) of the exact one.

        Parameters
        ----------
        tips_mm
            Centres of all discs, set after set, shape (m, 2).
        first
            Where each set begins, with the total at the end, shape (j + 1,).
        """
        largest = int(np.diff(first).max(initial=1))
        seen, summed = np.zeros((2, len(first) - 1))
        rows, most = len(self.free_mm2) + 2, 2 * STRIPS_PER_RADIUS + 3
        areas_kernel.cover_areas(
            tips_mm,
            first,
            self.radius_mm,
            self.segments,
            self.free_mm2,
            self.box,
            np.empty((2, largest), dtype=np.int64),
            np.empty((3, rows), dtype=np.int64),
            np.empty((4, rows)),
            np.empty((4, most * largest)),
            seen,
            summed,
        )
        return seen, summed

    def reached_mm2(self, chains: Chains) -> Floats:
        """Return the free area within the radius of each body, shape (j,).

        A cell's free area counts as if it lay at the cell's centre: a cell whose centre lies half
        a diagonal inside the edge of the reached area counts in full, one half a diagonal outside
        not at all, and only cells in between can be wrong, with either sign. The error is
        therefore below the free area of that band, 0.14 radii wide along the edge, whatever the
        map, and far smaller in practice.
        """
        weight = np.diff(self.free_mm2, axis=1)
        out = np.zeros(len(chains.branch) - 1)
        level, mark = np.empty(weight.shape), np.zeros(weight.shape, dtype=np.int64)
        areas_kernel.reach_areas(*chains, self.radius_mm, weight, self.box, level, mark, out)
        return out


def segment_table() -> Floats:
    """Return the area of the unit disc below heights evenly spaced from -1 to 1."""
    y = np.linspace(-1.0, 1.0, TABLE_STEPS + 1)
    table: Floats = 0.5 * math.pi + y * np.sqrt(1.0 - y * y) + np.arcsin(y)
    return table


# --- Walls by grid cells ------------------------------------------------------------------------

MOST_WALL_CELLS = 1_000_000
MOST_ENTRIES = 20_000_000
"""Limits of an index's size: 160 MB. One cell with all the walls is never too large."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WallCells:
    """A uniform grid over walls that lists the walls near each cell."""

    walls_mm: Floats  # both ends of each wall, shape (e, 4)
    # lower left corner and side of the cells, mm, then columns and rows; shape (5,)
    grid: Floats
    # where the walls of each cell begin in ``item``, row by row, with the total at the end
    first: Ints
    # walls within reach of each cell, and perhaps some a little further off, in rising order
    item: Ints

    @classmethod
    def of(cls, walls_mm: Floats, side_mm: float, reach_mm: float) -> "WallCells | None":
        """Return the index of some walls, None if it would take too much memory.

        Parameters
        ----------
        walls_mm
            Both ends of each wall, at least one, shape (e, 4).
        side_mm
            Side of the cells.
        reach_mm
            Walls within this distance of a cell are listed in it.
        """
        ends = walls_mm.reshape(-1, 2)
        low, size = ends.min(axis=0), np.ptp(ends, axis=0)
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        if columns * rows > MOST_WALL_CELLS:
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
        """Return the number of walls that the cells of some places list, shape (m,).

        Places outside the grid belong to the nearest cell.
        """
        low, side_mm, shape = self.grid[:2], self.grid[2], self.grid[3:].astype(np.int64)
        column, row = np.clip(((places_mm - low) / side_mm).astype(np.int64), 0, shape - 1).T
        cell = row * shape[0] + column
        return np.asarray(self.first[cell + 1] - self.first[cell])


# --- Lines of sight -----------------------------------------------------------------------------

LINES_PER_RADIUS = 40
"""Lines per radius of the discs of sight."""

LEAST_LINES = 160
"""Lines across a square map that is smaller than the discs."""

DIRECTIONS = 16
"""Candidate directions of the lines."""

MOST_LINES = 1_000_000
"""Limit of their number: every growth visits all of them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SightLines:
    """Parallel lines across a free space, and the walls that can hide something from each cell.

    All coordinates are rotated so that the lines run along x.
    """

    radius_mm: float  # how far sensors see
    # cosine and sine of the angle between x and the lines on the map
    direction: tuple[float, float]
    # walls within the radius of each cell, with free space on their left, rotated
    cells: WallCells
    line: Floats  # lower side of the lowest strip and how high each is, mm; shape (2,)
    lines: int  # how many there are, each in the middle of its strip

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "SightLines | None":
        """Return the lines across a free space, None if they would be too many.

        Parameters
        ----------
        edges_mm
            Directed edges with the free space on their left, shape (e, 2, 2).
        """
        # Shadows of walls are as fine as the map, however far sensors see.
        side_mm = math.sqrt(np.ptp(edges_mm.reshape(-1, 2), axis=0).prod())
        step_mm = min(radius_mm / LINES_PER_RADIUS, side_mm / LEAST_LINES)
        direction = _direction(edges_mm, step_mm)
        walls_mm = _rotated(edges_mm, direction)
        low_mm, high_mm = float(walls_mm[..., 1].min()), float(walls_mm[..., 1].max())
        lines = max(1, math.ceil((high_mm - low_mm) / step_mm))
        if lines > MOST_LINES:
            return None
        # Sensors outside by rounding use the walls of the nearest cell.
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
        """Return the area that sensors see together, and the sum of the areas that each sees.

        The seen length on every line is exact, and stands for the strip about the line. Within a
        strip, the seen length changes by no more than the outline of the seen area runs along the
        lines there. The error is therefore below half a strip, at most an eightieth of the radius,
        times the length of the outline. It is far smaller in practice, because errors have either
        sign and arise only where the outline runs along the lines, whose direction is the one
        least followed by walls.

        Parameters
        ----------
        tips_mm
            All sensors, in free space or on its border, set after set, shape (m, 2).
        first
            Where each set begins, with the total at the end, shape (j + 1,).
        """
        tips_mm = _rotated(tips_mm, self.direction)
        sensors = int(np.diff(first).max(initial=0))
        number = np.concatenate([[0], np.cumsum(self.cells.numbers_at(tips_mm))])
        walls = int(np.diff(number[first]).max(initial=0))
        seen, summed = np.zeros((2, len(first) - 1))
        sight_kernel.seen_areas_by_lines(
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


def _rotated(points_mm: Floats, direction: tuple[float, float]) -> Floats:
    """Return points in a frame whose x axis has a direction, shape (..., 2)."""
    x, y = points_mm[..., 0], points_mm[..., 1]
    cosine, sine = direction
    return np.stack([x * cosine + y * sine, y * cosine - x * sine], axis=-1)


def _direction(edges_mm: Floats, step_mm: float) -> tuple[float, float]:
    """Return the direction of lines that walls follow the least.

    The length that walls run between two neighbouring lines bounds the error.
    """
    runs = edges_mm[:, 1] - edges_mm[:, 0]
    best, least = (1.0, 0.0), math.inf
    for k in range(DIRECTIONS):
        direction = math.cos(math.pi * k / DIRECTIONS), math.sin(math.pi * k / DIRECTIONS)
        along, across = np.abs(_rotated(runs, direction)).T
        flat = across <= step_mm
        cost = along[flat].sum() + (along[~flat] * step_mm / across[~flat]).sum()
        if cost < least:
            best, least = direction, float(cost)
    return best
