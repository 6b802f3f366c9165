"""Optimizers: the protocol (ask and tell), the coordinates that they search, and the registry."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.foreign import broken, calling
from vinefab.core.registry import Registry, with_parameters
from vinefab.core.rng import child
from vinefab.core.table import Table
from vinefab.core.validation import Floats, Ints


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchAxes:
    """The d coordinates of a search: which are integers, and where each is active.

    A coordinate that stands for one of k integers divides 0 to 1 into k equal intervals. A
    coordinate of a level has no effect on designs with fewer levels: it is inactive there.

    Examples
    --------
    >>> axes = SearchAxes(choices=(3, 0, 0), levels=(0, 0, 3), depth=0, least_depth=1)
    >>> axes.active(np.array([[0.1, 0.5, 0.5], [0.9, 0.5, 0.5]])).tolist()
    [[True, True, False], [True, True, True]]
    """

    choices: tuple[int, ...]  # number of integers per coordinate, 0 if continuous; length d
    levels: tuple[int, ...]  # level of each coordinate, 0 if it is always active; length d
    depth: int | None = None  # coordinate for the number of levels; None if that is fixed
    least_depth: int = 1  # the smallest number of levels, or the fixed one

    def __post_init__(self) -> None:
        if len(self.choices) != len(self.levels) or not self.choices:
            raise BadInputError("axes", len(self.choices), "as many levels, at least one")

    @classmethod
    def continuous(cls, dimensions: int) -> "SearchAxes":
        """Return continuous coordinates that are always active."""
        return cls(choices=(0,) * dimensions, levels=(0,) * dimensions)

    def __len__(self) -> int:
        return len(self.choices)

    @property
    def integer(self) -> NDArray[np.bool_]:
        """Whether each coordinate stands for integers, shape (d,)."""
        return np.array(self.choices) > 0

    def active(self, x: Floats) -> NDArray[np.bool_]:
        """Return whether each coordinate is active at each point; (m, d) both."""
        depths = np.full(len(x), self.least_depth)
        if self.depth is not None:
            depths = self.least_depth + self.indices(x)[:, self.depth]
        active: NDArray[np.bool_] = np.array(self.levels) <= depths[:, None]
        return active

    def indices(self, x: Floats) -> Ints:
        """Return the integer, from 0, that each entry of points stands for; 0 if continuous."""
        counts = np.array(self.choices)
        indices: Ints = np.clip((x * counts).astype(np.int64), 0, np.maximum(counts - 1, 0))
        return indices

    def canonical(self, x: Floats) -> Floats:
        """Return the canonical point for the design of each point.

        Inactive entries become 0.5, integers the middle of their interval: points that stand for
        the same design become the same point.
        """
        counts = np.maximum(np.array(self.choices), 1)
        middle = np.where(self.integer, (self.indices(x) + 0.5) / counts, x)
        return np.where(self.active(x), middle, 0.5)


class Optimizer(Protocol):
    """A search in the unit cube, one generation after the other.

    All random numbers derive from the seed and the number of the generation, so that a state
    restored in another process continues exactly as the first one would have.
    """

    def ask(self) -> Floats:
        """Return the points of the next generation, shape (m, d), entries 0 to 1; m may vary.

        Asking again before telling gives the same points.
        """
        ...

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Take the fitness of the points asked for.

        Parameters
        ----------
        x
            The points, shape (m, d).
        fitness
            Shape (m,), finite; higher is better.
        """
        ...

    def state(self) -> Mapping[str, object]:
        """Return everything needed to continue: plain values, lists of them, float arrays."""
        ...

    def restore(self, state: Mapping[str, object]) -> None:
        """Continue from a state that an optimizer with the same settings returned."""
        ...


PenaltyOfPoints = Callable[[Floats], Floats]
"""Takes points, shape (m, d); returns penalties, 0 if manufacturable, NaN if not valid; (m,)."""


