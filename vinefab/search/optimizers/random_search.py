"""Random search: the baseline for every other optimizer."""

from collections.abc import Mapping
from typing import cast

from vinefab.core.rng import child
from vinefab.core.table import Table
from vinefab.core.validation import Floats
from vinefab.search.optimizers.optimizer import Optimizer, SearchAxes

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
