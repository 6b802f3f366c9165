"""Unit conversions: angles are radians in code and degrees in files and on screen."""

import math

STANDARD_GRAVITY_M_S2 = 9.80665


def rad(angle_deg: float) -> float:
    """Return an angle in radians."""
    return math.radians(angle_deg)


def deg(angle_rad: float) -> float:
    """Return an angle in degrees, rounded to 1e-9 so that 30 deg stays 30 through radians."""
    return round(math.degrees(angle_rad), 9)
