"""Numbers beside the paper's with bootstrap intervals, and claims that hold or do not."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vinefab.core.rng import child
from vinefab.core.statistics import holm
from vinefab.core.validation import Floats, Ints
from vinefab.pages.html import Picture

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
    """Return mean of one group over that of another, minus 1; runs paired, maps not.

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


LEVEL = 0.05

CLAIM_HEADINGS = ("verdict", "claim", "difference [95 %]", "p", "confidence", "kept designs only")


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperNumber:
    """A number of ours beside the paper's."""

    what: str  # what was measured
    ours: str  # our number, in words
    paper: str = "-"  # the paper's, in words; a dash where it gives none


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """An ordering that the paper claims, as a difference that should be above 0."""

    text: str  # the claim
    tested: ConfidenceInterval  # the difference over all seeds and maps
    # the same for the kept designs alone, which is what the paper compares; None where there is no
    # such choice
    kept: ConfidenceInterval | None = None
    digits: int = 3  # decimals to print

    def plain(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "claim": self.text,
            "verdict": self.tested.verdict,
            "difference": _plain(self.tested),
            "kept_designs": None
            if self.kept is None
            else {"verdict": self.kept.verdict, "difference": _plain(self.kept)},
        }

    def cells(self) -> tuple[str, ...]:
        """Return it as cells of a table, under `CLAIM_HEADINGS`."""
        kept = "-"
        if self.kept is not None:
            kept = f"{interval_text(self.kept, self.digits)}, {self.kept.verdict}"
        difference = interval_text(self.tested, self.digits)
        sure = _percent(self.tested.above)
        return self.tested.verdict, self.text, difference, p_text(self.tested.p), sure, kept


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyResult:
    """An experiment, done."""

    # name, title: what it is called, and what it is about
    name: str
    title: str
    protocol: tuple[str, ...]  # how it was done, a paragraph each
    rows: tuple[PaperNumber, ...]  # numbers beside the paper's
    claims: tuple[Claim, ...] = ()  # orderings, tested
    remarks: tuple[str, ...] = ()  # where and why numbers differ from the paper's
    pictures: tuple[Picture, ...] = ()  # figures
    # the numbers behind it all, as plain values
    data: Mapping[str, Any] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """Return it as it stands in JSON, without pictures."""
        return {
            "title": self.title,
            "protocol": list(self.protocol),
            "numbers": [{"what": r.what, "ours": r.ours, "paper": r.paper} for r in self.rows],
            "claims": [claim.plain() for claim in self.claims],
            "remarks": list(self.remarks),
            "data": dict(self.data),
        }


def held(findings: Sequence[StudyResult]) -> tuple[int, int]:
    """Return how many claims hold, and how many there are."""
    claims = [claim for finding in findings for claim in finding.claims]
    return sum(claim.tested.held for claim in claims), len(claims)


def held_corrected(findings: Sequence[StudyResult]) -> int:
    """Return how many claims hold still when p is corrected for their number (Holm)."""
    tested = [claim.tested for finding in findings for claim in finding.claims]
    corrected = holm([found.p for found in tested])
    return sum(found.held and p < LEVEL for found, p in zip(tested, corrected, strict=True))


def interval_text(found: ConfidenceInterval, digits: int = 3) -> str:
    """Return a number with its interval in words."""
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def percent_text(found: ConfidenceInterval) -> str:
    """Return a share with its interval as per cent."""
    return f"{100 * found.value:.1f} % [{100 * found.low:.1f}, {100 * found.high:.1f}]"


def p_text(p: float) -> str:
    """Return a p-value; a bootstrap of so many resamples tells none apart below 0.001."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _percent(share: float) -> str:
    """Return a confidence; a bootstrap never makes sure."""
    return "> 99.9 %" if share > 0.999 else f"{100 * share:.1f} %"


def _plain(found: ConfidenceInterval) -> dict[str, float]:
    names = ("value", "low", "high", "above", "p")
    return {name: getattr(found, name) for name in names}
