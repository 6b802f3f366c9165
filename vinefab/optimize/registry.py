"""The optimizers that come with vinefab."""

from collections.abc import Callable, Mapping

from vinefab.core.registry import Registry
from vinefab.optimize.cma import CmaRecipe
from vinefab.optimize.evolution import EvolutionRecipe
from vinefab.optimize.matlab_swarm import AdaptiveSwarmRecipe
from vinefab.optimize.nsga import NsgaRecipe
from vinefab.optimize.optimizer import Recipe
from vinefab.optimize.pso import SwarmRecipe
from vinefab.optimize.random import RandomRecipe
from vinefab.tasks.parameters import with_parameters

OPTIMIZERS: Registry[Callable[..., Recipe]] = Registry(
    "optimizer",
    {
        "cmaes": CmaRecipe,
        "evolution": EvolutionRecipe,
        "nsga2": NsgaRecipe,
        "particleswarm": AdaptiveSwarmRecipe,
        "pso": SwarmRecipe,
        "random": RandomRecipe,
    },
    group="vinefab.optimizers",
)


def make_recipe(name: str, parameters: Mapping[str, object] | None = None) -> Recipe:
    """Return an optimizer's parameters, ready to start.

    Raises
    ------
    UnknownNameError
        If no optimizer has that name.
    BadInputError
        If a parameter is unknown or cannot be used.
    """
    return with_parameters(OPTIMIZERS[name], "optimizer", parameters or {})
