"""What an optimizer is: it is asked for points and told what they are worth."""

from collections.abc import Mapping
from typing import Protocol

from vinefab.core.validation import Floats
from vinefab.search.axes import SearchAxes


class Optimizer(Protocol):
    """A search in the unit cube, one generation after the other.

    Everything random in it derives from its seed and the number of the generation, so that a
    state restored in another process goes on exactly as the first one would have.
    """

    def ask(self) -> Floats:
        """Return the points of the next generation, shape (m, d), entries 0 to 1; m may vary.

        Asking again before telling gives the same points.
        """
        ...

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Take the worth of the points asked for.

        Parameters
        ----------
        x
            The points, shape (m, d).
        fitness
            What they are worth, shape (m,), finite; higher is better.
        """
        ...

    def state(self) -> Mapping[str, object]:
        """Return everything that is needed to go on: plain values, lists of them, float arrays."""
        ...

    def restore(self, state: Mapping[str, object]) -> None:
        """Go on from a state that an optimizer with the same settings returned."""
        ...


class OptimizerConfig(Protocol):
    """An optimizer's own parameters: a frozen dataclass whose fields all have defaults."""

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return an optimizer before its first generation."""
        ...
