"""Parameters of the evolutionary algorithms; pymoo, of an extra, is loaded when one starts."""

from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le
from typing_extensions import Doc

from vinefab.core.extras import ensure_extra
from vinefab.core.front_door import imported_later
from vinefab.core.table import Table
from vinefab.search.optimizers.optimizer import Optimizer, SearchAxes

if TYPE_CHECKING:
    from vinefab.search.optimizers import evolution
else:
    evolution = imported_later("vinefab.search.optimizers.evolution")

Eta = Annotated[float, Ge(1), Le(1000)]
"""Distribution index."""


class EvolutionConfig(Table):
    """Parameters of the evolutionary algorithm; the defaults are pymoo's."""

    crossover_eta: Annotated[Eta, Doc("larger values keep children nearer to their parents")] = 15.0
    mutation_eta: Annotated[Eta, Doc("larger values keep mutants nearer to their originals")] = 20.0

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return the algorithm before its first generation."""
        ensure_extra("evolution", "optimizer 'evolution'")
        etas = (self.crossover_eta, self.mutation_eta)
        return evolution.Evolution(axes, population, seed, etas=etas)


class NsgaConfig(EvolutionConfig):
    """Parameters of NSGA-II, those of the evolutionary algorithm."""

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return the algorithm before its first generation, with fitness as its only objective."""
        ensure_extra("evolution", "optimizer 'nsga2'")
        etas = (self.crossover_eta, self.mutation_eta)
        return evolution.Nsga(axes, population, seed, etas=etas)
