"""Numbers next to the paper's with intervals, and claims of three kinds that hold or do not."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.stats import t as student

from vinefab.core.rng import child
from vinefab.core.statistics import NumberRange, holm
from vinefab.core.validation import Floats
from vinefab.core.view import Picture, p_value

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
class ConfidenceInterval(NumberRange):
    """A number with its 95 % interval by Student's law."""

    error: float  # standard error
    degrees: float  # degrees of freedom

    @property
    def held(self) -> bool:
        """Whether all of the interval is above 0."""
        return self.low > 0.0

    @property
    def above(self) -> float:
        """Confidence that the number is above 0: 1 less the one-sided p-value."""
        if self.error == 0.0:
            return 0.5 if self.value == 0.0 else float(self.value > 0.0)
        return float(student.cdf(self.value / self.error, self.degrees))

    @property
    def p(self) -> float:
        """Two-sided p-value of a number of 0."""
        return min(1.0, 2.0 * min(self.above, 1.0 - self.above))

    @property
    def verdict(self) -> str:
        """``held``, or in which of two ways not."""
        if self.held:
            return "held"
        return "not held: reversed" if self.high < 0.0 else "not held: undecided"

    def moved(self, value: float) -> "ConfidenceInterval":
        """Return another number that is known as well."""
        # Added to the number itself, so that rounding puts no bound beyond it.
        below, above = self.value - self.low, self.high - self.value
        return replace(self, value=value, low=value - below, high=value + above)


class VarianceShare(NamedTuple):
    """One source of a number's variance."""

    variance: float  # how much of it
    degrees: float  # degrees of freedom of its estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CrossedSample:
    """A statistic of some runs on some maps: the parts that vary with runs and with maps."""

    by_run: Floats  # the statistic of every run, shape (runs,)
    # the statistic of every run on every map, or where it is not a mean in every resample of maps;
    # two groups that met the same maps meet the same resamples. Shape (runs, maps or resamples)
    cells: Floats
    maps: int  # how many maps
    factor: float  # variance of the statistic over maps, by the variance along the cells

    @classmethod
    def of(cls, values: Floats, statistic: Statistic) -> "CrossedSample":
        """Return scores of shape (runs, maps, poses); poses stay with their map."""
        count = values.shape[1]
        by_run = statistic(values.reshape(len(values), -1))
        if statistic is seed_mean:
            return cls(by_run=by_run, cells=values.mean(axis=2), maps=count, factor=1.0 / count)
        resamples = 1000
        draws = child(0, _STREAM).integers(0, count, (resamples, count))
        cells = np.array([statistic(run[draws].reshape(resamples, -1)) for run in values])
        return cls(by_run=by_run, cells=cells, maps=count, factor=count / max(count - 1.0, 1.0))

    def minus(self, other: "CrossedSample") -> "CrossedSample":
        """Return the differences of the same runs on the same maps."""
        return CrossedSample(
            by_run=self.by_run - other.by_run,
            cells=self.cells - other.cells,
            maps=self.maps,
            factor=self.factor,
        )

    @property
    def run_share(self) -> VarianceShare:
        """The variance between runs."""
        return _share_of_mean(self.by_run)

    @property
    def map_share(self) -> VarianceShare:
        """The variance between maps."""
        return _along_maps(self.cells.mean(axis=0), self)

    @property
    def both_share(self) -> VarianceShare:
        """The variance of runs and maps together: both of the other shares hold it."""
        count = len(self.by_run)
        if min(count, self.maps) < 2:
            return VarianceShare(0.0, 0.0)
        own = self.cells - self.cells.mean(axis=0)
        variance = float(own.var(axis=1, ddof=1).sum()) / (count - 1.0) / count * self.factor
        return VarianceShare(variance, (count - 1.0) * (self.maps - 1.0))


def _share_of_mean(found: Floats) -> VarianceShare:
    """Return the variance of the mean of independent numbers."""
    count = len(found)
    return VarianceShare(float(found.var(ddof=1)) / count if count > 1 else 0.0, count - 1.0)


def _along_maps(found: Floats, sample: CrossedSample) -> VarianceShare:
    """Return the share of maps in numbers along the cells of a sample."""
    if sample.maps < 2:
        return VarianceShare(0.0, 0.0)
    return VarianceShare(sample.factor * float(found.var(ddof=1)), sample.maps - 1.0)


def interval(values: Floats, statistic: Statistic = seed_mean) -> ConfidenceInterval:
    """Return a statistic of scores (runs, maps, poses), a mean over runs, with its interval.

    Runs and maps are two crossed samples: the variance is that between runs plus that between
    maps less what both hold, with Satterthwaite's degrees of freedom. With one run the interval
    is over maps only, with one map over runs only.
    """
    one = CrossedSample.of(values, statistic)
    return _student(float(one.by_run.mean()), [one.run_share, one.map_share], [one.both_share])


def share_interval(values: Floats) -> ConfidenceInterval:
    """Return the interval of the mean of shares, which lies from 0 to 1."""
    found = interval(values)
    return replace(found, low=max(0.0, found.low), high=min(1.0, found.high))


