"""The evolutionary algorithm: pymoo's mixed-variable operators, one generation at a time.

Parents are drawn at random, real and integer variables have their own crossover and mutation, and
the best of parents and children survive. pymoo's own loop hides its random generator and history;
its public operators can be driven step by step. They take a second to import.

NSGA-II is the same for several objectives, with pymoo's ranking: designs are ranked by
non-dominated front, and within a front by crowding distance. Parents are the winners of binary
tournaments; of parents and children together the first in rank survive. Designs that are not
manufacturable rank below all others, by their fitness.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pymoo.core.duplicate import DefaultDuplicateElimination
from pymoo.core.mixed import MixedVariableMating
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.core.variable import Integer, Real
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM
from pymoo.operators.repair.rounding import RoundingRepair
from pymoo.operators.selection.tournament import TournamentSelection
from pymoo.operators.survival.rank_and_crowding.metrics import calc_crowding_distance
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints
from vinefab.search.optimizers.optimizer import SearchAxes

_STREAM = 1404

Etas = tuple[float, float]
"""Distribution indices of crossover and mutation."""


class Evolution:
    """A population under crossover, mutation and selection."""

    def __init__(self, axes: SearchAxes, population: int, seed: int, *, etas: Etas) -> None:
        self._axes = axes
        self._population = population
        self._seed = seed
        self._generation = 0
        self._parents = np.empty((0, len(axes)))
        self._fitness = np.empty(0)
        variables = {
            axis: Integer(bounds=(0, choices - 1)) if choices else Real(bounds=(0.0, 1.0))
            for axis, choices in enumerate(axes.choices)
        }
        self._problem = Problem(vars=variables, n_obj=1)
        crossover, mutation = etas
        rounded = {"vtype": float, "repair": RoundingRepair()}
        self._mating = MixedVariableMating(
            crossover={
                Real: SBX(eta=crossover),
                Integer: SBX(eta=crossover, **rounded),
            },
            mutation={
                Real: PM(eta=mutation),
                Integer: PM(eta=mutation, **rounded),
            },
        )
        # Children that stand for the same design as another one are left out.
        self._mating.eliminate_duplicates = DefaultDuplicateElimination(
            func=lambda pop: axes.canonical(self._points(pop))
        )

    def ask(self) -> Floats:
        """Return the first population, or the children of the last, shape (m, d)."""
        rng = child(self._seed, _STREAM, self._generation)
        first = rng.random((self._population, len(self._axes)))
        if self._generation == 0:
            return self._axes.canonical(first)
        indices = self._axes.indices(self._parents)
        rows = [
            {
                a: i if n else v
                for a, (n, i, v) in enumerate(zip(self._axes.choices, *row, strict=True))
            }
            for row in zip(indices.tolist(), self._parents.tolist(), strict=True)
        ]
        parents = Population.new(X=rows)
        children = self._mating.do(self._problem, parents, self._population, random_state=rng)
        points = self._points(children)
        # Where the parents give too few new designs, random points fill up.
        return np.concatenate([points, self._axes.canonical(first)])[: self._population]

    def tell(self, x: Floats, fitness: Floats) -> None:
        """Keep the best of parents and children; of equals, the older."""
        points = np.concatenate([self._parents, x])
        together = np.concatenate([self._fitness, fitness])
        best = np.argsort(-together, kind="stable")[: self._population]
        self._parents, self._fitness = points[best], together[best]
        self._generation += 1

    def state(self) -> Mapping[str, object]:
        """Return the survivors and their fitness."""
        return {
            "generation": self._generation,
            "parents": self._parents.copy(),
            "fitness": self._fitness.copy(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        self._generation = state["generation"]
        self._fitness = np.array(state["fitness"], dtype=np.float64)
        parents = np.array(state["parents"], dtype=np.float64)
        self._parents = parents.reshape(-1, len(self._axes))

    def _points(self, individuals: Any) -> Floats:  # noqa: ANN401 - pymoo has no types
        axes = range(len(self._axes))
        rows = [one.X for one in individuals]
        values = np.array([[row[axis] for axis in axes] for row in rows], dtype=np.float64)
        values = values.reshape(-1, len(self._axes))
        counts = np.maximum(np.array(self._axes.choices), 1)
        points: Floats = np.where(self._axes.integer, (values + 0.5) / counts, values)
        return points


class Nsga(Evolution):
    """A population that approximates a front."""

    def __init__(self, axes: SearchAxes, population: int, seed: int, *, etas: Etas) -> None:
        super().__init__(axes, population, seed, etas=etas)
        self._costs = np.empty((0, 0))
        self._lowest = -np.inf
        self._mating.selection = TournamentSelection(
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
    """Return the order of points, the best first."""
    feasible = np.flatnonzero((fitness >= lowest) & np.isfinite(costs).all(axis=1))
    rest = np.setdiff1d(np.arange(len(fitness)), feasible)
    order = [rest[np.argsort(-fitness[rest], kind="stable")]]
    if len(feasible):
        values = np.column_stack([-fitness[feasible], costs[feasible]])
        for front in reversed(NonDominatedSorting().do(values)):
            rows = np.sort(front)
            crowding = calc_crowding_distance(values[rows])
            order.insert(0, feasible[rows[np.argsort(-crowding, kind="stable")]])
    return np.concatenate(order)
