"""``vinefab fix``: the smallest change of a design that clears its errors.

The search is deterministic and follows the order of a maker's attempts: smaller fillets alone; then
widths, lengths and angles, alone and together; then fewer branches. What comes later is tried only
if all before it found nothing. At first one value, or a group of them, is moved at a time: what
lowers the penalty most for its cost, in steps that grow and shrink, until no penalty is left. Where
that gets stuck and no branch is to go, CMA-ES moves all values of levels together. Then every value
moves back towards the original as far as the rules allow. The cheapest result counts. It is the
best that this search finds, not proven to be the smallest there is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vinefab.core.front_door import imported_later
from vinefab.core.progress import each
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.search.fix_changes import change_cost, pruning_cost
from vinefab.search.fix_space import (
    BRANCHES,
    FILLETS,
    FIX_KINDS,
    PENALTY_COST,
    ChangeSpace,
    FixSpace,
    FixStage,
    fix_stages,
    kept_branches,
)
from vinefab.search.fix_targets import FixTargets
from vinefab.search.fix_trees import TreeSpace, kept_trees

if TYPE_CHECKING:
    import cmaes
else:  # it takes long to load, and most fixes do without
    cmaes = imported_later("cmaes")

_FIRST_STEP, _LARGEST_STEP, _LEAST_STEP = 0.15, 0.4, 0.005
_SMALLEST = 7.0
"""Logarithm by which fillets shrink to the smallest that the limits allow, whatever they are."""


_MOST_PRUNINGS = 12
"""Ways to prune that are searched in full, the most promising first."""

_POPULATION, _SPREAD, _SEED = 16, 0.3, 1
_RISE, _STUCK, _STALLED = 0.99, 60, 20
"""CMA-ES ends when nothing was better by one percent for so many generations: before it has met
the targets, and after."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedDesign:
    """A design that meets its targets."""

    design: Design
    cost: float  # weighted sum of its changes


@dataclass(frozen=True, kw_only=True, eq=False)
class _Original:
    """A design and its targets; the ways to leave branches out are looked for once."""

    design: Design
    targets: FixTargets

    def spaces(self, stage: FixStage) -> Sequence[ChangeSpace]:
        """Return the spaces that a stage searches, the most promising first."""
        design, targets = self.design, self.targets
        if design.branches is not None:
            trees = self._fewer_trees if stage.prunes else [design]
            return [TreeSpace.of(design, some, targets, stage.kinds) for some in trees]
        whole = tuple(level.branches for level in design.levels)
        prunings = self._fewer_on_levels if stage.prunes else [whole]
        return [FixSpace.of(design, pruning, targets, stage.kinds) for pruning in prunings]

    @cached_property
    def _fewer_trees(self) -> list[Design]:
        return kept_trees(self.design, self.targets, _MOST_PRUNINGS)

    @cached_property
    def _fewer_on_levels(self) -> list[tuple[int, ...]]:
        whole = tuple(level.branches for level in self.design.levels)
        fewer = [pruning for pruning in kept_branches(self.design) if pruning != whole]

        def estimated_cost(pruning: tuple[int, ...]) -> float:
            space = FixSpace.of(self.design, pruning, self.targets)
            penalty = space.penalty(np.zeros(len(space)))
            return pruning_cost(self.design, pruning) + PENALTY_COST * penalty

        return sorted(fewer, key=estimated_cost)[:_MOST_PRUNINGS]


def fix_design(
    design: Design,
    targets: FixTargets,
    keep: frozenset[str] = frozenset(),
) -> FixedDesign | None:
    """Return the cheapest change found in the first step that finds any, or None.

    Parameters
    ----------
    keep
        Words of `KEEPS`: what must not change.
    """
    for step in fix_stages(keep):
        if found := fix_in_step(design, targets, step):
            return min(found.values(), key=lambda one: one.cost)
    return None


