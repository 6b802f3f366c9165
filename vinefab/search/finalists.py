"""Choosing the winner: the best designs of the run, evaluated again on fresh poses."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.model.score import Score
from vinefab.search.evaluator import INVALID_FITNESS, Evaluations, Evaluator, FullCheck
from vinefab.search.feasibility_repair import RepairResults
from vinefab.search.front import costs_of, feasible_points, non_dominated, spread_out
from vinefab.search.parallel.point_evaluator import Begin
from vinefab.search.record.result import Finalist, Generation
from vinefab.search.space import Space
from vinefab.tasks.evaluate import Conditions, score_designs

MOST_FULL_CHECKS = 200
"""Most full checks among the designs of a run; each takes some 50 ms."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FinalistChoice:
    """The points that are evaluated again at the end of a run."""

    points: list[Floats]  # at least one
    checked: bool = False  # whether they are known to pass the full check
    repair: str = ""  # message on the feasibility repair; empty where none was needed


def choose_finalists(
    history: Sequence[Generation],
    evaluator: Evaluator,
    count: int,
    costs: Sequence[str] = (),
    recommended: Sequence[Floats] = (),
) -> FinalistChoice:
    """Return the points that are evaluated again at the end of a run.

    Without a full check these are the best of the run. With one, they are the best that pass it;
    if none does, the best are repaired, and if that fails too they stay as they are. With costs,
    they are taken from the front of fitness and costs.

    Parameters
    ----------
    recommended
        Points that the optimizer takes to be the best; they become up to half of the finalists.
    """
    if costs and (front := front_points(history, evaluator, count, costs)):
        return FinalistChoice(points=front, checked=True)
    penalty, space, known = evaluator.penalty, evaluator.space, list(recommended[: count // 2])
    if not isinstance(penalty, FullCheck):
        return FinalistChoice(points=[*known, *best_points(history, space, count - len(known))])
    known = [x for x in known if penalty.passes(space.design(x))]
    passing = [*known, *_passing(history, space, count - len(known), penalty.passes)]
    if passing:
        return FinalistChoice(points=passing, checked=True)
    best = best_points(history, space, count)
    repairs = RepairResults.of(best, space, penalty, penalty.passes)
    if repairs.repaired:
        return FinalistChoice(points=repairs.repaired, checked=True, repair=repairs.message)
    return FinalistChoice(points=best, repair=repairs.message)


def front_points(
    history: Sequence[Generation], evaluator: Evaluator, count: int, costs: Sequence[str]
) -> list[Floats]:
    """Return points of the front of all manufacturable designs of a run, perhaps none."""
    x, fitness = feasible_points(history, evaluator.lowest)
    space, penalty = evaluator.space, evaluator.penalty
    passes = penalty.passes if isinstance(penalty, FullCheck) else _always
    cost, left = costs_of(x, space, costs), np.ones(len(x), dtype=np.bool_)
    while left.any():
        rows = np.flatnonzero(left)
        front = rows[non_dominated(fitness[rows], cost[rows])]
        chosen = front[spread_out(cost[front], count)]
        failed = [row for row in chosen if not passes(space.design(x[row]))]
        if not failed:
            return [x[row] for row in chosen]
        left[failed] = False
    return []


def _always(_: Design) -> bool:
    return True


def best_points(history: Sequence[Generation], space: Space, count: int) -> list[Floats]:
    """Return the points of the best designs of a run, best first, each design once."""
    points = [x for x, _ in _ranked(history, space, count)]
    if not points:
        raise BadInputError("space", "no point of it was a design", "bounds that hold designs")
    return points


def _passing(
    history: Sequence[Generation], space: Space, count: int, passes: Callable[[Design], bool]
) -> list[Floats]:
    """Return the best points whose designs pass the full check, best first."""
    points: list[Floats] = []
    for x, penalty in _ranked(history, space, MOST_FULL_CHECKS):
        if len(points) == count or penalty > 0.0:
            break
        if passes(space.design(x)):
            points.append(x)
    return points


def _ranked(history: Sequence[Generation], space: Space, count: int) -> list[tuple[Floats, float]]:
    """Return points and penalties of the best designs, best first, each design once."""
    x = np.concatenate([generation.x for generation in history])
    fitness = np.concatenate([generation.fitness for generation in history])
    penalty = np.concatenate([generation.penalty for generation in history])
    ranked: dict[object, tuple[Floats, float]] = {}
    for index in np.argsort(-fitness, kind="stable"):
        if fitness[index] <= INVALID_FITNESS or len(ranked) == count:
            break
        design = space.design(x[index])
        key = design.trunk_length_mm, design.levels
        ranked.setdefault(key, (x[index], float(penalty[index])))
    return list(ranked.values())


def reevaluated(
    choice: FinalistChoice, begin: Begin, conditions: Conditions, evaluator: Evaluator
) -> tuple[Finalist, ...]:
    """Return the points chosen, evaluated on fresh poses, best first.

    The best of many noisy evaluations is overestimated; here all finalists are evaluated on the
    same poses, more of them, and none by which it was selected. Designs without a penalty come
    first, because their fitness is above that of all others; one that fails the full check counts
    as penalized.
    """
    x = np.array(choice.points)
    finalists = list(_finalists(x, begin(x, conditions)(), conditions, evaluator))
    if not choice.checked:
        finalists = [_fully_checked(finalist, conditions, evaluator) for finalist in finalists]
    # Stable: of equals, the one that was better in the search stays first.
    return tuple(sorted(finalists, key=lambda f: -f.fitness))


def _finalists(
    x: Floats, evaluations: Evaluations, conditions: Conditions, evaluator: Evaluator
) -> Iterator[Finalist]:
    """Yield the finalists, their scores by the task as it is."""
    designs = [evaluator.space.design(point) for point in x]
    for row, score in enumerate(_scores(designs, evaluations, conditions, evaluator)):
        penalty = float(evaluations.penalty[row])
        yield Finalist(
            x=x[row],
            design=designs[row],
            score=score,
            penalty=penalty,
            fitness=_fitness(score, penalty, conditions, evaluator),
        )


def _scores(
    designs: Sequence[Design],
    evaluations: Evaluations,
    conditions: Conditions,
    evaluator: Evaluator,
) -> Sequence[Score]:
    if not evaluator.spec.approximates:
        return [evaluator.score(evaluations, row, conditions) for row in range(len(designs))]
    # The search has approximated areas; what a run reports is what `vinefab score` gives.
    launches, task = evaluator.launches(conditions), evaluator.spec.reported_task
    return score_designs(designs, evaluator.maps, launches, task, evaluator.growth)


def _fitness(score: Score, penalty: float, conditions: Conditions, evaluator: Evaluator) -> float:
    composite = evaluator.composites(score.scores[None], conditions.weights)
    return float(evaluator.fitness(composite, np.array([penalty]))[0])


def _fully_checked(finalist: Finalist, conditions: Conditions, evaluator: Evaluator) -> Finalist:
    """Return a finalist, with a penalty of 1 if it has none but fails the full check."""
    penalty = evaluator.penalty
    if not isinstance(penalty, FullCheck) or finalist.penalty > 0.0:
        return finalist
    if penalty.passes(finalist.design):
        return finalist
    fitness = _fitness(finalist.score, 1.0, conditions, evaluator)
    return replace(finalist, penalty=1.0, fitness=fitness)
