"""Unit conversions: angles are radians in code and degrees in files and on screen."""

import math
import warnings
from collections.abc import Callable, Iterator

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


def file_number(wanted: float, guess: float, read: Callable[[float], float]) -> float:
    """Return the shortest number that is read as the one wanted.

    Parameters
    ----------
    guess
        Near what is looked for; it is returned where nothing near it is read exactly so.
    read
        What becomes of a number of a file.

    Examples
    --------
    >>> file_number(12.500000000000002 / 100.0, 12.500000000000002, lambda n: n / 100.0)
    12.500000000000002
    >>> file_number(0.3, 0.1 + 0.2, float)
    0.3
    """
    short = (float(f"{guess:.{digits}g}") for digits in range(1, 18))
    for number in (*short, *_neighbours(guess)):
        if read(number) == wanted:
            return number
    return guess


def _neighbours(number: float, most: int = 8) -> Iterator[float]:
    above = below = number
    for _ in range(most):
        above, below = math.nextafter(above, math.inf), math.nextafter(below, -math.inf)
        yield above
        yield below
