"""Unit conversions: angles are radians in code and degrees in files and on screen."""

import math
import warnings

STANDARD_GRAVITY_M_S2 = 9.80665


def rad(angle_deg: float) -> float:
    """Return an angle in radians."""
    return math.radians(angle_deg)


def deg(angle_rad: float) -> float:
    """Return an angle in degrees, rounded to 1e-9 so that 30 deg stays 30 through radians."""
    return round(math.degrees(angle_rad), 9)


_TURNS_AS_TYPED = (0.785, 1.57, 1.571, 3.14, 3.142, 4.71, 4.712, 6.28, 6.283)
"""Parts of a turn in radians, as people write them."""


def warn_of_radians(key: str, degrees: float) -> None:
    """Warn where an angle in degrees looks like one in radians: pi/6 and its multiples, or 1.57."""
    twelfths = degrees / (math.pi / 6.0)
    is_exact = abs(twelfths - round(twelfths)) < 1e-6 and 1 <= abs(round(twelfths)) <= 12
    if is_exact or abs(degrees) in _TURNS_AS_TYPED:
        said = f"{key} is {degrees:.4g}: degrees are meant"
        warnings.warn(f"{said}; {degrees:.4g} rad are {deg(degrees):.4g} deg", stacklevel=3)
