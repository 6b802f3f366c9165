"""Numbers within limits, without numpy, and angles: radians in code, degrees in files and shown."""

import math
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from vinefab.core.errors import BadInputError

MOST_SEED = 2**63 - 1
MOST_FIRST_SEED = 2**62
"""Of the first of many maps: the next have the next seeds, and all are whole numbers of 64 bits."""

DEFAULT_MARKER_MM = 30.0
"""Side of a corner marker, frame included, as printed."""

LARGEST_MM = 1e7
"""Limit of lengths and coordinates (10 km): a larger one is a mixed-up unit."""
SMALLEST = 1e-6
"""Least number, in any unit, where it must be above zero: what divides by less may overflow."""


def number(key: str, value: float, low: float, high: float, unit: str = "") -> float:
    """Return a finite number within ``low .. high`` (both allowed), or raise BadInputError."""
    try:
        allowed = math.isfinite(value) and low <= value <= high
    except TypeError:  # no number at all: what a caller of the library may pass
        allowed = False
    if not allowed:
        raise BadInputError(key, value, f"{low:g} to {high:g}{f' {unit}' if unit else ''}")
    return float(value)


def plain_number(value: Any) -> Any:  # noqa: ANN401  whatever else is given is returned
    """Return a number of numpy as Python's, which every file form takes; anything else as it is."""
    numpy = sys.modules.get("numpy")  # whose numbers there are only once it is loaded
    return value.item() if numpy is not None and isinstance(value, numpy.generic) else value


def positive(key: str, value: float, high: float = LARGEST_MM, unit: str = "mm") -> float:
    """Return a number from `SMALLEST` to ``high``, or raise BadInputError."""
    return number(key, value, SMALLEST, high, unit)


def whole(key: str, value: int, low: int, high: int) -> int:
    """Return a whole number within ``low .. high``, or raise BadInputError."""
    try:
        allowed = not isinstance(value, bool) and low <= value <= high and int(value) == value
    except TypeError:
        allowed = False
    if not allowed:
        raise BadInputError(key, value, f"a whole number from {low} to {high}")
    return int(value)


def check_plain(content: object, *, finite: bool = True) -> None:
    """Raise BadInputError where nested tables and lists hold what no file of ours may hold.

    That is whole numbers above 64 bits, dates, nesting that later functions, which call
    themselves, would not survive, and, unless the reader's schema refuses them with the range that
    it allows, NaN and infinity.
    """
    open_values: list[tuple[str, int, object]] = [("", 0, content)]
    deepest_nesting = 32  # of tables and lists in each other, in a file; ours need five
    while open_values:
        key, depth, value = open_values.pop()
        if depth > deepest_nesting:
            raise BadInputError(_shortened(key), "nested deeper", f"{deepest_nesting} levels")
        if isinstance(value, Mapping):
            children = [(f"{key}.{name}" if key else str(name), value[name]) for name in value]
        elif isinstance(value, list):
            children = [(f"{key}[{number}]", part) for number, part in enumerate(value, start=1)]
        else:
            _check_plain_value(key, value, finite=finite)
            continue
        # Reversed: the first in the file is the first that is reported.
        open_values += [(name, depth + 1, part) for name, part in reversed(children)]


def _check_plain_value(key: str, value: object, *, finite: bool) -> None:
    if finite and isinstance(value, float) and not math.isfinite(value):
        raise BadInputError(_shortened(key), value, "a finite number")
    most_bits = 63
    if isinstance(value, int) and value.bit_length() > most_bits:
        raise BadInputError(_shortened(key), value, "whole numbers of at most 64 bits")
    if isinstance(value, str) and any("\ud800" <= letter <= "\udfff" for letter in value):
        raise BadInputError(_shortened(key), value, "text without halves of letters (surrogates)")
    if value is not None and not isinstance(value, bool | int | float | str):
        raise BadInputError(_shortened(key), value, "text, a number, true, false, a list, a table")


def _shortened(key: str) -> str:
    return key if len(key) <= 60 else f"{key[:57]}..."


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
