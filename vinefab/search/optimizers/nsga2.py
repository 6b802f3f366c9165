"""NSGA-II: the evolutionary algorithm for several objectives, with pymoo's ranking and operators.

Designs are ranked by the fronts that they lie on, and on a front by how alone they are there.
Parents are the winners of small tournaments, and of parents and children together the first in
rank survive. Designs that cannot be made rank below all others, by their fitness.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.search.axes import SearchAxes
from vinefab.search.optimizers.evolution import Evolution, EvolutionConfig
from vinefab.search.optimizers.optimizer import Optimizer

CostsOf = Callable[[Floats], Floats]
"""Takes points of shape (m, d), gives their costs, shape (m, k)."""


@runtime_checkable
class FrontFinder(Protocol):
    """An optimizer that can weigh fitness against costs."""

    def weigh(self, costs_of: CostsOf, lowest: float) -> None:
        """Take what points cost, and the fitness below which no design can be made."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class NsgaConfig(EvolutionConfig):
    """Parameters of NSGA-II, those of the evolutionary algorithm."""

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return the algorithm before its first generation; without costs it has one objective."""
        return Nsga(self, axes, population, seed)


class Nsga(Evolution):
    """A population that keeps a front."""

    def __init__(self, recipe: NsgaConfig, axes: SearchAxes, population: int, seed: int) -> None:
        super().__init__(recipe, axes, population, seed)
        self._costs_of: CostsOf = lambda x: np.zeros((len(x), 0))
        self._lowest = -np.inf
        self._mating.selection = _tournament()

    def weigh(self, costs_of: CostsOf, lowest: float) -> None:
        """Take what points cost, and the fitness below which no design can be made."""
        self._costs_of, self._lowest = costs_of, lowest

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Let the first in rank of parents and children survive; of equals, the older."""
        points = np.concatenate([self._parents, x])
        worth = np.concatenate([self._fitness, fitness])
        costs = self._costs_of(points)
        best = ranking(worth, costs, self._lowest)[: self._population]
        # In the order of their rank: that is what the tournaments go by.
        self._parents, self._fitness = points[best], worth[best]
        self._generation += 1


def ranking(worth: Floats, costs: Floats, lowest: float) -> Ints:
    """Return the order of points, the best first.

    Parameters
    ----------
    worth
        Fitness, shape (m,).
    """
    from pymoo.operators.survival.rank_and_crowding.metrics import (  # noqa: PLC0415 - when used
        calc_crowding_distance,
    )
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting  # noqa: PLC0415

    able = np.flatnonzero((worth >= lowest) & np.isfinite(costs).all(axis=1))
    rest = np.setdiff1d(np.arange(len(worth)), able)
    order = [rest[np.argsort(-worth[rest], kind="stable")]]
    if len(able):
        values = np.column_stack([-worth[able], costs[able]])
        for front in reversed(NonDominatedSorting().do(values)):
            rows = np.sort(front)
            alone = calc_crowding_distance(values[rows])
            order.insert(0, able[rows[np.argsort(-alone, kind="stable")]])
    return np.concatenate(order)


def _tournament() -> Any:  # noqa: ANN401 - pymoo has no types
    from pymoo.operators.selection.tournament import TournamentSelection  # noqa: PLC0415

    return TournamentSelection(func_comp=lambda _, pairs, **__: pairs.min(axis=1)[:, None])
