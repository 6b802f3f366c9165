"""The smallest change of a design that clears its errors.

The search is deterministic. Branches may be pruned; for each way to do that, every length, angle
and width is moved in the direction that takes the most trouble away for its cost, in steps that
grow and shrink, until no trouble is left; then every value goes back towards what it was as far as
the rules allow. The cheapest result counts. It is the best that this search finds, not proven to
be the smallest there is.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.fabrication.rules.fix_space import FixSpace, kept_branches
from vinefab.fabrication.rules.fix_targets import FixTargets, change_cost, pruning_cost
from vinefab.model.design import Design

MOST_WAYS = 12
"""How many ways to prune are tried in full, the most hopeful ones."""

MOST_STEPS = 60
TROUBLE_COST = 0.4
"""What a unit of trouble is guessed to cost, to tell which ways to prune are hopeful."""

_FIRST_STEP, _LARGEST_STEP, _LEAST_STEP = 0.15, 0.4, 0.005
_BACKWARD = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedDesign:
    """A design that keeps what its bench looks at."""

    design: Design  # the changed design
    cost: float  # the weighted sum of its changes


def fix_design(
    design: Design, bench: FixTargets, told: Callable[[float], None] | None = None
) -> FixedDesign | None:
    """Return the cheapest change found that leaves no trouble, or None if none was found."""
    best: FixedDesign | None = None
    ways = _hopeful(design, bench)
    for number, way in enumerate(ways):
        if told:
            told(number / len(ways))
        pruned = pruning_cost(design, way)
        if best is not None and pruned >= best.cost:
            continue
        space = FixSpace.of(design, way, bench)
        x = _descended(space, bench, most_cost=best.cost if best else np.inf)
        if x is None:
            continue
        changed = space.at(_gone_back(space, bench, x))
        cost = change_cost(design, changed)
        if best is None or cost < best.cost:
            best = FixedDesign(design=changed, cost=cost)
    return best


def _hopeful(design: Design, bench: FixTargets) -> list[tuple[int, ...]]:
    """Return ways to prune, the most hopeful first: little lost, and little trouble left."""
    ways = kept_branches(design)

    def guess(way: tuple[int, ...]) -> float:
        space = FixSpace.of(design, way, bench)
        trouble = bench.trouble(space.at(np.zeros(len(space))))
        return pruning_cost(design, way) + TROUBLE_COST * trouble

    return sorted(ways, key=guess)[:MOST_WAYS]


def _descended(space: FixSpace, bench: FixTargets, *, most_cost: float) -> Floats | None:
    """Return a vector without trouble, or None: step by step, the most relief for its cost."""
    directions, x = space.directions(), np.zeros(len(space))
    left, cost, step = bench.trouble(space.at(x)), space.cost(x), _FIRST_STEP
    for _ in range(MOST_STEPS):
        if left == 0.0:
            return x
        if cost >= most_cost or step < _LEAST_STEP:
            return None
        found = _best_step(space, bench, x + step * directions, (left, cost))
        if found is None:
            step /= 2.0
            continue
        x, left, cost = found
        step = min(_LARGEST_STEP, 1.3 * step)
    return None


def _best_step(
    space: FixSpace, bench: FixTargets, candidates: Floats, here: tuple[float, float]
) -> tuple[Floats, float, float] | None:
    """Return the candidate that relieves most for what it costs more, with trouble and cost."""
    left, cost = here
    best, best_worth = None, 0.0
    for x in candidates:
        design = space.at(x)
        trouble = bench.trouble(design)
        if trouble >= left - 1e-4 * left:
            continue
        total = change_cost(space.design, design)
        worth = (left - trouble) / (0.02 + max(0.0, total - cost))
        if worth > best_worth:
            best, best_worth = (x, trouble, total), worth
    return best


def _gone_back(space: FixSpace, bench: FixTargets, x: Floats) -> Floats:
    """Return a vector whose values went back towards zero as far as no trouble comes."""
    x = _shrunk(space, bench, x, np.ones(len(x), dtype=np.bool_))
    for _ in range(3):
        before = space.cost(x)
        for entry in np.argsort(-np.abs(x), kind="stable"):
            only = np.zeros(len(x), dtype=np.bool_)
            only[entry] = True
            x = _shrunk(space, bench, x, only)
        if space.cost(x) > 0.99 * before:
            break
    return x


def _shrunk(space: FixSpace, bench: FixTargets, x: Floats, which: NDArray[np.bool_]) -> Floats:
    """Return a vector with some entries as near to zero as bisection finds without trouble."""
    low, high, good = 0.0, 1.0, x
    if not np.any(x[which]):
        return x
    for turn in range(_BACKWARD):
        share = low if turn == 0 else (low + high) / 2.0
        trial = np.where(which, share * x, x)
        if bench.trouble(space.at(trial)) == 0.0:
            good, high = trial, share
            if turn == 0:
                return good
        else:
            low = share
    return good
