"""What one pouch and one branch hold: the kernels of anchoring are held against these."""

import math

from vinefab.physics.growth_pressure import capstan_factor
from vinefab.physics.tube import N_MM2_PER_KPA


def pouch_contact_mm2(length_mm: float, width_mm: float, gap_mm: float) -> float:
    """Return the area that a pouch presses on each of two parallel walls."""
    if 2.0 * width_mm / math.pi <= gap_mm:
        return 0.0
    return length_mm * (width_mm - math.pi * gap_mm / 2.0)


def tip_force_n(pressure_kpa: float, contact_mm2: float, friction: float) -> float:
    """Return the force that one pouch holds between two walls: 2 P A_c mu (Eq. 1 of the paper)."""
    return 2.0 * pressure_kpa * N_MM2_PER_KPA * contact_mm2 * friction


def branch_force_n(carried_n: float, turn_rad: float, friction: float, limit_n: float) -> float:
    """Return the pull at the base end of a branch, at most what it stands (Eq. 2 of the paper).

    Parameters
    ----------
    carried_n
        What its pouch, or all its children together, hold at its tip.
    turn_rad
        Its own turns at contacts.
    """
    return min(limit_n, carried_n * capstan_factor(friction, turn_rad))
