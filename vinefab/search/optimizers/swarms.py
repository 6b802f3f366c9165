"""Two particle swarms: that of the paper, and that of pyswarms, a generation at a time.

`AdaptiveSwarm` is the algorithm of MATLAB's ``particleswarm``, from its published description. A
particle follows its own best point and the best of a few neighbours drawn for every generation;
inertia and the number of neighbours adapt to whether the swarm improves. All coordinates are
continuous; the space maps them to integers.

`ParticleSwarm` drives swarm, topologies and handlers of pyswarms' backend, because pyswarms' own
optimizers cannot be paused or seeded. They use numpy's global generator, which gets a seeded state
for each step and its own state back afterwards.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import Ge, Le
from pydantic import model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import imported_later
from vinefab.core.rng import child
from vinefab.core.table import Table
from vinefab.core.validation import Floats
from vinefab.search.optimizers.optimizer import Optimizer, SearchAxes

_ADAPTIVE_STREAM = 1403
_ADAPTIVE_ARRAYS = ("position", "velocity", "best_x", "best_sum", "best_count")
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
        rng = child(seed, _ADAPTIVE_STREAM, 0)
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
        if len(again := fitness[count:]):
            self.best_sum, self.best_count = self.best_sum + again, self.best_count + 1.0
        x, fitness = x[:count], fitness[:count]
        better = fitness > self._best_means()
        self.best_x = np.where(better[:, None], x, self.best_x)
        self.best_sum = np.where(better, fitness, self.best_sum)
        self.best_count = np.where(better, 1.0, self.best_count)
        if self.generation > 0:
            self._adapt(improved=bool(self._best_means().max() > before))
        self.generation += 1
        self._move()

    def state(self) -> Mapping[str, object]:
        """Return the swarm; nothing before the first generation."""
        if self.generation == 0:
            return {"generation": 0}
        arrays = {name: getattr(self, name).copy() for name in _ADAPTIVE_ARRAYS}
        return {**{name: getattr(self, name) for name in _NUMBERS}, **arrays}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        if state["generation"] == 0:
            return
        for name in _ADAPTIVE_ARRAYS:
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
        rng = child(self._seed, _ADAPTIVE_STREAM, self.generation)
        count = len(self.position)
        lots = rng.random((count, count))
        np.fill_diagonal(lots, np.inf)
        others = np.argsort(lots, axis=1)[:, : self.neighbours]
        best = np.argmax(self._best_means()[others], axis=1)  # of each particle's neighbours
        leaders = self.best_x[others[np.arange(count), best]]
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


_QUIET = Path(__file__).with_name("quiet_pyswarms.yaml")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep pyswarms from configuring logging, on import and whenever it creates a part."""
    before = os.environ.get("LOG_CFG")
    os.environ["LOG_CFG"] = str(_QUIET)
    try:
        yield
    finally:
        if before is None:
            del os.environ["LOG_CFG"]
        else:
            os.environ["LOG_CFG"] = before


if TYPE_CHECKING:
    from pyswarms import backend
    from pyswarms.backend import topology
else:
    backend = imported_later("pyswarms.backend", within=_quiet)
    topology = imported_later("pyswarms.backend.topology", within=_quiet)

_STREAM = 1401
_ARRAYS = ("position", "velocity", "pbest_pos", "pbest_cost")


