"""A uniform grid over walls and vertices, so that a ray or a sweep looks only at what is near."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import Ints32, WallArrays
from vinefab.growth.free_space import FreeSpaceWalls

MARGIN = 1e-6
"""Walls are entered in cells that they miss by up to this share of a cell.

It is far above rounding and above the tolerance of touching, so that a ray along a cell's edge or
through its corner finds everything that it touches in the cells that it is said to cross.
"""


class _Grid(NamedTuple):
    """Lower left corner, cell side (mm), cells per mm, columns and rows."""

    x_mm: float
    y_mm: float
    cell_mm: float
    per_mm: float
    columns: int
    rows: int


def indexed(walls: FreeSpaceWalls, near_mm: float) -> WallArrays:
    """Return the walls with their grid index, all arrays read-only."""
    grid = _grid_over(walls.wall)
    wall_first, wall_item = _listed(grid, *_cells_of_walls(grid, walls.wall))
    crowded = _crowded(walls, wall_item, _lists_at_starts(grid, walls.wall, wall_first), near_mm)
    vertex_first, order = _listed(grid, *_cells_of_vertices(grid, walls.vertex))
    arrays = WallArrays(
        wall=np.ascontiguousarray(walls.wall),
        link=np.column_stack([walls.link, crowded]),
        vertex=walls.vertex[order],
        vertex_point=walls.vertex_point[order],
        box=np.array([grid.x_mm, grid.y_mm, grid.cell_mm, grid.per_mm]),
        shape=np.array([grid.columns, grid.rows], dtype=np.int64),
        wall_first=wall_first,
        wall_item=wall_item,
        vertex_first=vertex_first,
    )
    for array in arrays:
        array.setflags(write=False)
    return arrays


def _grid_over(wall: Floats) -> _Grid:
    """Return a grid with about one cell per wall.

    It reaches half a cell beyond the walls, so that a body that lies along the outermost one, which
    rounding may place a trifle outside, is still in it.
    """
    if len(wall) == 0:
        return _Grid(0.0, 0.0, 1.0, 1.0, 1, 1)
    low, high = wall[:, :2].min(axis=0), wall[:, :2].max(axis=0)
    width, height = (high - low).tolist()
    cell = max(np.sqrt(width * height / len(wall)), max(width, height) / (4.0 * len(wall)))
    columns, rows = int(width / cell) + 2, int(height / cell) + 2
    corner = low - 0.5 * cell
    return _Grid(float(corner[0]), float(corner[1]), float(cell), 1.0 / float(cell), columns, rows)


def _column(grid: _Grid, x_mm: Floats) -> Ints:
    column = np.floor((x_mm - grid.x_mm) * grid.per_mm)
    return np.clip(column, 0, grid.columns - 1).astype(np.int64)


def _row(grid: _Grid, y_mm: Floats) -> Ints:
    row = np.floor((y_mm - grid.y_mm) * grid.per_mm)
    return np.clip(row, 0, grid.rows - 1).astype(np.int64)


def _cells_of_walls(grid: _Grid, wall: Floats) -> tuple[Ints, Ints]:
    """Return (wall, cell) pairs for every cell that a wall touches within the margin."""
    margin = MARGIN * grid.cell_mm
    left = np.minimum(wall[:, 0], wall[:, 5])
    right = np.maximum(wall[:, 0], wall[:, 5])
    first, last = _column(grid, left - margin), _column(grid, right + margin)
    item, column = _expanded(first, last)
    low, high = _heights(grid, wall[item], column, margin)
    pair, row = _expanded(_row(grid, low - margin), _row(grid, high + margin))
    return item[pair], row * grid.columns + column[pair]


def _heights(grid: _Grid, wall: Floats, column: Ints, margin: float) -> tuple[Floats, Floats]:
    """Return the lowest and highest y of each wall within its column."""
    x, y = wall[:, 0], wall[:, 1]
    dx, dy = wall[:, 5] - x, wall[:, 6] - y
    edge = grid.x_mm + column * grid.cell_mm
    # Upright walls are taken whole: dividing by their width would lose them.
    upright = np.abs(dx) < 1e-3 * grid.cell_mm
    width = np.where(upright, 1.0, dx)
    one = np.where(upright, 0.0, np.clip((edge - margin - x) / width, 0.0, 1.0))
    two = np.where(upright, 1.0, np.clip((edge + grid.cell_mm + margin - x) / width, 0.0, 1.0))
    return np.minimum(y + one * dy, y + two * dy), np.maximum(y + one * dy, y + two * dy)


def _lists_at_starts(grid: _Grid, wall: Floats, first: Ints32) -> tuple[Ints, Ints]:
    """Return (wall, place in the list of items) for all walls in the cell of each wall's start."""
    cell = _row(grid, wall[:, 1]) * grid.columns + _column(grid, wall[:, 0])
    return _expanded(first[cell].astype(np.int64), first[cell + 1].astype(np.int64) - 1)


def _crowded(walls: FreeSpaceWalls, item: Ints32, pairs: tuple[Ints, Ints], near_mm: float) -> Ints:
    """Return 1 for every wall that another comes near to, except where they join.

    Walls do not cross, so what comes nearest is an end of one of the two.
    """
    owner, other = pairs[0], item[pairs[1]].astype(np.int64)
    start, end = walls.link[:, 2], walls.link[:, 3]
    apart = (start[other] != start[owner]) & (end[other] != start[owner])
    owner, other = owner[apart], other[apart]
    r, t = walls.wall[owner, :2] - walls.wall[other, :2], walls.wall[other, 2:4]
    along = np.sum(r * t, axis=1)
    aside = np.abs(r[:, 0] * t[:, 1] - r[:, 1] * t[:, 0])
    near = (aside <= near_mm) & (along >= -near_mm) & (along <= walls.wall[other, 4] + near_mm)
    crowded = np.zeros(len(start), dtype=np.int64)
    crowded[other[near]] = 1
    crowded[np.isin(start, start[owner[near]]) | np.isin(end, start[owner[near]])] = 1
    return crowded


def _expanded(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Return (index, value) for all values of each range ``first .. last``, both included."""
    count = last - first + 1
    index = np.repeat(np.arange(len(first)), count)
    within = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    return index, first[index] + within


def _cells_of_vertices(grid: _Grid, vertex: Floats) -> tuple[Ints, Ints]:
    cell = _row(grid, vertex[:, 1]) * grid.columns + _column(grid, vertex[:, 0])
    return np.arange(len(vertex)), cell


def _listed(grid: _Grid, item: Ints, cell: Ints) -> tuple[Ints32, Ints32]:
    """Return where each cell's items begin, and the items cell by cell in rising order."""
    order: NDArray[np.int64] = np.argsort(cell, kind="stable")
    counts = np.bincount(cell, minlength=grid.columns * grid.rows)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return first, item[order].astype(np.int32)
