"""Designs side by side: the same maps, the same poses, paired statistics."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.resampling import group_means, holm, mean_interval, sign_flip_p
from vinefab.model.design import Design
from vinefab.model.duel import Duel
from vinefab.model.measure import MEASURES, Measure, Outcomes
from vinefab.pipeline.predict import Place, Tell, Trials, Trip, deploy_on, tell_nobody
from vinefab.pipeline.unseen import Field

MOST_DESIGNS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Designs on the same maps from the same poses.

    Parameters
    ----------
    names
        What each design is called, all different.
    designs
        The designs.
    trips
        Deployments of each.
    duels
        Every pair in every measure that both have.
    """

    names: tuple[str, ...]
    designs: tuple[Design, ...]
    trips: tuple[Trip, ...]
    duels: tuple[Duel, ...]

    def outcomes(self) -> dict[str, Outcomes]:
        """Return the outcomes by the designs' names."""
        return {name: trip.outcomes for name, trip in zip(self.names, self.trips, strict=True)}

    def in_measure(self, measure: Measure) -> tuple[Duel, ...]:
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


def compare(
    designs: Sequence[Design], fields: Sequence[Field], trials: Trials, tell: Tell = tell_nobody
) -> Comparison:
    """Deploy designs on the same maps from the same poses and compare them pair by pair.

    Parameters
    ----------
    designs
        Two or more.
    fields
        The maps; several fields are taken together.
    trials
        How often and by which rules.
    tell
        Called as the work goes on.

    Raises
    ------
    BadInputError
        If there are too few designs or too many.
    """
    if not 2 <= len(designs) <= MOST_DESIGNS:
        raise BadInputError("DESIGN", f"{len(designs)} designs", f"2 to {MOST_DESIGNS}")
    tell(0.0, "preparing maps")
    worlds = tuple(world for field in fields for world in field.worlds)
    label = " and ".join(field.label for field in fields)
    place = Place.of(Field(label=label, worlds=worlds), trials)
    names = _told_apart([design.name for design in designs])
    trips = []
    for index, design in enumerate(designs):
        trips.append(deploy_on(design, place, trials, _share(tell, index, len(designs))))
    return Comparison(
        names=names,
        designs=tuple(designs),
        trips=tuple(trips),
        duels=tuple(
            duel
            for measure in MEASURES
            for duel in duels_in(measure, names, [trip.outcomes for trip in trips])
        ),
    )


def duels_in(
    measure: Measure, names: Sequence[str], outcomes: Sequence[Outcomes]
) -> tuple[Duel, ...]:
    """Return every pair of designs in one measure, p-values adjusted for the number of pairs.

    Parameters
    ----------
    measure
        What is compared.
    names, outcomes
        The designs; deployments in the same order.
    """
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


def _duel(measure: Measure, pair: tuple[str, str, np.ndarray], p: float, adjusted: float) -> Duel:
    first, second, means = pair
    low, high = mean_interval(means)
    better = means > 0.0 if measure.better == "more" else means < 0.0
    won = np.mean(better + 0.5 * (means == 0.0))
    return Duel(
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
