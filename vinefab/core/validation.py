"""Checks of numbers and arrays that dataclasses share, and read-only arrays."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vinefab.core.errors import BadInputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LARGEST_MM = 1e7
"""Limit of lengths and coordinates (10 km): a larger one is a mixed-up unit."""


def number(key: str, value: float, low: float, high: float, unit: str = "") -> float:
    """Return a finite number within ``low .. high`` (both allowed), or raise BadInputError."""
    try:
        allowed = math.isfinite(value) and low <= value <= high
    except TypeError:  # no number at all: what a caller of the library may pass
        allowed = False
    if not allowed:
        raise BadInputError(key, value, f"{low:g} to {high:g}{f' {unit}' if unit else ''}")
    return float(value)


def positive(key: str, value: float, high: float = LARGEST_MM, unit: str = "mm") -> float:
    """Return a finite number above zero and at most ``high``, or raise BadInputError."""
    try:
        allowed = math.isfinite(value) and 0.0 < value <= high
    except TypeError:
        allowed = False
    if not allowed:
        raise BadInputError(key, value, f"above 0, at most {high:g} {unit}")
    return float(value)


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
