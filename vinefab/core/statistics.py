"""Statistics of few maps: Student's interval of a mean, its test, corrections for many tests.

Deployments on one map are alike, so that maps are the sample: their means, not deployments.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load at their first use
from numpy.typing import ArrayLike

from vinefab.core.codec import MaybeNan
from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats

LEVEL, SIGNIFICANT = 0.95, 0.05
"""Confidence level of intervals that are shown, and p-values below which a difference is clear."""

LONG_TAILS = 4.0
"""Excess kurtosis that scores of maps are taken to have: on bench Grids and Caves it was -2 to 16
(simulated), and with 4 the intervals over 5 to 50 maps hold the truth often enough."""

PAIRED_TAILS = 1.0
"""The same of differences of two designs on the same maps: what stops both cancels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberRange:
    """An estimate with bounds, in rising order."""

    low: float
    value: float
    high: float

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            raise BadInputError("interval", [self.low, self.value, self.high], "rising numbers")


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


def mean_interval(
    values: ArrayLike, level: float = LEVEL, tails: float = LONG_TAILS
) -> tuple[float, float]:
    """Return Student's interval of the mean of independent values; NaN twice where there is none.

    One value has none, nor have few that are all alike: they say nothing of how the next may
    differ.

    Its degrees of freedom are those of map scores (`degrees_of`), or with ``tails`` 0 those of the
    normal law. It leaves out 0 exactly where
    `mean_p` is below ``1 - level``. How often it holds the truth: `docs/trust.md`.

    Examples
    --------
    >>> low, high = mean_interval([0.4, 0.5, 0.5, 0.5, 0.6])
    >>> round(low, 3), round(high, 3)
    (0.316, 0.684)
    """
    sample = np.asarray(values, dtype=np.float64)
    mean, error = float(sample.mean()), _error(sample)
    if error == 0.0:
        known = len(sample) > 1 and _alike_p(len(sample)) < 1.0 - level
        return (mean, mean) if known else (math.nan, math.nan)
    half = float(scipy.special.stdtrit(degrees_of(len(sample), tails), 0.5 + 0.5 * level)) * error
    return mean - half, mean + half


def means_by_map(values: Floats, maps: Sequence[str]) -> Floats:
    """Return the mean of each map, or the known values where there is one map.

    Deployments on one map are alike; where there is one map, poses have to do.
    """
    return group_means(values, maps) if len(set(maps)) > 1 else values[np.isfinite(values)]


def samples_text(count: int, maps: Sequence[str]) -> str:
    """Return over how many independent samples an interval is, see `means_by_map`."""
    return counted(count, "map" if len(set(maps)) > 1 or count == 1 else "pose")


ANY_NUMBER = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanValue:
    """A mean with its interval."""

    mean: float  # mean of the maps' means
    # low, high: 95 % interval of it over maps (over poses where there is one map); NaN where there
    # is none
    low: MaybeNan
    high: MaybeNan
    over: str  # how many independent samples that is

    @property
    def is_clear(self) -> bool:
        """Whether the interval leaves out 0."""
        return self.low > 0.0 or self.high < 0.0

    @property
    def has_interval(self) -> bool:
        """Whether the samples differ, or are many enough to be alike."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @classmethod
    def of(
        cls,
        values: Floats,
        maps: Sequence[str],
        ends: tuple[float, float] = ANY_NUMBER,
        tails: float = LONG_TAILS,
    ) -> "MeanValue":
        """Return the mean of values, each under the name of its map; see `mean_interval`.

        Parameters
        ----------
        ends
            The least and the greatest value that can be: an interval has no others.
        """
        means = means_by_map(values, maps)
        low, high = mean_interval(means, tails=tails)
        return cls(
            mean=float(means.mean()),
            low=max(low, ends[0]),  # NaN stays
            high=min(high, ends[1]),
            over=samples_text(len(means), maps),
        )


def clopper_pearson(share: float, count: int, level: float = LEVEL) -> tuple[float, float]:
    """Return the interval of Clopper and Pearson of a share of independent samples.

    It holds the truth at least that often, also where none or all of few samples have it. Of
    deployments, maps are the samples; their mean share need not be a whole number of maps.

    Examples
    --------
    >>> [round(end, 3) for end in clopper_pearson(0.0, 100)]
    [0.0, 0.036]
    """
    tail, have = 0.5 * (1.0 - level), share * count
    low = float(scipy.special.betaincinv(have, count - have + 1.0, tail)) if have > 0.0 else 0.0
    high = (
        float(scipy.special.betaincinv(have + 1.0, count - have, 1.0 - tail))
        if have < count
        else 1.0
    )
    return low, high


def mean_p(differences: ArrayLike, tails: float = LONG_TAILS) -> float:
    """Return the two-sided p-value of a mean of 0 by Student's t; NaN for one value.

    Values that are all alike have no spread: p is that of as many flips of their sign.

    Examples
    --------
    >>> mean_p([1.0, 1.0, 1.0])
    0.25
    """
    sample = np.asarray(differences, dtype=np.float64)
    mean, error = float(sample.mean()), _error(sample)
    if len(sample) == 1:
        return math.nan
    if error == 0.0:
        return _alike_p(len(sample)) if mean else 1.0
    return 2.0 * float(scipy.special.stdtr(degrees_of(len(sample), tails), -abs(mean) / error))


def degrees_of(count: int, tails: float = LONG_TAILS) -> float:
    """Return Satterthwaite's degrees of freedom for the standard error of so many scores.

    Now and then a robot hardly gets into a map: scores have longer tails than the normal law, and
    a few maps without such a one look too much alike. ``1 / degrees`` is half the relative
    variance of the squared error, ``2 / (n - 1)`` plus excess kurtosis over n.

    Parameters
    ----------
    tails
        Excess kurtosis of the scores.

    Examples
    --------
    >>> [round(degrees_of(count), 1) for count in (2, 5, 10, 20, 50)]
    [1.0, 1.5, 3.2, 6.6, 16.6]
    """
    return max(1.0, 2.0 / (2.0 / (count - 1) + tails / count))


def _error(sample: Floats) -> float:
    """Return the standard error of the mean; 0 for one value, or for values that are alike."""
    # Values that differ by no more, over the largest of them, are equal up to rounding.
    alike = 1e-12
    if np.ptp(sample) <= alike * np.abs(sample).max():
        return 0.0
    return float(sample.std(ddof=1)) / math.sqrt(len(sample))


def _alike_p(count: int) -> float:
    return 2.0 ** (1 - count)


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
