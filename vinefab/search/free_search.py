"""Search of free trees: levels first, then every branch on its own.

1. *Levels*: the run's optimizer searches the space of levels for a third of the designs, unless the
   run begins at given designs.
2. *Race*: the best of them, as they are and with branches added wherever the rules leave room, meet
   on one set of maps after another; each time the better half stays.
3. *Trees*: CMA-ES over the angles, lengths and bends of all branches of the winner. Points that
   break rules are drawn back towards the middle until they break none. Now and then branches go
   that earn nothing, and others are added: each such change is tried on a few sets of maps, and
   those that gained meet again: none, one, half or all of them together.

Which points are asked for depends on the seed and on what was told, not on the number of workers.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints
from vinefab.search.evaluator import INVALID_FITNESS
from vinefab.search.free_space import EMPTY, FreeSpace
from vinefab.search.optimizers.cmaes import LEAST_POPULATION, Distribution
from vinefab.search.optimizers.optimizer import Optimizer, PenaltyOfPoints
from vinefab.search.settings import SearchSettings
from vinefab.search.space import DesignBatch

_STREAM = 1418
_SAMPLES, _FILLED, _VARIED = range(3)

LEVEL_SHARE = 3
"""One of so many generations, at most, searches levels."""

RACERS = 8
"""Best level designs that race, each as it is and filled."""

SPREAD = 0.04
"""First standard deviation of angles and lengths, as a share of their ranges."""

LENGTHS = (0.45, 0.35, 0.27, 0.2)
"""Lengths that a new branch is tried with, as shares of the range of its level."""

TRIALS, TRIAL_EVERY, ADDED = 2, 15, 12
"""Generations that changes of the structure are tried for, generations between two trials, and
branches that a trial tries to add."""

GAIN_OF_LESS, GAIN_OF_MORE, LEAST_SPREAD = 0.001, 0.003, 1e-3
"""Mean gain of fitness for which a branch is left out, and for which one is added; and the least
standard deviation of branches that stay."""

DRAWN = 4
"""Points sampled for each that is evaluated: those that break rules are left out."""

BACK = (0.75, 0.5, 0.35, 0.25, 0.12)
"""Shares of its way from the middle at which a point that breaks rules is tried again."""

KEPT = 8
"""Middles of the search that are remembered as candidates for the winner."""


@dataclass(slots=True, kw_only=True, eq=False)
class _Race:
    """Points that meet on the same maps, generation after generation."""

    points: Floats  # those still in the race, shape (m, d)
    total: Floats  # their summed fitness, shape (m,)
    rounds: int = 0

    def tell(self, fitness: Floats) -> None:
        """Take the fitness of all points on one set of maps."""
        self.total = self.total + fitness
        self.rounds += 1

    def halve(self) -> None:
        """Keep the better half, in the order of their means."""
        best = np.argsort(-self.total, kind="stable")[: max(1, len(self.points) // 2)]
        self.points, self.total = self.points[best], self.total[best]


@dataclass(slots=True, kw_only=True, eq=False)
class _Kept:
    """The best level designs so far."""

    points: list[Floats] = field(default_factory=list)
    fitness: list[float] = field(default_factory=list)

    def add(self, x: Floats, fitness: Floats) -> None:
        """Take the best of a generation."""
        for row in np.argsort(-fitness, kind="stable")[:RACERS].tolist():
            if any((x[row] == known).all() for known in self.points):
                continue
            self.points.append(x[row].copy())
            self.fitness.append(float(fitness[row]))
        best = np.argsort(-np.array(self.fitness), kind="stable")[:RACERS].tolist()
        self.points = [self.points[row] for row in best]
        self.fitness = [self.fitness[row] for row in best]


@dataclass(slots=True, kw_only=True, eq=False)
class _Trees:
    """A search over the coordinates of one structure."""

    middle: Floats  # a tree that breaks no rules, shape (d,)
    first_spread: Floats  # standard deviation of each coordinate at first, shape (d,)
    active: Ints  # coordinates that the structure has
    search: Distribution  # of the active coordinates
    age: int = 0  # generations

    def points(self, v: Floats) -> Floats:
        """Return points with given active coordinates, shape (m, d)."""
        x = np.tile(self.middle, (len(v), 1))
        x[:, self.active] = np.clip(v, 0.0, 1.0)
        return x


class FreeSearch:
    """Levels, race and trees, one after the other.

    Parameters
    ----------
    space
        The space of free trees.
    levels
        The search of its levels, which is screened for itself.
    level_generations
        Generations of that search.
    """

    def __init__(
        self,
        space: FreeSpace,
        levels: Optimizer,
        level_generations: int,
        population: int,
        seed: int,
    ) -> None:
        self._space, self._levels, self._seed = space, levels, seed
        self._population = max(LEAST_POPULATION, population)
        self._level_generations = level_generations
        self._penalty: PenaltyOfPoints | None = None
        self._generation = 0
        self._kept = _Kept()
        self._race: _Race | None = None
        self._trees: _Trees | None = None
        self._trial: _Race | None = None
        self._middles: list[Floats] = []  # the latest middles of the search of trees
        self._moved: Ints | None = None  # coordinates of the only branches that may change
        self._asked: Floats | None = None

    @classmethod
    def of(cls, space: FreeSpace, levels: Optimizer, search: SearchSettings) -> "FreeSearch":
        """Return the search of a run; a third of its generations, at most, looks at levels."""
        generations = search.generations
        if search.evaluations:
            generations = min(generations, math.ceil(search.evaluations / search.population))
        return cls(
            space, levels, max(1, generations // LEVEL_SHARE), search.population, search.seed
        )

    # --- What a run asks of it --------------------------------------------------------------------

    def screen_by(self, penalty: PenaltyOfPoints) -> None:
        """Take the penalty of points: only those without are evaluated, where there are any."""
        self._penalty = penalty

    def start_from(self, points: Sequence[Floats]) -> None:
        """Take the trees to begin at, in place of levels."""
        self._level_generations = 0
        if only := self._space.settings.only:
            self._moved = self._space.coordinates_of(points[0], only)
        for point in points:
            self._kept.points.append(np.array(point, dtype=np.float64))
            self._kept.fitness.append(0.0)

    def recommended(self) -> list[Floats]:
        """Return the points that it holds for the best, best first; none while it looks at levels.

        Fitness of different generations was measured on different maps: the middles of the search
        are better known than the luckiest of its points.
        """
        return self._middles[::-1] or (list(self._race.points) if self._race else [])

    def ask(self) -> Floats:
        """Return the points of the next generation, shape (m, d)."""
        if self._asked is None:
            self._asked = self._next_points()
        return self._asked

    def _next_points(self) -> Floats:
        if self._in_levels:
            return self._level_points()
        if self._trees is None and self._race is None:
            self._race = self._begun_race()
        if self._trees is None or self._race is not None:
            return cast("_Race", self._race).points
        if self._trial is None and self._trees.age == TRIAL_EVERY and self._moved is None:
            self._trial = self._begun_trial(self._trees)
        return self._sampled(self._trees) if self._trial is None else self._trial.points

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Take the fitness of the points asked for."""
        if self._in_levels:
            self._tell_levels(x, fitness)
        elif self._trees is None or self._race is not None:
            self._tell_race(cast("_Race", self._race), fitness)
        elif self._trial is not None:
            self._tell_trial(self._trees, self._trial, fitness)
        else:
            self._tell_trees(self._trees, x, fitness)
        self._asked = None
        self._generation += 1

    def state(self) -> Mapping[str, object]:
        """Return everything needed to continue."""
        state: dict[str, object] = {
            "generation": self._generation,
            "level_generations": self._level_generations,
            "kept": np.array(self._kept.points),
            "kept_fitness": [*self._kept.fitness],
            "middles": np.array(self._middles),
        }
        if self._in_levels:
            state["levels"] = self._levels.state()
        for name, race in (("race", self._race), ("trial", self._trial)):
            if race is not None:
                state[name] = {"points": race.points, "total": race.total, "rounds": race.rounds}
        if (trees := self._trees) is not None:
            state["trees"] = {
                "middle": trees.middle,
                "spread": trees.first_spread,
                "age": trees.age,
                "search": trees.search.packed(),
            }
        return state

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        self._generation = state["generation"]
        self._level_generations = state["level_generations"]
        self._kept = _Kept(points=[*state["kept"]], fitness=[*state["kept_fitness"]])
        self._middles = [*state["middles"]]
        if "levels" in state:
            self._levels.restore(state["levels"])
        self._race = _Race(**state["race"]) if "race" in state else None
        self._trial = _Race(**state["trial"]) if "trial" in state else None
        self._trees = None
        if (known := state.get("trees")) is not None:
            self._trees = self._trees_at(known["middle"], known["spread"])
            self._trees.age = known["age"]
            self._trees.search.unpack(known["search"])
        self._asked = None

    # --- Penalties --------------------------------------------------------------------------------

    def _penalties(self, x: Floats) -> Floats:
        """Return the penalties of points, infinite where there is no design, shape (m,)."""
        if self._penalty is None or len(x) == 0:
            return np.zeros(len(x))
        penalty = self._penalty(x)
        return np.where(np.isnan(penalty), np.inf, penalty)

    def _without_penalty(self, x: Floats) -> Floats:
        """Return those points that break no rules."""
        kept: Floats = x[self._penalties(x) == 0.0]
        return kept

    # --- Levels -----------------------------------------------------------------------------------

    @property
    def _in_levels(self) -> bool:
        return self._generation < self._level_generations

    def _small(self, designs: DesignBatch) -> Ints:
        """Return which designs of levels have as few branches as a tree may have."""
        return np.flatnonzero(designs.sizes <= self._space.most_branches)

    def _level_points(self) -> Floats:
        levels = self._space.levels
        designs = levels.batch(self._levels.ask())
        trees = levels.trees(designs.part(self._small(designs)))
        return np.array([self._space.point(tree) for tree in trees or self._space.smallest.trees])

    def _tell_levels(self, x: Floats, fitness: Floats) -> None:
        asked = self._levels.ask()
        rows = self._small(self._space.levels.batch(asked))
        told = np.full(len(asked), INVALID_FITNESS)
        if len(rows):
            told[rows] = fitness
            self._kept.add(x, fitness)
        self._levels.tell(asked, told)

    # --- Race -------------------------------------------------------------------------------------

    def _begun_race(self) -> _Race:
        """Return the race of the best so far, each as it is and filled."""
        rng = child(self._seed, _STREAM, _FILLED, self._generation)
        points = list[Floats]()
        for point in self._kept.points:
            filled = self._filled(point, rng)
            points += [point] if (filled == point).all() else [point, filled]
        return _Race(points=np.array(points), total=np.zeros(len(points)))

    def _filled(self, x: Floats, rng: np.random.Generator) -> Floats:
        """Return a tree with branches added wherever the rules leave room."""
        if self._penalty is None or self._moved is not None or self._penalties(x[None])[0] > 0.0:
            return x
        while True:
            for parent, share in self._gaps(x, rng):
                slot = self._space.free_slot(x, parent)
                more = None if slot is None else self._with_child(x, parent, slot, share)
                if more is not None:
                    x = more
                    break
            else:
                return x

    def _gaps(self, x: Floats, rng: np.random.Generator) -> list[tuple[int, float]]:
        """Return where children may be added, in random order: slot of the parent, and angle."""
        found = self._space.gaps(x)
        order = rng.permutation(len(found)).tolist()
        return [found[place] for place in order]

    def _with_child(self, x: Floats, parent: int, slot: int, share: float) -> Floats | None:
        """Return a tree with one more child, the longest that breaks no rule; None if all do."""
        more = np.array([self._space.with_child(x, parent, slot, share, size) for size in LENGTHS])
        kept = self._without_penalty(more)
        return kept[0] if len(kept) else None

    def _tell_race(self, race: _Race, fitness: Floats) -> None:
        race.tell(fitness)
        race.halve()
        if len(race.points) > 1:
            return
        self._race, (winner,), trees = None, race.points, self._trees
        if trees is not None and (winner == trees.middle).all():
            trees.age = 0  # nothing changed
            return
        spread = np.full(len(self._space), SPREAD)
        if trees is not None:
            spread[trees.active] = np.clip(trees.search.spread, LEAST_SPREAD, SPREAD)
        self._trees = self._trees_at(winner, spread)
        self._middles = [*self._middles, winner][-KEPT:]

    # --- Trees ------------------------------------------------------------------------------------

    def _trees_at(self, middle: Floats, spread: Floats) -> _Trees:
        """Return a search around a tree."""
        active = self._space.active(middle) if self._moved is None else self._moved
        search = Distribution(
            middle[active], spread[active], population=self._population, counts=[]
        )
        return _Trees(middle=middle, first_spread=spread, active=active, search=search)

    def _sampled(self, trees: _Trees) -> Floats:
        """Return the middle and points around it that break no rules, where there are any."""
        place = (_STREAM, _SAMPLES, self._generation)
        sequence = np.random.SeedSequence(self._seed, spawn_key=place)
        rng = np.random.RandomState(np.random.MT19937(sequence))
        wanted = self._population - 1
        points = trees.points(trees.search.sample(rng, DRAWN * wanted))
        penalties = self._penalties(points)
        good, bad = points[penalties == 0.0][:wanted], points[penalties > 0.0]
        lacking = wanted - len(good)
        if lacking and len(bad):
            # Drawn back towards the middle, as far as needed.
            bad = bad[: 2 * lacking]
            way = np.array(BACK)[:, None, None] * (bad - trees.middle)
            tried = (trees.middle + way).reshape(-1, len(trees.middle))
            free = (self._penalties(tried) == 0.0).reshape(len(BACK), len(bad))
            rows = np.flatnonzero(free.any(axis=0))
            back = tried.reshape(len(BACK), len(bad), -1)[free.argmax(axis=0)[rows], rows]
            good = np.concatenate([good, back])[:wanted]
        return np.concatenate([trees.middle[None], good])

    def _tell_trees(self, trees: _Trees, x: Floats, fitness: Floats) -> None:
        """Learn from the points, and move the middle as far as rules allow."""
        order = np.argsort(-fitness, kind="stable")
        points = x[order][:, trees.active]
        lacking = self._population - len(points)
        if lacking > 0:
            points = np.concatenate([points, np.repeat(points[-1:], lacking, axis=0)])
        trees.search.learn(points)
        wanted = trees.points(trees.search.middle[None])[0]
        way = np.array((1.0, 0.9, *BACK))[:, None] * (wanted - trees.middle)
        if len(free := self._without_penalty(trees.middle + way)):
            trees.middle = free[0]
        self._middles = [*self._middles, trees.middle][-KEPT:]
        trees.age += 1

    # --- Structure --------------------------------------------------------------------------------

    def _begun_trial(self, trees: _Trees) -> _Race:
        """Return the middle, and trees with one branch less or more."""
        rng, middle = child(self._seed, _STREAM, _VARIED, self._generation), trees.middle
        points = [middle]
        points += [self._space.without(middle, slot) for slot in self._space.leaves(middle)]
        points = list(self._without_penalty(np.array(points)))
        taken = list[int]()
        for parent, share in self._gaps(middle, rng):
            if len(taken) == ADDED:
                break
            if (slot := self._space.free_slot(middle, parent, taken)) is not None:
                more = self._with_child(middle, parent, slot, share)
                if more is not None:
                    points.append(more)
                    taken.append(slot)
        return _Race(points=np.array(points), total=np.zeros(len(points)))

    def _tell_trial(self, trees: _Trees, trial: _Race, fitness: Floats) -> None:
        """Take what single changes gained; after the last maps some of them race together."""
        trial.tell(fitness)
        if trial.rounds < TRIALS:
            return
        self._trial = None
        gain = (trial.total - trial.total[0]) / trial.rounds
        together = [trees.middle]  # with ever more changes, those that gained most first
        for row in np.argsort(-gain, kind="stable").tolist():
            slot = self._space.changed_slot(trees.middle, trial.points[row])
            if slot is None:
                continue  # the middle itself
            is_less = self._space.parents(trial.points[row])[slot] == EMPTY
            if gain[row] <= (GAIN_OF_LESS if is_less else GAIN_OF_MORE):
                continue
            changed = self._space.with_slot_of(together[-1], trial.points[row], slot)
            if changed is not None and self._penalties(changed[None])[0] == 0.0:
                together.append(changed)
        changes = len(together) - 1
        if not changes:
            trees.age = 0
            return
        some = sorted({0, 1, math.ceil(changes / 2), changes})
        points = np.array([together[number] for number in some])
        self._race = _Race(points=points, total=np.zeros(len(points)))
