"""An optimizer: steps around the best point so far, smaller ones where they do not help."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.search.optimizers.optimizer import Optimizer, SearchAxes


@dataclass(frozen=True, slots=True, kw_only=True)
class HillClimbConfig:
    """Parameters: ``name = "hillclimb"`` in a run file, with any of these below it.

    Parameters
    ----------
    step
        First standard deviation of a step, as a share of each range.
    shrink
        What a generation without a better point multiplies it by.
    """

    step: float = 0.3
    shrink: float = 0.8

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return a climber before its first generation."""
        return HillClimb(self, len(axes), population, seed)


class HillClimb:
    """Normal steps around the best point so far; points lie in the unit cube, high is good."""

    def __init__(
        self, config: HillClimbConfig, dimensions: int, population: int, seed: int
    ) -> None:
        self._config = config
        self._shape = (population, dimensions)
        self._seed = seed
        self._generation = 0
        self._step = config.step
        self._best = np.full(dimensions, 0.5)
        self._best_fitness = -np.inf

    def ask(self) -> Floats:
        """Return the points of the next generation; asking again gives the same."""
        draw = child(self._seed, self._generation)  # of seed and generation only: can be repeated
        if self._generation == 0:
            return draw.random(self._shape)
        return np.clip(self._best + self._step * draw.normal(size=self._shape), 0.0, 1.0)

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Keep the best point; smaller steps where none was better."""
        first = int(np.argmax(fitness))
        if fitness[first] > self._best_fitness:
            self._best, self._best_fitness = x[first].copy(), float(fitness[first])
        else:
            self._step *= self._config.shrink
        self._generation += 1

    def state(self) -> Mapping[str, object]:
        """Return all that ``restore`` needs: plain values, lists of them, float arrays."""
        return {
            "generation": self._generation,
            "step": self._step,
            "best": self._best.copy(),
            "best_fitness": self._best_fitness,
        }

    def restore(self, state: Mapping[str, object]) -> None:
        """Continue where a climber with the same parameters was."""
        self._generation = cast("int", state["generation"])
        self._step = cast("float", state["step"])
        self._best = np.array(state["best"])
        self._best_fitness = cast("float", state["best_fitness"])
