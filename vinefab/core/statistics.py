"""Distribution-free statistics: bootstrap, sign-flip test, Holm's correction.

Evaluations on one map are correlated, so maps are resampled, not evaluations.
"""

import math
from collections.abc import Hashable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints

_RESAMPLES = 4000
MOST_EXACT = 14
"""Up to so many differences all patterns of signs are enumerated: 2^14."""

MOST_KEPT = 1000
"""Draws for intervals of no more values are kept: 32 MB."""

_BOOTSTRAP, _FLIPS = 1701, 1702


def group_means(values: ArrayLike, groups: Sequence[Hashable]) -> Floats:
    """Return the mean of the values of each group, in the order in which groups first occur.

    Values that are not numbers (NaN) are left out, and so is a group without any other.

    Examples
    --------
    >>> group_means([1.0, 3.0, 5.0], ["a", "a", "b"]).tolist()
    [2.0, 5.0]
    """
    number = np.asarray(values, dtype=np.float64)
    places = {group: place for place, group in enumerate(dict.fromkeys(groups))}
    index = np.array([places[group] for group in groups], dtype=np.int64)
    known = np.isfinite(number)
    counts = np.bincount(index[known], minlength=len(places))
    sums = np.bincount(index[known], weights=number[known], minlength=len(places))
    means: Floats = sums[counts > 0] / counts[counts > 0]
    return means


def mean_interval(means: ArrayLike, level: float = 0.95, seed: int = 0) -> tuple[float, float]:
    """Return the percentile bootstrap interval of the mean of independent values.

    One value has no interval: NaN twice.

    Notes
    -----
    With fewer than about ten values percentile intervals are too narrow.
    """
    values = np.asarray(means, dtype=np.float64)
    if len(values) == 1:
        return math.nan, math.nan
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    picks = (_kept_picks if len(values) <= MOST_KEPT else _picks)(seed, len(values))
    tail = 50.0 * (1.0 - level)
    low, high = np.percentile(values[picks].mean(axis=1), [tail, 100.0 - tail])
    return float(low), float(high)


def _picks(seed: int, count: int) -> Ints:
    return child(seed, _BOOTSTRAP).integers(0, count, (_RESAMPLES, count))


# A page has dozens of intervals over the same number of maps.
_kept_picks = lru_cache(maxsize=2)(_picks)


def sign_flip_p(differences: ArrayLike, seed: int = 0) -> float:
    """Return the two-sided p-value of a mean difference of 0, by flipping signs; NaN for one.

    If two designs are equally good, each paired difference is as likely to have the other sign.
    The p-value is the share of sign patterns whose mean is at least as far from 0; all patterns
    for up to `MOST_EXACT` differences, 20,000 drawn ones beyond.

    Examples
    --------
    >>> sign_flip_p([1.0, 1.0, 1.0])
    0.25
    """
    values = np.asarray(differences, dtype=np.float64)
    count = len(values)
    if count == 1:
        return math.nan
    if count <= MOST_EXACT:
        bits = np.arange(2**count)[:, None] >> np.arange(count) & 1
        means = (2.0 * bits - 1.0) @ values
        return float(np.mean(_at_least(means, values.sum())))
    signs = child(seed, _FLIPS).choice([-1.0, 1.0], (5 * _RESAMPLES, count))
    hits = int(np.count_nonzero(_at_least(signs @ values, values.sum())))
    # The observed pattern is one of them: a p-value is never 0.
    return (hits + 1) / (5 * _RESAMPLES + 1)


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Return p-values adjusted for multiple tests by Holm's step-down method; NaN stays NaN.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03])
    (0.03, 0.06, 0.06)
    """
    known = [index for index, p in enumerate(p_values) if not math.isnan(p)]
    count, adjusted, least = len(known), [math.nan] * len(p_values), 0.0
    for place, index in enumerate(sorted(known, key=lambda i: p_values[i])):
        least = max(least, min(1.0, (count - place) * p_values[index]))
        adjusted[index] = least
    return tuple(adjusted)


def _at_least(sums: Floats, seen: float) -> NDArray[np.bool_]:
    """Tell which sums are at least as far from 0 as the observed one, up to rounding."""
    slack = 1e-12 * (1.0 + abs(seen))
    return np.asarray(np.abs(sums) >= abs(seen) - slack)
