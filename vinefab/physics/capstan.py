"""Friction of a film that is drawn around bends."""

import math


def capstan_factor(friction: float, turn_rad: float) -> float:
    """Return e^(mu |gamma|), by which the tension grows around a turn (Eq. 2 of the paper).

    Parameters
    ----------
    friction
        Coefficient of friction mu, 0 or more.
    turn_rad
        Total turn gamma; its sign does not matter.

    Examples
    --------
    >>> capstan_factor(0.3, 0.0)
    1.0
    """
    return math.exp(friction * abs(turn_rad))
