"""Checks of numbers and arrays that dataclasses share, and read-only arrays."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.limits import LARGEST_MM, SMALLEST, number, plain_number, positive, whole

__all__ = [
    "LARGEST_MM",
    "SMALLEST",
    "Floats",
    "Ints",
    "check_plain",
    "frozen_floats",
    "frozen_ints",
    "number",
    "plain_number",
    "positive",
    "whole",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
