"""Numbers within limits, without numpy: what every door of the program checks first."""

import math
import sys
from typing import Any

from vinefab.core.errors import BadInputError

MOST_SEED = 2**63 - 1
MOST_FIRST_SEED = 2**62
"""Of the first of many maps: the next have the next seeds, and all are whole numbers of 64 bits."""

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
