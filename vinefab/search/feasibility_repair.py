"""Turning a design that cannot be made into one nearby that can."""

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
"""Changes tried for all points of a run together; each costs one penalty, a few milliseconds.
Points that could be mended took 400 at most (measured)."""

PATIENCE = 300
"""So many changes in a row that do not lower the penalty, and a point is given up; on the way to
a design that can be made, 45 were the most (measured)."""

MOST_LOOKS = 50
"""Designs without penalty that are inspected in full for one point, and twice as many for all."""

_SPREAD = 0.15
"""Usual change of a coordinate, as a share of its range."""


@dataclass(slots=True)
class RepairBudget:
    """What repairs have cost so far, and may cost in all."""

    steps: int = STEPS  # changes that may still be tried
    looks: int = 2 * MOST_LOOKS  # designs that may still be inspected in full


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepairResult:
    """What came of a repair."""

    x: Floats  # the point nearest to a design that can be made, shape (d,)
    penalty: float  # its penalty
    passed: bool  # whether its design can be made


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepairResults:
    """What came of the repairs of a run, all within one effort."""

    mended: list[Floats] = field(default_factory=list)  # points of designs that can be made now
    words: str = ""  # what was done and what came of it

    @classmethod
    def of(
        cls,
        points: Sequence[Floats],
        space: Space,
        penalty: Callable[[Design], float],
        passes: Callable[[Design], bool],
    ) -> "RepairResults":
        """Return what came of repairing points, one after the other, until the effort is spent."""
        effort, found = RepairBudget(), list[RepairResult]()
        for x in points:
            if effort.steps > 0 and effort.looks > 0:
                found.append(repair_design(x, space, penalty, passes, effort))
        mended = [one.x for one in found if one.passed]
        outcome = f"{len(mended)} of them can be made now"
        if not mended:
            least = min(one.penalty for one in found)
            outcome = f"none can be made, the least penalty left is {least:.3g}"
        tried = f"{STEPS - effort.steps} changes of the {len(found)} best were tried"
        words = f"no design that the search found can be made; {tried}, and {outcome}"
        return cls(mended=mended, words=words)


def repair_design(
    x: Floats,
    space: Space,
    penalty: Callable[[Design], float],
    passes: Callable[[Design], bool],
    effort: RepairBudget | None = None,
) -> RepairResult:
    """Return what comes of looking for a point near another one whose design passes inspection.

    One or two coordinates at a time are changed a little, and a change that does not raise the
    penalty is kept; nothing is grown. Now and then a coordinate jumps anywhere in its range. The
    same point is always repaired in the same way. It is given up when the penalty has not fallen
    for a long time, when too many designs failed the inspection, or when the effort is spent.

    Parameters
    ----------
    x
        The point, shape (d,).
    effort
        What may be spent; what is spent is taken off. None: enough for one point.
    """
    effort = RepairBudget() if effort is None else effort
    rng, looks, vain = child(0, _STREAM), 0, 0
    here, worth = x, _penalty(x, space, penalty)
    while effort.steps > 0 and effort.looks > 0 and looks < MOST_LOOKS and vain < PATIENCE:
        effort.steps -= 1
        there = _changed(here, rng)
        found = _penalty(there, space, penalty)
        vain = 0 if found < worth or found == 0.0 else vain + 1
        if found > worth:
            continue
        here, worth = there, found
        if worth == 0.0:
            if passes(space.design(here)):
                return RepairResult(x=here, penalty=0.0, passed=True)
            looks, effort.looks = looks + 1, effort.looks - 1
    return RepairResult(x=here, penalty=worth, passed=False)


def _changed(x: Floats, rng: np.random.Generator) -> Floats:
    """Return a point with one or two coordinates changed."""
    y = x.copy()
    for place in rng.integers(0, len(x), rng.integers(1, 3)).tolist():
        jump = rng.random() < 0.1
        y[place] = rng.random() if jump else y[place] + _SPREAD * rng.standard_normal()
    return np.clip(y, 0.0, 1.0)


def _penalty(x: Floats, space: Space, penalty: Callable[[Design], float]) -> float:
    """Return a point's penalty, infinite where there is no design."""
    try:
        found = float(penalty(space.design(x)))
    except BadInputError:
        return np.inf
    return np.inf if np.isnan(found) else found
