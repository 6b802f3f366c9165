"""Several robots that together cover most: greedy choice, with bounds on what the best set covers.

What a set covers is a monotone submodular function of it: a further robot adds the less, the more
others cover. So the greedy set of k robots covers at least 1 - 1/e of the best set of k among the
candidates (Nemhauser, Wolsey and Fisher, 1978); and no set of k covers more than any set does plus
the k largest gains that candidates still have next to it (Minoux, 1978; Leskovec et al., 2007),
which is much closer.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vinefab.core.plain_text import counted
from vinefab.core.statistics import mean_interval
from vinefab.core.validation import Floats, Ints
from vinefab.core.view import Number
from vinefab.growth.batch import GrowthBlock
from vinefab.model.deployment import Deployment
from vinefab.prediction.pose_search import (
    DeploymentCounter,
    PoseDraws,
    PoseErrors,
    PoseLandscape,
    PoseTrial,
    pose_of,
    printed_pose,
)
from vinefab.tasks.areas import Cover

GREEDY_SHARE = 1.0 - 1.0 / math.e
"""The greedy set covers at least this share of the cover of the best one."""

Bits = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoveredSets:
    """What n candidates cover at each of k draws, as bits."""

    bits: Bits  # packed, shape (n, k, ceil(e / 8))
    weight: Floats  # share of the whole of each element, shape (e,)

    def __len__(self) -> int:
        return len(self.bits)

    def alone(self, index: int) -> NDArray[np.bool_]:
        """Return the cover of one candidate, shape (k, e)."""
        found = np.unpackbits(self.bits[index], axis=-1, count=len(self.weight))
        return found.astype(np.bool_)

    def share(self, covered: NDArray[np.bool_]) -> float:
        """Return the mean share of the whole that is covered, over the draws."""
        return float((covered @ self.weight).mean())

    def gains(self, covered: NDArray[np.bool_]) -> Floats:
        """Return how much each candidate adds to what is covered, shape (n,)."""
        left = (~covered * self.weight).ravel() / len(covered)
        found, together = np.empty(len(self)), max(1, 4_000_000 // left.size)
        for first in range(0, len(self), together):
            some = self.bits[first : first + together]
            open_bits = np.unpackbits(some, axis=-1, count=len(self.weight))
            found[first : first + together] = open_bits.reshape(len(some), -1) @ left
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class GreedyChoice:
    """Candidates chosen one after the other, each for its gain."""

    chosen: tuple[int, ...]
    covered: tuple[float, ...]  # share of the whole that the first 1, 2, ... cover
    bounds: tuple[float, ...]  # no set of 1, 2, ... candidates covers more


def chosen_greedily(sets: CoveredSets, count: int) -> GreedyChoice:
    """Choose candidates that together cover most, with a bound for every number of them."""
    covered = np.zeros_like(sets.alone(0))
    bounds = np.ones(count)
    chosen, shares = list[int](), list[float]()
    for _ in range(min(count, len(sets))):
        gains = sets.gains(covered)
        _tighten(bounds, sets.share(covered), gains)
        chosen.append(int(np.argmax(gains)))
        covered |= sets.alone(chosen[-1])
        shares.append(sets.share(covered))
    _tighten(bounds, shares[-1], sets.gains(covered))
    return GreedyChoice(
        chosen=tuple(chosen),
        covered=tuple(shares),
        bounds=tuple(float(value) for value in bounds[: len(chosen)]),
    )


def _tighten(bounds: Floats, share: float, gains: Floats) -> None:
    """Lower the bounds to the cover of a set plus the largest gains next to it."""
    largest = np.sort(gains)[::-1][: len(bounds)]
    largest = np.pad(largest, (0, len(bounds) - len(largest)))
    np.minimum(bounds, share + np.cumsum(largest), out=bounds)


# --- Robots on a map ----------------------------------------------------------------------------

LARGEST_TEAM = 50

SET_DRAWS = 32
"""Draws of contacts and placing errors at which candidates are compared."""

FRESH_SET_DRAWS = 200
"""Draws that no choice has seen, for the values that are reported."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotSet:
    """Poses for several robots, in the order in which they were chosen."""

    poses: Floats  # x and y (mm), heading (rad); shape (m, 3)
    choice: GreedyChoice  # at the draws of the search
    fresh: Floats  # share that the first 1, 2, ... cover at fresh draws, shape (m, f)
    covered: NDArray[np.bool_]  # what each covers at the first fresh draw, shape (m, e)
    shown: tuple[Deployment, ...]  # each at that draw
    candidates: int
    cover: Cover  # what can be covered

    def answer(self, name: str) -> str:
        """Return the bases of all robots, and their cover together."""
        count, mean, low, high, _ = union_curve(self)[-1]
        over = counted(self.fresh.shape[1], "draw")
        together = Number(mean, "%", ".1f", (low, high), per=0.01, over=over, standing="simulated")
        places = "; ".join(pose_of(row).text for row in self.poses)
        return (
            f"Best found for {count} robots {name} together: bases at {places}: "
            f"{self.cover.words} {together}."
        )

    @property
    def least_share(self) -> float:
        """At least this share of the cover of the best set of as many candidates, by the bound."""
        return self.choice.covered[-1] / max(self.choice.bounds[-1], 1e-300)

    @property
    def least_percent(self) -> float:
        """The same in percent with one decimal, rounded down."""
        return math.floor(1000.0 * self.least_share) / 10.0


