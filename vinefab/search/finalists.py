"""Choosing the winner: the best of the run, evaluated once more."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.model.score import Score
from vinefab.search.costs import costs_of
from vinefab.search.evaluation import INVALID_FITNESS, Evaluations
from vinefab.search.evaluator import Evaluator, FullCheck
from vinefab.search.feasibility_repair import RepairResults
from vinefab.search.front import archive, non_dominated, spread_out
from vinefab.search.parallel.evaluators import Begin
from vinefab.search.record.result import Finalist, Generation
from vinefab.search.space import Space
from vinefab.tasks.evaluate import Poses

MOST_LOOKS = 200
"""So many designs of a run are looked at in full at most: a look takes some 50 ms."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FinalistChoice:
    """The points that are judged once more at the end of a run."""

    points: list[Floats]  # at least one
    repair: str = ""  # what was done to mend them, in words; empty where nothing had to be


def choose_finalists(
    history: Sequence[Generation], trial: Evaluator, count: int, costs: Sequence[str] = ()
) -> FinalistChoice:
    """Return the points that are judged once more at the end of a run.

    Without a full inspection these are the best of the run. With one, they are the best that
    pass it; if none does, the best are repaired, and if that fails too they stand as they are.
    With costs, the best are those that no other beats in fitness and costs together.
    """
    if costs and (front := front_points(history, trial, count, costs)):
        return FinalistChoice(points=front)
    if not isinstance(trial.penalty, FullCheck):
        return FinalistChoice(points=best_points(history, trial.space, count))
    inspector = trial.penalty
    passing = _passing(history, trial.space, count, inspector.passes)
    if passing:
        return FinalistChoice(points=passing)
    best = best_points(history, trial.space, count)
    repairs = RepairResults.of(best, trial.space, trial.penalty, inspector.passes)
    return FinalistChoice(points=repairs.mended or best, repair=repairs.words)


def front_points(
    history: Sequence[Generation], trial: Evaluator, count: int, costs: Sequence[str]
) -> list[Floats]:
    """Return points of the front of all designs of a run that can be made; none if none can."""
    x, fitness = archive(history, trial.lowest)
    passes = trial.penalty.passes if isinstance(trial.penalty, FullCheck) else _always
    cost, left = costs_of(x, trial.space, costs), np.ones(len(x), dtype=np.bool_)
    while left.any():
        rows = np.flatnonzero(left)
        front = rows[non_dominated(fitness[rows], cost[rows])]
        chosen = front[spread_out(cost[front], count)]
        wrong = [row for row in chosen if not passes(trial.space.design(x[row]))]
        if not wrong:
            return [x[row] for row in chosen]
        left[wrong] = False
    return []


def _always(_: Design) -> bool:
    return True


def best_points(history: Sequence[Generation], space: Space, count: int) -> list[Floats]:
    """Return the points of the best designs of a run, best first, each design once."""
    found = [x for x, _ in _ranked(history, space, count)]
    if not found:
        raise BadInputError("space", "no point of it was a design", "bounds that hold designs")
    return found


def _passing(
    history: Sequence[Generation], space: Space, count: int, passes: Callable[[Design], bool]
) -> list[Floats]:
    """Return the best points whose designs pass a full inspection, best first."""
    found: list[Floats] = []
    for x, penalty in _ranked(history, space, MOST_LOOKS):
        if len(found) == count or penalty > 0.0:
            break
        if passes(space.design(x)):
            found.append(x)
    return found


def _ranked(history: Sequence[Generation], space: Space, count: int) -> list[tuple[Floats, float]]:
    """Return points and penalties of the best designs, best first, each design once."""
    x = np.concatenate([generation.x for generation in history])
    fitness = np.concatenate([generation.fitness for generation in history])
    penalty = np.concatenate([generation.penalty for generation in history])
    found: dict[object, tuple[Floats, float]] = {}
    for index in np.argsort(-fitness, kind="stable"):
        if fitness[index] <= INVALID_FITNESS or len(found) == count:
            break
        design = space.design(x[index])
        key = design.trunk_length_mm, design.levels
        found.setdefault(key, (x[index], float(penalty[index])))
    return list(found.values())


def reevaluated(
    points: Sequence[Floats], begin: Begin, poses: Poses, trial: Evaluator
) -> tuple[Finalist, ...]:
    """Return points evaluated on fresh poses, best first.

    In training, the luckiest evaluation of many looks best; here every finalist meets the same
    poses, more of them, and none that it was chosen by. Designs without a penalty come first,
    because their fitness is above that of all others; one that fails a full inspection counts as
    penalized.
    """
    x = np.array(points)
    found = begin(x, poses)()
    finalists = [_finalist(x[row], found, row, poses, trial) for row in range(len(x))]
    # Stable: of equals, the one that was better in training stays first.
    return tuple(
        sorted((_inspected(f, trial) for f in finalists), key=lambda finalist: -finalist.fitness)
    )


def _finalist(x: Floats, found: Evaluations, row: int, poses: Poses, trial: Evaluator) -> Finalist:
    score, penalty = trial.score(found, row, poses), float(found.penalty[row])
    return Finalist(
        x=x,
        design=trial.space.design(x),
        score=score,
        penalty=penalty,
        fitness=_fitness(score, penalty, trial),
    )


def _fitness(score: Score, penalty: float, trial: Evaluator) -> float:
    composite = trial.composites(score.scores[None])
    return float(trial.fitness(composite, np.array([penalty]))[0])


def _inspected(finalist: Finalist, trial: Evaluator) -> Finalist:
    """Return a finalist with a penalty of 1 if only a full inspection finds it wanting."""
    inspector = trial.penalty
    if not isinstance(inspector, FullCheck) or finalist.penalty > 0.0:
        return finalist
    if inspector.passes(finalist.design):
        return finalist
    return replace(finalist, penalty=1.0, fitness=_fitness(finalist.score, 1.0, trial))
