"""Turning a design that cannot be made into one nearby that can."""

from collections.abc import Callable

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.model.checked import Floats
from vinefab.model.design import Design
from vinefab.optimize.space import Space

_STREAM = 1413
STEPS = 2000
"""Changes tried; each costs one penalty, about a millisecond."""

MOST_LOOKS = 50
"""Designs without penalty that are inspected in full."""

_SPREAD = 0.15
"""Usual change of a coordinate, as a share of its range."""


def repaired(
    x: Floats, space: Space, penalty: Callable[[Design], float], passes: Callable[[Design], bool]
) -> Floats | None:
    """Return a point near another one whose design passes inspection, or None if none was found.

    One or two coordinates at a time are changed a little, and a change that does not raise the
    penalty is kept; nothing is grown. Now and then a coordinate jumps anywhere in its range. The
    same point is always repaired in the same way.

    Parameters
    ----------
    x
        The point, shape (d,).
    space
        What it stands for.
    penalty
        How far a design is from one that can be made.
    passes
        Whether a design without penalty can be made indeed.
    """
    rng = child(0, _STREAM)
    here, worth, looks = x, _penalty(x, space, penalty), 0
    for _ in range(STEPS):
        there = _changed(here, rng)
        found = _penalty(there, space, penalty)
        if found > worth:
            continue
        here, worth = there, found
        if worth == 0.0:
            if passes(space.design(here)):
                return here
            looks += 1
            if looks == MOST_LOOKS:
                break
    return None


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
