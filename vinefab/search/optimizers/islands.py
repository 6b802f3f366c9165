"""Islands: one CMA-ES for each of many structures, and more time for those that do well.

A structure is a choice of all integers: the number of levels and the children on each. One search
over all of them freezes its integers early, on whatever structure was good at first. Here every
island keeps to one structure and adapts a normal distribution of its lengths, angles and growths.
Islands climb rungs: those whose points were among the best at one rung get several times as many
generations to reach the next (asynchronous successive halving, Li et al., arXiv:1810.05934). The
number of generations of the run has no influence on which points are asked for.

Where designs have to be manufacturable, the penalty, which is far cheaper than growth, chooses what
is evaluated: islands begin at points without penalty, and of the points that they sample only those
without penalty are evaluated.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le
from pydantic import model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.table import Table
from vinefab.core.validation import Floats, Ints
from vinefab.search.optimizers.cmaes import (
    LEAST_POPULATION,
    CmaConfig,
    Distribution,
    Spread,
)
from vinefab.search.optimizers.optimizer import Optimizer, PenaltyOfPoints, SearchAxes

_STREAM = 1406


class IslandsConfig(Table):
    """Parameters of the islands."""

    island: Annotated[
        int,
        Ge(0),
        Le(1000),
        Doc(
            "points that an island evaluates in a generation, about: the population is divided "
            "evenly; 0: a fifth of the population, but from 6 to 12"
        ),
    ] = 0
    first_generations: Annotated[
        int, Ge(1), Le(1000), Doc("generations of an island on the first rung")
    ] = 3
    keep: Annotated[
        int,
        Ge(2),
        Le(100),
        Doc("one island of so many climbs to the next rung, which takes so many times as long"),
    ] = 3
    spread: Spread = 0.2

    @model_validator(mode="after")
    def _enough_points(self) -> "IslandsConfig":
        if 0 < self.island < LEAST_POPULATION:
            raise BadInputError("island", self.island, f"0, or at least {LEAST_POPULATION}")
        return self

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return the search before its first generation.

        Without any continuous variable there is nothing that an island could adapt: then it is
        CMA-ES over the integers.
        """
        if population < LEAST_POPULATION:
            allowed = f"at least {LEAST_POPULATION} for the optimizer islands"
            raise BadInputError("optimizer.population", population, allowed)
        if axes.integer.all():
            return CmaConfig(spread=self.spread).start(axes, population, seed)
        return Islands(self, axes, population, seed)


UNRATED = -1e9
"""Rating of an island of which no point was evaluated yet; finite, for records."""


