"""Anchoring force: pouches jammed in gaps, and bodies wrapped around corners.

One pouch holds F_tip = 2 P A_c mu; a branch that is wrapped around contacts by gamma holds
F_tip e^(mu gamma) (Eq. 1 and 2 of the paper). Which branches touch, and how firmly, is unknown
beforehand: of six branches in the paper's test one touched nothing and one hung slack. A
prediction is therefore an interval over friction and over the number of engaged branches.
"""

import math
from collections.abc import Sequence

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.limits import STANDARD_GRAVITY_M_S2
from vinefab.core.statistics import NumberRange
from vinefab.core.validation import Floats
from vinefab.physics.growth_pressure import capstan_factor
from vinefab.physics.tube import inflated_diameter_mm, line_load_n_mm

ASSUMED_FRICTION = NumberRange(low=0.2, value=0.3, high=0.8)
"""TPU film on printed plastic [assumed]; measure yours."""


def pouch_contacts_mm2(length_mm: Floats, width_mm: Floats, gap_mm: Floats) -> Floats:
    """Return the area l_p (w_p - pi g / 2) that each pouch presses on each of two parallel walls.

    Parameters
    ----------
    length_mm, width_mm
        Flat size of each pouch, along and across its branch, shape (m,).
    gap_mm
        Distance between the walls, shape (m,).

    Returns
    -------
    Floats
        0 where the inflated pouch, 2 w_p / pi wide, is not wider than the gap; shape (m,).

    Notes
    -----
    Standing: computed. The flat circumference 2 w_p minus the two half circles across the gap lies
    on the walls. Ends and hoop strain are neglected.
    """
    wide = inflated_diameter_mm(width_mm) > gap_mm
    return np.where(wide, length_mm * (width_mm - math.pi * gap_mm / 2.0), 0.0)


FILM_N_MM = 27.6 * 0.0375
"""Load per mm of circumference at which Stretchlon 200 tears: strength [published, lower end for
TPU film] times thickness [paper]."""

SEAM_N_MM = line_load_n_mm(70.0, 20.0)
"""Load per mm that its welded seam is known to stand: 70 kPa [paper] in a tube of 20 mm [assumed].
No test to failure was found; seams may hold more."""


def branch_limit_n(width_mm: float, weaker_n_mm: float) -> float:
    """Return the largest pull that a branch stands before the film tears or the seam opens.

    Parameters
    ----------
    width_mm
        Lay-flat lumen width of the branch; its circumference is 2 w.
    weaker_n_mm
        The smaller strength of film and seam, N per mm of circumference. The pull is assumed to
        load the whole circumference evenly, and no part of it to carry more than a seam does
        [assumed].
    """
    return 2.0 * width_mm * weaker_n_mm


def amplification(turns_rad: Sequence[float], friction: float) -> float:
    """Return the force of all branches over that of one pouch without any turn.

    Pressure and contact area cancel where all pouches are alike and no limit is reached.

    Examples
    --------
    >>> amplification([0.0, 0.0, 0.0], 0.3)
    3.0
    """
    return math.fsum(capstan_factor(friction, turn) for turn in turns_rad)


def amplification_interval(
    turns_rad: Sequence[float],
    fewest: int,
    most: int | None = None,
    friction: NumberRange = ASSUMED_FRICTION,
) -> NumberRange:
    """Return the amplification over friction and over how many branches are engaged.

    Parameters
    ----------
    turns_rad
        Turn at contacts on the way to each branch's tip.
    fewest, most
        Least and greatest number of them that hold; all if ``most`` is None. The low bound takes
        those that turned least, the high bound those that turned most, the estimate between them
        the mean turn of ``most`` branches.

    Raises
    ------
    BadInputError
        If the numbers do not rise, or are more than there are branches.
    """
    most = len(turns_rad) if most is None else most
    if not 0 <= fewest <= most <= len(turns_rad):
        numbers = f"rising numbers from 0 to {len(turns_rad)} engaged branches"
        raise BadInputError("fewest, most", [fewest, most], numbers)
    rising = sorted(abs(turn) for turn in turns_rad)
    factors = [capstan_factor(friction.value, turn) for turn in rising]
    return NumberRange(
        low=amplification(rising[:fewest], friction.low),
        value=most * math.fsum(factors) / max(1, len(factors)),
        high=amplification(rising[len(rising) - most :], friction.high),
    )


def payload_over_mass(force_n: float, mass_g: float) -> float:
    """Return the force that a robot holds over its own weight.

    Examples
    --------
    >>> round(payload_over_mass(575e-3 * STANDARD_GRAVITY_M_S2, 5.0))
    115
    """
    return force_n / (mass_g * 1e-3 * STANDARD_GRAVITY_M_S2)