def fix_in_step(
    design: Design,
    targets: FixTargets,
    step: Sequence[FixStage],
) -> dict[FixStage, FixedDesign]:
    """Return the cheapest change found that meets the targets in each stage that finds one.

    CMA-ES moves all values of a stage together where single steps find nothing in it, nor in any
    stage with less to change, but do with everything to change. Fewer branches take its place, and
    the groups of single branches in a tree, whose values are too many to move together.
    """
    found: dict[FixStage, FixedDesign] = {}
    original = _Original(design=design, targets=targets)
    for stage in each("combinations of changes", step):
        most_cost = min((one.cost for one in found.values()), default=np.inf)
        one = _fixed_in_stage(original, stage, most_cost if stage.prunes else np.inf)
        found |= {stage: one} if one else {}
    if design.branches is not None or any(stage.prunes for stage in step):
        return found
    lacks = [
        stage
        for stage in step
        if len(stage.groups) > 1 and not any(one.kinds <= stage.kinds for one in found)
    ]
    if not lacks or not (found or _has_change(original, known=step)):
        return found
    for stage in each("combinations of changes, all values together", lacks):
        one = _evolved_in_stage(original, stage)
        found |= {stage: one} if one else {}
    return found


def _has_change(original: _Original, known: Sequence[FixStage]) -> bool:
    """Return whether any change is found with every branch, some stages being known to fail."""
    step = [stage for stage in fix_stages(frozenset({BRANCHES}))[-1] if stage not in known]
    tried = each("combinations that were not asked for", step)
    if any(_fixed_in_stage(original, stage) for stage in tried):
        return True
    return _evolved_in_stage(original, FixStage(kinds=FIX_KINDS)) is not None


def _fixed_in_stage(
    original: _Original, stage: FixStage, most_cost: float = np.inf
) -> FixedDesign | None:
    """Return the cheapest change that steps of values find in one stage, or None.

    Parameters
    ----------
    most_cost
        Of a change that is worth looking for.
    """
    best: FixedDesign | None = None
    most_steps = 60
    for space in original.spaces(stage):
        if space.least_cost >= most_cost:
            continue
        # Nothing clears more than the smallest fillets do; of no values there is one vector alone.
        if stage.kinds <= FILLETS.kinds or not len(space):
            x = np.zeros(len(space))
            if space.penalty(x) > 0.0 and space.penalty(x := x - _SMALLEST) > 0.0:
                continue
            several = [x]
        else:
            steps = most_steps if stage.prunes else space.first_steps
            far = None if stage.prunes else _moved_far(space)
            found = far, _descended(space, steps, most_cost)
            several = [x for x in found if x is not None]
        for x in several:
            changed = _settled(space, x)
            if changed.cost < most_cost:
                best, most_cost = changed, changed.cost
    return best


def _evolved_in_stage(original: _Original, stage: FixStage) -> FixedDesign | None:
    """Return the cheapest change that CMA-ES finds in a stage that keeps every branch, or None."""
    (space,) = original.spaces(stage)
    x = _evolved(space)
    return None if x is None else _settled(space, x)


def _settled(space: ChangeSpace, x: Floats) -> FixedDesign:
    """Return the design at a vector without penalty, with its values moved back towards zero."""
    changed = space.at(_retracted(space, x))
    return FixedDesign(design=changed, cost=change_cost(space.design, changed))


def _moved_far(space: ChangeSpace) -> Floats | None:
    """Return the cheapest vector without penalty in one direction, by the space's distances.

    It finds what no small step leads to: a branch turned past others.
    """
    directions = space.directions()
    best, least = None, math.inf
    for far in space.distances:
        for x, penalty, cost in space.assessed(far * directions):
            if penalty == 0.0 and cost < least:
                best, least = x, cost
    return best


def _descended(
    space: ChangeSpace, steps: int, most_cost: float, x: Floats | None = None
) -> Floats | None:
    """Return a vector without penalty, by steps that lower it most for their cost, or None.

    From a vector ``x`` on, its zeros stay as they are.
    """
    directions = space.directions()
    if x is None:
        x = np.zeros(len(space))
    else:
        directions = directions[~directions[:, x == 0.0].any(axis=1)]
    left, cost, step = space.penalty(x), space.cost(x), _FIRST_STEP
    for _ in range(steps):
        if left == 0.0:
            return x
        if cost >= most_cost or step < _LEAST_STEP:
            return None
        best, best_worth = None, 0.0
        for there, penalty, total in space.assessed(x + step * directions):
            if penalty >= left - 1e-4 * left:
                continue
            worth = (left - penalty) / (0.02 + max(0.0, total - cost))
            if worth > best_worth:
                best, best_worth = (there, penalty, total), worth
        if best is None:
            step /= 2.0
            continue
        x, left, cost = best
        step = min(_LARGEST_STEP, 1.3 * step)
    return x if left == 0.0 else None


