"""The particle swarm of the paper: the algorithm of MATLAB's ``particleswarm``.

Written from its published description. A particle follows its own best point and the best of a few
neighbours drawn for every generation; inertia and the number of neighbours adapt to whether the
swarm improves. All coordinates are continuous; the space maps them to integers.
"""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le
from pydantic import model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.table import Table
from vinefab.core.validation import Floats, Ints
from vinefab.search.optimizers.optimizer import Optimizer, SearchAxes

_STREAM = 1403
_ARRAYS = ("position", "velocity", "best_x", "best_sum", "best_count")
_NUMBERS = ("generation", "inertia", "neighbours", "failures")


Weight = Annotated[float, Ge(0), Le(10)]


class AdaptiveSwarmConfig(Table):
    """Parameters of the adaptive swarm; the defaults are MATLAB's."""

    least_inertia: Annotated[Weight, Doc("lower end of the range of the inertia")] = 0.1
    most_inertia: Annotated[Weight, Doc("upper end of it, where it starts")] = 1.1
    self_weight: Annotated[Weight, Doc("acceleration towards a particle's own best point")] = 1.49
    social_weight: Annotated[Weight, Doc("acceleration towards the best of its neighbours")] = 1.49
    least_neighbours: Annotated[
        float, Ge(0), Le(1), Doc("smallest number of neighbours, as a share of the swarm")
    ] = 0.25
    adapt_always: Annotated[
        bool,
        Doc(
            "whether the inertia also adapts after a generation without improvement; descriptions "
            "of the algorithm differ on this"
        ),
    ] = True
    reevaluate: Annotated[
        bool,
        Doc(
            "evaluate every personal best again in each generation and use its mean, so that a "
            "lucky evaluation does not persist; the swarm is then half as large: the other half of "
            "the generation's evaluations goes to the personal bests"
        ),
    ] = False

    @model_validator(mode="after")
    def _range_of_inertia(self) -> "AdaptiveSwarmConfig":
        if self.least_inertia > self.most_inertia:
            allowed = f"at most most_inertia, {self.most_inertia:g}"
            raise BadInputError("least_inertia", self.least_inertia, allowed)
        return self

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return a swarm before its first generation."""
        particles = (population + 1) // 2 if self.reevaluate else population
        return AdaptiveSwarm(self, (max(2, particles), len(axes)), seed)


class AdaptiveSwarm:
    """A swarm whose inertia and neighbourhoods adapt."""

    def __init__(self, config: AdaptiveSwarmConfig, shape: tuple[int, int], seed: int) -> None:
        self._config = config
        self._seed = seed
        rng = child(seed, _STREAM, 0)
        self.position = rng.random(shape)
        self.velocity = rng.uniform(-1.0, 1.0, shape)
        self.best_x = self.position.copy()
        self.best_sum = np.full(shape[0], -np.inf)
        self.best_count = np.ones(shape[0])
        self.generation = 0
        self.inertia = config.most_inertia
        self.neighbours = self._fewest_neighbours
        self.failures = 0

    def ask(self) -> Floats:
        """Return the positions, followed by the personal bests where those are evaluated again."""
        if self.generation == 0 or not self._config.reevaluate:
            return self.position.copy()
        return np.concatenate([self.position, self.best_x])

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Update the personal bests, adapt, and move the swarm."""
        count = len(self.position)
        before = self._best_means().max()
        self._reevaluate_bests(fitness[count:])
        self._improve(x[:count], fitness[:count])
        if self.generation > 0:
            self._adapt(improved=bool(self._best_means().max() > before))
        self.generation += 1
        self._move()

    def state(self) -> Mapping[str, object]:
        """Return the swarm; nothing before the first generation."""
        if self.generation == 0:
            return {"generation": 0}
        arrays = {name: getattr(self, name).copy() for name in _ARRAYS}
        return {**{name: getattr(self, name) for name in _NUMBERS}, **arrays}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        if state["generation"] == 0:
            return
        for name in _ARRAYS:
            setattr(self, name, np.array(state[name], dtype=np.float64))
        for name in _NUMBERS:
            setattr(self, name, state[name])

    @property
    def _fewest_neighbours(self) -> int:
        particles = len(self.position)
        return min(max(2, int(self._config.least_neighbours * particles)), particles - 1)

    def _best_means(self) -> Floats:
        means: Floats = self.best_sum / self.best_count
        return means

    def _reevaluate_bests(self, fitness: Floats) -> None:
        if len(fitness):
            self.best_sum = self.best_sum + fitness
            self.best_count = self.best_count + 1.0

    def _improve(self, x: Floats, fitness: Floats) -> None:
        better = fitness > self._best_means()
        self.best_x = np.where(better[:, None], x, self.best_x)
        self.best_sum = np.where(better, fitness, self.best_sum)
        self.best_count = np.where(better, 1.0, self.best_count)

    def _adapt(self, *, improved: bool) -> None:
        if improved:
            self.failures = max(0, self.failures - 1)
            self.neighbours = self._fewest_neighbours
        else:
            self.failures += 1
            self.neighbours = min(self.neighbours + self._fewest_neighbours, len(self.position) - 1)
        if improved or self._config.adapt_always:
            if self.failures < 2:
                self.inertia *= 2.0
            elif self.failures > 5:
                self.inertia /= 2.0
            low, high = self._config.least_inertia, self._config.most_inertia
            self.inertia = min(high, max(low, self.inertia))

    def _move(self) -> None:
        rng = child(self._seed, _STREAM, self.generation)
        leaders = self.best_x[self._leaders(rng)]
        own, social = rng.random((2, *self.position.shape))
        self.velocity = (
            self.inertia * self.velocity
            + self._config.self_weight * own * (self.best_x - self.position)
            + self._config.social_weight * social * (leaders - self.position)
        )
        moved = self.position + self.velocity
        self.position = np.clip(moved, 0.0, 1.0)
        # A clipped coordinate stops at the face: its velocity would only push against it.
        self.velocity = np.where(moved == self.position, self.velocity, 0.0)

    def _leaders(self, rng: np.random.Generator) -> Ints:
        """Return for each particle the best of its random neighbours, shape (m,)."""
        count = len(self.position)
        lots = rng.random((count, count))
        np.fill_diagonal(lots, np.inf)
        others = np.argsort(lots, axis=1)[:, : self.neighbours]
        best = np.argmax(self._best_means()[others], axis=1)
        leaders: Ints = others[np.arange(count), best]
        return leaders
