"""Which of many points are worth keeping when several things count."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.search.record.result import Generation


def non_dominated(worth: Floats, costs: Floats) -> NDArray[np.bool_]:
    """Return which points no other point beats, shape (m,).

    A point beats another when it is worth no less, costs no more in any way, and differs in one of
    these for the better. Of points that are equal in all, the first is kept.

    Parameters
    ----------
    worth
        Larger is better, shape (m,).
    costs
        Smaller is better, shape (m, k).

    Examples
    --------
    >>> non_dominated(np.array([1.0, 2.0, 0.5]), np.array([[1.0], [3.0], [2.0]])).tolist()
    [True, True, False]
    """
    values = np.column_stack([-worth, costs])
    kept = np.ones(len(values), dtype=np.bool_)
    for row in range(len(values)):
        no_worse = (values <= values[row]).all(axis=1)
        better = (values < values[row]).any(axis=1)
        equal_before = no_worse & ~better & (np.arange(len(values)) < row)
        kept[row] = not (no_worse & better).any() and not equal_before.any()
    return kept


LEAST_BEND = 0.05
"""A front bends where it lies so much of both ranges above the line between its ends (assumed);
less is within the noise of scores."""


def knee(worth: Floats, costs: Floats) -> int | None:
    """Return the point of a front where it bends most, or None where it has no knee.

    A knee is a point from which a little more worth costs much, and a little less saves little:
    it lies above the straight line between the cheapest point and the one worth most. A front of
    fewer than three points, or one that runs along that line or sags below it, has none.

    Parameters
    ----------
    costs
        The cost, shape (m,). Points that others beat in these two, as a front of more costs may
        have, are left out.

    Examples
    --------
    >>> knee(np.array([0.0, 0.8, 1.0]), np.array([1.0, 2.0, 9.0]))
    1
    >>> knee(np.array([0.0, 0.2, 1.0]), np.array([1.0, 8.0, 9.0])) is None
    True
    """
    rows = np.flatnonzero(non_dominated(worth, costs[:, None]))
    rows = rows[np.argsort(costs[rows], kind="stable")]
    if len(rows) < 3:
        return None
    # Of points none of which beats another, the dearest is worth most: both spans are above 0.
    gained, spent = worth[rows] - worth[rows[0]], costs[rows] - costs[rows[0]]
    above = gained / gained[-1] - spent / spent[-1]
    place = int(np.argmax(above))
    return int(rows[place]) if above[place] >= LEAST_BEND else None


def archive(history: Sequence[Generation], lowest: float) -> tuple[Floats, Floats]:
    """Return points and fitness of all designs of a run that can be made, in their order."""
    x = np.concatenate([generation.x for generation in history])
    fitness = np.concatenate([generation.fitness for generation in history])
    able = fitness >= lowest
    return x[able], fitness[able]


def spread_out(costs: Floats, count: int) -> list[int]:
    """Return so many points of a front at most, evenly spaced along its first cost, with ends."""
    order = np.argsort(costs[:, 0], kind="stable")
    if len(order) > count:
        places = np.linspace(0, len(order) - 1, count).round().astype(np.int64)
        order = order[np.unique(places)]
    return [int(row) for row in order]