def _evolved(space: ChangeSpace) -> Floats | None:
    """Return the cheapest vector without penalty that CMA-ES meets from zero on, or None.

    It ends when the worth of the best vector hardly rises any more.
    """
    large = 160  # branches of a design from which on fewer generations are tried
    most_generations = 150
    # Large designs take longer: they get fewer generations.
    most = max(1, min(most_generations, most_generations * large // space.design.branch_count))
    search = cmaes.CMA(
        mean=np.zeros(len(space)), sigma=_SPREAD, seed=_SEED, population_size=_POPULATION
    )
    best, best_cost, least, since = None, math.inf, math.inf, 0
    penalty_worth = 10.0  # cost that CMA-ES accepts to clear a unit of penalty
    for _ in range(most):
        told = []
        for x, penalty, cost in space.assessed([search.ask() for _ in range(_POPULATION)]):
            told.append((x, penalty_worth * penalty + cost))
            if penalty == 0.0 and cost < best_cost:
                best, best_cost = x, cost
        search.tell(told)
        now = min(value for _, value in told)
        since, least = (0, now) if now < _RISE * least else (since + 1, least)
        if since > (_STUCK if best is None else _STALLED):
            break
    return best


def _retracted(space: ChangeSpace, x: Floats) -> Floats:
    """Return a vector with its values moved back towards zero as far as no penalty arises.

    Either all shrink together first, or those that matter least are left out first. Then each is
    left out while the others go farther. The cheapest counts.
    """
    ways = (_without_needless(space, x), x)
    best = min((_moved_back(space, way) for way in ways), key=space.cost)
    # A single large change often costs less than that and a second one.
    for entry in np.flatnonzero(best):
        if not best[entry] or np.count_nonzero(best) == 1:
            continue
        without = np.where(np.arange(len(best)) == entry, 0.0, best)
        farther = _descended(space, space.first_steps, space.cost(best), without)
        if farther is not None:
            best = min(best, _moved_back(space, farther), key=space.cost)
    return best


def _without_needless(space: ChangeSpace, x: Floats) -> Floats:
    """Return a vector without the entries that it can do without, the smallest first."""
    order = [int(entry) for entry in np.argsort(np.abs(x), kind="stable") if x[entry]]
    while order:
        some = order[: 2**space.steps_ahead - 1]
        trials = [np.where(np.arange(len(x)) == entry, 0.0, x) for entry in some]
        needless = (place for place, found in enumerate(space.assessed(trials)) if found[1] == 0.0)
        first = next(needless, None)
        if first is None:
            order = order[len(some) :]
        else:
            x, order = trials[first], order[first + 1 :]
    return x


def _moved_back(space: ChangeSpace, x: Floats) -> Floats:
    """Return a vector with all values shrunk together, then each as far as the targets allow."""
    x = _shrunk(space, x, np.ones(len(x), dtype=np.bool_))
    for _ in range(3):
        before = space.cost(x)
        for entry in np.argsort(-np.abs(x), kind="stable"):
            only = np.zeros(len(x), dtype=np.bool_)
            only[entry] = True
            x = _shrunk(space, x, only)
        if space.cost(x) > 0.99 * before:
            break
    return x


def _shrunk(space: ChangeSpace, x: Floats, which: NDArray[np.bool_]) -> Floats:
    """Return a vector with some entries as near to zero as bisection finds without penalty.

    The trials of some steps are assessed together, whichever way the first of these go.
    """
    if not np.any(x[which]):
        return x
    low, high, left = 0.0, 1.0, 11
    shares, found = [0.0], dict[float, bool]()
    while True:
        steps = min(space.steps_ahead, left)
        shares += [low + (high - low) * place / 2**steps for place in range(1, 2**steps)]
        trials = [np.where(which, share * x, x) for share in shares]
        for share, (_, penalty, _) in zip(shares, space.assessed(trials), strict=True):
            found[share] = penalty == 0.0
        if found[0.0]:
            return np.where(which, 0.0, x)
        for _ in range(steps):
            middle = (low + high) / 2.0
            low, high = (low, middle) if found[middle] else (middle, high)
        left -= steps
        if not left:
            return x if high == 1.0 else np.where(which, high * x, x)
        shares = []
