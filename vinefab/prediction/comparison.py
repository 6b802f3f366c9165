"""Designs side by side: the same maps, the same poses, paired statistics."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.statistics import group_means, holm, mean_interval, sign_flip_p
from vinefab.model.design import Design
from vinefab.prediction.deployments import (
    FamilyDeployments,
    PredictionPlan,
    PreparedFamily,
    Tell,
    deploy_family,
    silent,
)
from vinefab.prediction.map_families import MapFamily
from vinefab.prediction.measures import MEASURES, Measure, MeasureTable

LEVEL = 0.05
"""A difference is called clear when its adjusted p-value is below this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedDifference:
    """The paired difference of two designs in one measure, first less second."""

    measure: Measure  # what is compared
    # first, second: names of the designs
    first: str
    second: str
    # mean, low, high: mean difference and its 95 % bootstrap interval over maps
    mean: float
    low: float
    high: float
    # p, p_adjusted: two-sided p-value of no difference by flipping signs of maps' differences, and
    # the same adjusted for the number of pairs of designs (Holm)
    p: float
    p_adjusted: float
    won_percent: float  # share of the maps on which the first is better, ties as half
    pairs: int  # independent differences: maps, or poses where there is one map

    @property
    def is_clear(self) -> bool:
        """Whether the difference can hardly be chance."""
        return self.p_adjusted < LEVEL

    @property
    def winner(self) -> str:
        """The design that is better in the mean."""
        more = self.measure.better == "more"
        return self.first if (self.mean > 0.0) == more else self.second

    @property
    def words(self) -> str:
        """The outcome in one sentence."""
        mean, low, high = (self.measure.number(value) for value in (self.mean, self.low, self.high))
        by = f"{mean} [{low}, {high}] {self.measure.unit}".rstrip()
        chance = f"p = {self.p_adjusted:.5f}, {self.pairs} pairs"
        pair = f"{self.first} less {self.second}: {by}, {chance}"
        if self.is_clear:
            return f"{self.measure.title}: {self.winner} is better; {pair}"
        return f"{self.measure.title}: no clear difference; {pair}"


MOST_DESIGNS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignComparison:
    """Designs on the same maps from the same poses."""

    names: tuple[str, ...]  # what each design is called, all different
    designs: tuple[Design, ...]  # the designs
    trips: tuple[FamilyDeployments, ...]  # deployments of each
    duels: tuple[PairedDifference, ...]  # every pair in every measure that both have

    def outcomes(self) -> dict[str, MeasureTable]:
        """Return the outcomes by the designs' names."""
        return {name: trip.outcomes for name, trip in zip(self.names, self.trips, strict=True)}

    def in_measure(self, measure: Measure) -> tuple[PairedDifference, ...]:
        """Return the duels in one measure."""
        return tuple(duel for duel in self.duels if duel.measure is measure)

    def usual(self, measure: Measure) -> int:
        """Return the deployment at which all designs together stand in the middle."""
        table = np.array([trip.outcomes.values[measure.key] for trip in self.trips])
        order = np.argsort(np.nan_to_num(table).mean(axis=0), kind="stable")
        return int(order[len(order) // 2])

    def ranked(self, measure: Measure) -> list[tuple[str, float]]:
        """Return names and means, the best first; designs without any value are left out."""
        found = [
            (name, spread.mean)
            for name, outcomes in self.outcomes().items()
            if (spread := outcomes.spread(measure)) is not None
        ]
        return sorted(found, key=lambda pair: pair[1], reverse=measure.better == "more")


def compare_designs(
    designs: Sequence[Design],
    fields: Sequence[MapFamily],
    trials: PredictionPlan,
    tell: Tell = silent,
) -> DesignComparison:
    """Deploy designs on the same maps from the same poses and compare them pair by pair."""
    if not 2 <= len(designs) <= MOST_DESIGNS:
        raise BadInputError("DESIGN", f"{len(designs)} designs", f"2 to {MOST_DESIGNS}")
    tell(0.0, "preparing maps")
    worlds = tuple(world for field in fields for world in field.worlds)
    label = " and ".join(field.label for field in fields)
    place = PreparedFamily.of(MapFamily(label=label, worlds=worlds), trials)
    names = _told_apart([design.name for design in designs])
    trips = []
    for index, design in enumerate(designs):
        trips.append(deploy_family(design, place, trials, _share(tell, index, len(designs))))
    return DesignComparison(
        names=names,
        designs=tuple(designs),
        trips=tuple(trips),
        duels=tuple(
            duel
            for measure in MEASURES
            for duel in paired_differences(measure, names, [trip.outcomes for trip in trips])
        ),
    )


def paired_differences(
    measure: Measure, names: Sequence[str], outcomes: Sequence[MeasureTable]
) -> tuple[PairedDifference, ...]:
    """Return every pair of designs in one measure, p-values adjusted for the number of pairs."""
    found = []
    for one, two in combinations(range(len(names)), 2):
        differences = outcomes[one].values[measure.key] - outcomes[two].values[measure.key]
        groups = outcomes[one].maps
        # Differences on one map are alike; where there is one map, poses have to do.
        means = (
            group_means(differences, groups)
            if len(set(groups)) > 1
            else differences[np.isfinite(differences)]
        )
        if len(means):
            found.append((names[one], names[two], means))
    chances = [sign_flip_p(means) for _, _, means in found]
    return tuple(
        _duel(measure, pair, p, adjusted)
        for pair, p, adjusted in zip(found, chances, holm(chances), strict=True)
    )


def _duel(
    measure: Measure, pair: tuple[str, str, np.ndarray], p: float, adjusted: float
) -> PairedDifference:
    first, second, means = pair
    low, high = mean_interval(means)
    better = means > 0.0 if measure.better == "more" else means < 0.0
    won = np.mean(better + 0.5 * (means == 0.0))
    return PairedDifference(
        measure=measure,
        first=first,
        second=second,
        mean=float(means.mean()),
        low=low,
        high=high,
        p=p,
        p_adjusted=adjusted,
        won_percent=100.0 * float(won),
        pairs=len(means),
    )


def _told_apart(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(
        f"{name} ({names[: index + 1].count(name)})" if names.count(name) > 1 else name
        for index, name in enumerate(names)
    )


def _share(tell: Tell, index: int, count: int) -> Tell:
    return lambda share, words: tell(0.9 * (index + share) / count, words)
