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


def warn_of_radians(key: str, degrees: float) -> None:
    """Warn where an angle in degrees looks like one in radians: eighths and twelfths of a turn.

    The warning points at the caller of the public function that asks.
    """
    eighths, twelfths = degrees / (math.pi / 4.0), degrees / (math.pi / 6.0)
    is_near = abs(eighths - round(eighths)) < 0.005 and round(eighths) != 0
    is_exact = abs(twelfths - round(twelfths)) < 1e-6 and round(twelfths) != 0
    if abs(degrees) < 6.3 and (is_near or is_exact):
        said = f"{key} is {degrees:.4g}: degrees are meant"
        warnings.warn(f"{said}; {degrees:.4g} rad are {deg(degrees):.4g} deg", stacklevel=3)