def candidate_poses(landscape: PoseLandscape, most: int, extra: Floats) -> Floats:
    """Return poses to choose from: the same number at every place, the best headings first.

    Peaks come before their slopes: a robot that goes elsewhere covers what others leave out.

    Parameters
    ----------
    extra
        Poses that are candidates too, shape (m, 3).
    """
    scores = np.where(np.isnan(landscape.scores), -np.inf, landscape.scores)
    is_peak = (scores >= np.roll(scores, 1, axis=1)) & (scores > np.roll(scores, -1, axis=1))
    places = np.flatnonzero(landscape.known)
    every = max(1, math.ceil(len(places) / most))
    places = places[::every]
    each = max(1, most // max(1, len(places)))
    found = [extra]
    for place in places.tolist():
        row = scores[place]
        order = sorted(range(len(row)), key=lambda h: (not is_peak[place, h], -row[h], h))
        kept = [h for h in order if np.isfinite(row[h])][:each]
        xy = np.repeat(landscape.places_mm[place][None], len(kept), axis=0)
        found.append(np.column_stack([xy, landscape.headings_rad[kept]]))
    return np.concatenate(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamSearch:
    """Several robots of one design on a map, to be placed.

    All robots of one draw have the same contacts, and placing errors of their own.
    """

    trial: PoseTrial
    cover: Cover
    errors: PoseErrors
    tell: DeploymentCounter

    def choose(
        self,
        landscape: PoseLandscape,
        best: Floats,
        count: int,
        candidates: int,
        rng: np.random.Generator,
    ) -> RobotSet:
        """Choose poses for several robots that together cover most.

        Parameters
        ----------
        best
            The best pose of a single one, shape (3,).
        candidates
            About so many poses to choose from; fewer where memory is too small for them.
        rng
            For the fresh draws.
        """
        weight = self.cover.weight
        most_bits = 400_000_000  # candidates times draws times elements: 50 MB
        most = max(count, min(candidates, most_bits // (SET_DRAWS * len(weight))))
        poses = candidate_poses(landscape, most, best[None])
        draws = self.errors.even(SET_DRAWS)
        bits = np.empty((len(poses), SET_DRAWS, math.ceil(len(weight) / 8)), dtype=np.uint8)
        for shift in range(SET_DRAWS):
            rows: Ints = np.arange(shift, len(poses), SET_DRAWS)
            if len(rows):
                offset_mm = np.roll(draws.offset_mm, shift, axis=0)
                turn_rad = np.roll(draws.turn_rad, shift)
                other_contacts = replace(draws, offset_mm=offset_mm, turn_rad=turn_rad)
                bits[rows] = self._covered_bits(poses[rows], other_contacts)
        choice = chosen_greedily(CoveredSets(bits=bits, weight=weight), count)
        chosen = np.array([printed_pose(self.trial, poses[index]) for index in choice.chosen])
        fresh, covered, shown = self._fresh_shares(chosen, rng)
        return RobotSet(
            poses=chosen,
            choice=choice,
            fresh=fresh,
            covered=covered,
            shown=shown,
            candidates=len(poses),
            cover=self.cover,
        )

    def _covered_bits(self, poses: Floats, draws: PoseDraws) -> Bits:
        def packed(block: GrowthBlock) -> Bits:
            return np.packbits(self.cover.covered(block), axis=-1)

        return np.asarray(self.trial.each(poses, draws, packed, self.tell))

    def _fresh_shares(
        self, poses: Floats, rng: np.random.Generator
    ) -> tuple[Floats, NDArray[np.bool_], tuple[Deployment, ...]]:
        """Return the share that the first robots cover at each fresh draw, and the first draw."""
        weight, contacts = self.cover.weight, self.errors.drawn(FRESH_SET_DRAWS, rng)
        union = np.zeros((FRESH_SET_DRAWS, len(weight)), dtype=np.bool_)
        shares, firsts, shown = list[Floats](), list[NDArray[np.bool_]](), list[Deployment]()
        for pose in poses:
            draws = self.errors.drawn(FRESH_SET_DRAWS, rng).with_contacts_of(contacts)
            (bits,) = self._covered_bits(pose[None], draws)
            found = np.unpackbits(bits, axis=-1, count=len(weight)).astype(np.bool_)
            firsts.append(found[0])
            shown += self.trial.deployments(pose, draws.part(0, 1))
            union |= found
            shares.append(union @ weight)
        return np.array(shares), np.array(firsts), tuple(shown)


def union_curve(found: RobotSet) -> Sequence[tuple[int, float, float, float, float]]:
    """Return for each number of robots: mean, low and high at fresh draws, bound of the search."""
    rows = zip(found.fresh, found.choice.bounds, strict=True)
    return [
        (count, float(shares.mean()), *mean_interval(shares), bound)
        for count, (shares, bound) in enumerate(rows, 1)
    ]
