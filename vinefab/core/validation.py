"""Checks of numbers and arrays that dataclasses share, and read-only arrays."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vinefab.core.errors import BadInputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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
    return value.item() if isinstance(value, np.generic) else value


def positive(key: str, value: float, high: float = LARGEST_MM, unit: str = "mm") -> float:
    """Return a number from `SMALLEST` to ``high``, or raise BadInputError."""
    return number(key, value, SMALLEST, high, unit)


DEEPEST_NESTING = 32
"""Of tables and lists in each other, in a file; ours need five."""
_MOST_BITS = 63


def check_plain(content: object, *, finite: bool = True) -> None:
    """Raise BadInputError where nested tables and lists hold what no file of ours may hold.

    That is whole numbers above 64 bits, dates, nesting that later functions, which call
    themselves, would not survive, and, unless the reader's schema refuses them with the range that
    it allows, NaN and infinity.
    """
    open_values: list[tuple[str, int, object]] = [("", 0, content)]
    while open_values:
        key, depth, value = open_values.pop()
        if depth > DEEPEST_NESTING:
            raise BadInputError(_shortened(key), "nested deeper", f"{DEEPEST_NESTING} levels")
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
    if isinstance(value, int) and value.bit_length() > _MOST_BITS:
        raise BadInputError(_shortened(key), value, "whole numbers of at most 64 bits")
    if isinstance(value, str) and any("\ud800" <= letter <= "\udfff" for letter in value):
        raise BadInputError(_shortened(key), value, "text without halves of letters (surrogates)")
    if value is not None and not isinstance(value, bool | int | float | str):
        raise BadInputError(_shortened(key), value, "text, a number, true, false, a list, a table")


def _shortened(key: str) -> str:
    return key if len(key) <= 60 else f"{key[:57]}..."


def whole(key: str, value: int, low: int, high: int) -> int:
    """Return a whole number within ``low .. high``, or raise BadInputError."""
    try:
        allowed = not isinstance(value, bool) and low <= value <= high and int(value) == value
    except TypeError:
        allowed = False
    if not allowed:
        raise BadInputError(key, value, f"a whole number from {low} to {high}")
    return int(value)


def frozen_floats(key: str, values: ArrayLike, columns: int | None = None) -> Floats:
    """Return a read-only copy of finite numbers, shape (n,) or (n, columns)."""
    array = np.array(values, dtype=np.float64)
    if columns is not None and array.size == 0:
        array = array.reshape(0, columns)
    if array.ndim != (1 if columns is None else 2) or (columns and array.shape[1] != columns):
        raise BadInputError(key, array.shape, f"shape (n{f', {columns}' if columns else ''})")
    if not np.isfinite(array).all():
        raise BadInputError(key, "NaN or infinity", "finite numbers")
    array.setflags(write=False)
    return array


def frozen_ints(values: ArrayLike) -> Ints:
    """Return a read-only copy of whole numbers."""
    array = np.array(values, dtype=np.int64)
    array.setflags(write=False)
    return array
