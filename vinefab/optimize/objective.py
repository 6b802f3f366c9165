"""The number that the optimizer maximises."""

import numpy as np

from vinefab.model.checked import Floats

INVALID_FITNESS = -1e6
"""Fitness of a point that is no design, or whose worth cannot be told: below everything."""


def objective(composite: Floats, penalty: Floats, lowest: float, weight: float) -> Floats:
    """Return the fitness of designs.

    A design without penalty is worth its composite score. One with a penalty is worth less than
    any without: its score is squeezed into the unit below the lowest possible score, so that it
    still counts among designs that cannot be made, and the penalty is taken off.

    Parameters
    ----------
    composite
        Composite scores, shape (m,).
    penalty
        0 for a design that can be made, else above 0; shape (m,).
    lowest
        A number that no composite falls below.
    weight
        Fitness that one unit of penalty costs.

    Examples
    --------
    >>> objective(np.array([0.4, 0.4]), np.array([0.0, 1e-9]), lowest=-1.0, weight=1.0) < -1.0
    array([False,  True])
    """
    known = np.isfinite(composite) & np.isfinite(penalty)
    worth, lack = np.where(known, composite, 0.0), np.where(known, penalty, 0.0)
    below = lowest - 1.0 / (1.0 + np.maximum(0.0, worth - lowest)) - weight * lack
    fitness = np.where(lack <= 0.0, worth, np.maximum(INVALID_FITNESS, below))
    return np.where(known, fitness, INVALID_FITNESS)
