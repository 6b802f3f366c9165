"""Several objectives: scores and costs, and the front of designs that no other dominates."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.model.design import MOST_BRANCHES
from vinefab.search.costs import COSTS
from vinefab.search.record.generations import Generation
from vinefab.search.space import Space


def minimized(
    x: Floats, scores: Mapping[str, Floats], space: Space, names: Sequence[str]
) -> Floats:
    """Return what a front minimizes beside the score, shape (m, k).

    These are costs, and the scores of other tasks with the opposite sign; infinite where there is
    no valid design.

    Parameters
    ----------
    x
        The points, shape (m, d).
    scores
        Composite scores of the points, shape (m,), by the names of their tasks; without any where
        none of the points has a design.
    names
        Costs and other tasks.
    """
    values, designs = np.full((len(x), len(names)), np.inf), space.batch(x)
    rows = np.flatnonzero(designs.sizes <= MOST_BRANCHES)
    for column, name in enumerate(names):
        if name in COSTS:
            values[rows, column] = COSTS[name].of(designs.part(rows), space.build_of)
        elif name in scores:
            values[:, column] = np.where(np.isfinite(scores[name]), -scores[name], np.inf)
    return values


def non_dominated(fitness: Floats, costs: Floats) -> NDArray[np.bool_]:
    """Return which points no other point dominates, shape (m,).

    A point dominates another when it is no worse in fitness and all costs and better in at least
    one. Of equal points, the first counts as non-dominated.

    Parameters
    ----------
    fitness
        Larger is better, shape (m,).
    costs
        Smaller is better, shape (m, k).

    Examples
    --------
    >>> non_dominated(np.array([1.0, 2.0, 0.5]), np.array([[1.0], [3.0], [2.0]])).tolist()
    [True, True, False]
    """
    values = np.column_stack([-fitness, costs])
    on_front = np.ones(len(values), dtype=np.bool_)
    for row in range(len(values)):
        no_worse = (values <= values[row]).all(axis=1)
        better = (values < values[row]).any(axis=1)
        equal_before = no_worse & ~better & (np.arange(len(values)) < row)
        on_front[row] = not (no_worse & better).any() and not equal_before.any()
    return on_front


LEAST_BEND = 0.05
"""Least height of a knee above the line between the ends of the front, as a share of the range
(assumed); less is within the noise of scores."""


def knee(fitness: Floats, costs: Floats) -> int | None:
    """Return the knee of a front, the point where it bends most, or None.

    At a knee, a little more fitness costs much and a little less saves little: it lies above the
    straight line between the cheapest and the fittest point. A front of fewer than three points,
    a straight one and a convex one have none.

    Parameters
    ----------
    costs
        The cost, shape (m,). Points that are dominated in these two, as a front with more costs
        may have, are left out.

    Examples
    --------
    >>> knee(np.array([0.0, 0.8, 1.0]), np.array([1.0, 2.0, 9.0]))
    1
    >>> knee(np.array([0.0, 0.2, 1.0]), np.array([1.0, 8.0, 9.0])) is None
    True
    """
    rows = np.flatnonzero(non_dominated(fitness, costs[:, None]))
    rows = rows[np.argsort(costs[rows], kind="stable")]
    if len(rows) < 3:
        return None
    # Along a front, fitness rises with the cost: both spans are above 0.
    gained, spent = fitness[rows] - fitness[rows[0]], costs[rows] - costs[rows[0]]
    above = gained / gained[-1] - spent / spent[-1]
    place = int(np.argmax(above))
    return int(rows[place]) if above[place] >= LEAST_BEND else None


def feasible_points(
    history: Sequence[Generation], lowest: float, space: Space, names: Sequence[str]
) -> tuple[Floats, Floats, Floats]:
    """Return points, fitness and `minimized` of all manufacturable designs of a run, in order."""
    x = np.concatenate([generation.x for generation in history])
    fitness = np.concatenate([generation.fitness for generation in history])
    values = np.concatenate([minimized(g.x, g.terms, space, names) for g in history])
    feasible = fitness >= lowest
    return x[feasible], fitness[feasible], values[feasible]


def spread_out(costs: Floats, count: int) -> list[int]:
    """Return at most ``count`` points of a front, ends included, evenly spaced by first cost."""
    order = np.argsort(costs[:, 0], kind="stable")
    if len(order) > count:
        places = np.linspace(0, len(order) - 1, count).round().astype(np.int64)
        order = order[np.unique(places)]
    return [int(row) for row in order]
