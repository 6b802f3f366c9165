"""Boundaries of a region of cells, traced exactly.

Coordinates are in cells: the cell in column ``i`` and row ``j`` covers ``i .. i + 1`` times
``j .. j + 1``, rows counted upward.
"""

import numpy as np
from numpy.typing import NDArray

from vinefab.model.checked import Floats, Ints

Mask = NDArray[np.bool_]

_STEPS = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
"""Directions counter-clockwise: right, up, left, down."""


def boundary_loops(region: Mask) -> list[Floats]:
    """Return the closed loops of cell edges around a region, as the edges' midpoints.

    The region lies to the left: outer boundaries run counter-clockwise, holes clockwise. Where
    two cells of the region touch only at a corner the loops keep them apart, so that the region
    is 4-connected and what is not in it 8-connected: a wall drawn one cell thick along a
    diagonal stays closed. Outside the array is outside the region.

    Parameters
    ----------
    region
        Shape (rows, columns), row 0 lowest.

    Returns
    -------
    list of arrays
        Each of shape (n, 2), n at least 4, in cells; one entry per cell edge in walking order.
        Joined up, the midpoints make loops that never touch themselves or each other and stay
        within ``CORNER_CUT`` of the exact boundary.
    """
    starts, directions = _directed_edges(np.pad(region, 1))
    after = _following(starts, directions, region.shape[1] + 3)
    midpoints = starts + 0.5 * _STEPS[directions] - 1.0
    return [midpoints[order] for order in _cycles(after)]


CORNER_CUT = 0.25 * 2**0.5
"""Distance in cells from a corner of the exact boundary to the line through two midpoints."""


def corners_between(midpoints: Floats, ahead: Floats) -> Floats:
    """Return the boundary's lattice points: one between each midpoint and the one that follows.

    Every corner of the exact boundary is among them.

    Parameters
    ----------
    midpoints, ahead
        Shape (n, 2): midpoints of cell edges, and for each the next one of its loop.
    """
    lies_flat = (midpoints[:, 0] % 1.0) != 0.0
    turns = lies_flat != ((ahead[:, 0] % 1.0) != 0.0)
    x = np.where(lies_flat, ahead[:, 0], midpoints[:, 0])
    y = np.where(lies_flat, midpoints[:, 1], ahead[:, 1])
    return np.where(turns[:, None], np.column_stack([x, y]), 0.5 * (midpoints + ahead))


def _directed_edges(padded: Mask) -> tuple[Ints, Ints]:
    """Return start lattice point (column, row) and direction of every boundary edge."""
    rises = padded[1:].astype(np.int8) - padded[:-1]
    widens = padded[:, 1:].astype(np.int8) - padded[:, :-1]
    starts, directions = [], []
    for step, change, sign, (d_row, d_column) in (
        (0, rises, 1, (1, 0)),
        (1, widens, -1, (0, 1)),
        (2, rises, -1, (1, 1)),
        (3, widens, 1, (1, 1)),
    ):
        row, column = np.nonzero(change == sign)
        starts.append(np.column_stack([column + d_column, row + d_row]))
        directions.append(np.full(len(row), step))
    return np.concatenate(starts), np.concatenate(directions)


def _following(starts: Ints, directions: Ints, width: int) -> Ints:
    """Return for every edge the edge that follows it: the one that turns left most sharply."""
    key = 4 * (starts[:, 1] * width + starts[:, 0]) + directions
    order = np.argsort(key)
    ends = starts + _STEPS[directions]
    base = 4 * (ends[:, 1] * width + ends[:, 0])
    after = np.full(len(key), -1)
    for turn in (-1, 0, 1):
        wanted = base + (directions + turn) % 4
        place = np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)
        found = order[place]
        after = np.where(key[found] == wanted, found, after)
    return after


def _cycles(after: Ints) -> list[Ints]:
    """Split a permutation into its cycles."""
    following = after.tolist()
    seen = bytearray(len(following))
    cycles = []
    for first in range(len(following)):
        if seen[first]:
            continue
        cycle, current = [], first
        while not seen[current]:
            seen[current] = 1
            cycle.append(current)
            current = following[current]
        cycles.append(np.array(cycle))
    return cycles
