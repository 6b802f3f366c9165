"""The number that the optimizer maximises."""

import math

INVALID_FITNESS = -1e6
"""Fitness of a point that is no design, or whose worth cannot be told: below everything."""


def objective(composite: float, penalty: float, lowest: float, weight: float) -> float:
    """Return the fitness of a design.

    A design without penalty is worth its composite score. One with a penalty is worth less than
    any without: its score is squeezed into the unit below the lowest possible score, so that it
    still counts among designs that cannot be made, and the penalty is taken off.

    Parameters
    ----------
    composite
        Composite score.
    penalty
        0 for a design that can be made, else above 0.
    lowest
        A number that no composite falls below.
    weight
        Fitness that one unit of penalty costs.

    Examples
    --------
    >>> objective(0.4, 0.0, lowest=-1.0, weight=1.0)
    0.4
    >>> objective(0.4, 1e-9, lowest=-1.0, weight=1.0) < -1.0
    True
    """
    if not (math.isfinite(composite) and math.isfinite(penalty)):
        return INVALID_FITNESS
    if penalty <= 0.0:
        return composite
    above = max(0.0, composite - lowest)
    return max(INVALID_FITNESS, lowest - 1.0 / (1.0 + above) - weight * penalty)