class SwarmConfig(Table):
    """Parameters of the particle swarm."""

    inertia: Annotated[float, Ge(0), Le(2), Doc("share of its velocity that a particle keeps")] = (
        0.73
    )
    cognitive: Annotated[
        float, Ge(0), Le(10), Doc("acceleration towards a particle's own best point")
    ] = 1.49
    social: Annotated[float, Ge(0), Le(10), Doc("acceleration towards its neighbours' best")] = 1.49
    neighbours: Annotated[
        int,
        Ge(0),
        Le(100_000),
        Doc(
            "size of a particle's neighbourhood, itself included: a ring by number; 0: all "
            "particles"
        ),
    ] = 5
    most_speed: Annotated[
        float,
        Ge(1e-6),
        Le(1),
        Doc("largest change of a coordinate in one generation, as a share of its range"),
    ] = 0.5
    ignore_inactive: Annotated[
        bool,
        Doc(
            "whether best points of designs without a level exert no pull on that level's "
            "coordinates: their values there have never been evaluated"
        ),
    ] = False

    @model_validator(mode="after")
    def _neighbourhood(self) -> "SwarmConfig":
        if self.neighbours == 1:
            raise BadInputError("neighbours", 1, "0 for all, or at least 2")
        return self

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return a swarm before its first generation."""
        return ParticleSwarm(self, axes, population, seed)


class ParticleSwarm:
    """A swarm of particles that follow their own best points and their neighbours'.

    Points that would leave the unit cube are reflected at its faces.
    """

    def __init__(self, config: SwarmConfig, axes: SearchAxes, population: int, seed: int) -> None:
        self._config = config
        self._axes = axes
        self._shape = shape = (population, len(axes))
        self._seed = seed
        self._generation = 0
        self._bounds = (np.zeros(shape[1]), np.ones(shape[1]))
        with _quiet():
            self._topology = _topology(config, shape[0])
            self._on_bounds = backend.BoundaryHandler(strategy="reflective")
            self._on_speed = backend.VelocityHandler(strategy="unmodified")
        self._swarm = self._new_swarm()

    def ask(self) -> Floats:
        """Return the particles' positions, shape (m, d)."""
        positions: Floats = self._swarm.position.copy()
        return positions

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Update the particles' best points and move them."""
        swarm = self._swarm
        swarm.position = np.array(x, dtype=np.float64)
        swarm.current_cost = -np.asarray(fitness, dtype=np.float64)
        swarm.pbest_pos, swarm.pbest_cost = backend.compute_pbest(swarm)
        # Star keeps its best point until it is beaten: reset it, so that the result depends on the
        # particles' bests alone and is the same for a restored swarm.
        swarm.best_cost = np.inf
        swarm.best_pos, swarm.best_cost = self._topology.compute_gbest(
            swarm, p=2, k=max(2, self._config.neighbours)
        )
        self._generation += 1
        with _seeded_global_generator(self._seed, self._generation):
            speed = (-self._config.most_speed, self._config.most_speed)
            with self._inactive_ignored():
                swarm.velocity = self._topology.compute_velocity(
                    swarm, speed, self._on_speed, self._bounds
                )
            swarm.position = self._topology.compute_position(swarm, self._bounds, self._on_bounds)

    def state(self) -> Mapping[str, object]:
        """Return the swarm; nothing before the first generation."""
        if self._generation == 0:
            return {"generation": 0}
        arrays = {name: getattr(self._swarm, name).copy() for name in _ARRAYS}
        return {"generation": self._generation, **arrays}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        self._generation = state["generation"]
        self._swarm = self._new_swarm()
        if self._generation > 0:
            for name in _ARRAYS:
                setattr(self._swarm, name, np.array(state[name], dtype=np.float64))

    @contextmanager
    def _inactive_ignored(self) -> Iterator[None]:
        """Replace inactive coordinates of best points by the particle's own: no pull."""
        swarm, own = self._swarm, self._swarm.pbest_pos
        if self._config.ignore_inactive:
            leaders = np.broadcast_to(swarm.best_pos, own.shape)
            swarm.pbest_pos = np.where(self._axes.active(own), own, swarm.position)
            swarm.best_pos = np.where(self._axes.active(leaders), leaders, swarm.position)
        yield
        swarm.pbest_pos = own

    def _new_swarm(self) -> Any:  # noqa: ANN401 - pyswarms has no types
        config = self._config
        options = {"c1": config.cognitive, "c2": config.social, "w": config.inertia}
        with _seeded_global_generator(self._seed, 0):
            swarm = backend.create_swarm(
                *self._shape,
                options=options,
                bounds=self._bounds,
                clamp=(-config.most_speed, config.most_speed),
            )
        swarm.pbest_cost = np.full(self._shape[0], np.inf)
        return swarm


def _topology(config: SwarmConfig, population: int) -> Any:  # noqa: ANN401 - pyswarms has no types
    if config.neighbours == 0 or config.neighbours >= population:
        return topology.Star()
    ring = topology.Ring(static=True)
    # pyswarms would connect particles that start close to each other; a ring connects all.
    offsets = np.arange(config.neighbours) - config.neighbours // 2
    ring.neighbor_idx = (np.arange(population)[:, None] + offsets) % population
    return ring


@contextmanager
def _seeded_global_generator(seed: int, generation: int) -> Iterator[None]:
    """Give numpy's global generator the state of one generation, and restore it afterwards."""
    sequence = np.random.SeedSequence(seed, spawn_key=(_STREAM, generation))
    own = np.random.RandomState(np.random.MT19937(sequence))
    before = np.random.get_state()  # noqa: NPY002
    np.random.set_state(own.get_state())  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002
