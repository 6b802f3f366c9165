"""Whether an ordering holds: bootstrap over seeds and maps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints

RESAMPLES = 4000
BLOCK = 250
_STREAM = 1801

Statistic = Callable[[Floats], Floats]
"""From values of shape (..., n) to one number for each row, shape (...)."""


def seed_mean(values: Floats) -> Floats:
    """Return the mean of each row."""
    return np.asarray(values.mean(axis=-1))


def spread(values: Floats) -> Floats:
    """Return the standard deviation of each row."""
    return np.asarray(values.std(axis=-1))


def peak(values: Floats) -> Floats:
    """Return the 95th percentile of each row: the best outcomes, less noisy than the best one."""
    return np.asarray(np.percentile(values, 95.0, axis=-1))


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfidenceInterval:
    """A number with its 95 % interval."""

    value: float  # the number
    # low, high: the interval
    low: float
    high: float
    above: float  # share of the resamples above 0

    @property
    def held(self) -> bool:
        """Whether all of the interval is above 0."""
        return self.low > 0.0

    @property
    def p(self) -> float:
        """Two-sided bootstrap p-value of a difference of 0; at least 1 in `RESAMPLES`."""
        return min(1.0, max(2.0 * min(self.above, 1.0 - self.above), 1.0 / RESAMPLES))

    @property
    def verdict(self) -> str:
        """``held``, or in which of two ways not."""
        if self.held:
            return "held"
        return "not held: reversed" if self.high < 0.0 else "not held: undecided"


def interval(values: Floats, statistic: Statistic = seed_mean) -> ConfidenceInterval:
    """Return a statistic of scores with its bootstrap interval.

    Parameters
    ----------
    values
        Scores, shape (runs, maps, poses). Runs and maps are drawn with replacement; the poses on
        a map stay together, for they share its walls.
    """
    return _interval([_resampled(values, statistic, _draws(values, 0, 1))], [values], statistic)


def difference(
    first: Floats,
    second: Floats,
    statistic: Statistic = seed_mean,
    *,
    same_maps: bool = True,
    same_runs: bool = False,
) -> ConfidenceInterval:
    """Return how much larger a statistic is for one group of designs than for another.

    Parameters
    ----------
    first, second
        Scores, each of shape (runs, maps, poses).
    """
    one = _resampled(first, statistic, _draws(first, 0, 1))
    draws = _draws(second, 0 if same_runs else 2, 1 if same_maps else 3)
    two = _resampled(second, statistic, draws)
    return _interval([one, two], [first, second], statistic)


def ratio(first: Floats, second: Floats, *, beyond: float = 0.0) -> ConfidenceInterval:
    """Return mean of one group over that of another, less 1; runs paired, maps not.

    Parameters
    ----------
    first, second
        Scores of the same runs on different maps, shapes (runs, ..., ...).
    """
    one = _resampled(first, seed_mean, _draws(first, 0, 1))
    two = _resampled(second, seed_mean, _draws(second, 0, 3))
    shares = one / two - 1.0 - beyond
    return _summary(float(first.mean() / second.mean() - 1.0 - beyond), shares)


def _interval(
    samples: list[Floats], values: list[Floats], statistic: Statistic
) -> ConfidenceInterval:
    found = [float(statistic(v.reshape(len(v), -1)).mean()) for v in values]
    if len(samples) == 1:
        return _summary(found[0], samples[0])
    return _summary(found[0] - found[1], samples[0] - samples[1])


def _summary(value: float, samples: Floats) -> ConfidenceInterval:
    low, high = np.percentile(samples, [2.5, 97.5]).tolist()
    # Ties count by half: two groups that are the same have a chance of one half.
    above = float((samples > 0.0).mean() + 0.5 * (samples == 0.0).mean())
    return ConfidenceInterval(value=value, low=low, high=high, above=above)


def _draws(values: Floats, runs: int, maps: int) -> tuple[Ints, Ints]:
    """Return which runs and maps each resample takes, shapes (resamples, runs or maps)."""
    count, places = values.shape[:2]
    drawn_runs = child(0, _STREAM, runs).integers(0, count, (RESAMPLES, count))
    drawn_maps = child(0, _STREAM, maps).integers(0, places, (RESAMPLES, places))
    return drawn_runs, drawn_maps


def _resampled(values: Floats, statistic: Statistic, draws: tuple[Ints, Ints]) -> Floats:
    """Return the statistic of every resample, in blocks that fit the caches."""
    runs, maps = draws
    blocks = []
    for first in range(0, RESAMPLES, BLOCK):
        some = slice(first, first + BLOCK)
        taken = values[runs[some, :, None], maps[some, None, :]]
        blocks.append(statistic(taken.reshape(*taken.shape[:2], -1)).mean(axis=1))
    return np.concatenate(blocks)
