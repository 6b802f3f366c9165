"""Checks of numbers and arrays that dataclasses share, and read-only arrays."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.limits import (
    LARGEST_MM,
    SMALLEST,
    check_plain,
    number,
    plain_number,
    positive,
    whole,
)

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
