"""Choosing the winner: the best of the run, evaluated once more."""

from collections.abc import Sequence

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.model.checked import Floats
from vinefab.optimize.history import Generation
from vinefab.optimize.objective import INVALID_FITNESS
from vinefab.optimize.result import Finalist
from vinefab.optimize.space import Space
from vinefab.optimize.trial import Candidate
from vinefab.optimize.workers import Evaluate
from vinefab.tasks.evaluate import Poses


def best_points(history: Sequence[Generation], space: Space, count: int) -> list[Floats]:
    """Return the points of the best designs of a run, best first, each design once.

    Parameters
    ----------
    history
        All generations.
    space
        What the points stand for.
    count
        Most points.

    Raises
    ------
    BadInputError
        If no point of the run was a design.
    """
    x = np.concatenate([generation.x for generation in history])
    fitness = np.concatenate([generation.fitness for generation in history])
    found: dict[object, Floats] = {}
    for index in np.argsort(-fitness, kind="stable"):
        if fitness[index] <= INVALID_FITNESS or len(found) == count:
            break
        design = space.design(x[index])
        found.setdefault((design.trunk_length_mm, design.levels), x[index])
    if not found:
        raise BadInputError("space", "no point of it was a design", "bounds that hold designs")
    return list(found.values())


def judged(points: Sequence[Floats], evaluate: Evaluate, poses: Poses) -> tuple[Finalist, ...]:
    """Return points evaluated on fresh poses, best first.

    In training, the luckiest evaluation of many looks best; here every finalist meets the same
    poses, more of them, and none that it was chosen by. Designs without a penalty come first,
    because their fitness is above that of all others.
    """
    found = [
        _finalist(x, candidate)
        for x, candidate in zip(points, evaluate(np.array(points), poses), strict=True)
    ]
    # Stable: of equals, the one that was better in training stays first.
    return tuple(sorted(found, key=lambda finalist: -finalist.fitness))


def _finalist(x: Floats, candidate: Candidate) -> Finalist:
    if candidate.design is None or candidate.score is None:
        raise BadInputError("finalist", candidate.problem, "a point that was a design before")
    return Finalist(
        x=x,
        design=candidate.design,
        score=candidate.score,
        penalty=candidate.penalty,
        fitness=candidate.fitness,
    )