def difference(
    first: Floats,
    second: Floats,
    statistic: Statistic = seed_mean,
    *,
    same_maps: bool = True,
    same_runs: bool = False,
) -> ConfidenceInterval:
    """Return the difference of a statistic between two groups of scores (runs, maps, poses)."""
    one, two = CrossedSample.of(first, statistic), CrossedSample.of(second, statistic)
    value = float(one.by_run.mean() - two.by_run.mean())
    if same_maps and same_runs:
        pairs = one.minus(two)
        return _student(value, [pairs.run_share, pairs.map_share], [pairs.both_share])
    runs = [one.run_share, two.run_share]
    if same_runs:
        runs = [_share_of_mean(one.by_run - two.by_run)]
    maps = [one.map_share, two.map_share]
    if same_maps:
        maps = [_along_maps(one.cells.mean(axis=0) - two.cells.mean(axis=0), one)]
    return _student(value, [*runs, *maps], [one.both_share, two.both_share])


def ratio(first: Floats, second: Floats, *, beyond: float = 0.0) -> ConfidenceInterval:
    """Return mean of one group over that of another, minus 1; runs paired, maps not.

    Parameters
    ----------
    first, second
        Scores of the same runs on different maps, shapes (runs, ..., ...).
    """
    share = float(first.mean() / second.mean())
    # To first order a ratio varies as the difference of both sides, each over its mean.
    scaled = difference(
        share * first / first.mean(),
        share * second / second.mean(),
        same_maps=False,
        same_runs=True,
    )
    return scaled.moved(share - 1.0 - beyond)


def _student(
    value: float, shares: Sequence[VarianceShare], twice: Sequence[VarianceShare]
) -> ConfidenceInterval:
    """Return the interval of a number from shares of its variance and the shares counted twice."""
    whole, least = sum(s.variance for s in shares), max(s.variance for s in shares)
    variance = max(whole - sum(s.variance for s in twice), least)
    if variance <= 1e-24 * (1.0 + value * value):
        return ConfidenceInterval(value=value, low=value, high=value, error=0.0, degrees=1.0)
    weighed = sum(s.variance**2 / s.degrees for s in (*shares, *twice) if s.degrees > 0.0)
    degrees, error = variance**2 / weighed, math.sqrt(variance)
    half = float(student.ppf(0.975, degrees)) * error
    return ConfidenceInterval(
        value=value, low=value - half, high=value + half, error=error, degrees=degrees
    )


ClaimKind = Literal["of the paper", "our threshold", "calibrated"]
"""The source: the paper; the paper, but with a limit that is ours; or none any more, because
the maps were set so that it comes out. Only the first kind is counted as held or not."""

CLAIM_HEADINGS = (
    "verdict",
    "kind",
    "claim",
    "difference [95 %]",
    "p",
    "confidence",
    "kept designs only",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperNumber:
    """A number of ours with the paper's."""

    what: str  # what was measured
    ours: str  # our number, as text
    paper: str = "-"  # the paper's, as text; a dash where it gives none


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """An ordering, as a difference that should be above 0."""

    text: str  # the claim
    tested: ConfidenceInterval  # the difference over all seeds and maps
    # the same for the kept designs alone, which is what the paper compares; None where there is no
    # such choice
    kept: ConfidenceInterval | None = None
    digits: int = 3  # decimals to print
    kind: ClaimKind = "of the paper"  # whose claim it is

    @property
    def counted(self) -> bool:
        """Whether it is counted: whether the paper says it."""
        return self.kind == "of the paper"

    def plain(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "claim": self.text,
            "kind": self.kind,
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
        sure = "> 99.9 %" if self.tested.above > 0.999 else f"{100 * self.tested.above:.1f} %"
        probability = p_text(self.tested.p)
        return self.tested.verdict, self.kind, self.text, difference, probability, sure, kept


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyResult:
    """An experiment, done."""

    # name, title: its name, and its subject
    name: str
    title: str
    protocol: tuple[str, ...]  # how it was done, a paragraph each
    rows: tuple[PaperNumber, ...]  # numbers with the paper's
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
    """Return the number of the paper's claims that hold, and their number."""
    claims = counted_claims(findings)
    return sum(claim.tested.held for claim in claims), len(claims)


def counted_claims(findings: Sequence[StudyResult]) -> list[Claim]:
    """Return the claims of the paper: those with a limit of ours and calibrated ones left out."""
    return [claim for finding in findings for claim in finding.claims if claim.counted]


def held_corrected(findings: Sequence[StudyResult]) -> int:
    """Return the number of claims that hold with p corrected for their number (Holm)."""
    tested = [claim.tested for claim in counted_claims(findings)]
    corrected = holm([found.p for found in tested])
    level = 0.05
    return sum(found.held and p < level for found, p in zip(tested, corrected, strict=True))


def interval_text(found: ConfidenceInterval, digits: int = 3) -> str:
    """Return a number with its interval as text."""
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def percent_text(found: ConfidenceInterval) -> str:
    """Return a share with its interval as per cent."""
    return f"{100 * found.value:.1f} % [{100 * found.low:.1f}, {100 * found.high:.1f}]"


def p_text(p: float) -> str:
    """Return a p-value, not closer than 0.001."""
    return p_value(p).text


def _plain(found: ConfidenceInterval) -> dict[str, float]:
    names = ("value", "low", "high", "above", "p")
    return {name: getattr(found, name) for name in names}