@runtime_checkable
class ScreeningOptimizer(Protocol):
    """An optimizer that asks only for points without penalty, where it finds any."""

    def screen_by(self, penalty: PenaltyOfPoints) -> None:
        """Take the penalty of points."""
        ...


@runtime_checkable
class StartingOptimizer(Protocol):
    """An optimizer that can begin at given points."""

    def start_from(self, points: Sequence[Floats]) -> None:
        """Take the points, each of shape (d,), before the first generation."""
        ...


@runtime_checkable
class RecommendingOptimizer(Protocol):
    """An optimizer that knows better than single evaluations which points are good."""

    def recommended(self) -> list[Floats]:
        """Return the points that it holds for the best, best first; none where it knows none."""
        ...


@runtime_checkable
class FrontOptimizer(Protocol):
    """An optimizer for fitness and costs."""

    def set_lowest(self, lowest: float) -> None:
        """Take the lowest fitness of a manufacturable design."""
        ...

    def tell_costs(self, x: Floats, fitness: Floats, costs: Floats) -> None:
        """Take what `tell` does, and further values to be minimized, shape (m, k)."""
        ...


class OptimizerConfig(Protocol):
    """An optimizer's own parameters: a `Table`, or a frozen dataclass, all with defaults."""

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return an optimizer before its first generation."""
        ...


OPTIMIZERS: Registry[Callable[..., OptimizerConfig]] = Registry(
    "optimizer",
    {
        "cmaes": "vinefab.search.optimizers.cmaes:CmaConfig",
        "evolution": "vinefab.search.optimizers.evolution_settings:EvolutionConfig",
        "islands": "vinefab.search.optimizers.islands:IslandsConfig",
        "nsga2": "vinefab.search.optimizers.evolution_settings:NsgaConfig",
        "particleswarm": "vinefab.search.optimizers.swarms:AdaptiveSwarmConfig",
        "pso": "vinefab.search.optimizers.swarms:SwarmConfig",
        "random": "vinefab.search.optimizers.optimizer:RandomConfig",
    },
    group="vinefab.optimizers",
)


def make_optimizer_config(
    name: str, parameters: Mapping[str, object] | None = None
) -> OptimizerConfig:
    """Return an optimizer's parameters, ready to start."""
    return with_parameters(OPTIMIZERS[name], "optimizer", parameters or {})


def started(
    config: OptimizerConfig, name: str, axes: SearchAxes, population: int, seed: int
) -> Optimizer:
    """Return an optimizer before its first generation.

    Raises
    ------
    BrokenPluginError
        If one of another package breaks down, or cannot be asked and told.
    """
    what = f"optimizer {name!r}"
    with calling(what, config):
        optimizer = config.start(axes, population, seed)
    for method in ("ask", "tell", "state", "restore"):
        if not callable(getattr(optimizer, method, None)):
            raise broken(what, config, f"start returns {optimizer!r:.40} without {method}")
    return optimizer


_STREAM = 1402


class RandomSearch:
    """Uniformly random points, generation after generation."""

    def __init__(self, dimensions: int, population: int, seed: int) -> None:
        self._shape = (population, dimensions)
        self._seed = seed
        self._generation = 0

    def ask(self) -> Floats:
        """Return the points of the next generation, shape (m, d)."""
        return child(self._seed, _STREAM, self._generation).random(self._shape)

    def tell(self, x: Floats, fitness: Floats) -> None:  # noqa: ARG002 - it learns nothing
        """Count the generation."""
        self._generation += 1

    def state(self) -> Mapping[str, object]:
        """Return the number of the generation."""
        return {"generation": self._generation}

    def restore(self, state: Mapping[str, object]) -> None:
        """Continue from a generation."""
        self._generation = cast("int", state["generation"])


class RandomConfig(Table):
    """Random search has no parameters."""

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return a random search."""
        return RandomSearch(len(axes), population, seed)