@dataclass(slots=True, kw_only=True, eq=False)
class Island:
    """One structure and a distribution of its other variables."""

    number: int
    structure: Floats  # a point of it, shape (d,)
    free: Ints  # coordinates that its designs have and that are not integers, shape (k,)
    search: Distribution  # of the free coordinates
    rung: int = 0
    generations: int = 0
    ratings: list[float] = field(default_factory=list)  # of its generations

    def points(self, v: Floats) -> Floats:
        """Return points with given free coordinates, shape (m, d)."""
        x = np.tile(self.structure, (len(v), 1))
        x[:, self.free] = np.clip(v, 0.0, 1.0)
        return x

    @property
    def rating(self) -> float:
        """How good its points were in the second half of its generations."""
        later = self.ratings[len(self.ratings) // 2 :]
        return math.fsum(later) / len(later) if later else UNRATED


_TRIED, _DESCENT = 64, 40
"""Random points tried for a start without penalty, and generations of a descent of the penalty from
the best of them."""

_DEAD_ENDS, _ATTEMPTS = 8, 64
"""Structures without a start that are found before an island begins with a penalty, and structures
looked at, known ones among them."""

_DRAWN = 2, 6, 24
"""Points sampled for each that is evaluated, where only those without penalty are: at first, and
then as long as too few have none."""


_SAMPLES, _STARTS, _ORDER = range(3)


class Islands:
    """Islands that evaluate some points each, a few at a time, and climb rungs."""

    def __init__(self, config: IslandsConfig, axes: SearchAxes, population: int, seed: int) -> None:
        self._config, self._axes, self._seed = config, axes, seed
        size = config.island or min(12, max(6, population // 5))
        self._slots = max(1, population // size)
        self._size = population // self._slots
        self._penalty: PenaltyOfPoints | None = None
        self._structures = _structures(axes)
        self._given: list[Floats] = []  # points to start from
        self._begun = 0  # islands so far; the first of them start from the points given
        self._visited = 0  # those of them that took the next structure of all
        self._dead: set[tuple[int, ...]] = set()  # structures without a design without penalty
        self._active: list[Island] = []
        self._parked: list[Island] = []  # at the end of their rungs
        self._ratings: list[list[float]] = []  # of all that ever reached the end of each rung
        self._climbed: list[list[tuple[int, ...]]] = []  # structures of those that went on
        self._asked: list[_Asked] = []
        self._legacy = np.random.RandomState(0)  # seeded before each use: a new one takes longer

    def screen_by(self, penalty: PenaltyOfPoints) -> None:
        """Take the penalty of points: only those without are evaluated, where there are any."""
        self._penalty = penalty

    def start_from(self, points: Sequence[Floats]) -> None:
        """Take points: each is the middle of one of the first islands, or near it if penalized."""
        self._given = [np.array(point, dtype=np.float64) for point in points]

    def ask(self) -> Floats:
        """Return the points of all active islands, shape (m, d); fewer where few are valid."""
        if self._asked:
            return np.concatenate([each.x for each in self._asked])
        while len(self._active) < self._slots:
            self._active.append(self._promoted() or self._new_island())
        asked = list[_Asked]()
        for island in self._active:
            place = (_STREAM, _SAMPLES, island.number, island.generations)
            sequence = np.random.SeedSequence(self._seed, spawn_key=place)
            rng = np.random.RandomState(np.random.MT19937(sequence))
            asked.append(_Asked(island=island, rng=rng, size=self._size))
        for times in _DRAWN if self._penalty else (1,):  # more where few are valid
            lacking = [each for each in asked if each.count < self._size]
            if lacking:
                samples = [each.draw(times * self._size) for each in lacking]
                points = [each.island.points(v) for each, v in zip(lacking, samples, strict=True)]
                penalties = np.split(self._penalties(np.concatenate(points)), len(lacking))
                for each, v, penalty in zip(lacking, samples, penalties, strict=True):
                    each.add(v, penalty)
        if not any(each.count for each in asked):
            for each in asked:  # nothing valid anywhere: the least violations are evaluated
                each.count = 1
        self._asked = asked
        return np.concatenate([each.x for each in asked])

    def tell(self, x: Floats, fitness: Floats) -> None:  # noqa: ARG002 - points are kept as sampled
        """Let every island learn; those at the end of their rung make room for others."""
        first = 0
        for asked in self._asked:
            island, values = asked.island, fitness[first : first + asked.count]
            first += asked.count
            # Evaluated points by fitness, others by penalty.
            best = np.argsort(-values, kind="stable")
            island.search.learn(np.concatenate([asked.v[best], asked.v[asked.count :]]))
            island.generations += 1
            if asked.count:
                better = values[best][: max(1, asked.count // 2)]
                island.ratings.append(float(better.mean()))
        self._asked = []
        self._park()

    # --- One generation -------------------------------------------------------------------------

    def _penalties(self, x: Floats) -> Floats:
        """Return the penalties of points, infinite where there is no design, shape (m,)."""
        if self._penalty is None or len(x) == 0:
            return np.zeros(len(x))
        penalty = self._penalty(x)
        return np.where(np.isnan(penalty), np.inf, penalty)

    def _park(self) -> None:
        """Take islands at the end of their rungs out of the active ones."""
        going = []
        converged = 1e-4  # largest spread, as a share of the ranges, of an island that has ended
        for island in self._active:
            spread = island.search.spread.max()
            if not spread < 1.0 / converged:
                continue  # ran away
            until = self._config.first_generations * self._config.keep**island.rung
            if island.generations < until and spread > converged:
                going.append(island)
                continue
            while len(self._ratings) <= island.rung:
                self._ratings.append([])
                self._climbed.append([])
            self._ratings[island.rung].append(island.rating)
            self._parked.append(island)
        self._active = going
        parked = 6  # islands kept on each rung that did not climb yet
        for rung in range(len(self._ratings)):
            here = [island for island in self._parked if island.rung == rung]
            for island in sorted(here, key=lambda i: i.rating, reverse=True)[parked:]:
                self._parked.remove(island)

    # --- Which islands climb, and which begin ---------------------------------------------------

    def _promoted(self) -> Island | None:
        """Return an island that climbs to its next rung, from as high as possible.

        Of those good enough it is the one whose structure has climbed there least often, so that
        no structure crowds out the others.
        """
        for rung in reversed(range(len(self._ratings))):
            ratings = sorted(self._ratings[rung], reverse=True)
            allowed = len(ratings) // self._config.keep
            if allowed <= len(self._climbed[rung]):
                continue
            good = [
                (-self._climbed[rung].count(self._key(island.structure)), island.rating, -place)
                for place, island in enumerate(self._parked)
                if island.rung == rung and island.rating >= ratings[allowed - 1]
            ]
            if good:
                island = self._parked.pop(-max(good)[2])
                self._climbed[rung].append(self._key(island.structure))
                island.rung = rung + 1
                return island
        return None

    def _new_island(self) -> Island:
        """Return an island at a point without penalty, where one is found."""
        if self._begun < len(self._given):
            number_, self._begun = self._begun, self._begun + 1
            structure = self._axes.canonical(self._given[number_][None])[0]
            island = self._island(number_, structure)
            v = self._given[number_][None, island.free]
            self._descend(island, v, child(self._seed, _STREAM, _STARTS, number_))
            return island
        begun: list[tuple[float, Island]] = []
        for attempt in range(_ATTEMPTS):
            number_, self._begun = self._begun, self._begun + 1
            rng = child(self._seed, _STREAM, _STARTS, number_)
            structure = self._structure(rng)
            is_last = attempt == _ATTEMPTS - 1
            if self._key(structure) in self._dead and not is_last:
                continue
            island = self._island(number_, structure)
            penalty = self._descend(island, rng.random((_TRIED, len(island.free))), rng)
            begun.append((penalty, island))
            if penalty == 0.0:
                return island
            self._dead.add(self._key(structure))
            if len(begun) == _DEAD_ENDS:
                break
        return min(begun, key=lambda each: each[0])[1]

    def _structure(self, rng: np.random.Generator) -> Floats:
        """Return a structure: that of one of the best islands, or the next one of all."""
        known = sorted(self._active + self._parked, key=lambda i: i.rating, reverse=True)
        if self._ratings and known and rng.random() < 0.5:
            return known[int(rng.integers(min(len(known), self._config.keep)))].structure
        if self._structures is None:
            structure: Floats = self._axes.canonical(rng.random((1, len(self._axes))))[0]
            return structure
        count = len(self._structures)
        turn, place = divmod(self._visited, count)
        order = child(self._seed, _STREAM, _ORDER, turn).permutation(count)
        self._visited += 1
        following: Floats = self._structures[order[place]]
        return following

    def _island(self, number_: int, structure: Floats) -> Island:
        real = ~self._axes.integer
        free = np.flatnonzero(real & self._axes.active(structure[None])[0])
        free = free if len(free) else np.flatnonzero(real)  # of a structure without others
        search = self._distribution(np.full(len(free), 0.5))
        return Island(number=number_, structure=structure, free=free, search=search)

    def _descend(self, island: Island, v: Floats, rng: np.random.Generator) -> float:
        """Set an island's middle to the point with the least penalty; return the penalty.

        That is among the given points, or at the end of a descent from the best of them.
        """
        for generation in range(_DESCENT):
            penalty = self._penalties(island.points(v))
            best = int(penalty.argmin())
            if penalty[best] == 0.0 or not np.isfinite(penalty[best]):
                break
            if generation == 0:
                island.search = self._distribution(v[best])
            else:
                island.search.learn(v[np.argsort(penalty, kind="stable")])
            self._legacy.seed(int(rng.integers(2**32)))
            v = island.search.sample(self._legacy, self._size)
        island.search = self._distribution(np.clip(v[best], 0.0, 1.0))
        return float(penalty[best])

    def _distribution(self, middle: Floats) -> Distribution:
        return Distribution(
            middle, np.full(len(middle), self._config.spread), population=self._size
        )

    def _key(self, structure: Floats) -> tuple[int, ...]:
        return tuple(self._axes.indices(structure[None])[0].tolist())

    # --- State ----------------------------------------------------------------------------------

    def state(self) -> Mapping[str, object]:
        """Return all islands that may climb, and ratings and structures of the others."""
        islands = [*self._active, *self._parked]
        state: dict[str, object] = {
            "begun": self._begun,
            "visited": self._visited,
            "dead": sorted(map(list, self._dead)),
            "ratings": [list(ratings) for ratings in self._ratings],
            "climbed": [[list(key) for key in keys] for keys in self._climbed],
            "active": len(self._active),
            "rungs": [[i.number, i.rung, i.generations] for i in islands],
            "island ratings": [list(island.ratings) for island in islands],
        }
        for place, island in enumerate(islands):
            state[f"structure {place}"] = island.structure
            state[f"distribution {place}"] = island.search.packed()
        return state

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        self._begun, self._visited = state["begun"], state["visited"]
        self._dead = {tuple(key) for key in state["dead"]}
        self._ratings = [list(ratings) for ratings in state["ratings"]]
        self._climbed = [[tuple(key) for key in keys] for keys in state["climbed"]]
        self._asked = []
        islands = []
        for place, (number_, rung, generations) in enumerate(state["rungs"]):
            structure = np.array(state[f"structure {place}"], dtype=np.float64)
            island = self._island(number_, structure)
            island.search.unpack(np.array(state[f"distribution {place}"], dtype=np.float64))
            island.rung, island.generations = rung, generations
            island.ratings = list(state["island ratings"][place])
            islands.append(island)
        self._active, self._parked = islands[: state["active"]], islands[state["active"] :]


@dataclass(slots=True, kw_only=True, eq=False)
class _Asked:
    """The points of an island in one generation: those to be evaluated first."""

    island: Island
    rng: np.random.RandomState
    size: int  # points wanted
    v: Floats = field(default_factory=lambda: np.empty((0, 0)))  # free coordinates, shape (s, k)
    penalty: Floats = field(default_factory=lambda: np.empty(0))  # shape (s,)
    count: int = 0  # number of points to be evaluated

    @property
    def x(self) -> Floats:
        """The points to be evaluated, shape (count, d)."""
        return self.island.points(self.v[: self.count])

    def draw(self, count: int) -> Floats:
        """Return further samples, shape (count, k)."""
        return self.island.search.sample(self.rng, count)

    def add(self, v: Floats, penalty: Floats) -> None:
        """Choose from these and those before: the first without penalty, then the lowest."""
        if len(self.v):
            v, penalty = np.concatenate([self.v, v]), np.concatenate([self.penalty, penalty])
        best = np.argsort(penalty, kind="stable")[: self.size]
        self.v, self.penalty = v[best], penalty[best]
        self.count = int((self.penalty == 0.0).sum())


def _structures(axes: SearchAxes) -> Floats | None:
    """Return all structures as points, shape (s, d), or None if they are too many to count."""
    counts = [max(1, choices) for choices in axes.choices]
    most_structures = 4096  # more are drawn at random, not one after the other
    if math.prod(counts) > most_structures:
        return None
    indices = np.array(list(product(*map(range, counts))), dtype=np.float64)
    points = axes.canonical((indices + 0.5) / np.array(counts))
    return np.unique(points, axis=0)
