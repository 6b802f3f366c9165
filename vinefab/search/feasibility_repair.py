"""Feasibility repair: moving a design that is not manufacturable to a nearby one that is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.search.space import Space

_STREAM = 1413
STEPS = 4000
"""Most changes for all points of a run together; each costs one penalty, a few milliseconds.
Repairs that succeeded took at most 400 (measured)."""

PATIENCE = 300
"""Changes in a row without a lower penalty after which a point is given up; repairs that succeeded
had at most 45 (measured)."""

MOST_CHECKS = 50
"""Most full checks of designs without penalty for one point; twice as many for all points."""

_SPREAD = 0.15
"""Usual change of a coordinate, as a share of its range."""


@dataclass(slots=True)
class RepairBudget:
    """What repairs may still cost."""

    steps: int = STEPS  # changes
    checks: int = 2 * MOST_CHECKS  # full checks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepairResult:
    """The result of repairing one point."""

    x: Floats  # the last point, shape (d,)
    penalty: float  # its penalty
    passed: bool  # whether its design passes the full check


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepairResults:
    """The results of the repairs of a run, all within one budget."""

    repaired: list[Floats] = field(default_factory=list)  # points of designs that pass now
    message: str = ""  # what was tried, and with what result

    @classmethod
    def of(
        cls,
        points: Sequence[Floats],
        space: Space,
        penalty: Callable[[Design], float],
        passes: Callable[[Design], bool],
        asked: str = "manufacturable",
    ) -> "RepairResults":
        """Repair points one after the other until the budget is spent.

        Messages call designs that pass what is ``asked``.
        """
        budget, results = RepairBudget(), list[RepairResult]()
        for x in points:
            if budget.steps > 0 and budget.checks > 0:
                results.append(repair_design(x, space, penalty, passes, budget))
        repaired = [result.x for result in results if result.passed]
        outcome = f"{len(repaired)} of them are {asked} now"
        if not repaired:
            least = min(result.penalty for result in results)
            outcome = f"none is {asked}, lowest penalty {least:.3g}"
        tried = f"tried {STEPS - budget.steps} changes of the best {len(results)}"
        message = f"the search found no {asked} design; {tried}: {outcome}"
        return cls(repaired=repaired, message=message)


def repair_design(
    x: Floats,
    space: Space,
    penalty: Callable[[Design], float],
    passes: Callable[[Design], bool],
    budget: RepairBudget | None = None,
) -> RepairResult:
    """Search near a point for one whose design passes the full check.

    A random walk: each step changes one or two coordinates a little, now and then to anywhere in
    the range, and is kept unless it raises the penalty; nothing is grown. The result depends on
    the point alone. The walk ends when the penalty has not fallen for `PATIENCE` steps, when
    `MOST_CHECKS` designs failed the full check, or when the budget is spent.

    Parameters
    ----------
    x
        The point, shape (d,).
    budget
        What may be spent; costs are subtracted from it. None: enough for one point.
    """
    budget = RepairBudget() if budget is None else budget
    rng, checks, vain = child(0, _STREAM), 0, 0
    here, lowest = x, _penalty(x, space, penalty)
    while budget.steps > 0 and budget.checks > 0 and checks < MOST_CHECKS and vain < PATIENCE:
        budget.steps -= 1
        there = here.copy()
        for place in rng.integers(0, len(x), rng.integers(1, 3)).tolist():  # one or two
            jump = rng.random() < 0.1
            there[place] = rng.random() if jump else there[place] + _SPREAD * rng.standard_normal()
        there = np.clip(there, 0.0, 1.0)
        there_penalty = _penalty(there, space, penalty)
        vain = 0 if there_penalty < lowest or there_penalty == 0.0 else vain + 1
        if there_penalty > lowest:
            continue
        here, lowest = there, there_penalty
        if lowest == 0.0:
            if passes(space.design(here)):
                return RepairResult(x=here, penalty=0.0, passed=True)
            checks, budget.checks = checks + 1, budget.checks - 1
    return RepairResult(x=here, penalty=lowest, passed=False)


def _penalty(x: Floats, space: Space, penalty: Callable[[Design], float]) -> float:
    """Return a point's penalty, infinite where there is no valid design."""
    try:
        value = float(penalty(space.design(x)))
    except BadInputError:
        return np.inf
    return np.inf if np.isnan(value) else value
