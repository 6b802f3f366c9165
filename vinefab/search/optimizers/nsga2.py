"""NSGA-II: the evolutionary algorithm for several objectives, with pymoo's ranking and operators.

Designs are ranked by non-dominated front, and within a front by crowding distance. Parents are the
winners of binary tournaments; of parents and children together the first in rank survive. Designs
that are not manufacturable rank below all others, by their fitness.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from vinefab.core.compiling import imported_later
from vinefab.core.validation import Floats, Ints
from vinefab.search.optimizers.evolution import Evolution, EvolutionConfig
from vinefab.search.optimizers.optimizer import Optimizer, SearchAxes

if TYPE_CHECKING:
    from vinefab.search.optimizers import pymoo_parts
else:
    pymoo_parts = imported_later("vinefab.search.optimizers.pymoo_parts")


@runtime_checkable
class FrontOptimizer(Protocol):
    """An optimizer for fitness and costs."""

    def set_lowest(self, lowest: float) -> None:
        """Take the lowest fitness of a manufacturable design."""
        ...

    def tell_costs(self, x: Floats, fitness: Floats, costs: Floats) -> None:
        """Take what `tell` does, and what is to be minimized beside it, shape (m, k)."""
        ...


class NsgaConfig(EvolutionConfig):
    """Parameters of NSGA-II, those of the evolutionary algorithm."""

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return the algorithm before its first generation, with fitness as its only objective."""
        return Nsga(self, axes, population, seed)


class Nsga(Evolution):
    """A population that approximates a front."""

    def __init__(self, config: NsgaConfig, axes: SearchAxes, population: int, seed: int) -> None:
        super().__init__(config, axes, population, seed)
        self._costs = np.empty((0, 0))
        self._lowest = -np.inf
        self._mating.selection = pymoo_parts.TournamentSelection(
            func_comp=lambda _, pairs, **__: pairs.min(axis=1)[:, None]
        )

    def set_lowest(self, lowest: float) -> None:
        """Take the lowest fitness of a manufacturable design."""
        self._lowest = lowest

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Keep the best of parents and children; of equals, the older."""
        self.tell_costs(x, fitness, np.zeros((len(x), self._costs.shape[1])))

    def tell_costs(self, x: Floats, fitness: Floats, costs: Floats) -> None:
        """Keep the first in rank of parents and children; of equals, the older."""
        points = np.concatenate([self._parents, x])
        together = np.concatenate([self._fitness, fitness])
        costs = np.concatenate([self._costs if len(self._costs) else costs[:0], costs])
        best = ranking(together, costs, self._lowest)[: self._population]
        # In the order of their rank, by which tournaments are decided.
        self._parents, self._fitness = points[best], together[best]
        self._costs = costs[best]
        self._generation += 1

    def state(self) -> Mapping[str, object]:
        """Return the survivors with their fitness and costs."""
        return {**super().state(), "costs": self._costs.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        super().restore(state)
        self._costs = np.array(state["costs"], dtype=np.float64)


def ranking(fitness: Floats, costs: Floats, lowest: float) -> Ints:
    """Return the order of points, the best first.

    Parameters
    ----------
    fitness
        Shape (m,).
    """
    feasible = np.flatnonzero((fitness >= lowest) & np.isfinite(costs).all(axis=1))
    rest = np.setdiff1d(np.arange(len(fitness)), feasible)
    order = [rest[np.argsort(-fitness[rest], kind="stable")]]
    if len(feasible):
        values = np.column_stack([-fitness[feasible], costs[feasible]])
        for front in reversed(pymoo_parts.NonDominatedSorting().do(values)):
            rows = np.sort(front)
            crowding = pymoo_parts.calc_crowding_distance(values[rows])
            order.insert(0, feasible[rows[np.argsort(-crowding, kind="stable")]])
    return np.concatenate(order)
