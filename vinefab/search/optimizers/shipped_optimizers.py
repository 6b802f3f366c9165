"""The optimizers that come with vinefab."""

from collections.abc import Callable, Mapping

from vinefab.core.registry import Registry, with_parameters
from vinefab.search.optimizers.cmaes import CmaConfig
from vinefab.search.optimizers.evolution import EvolutionConfig
from vinefab.search.optimizers.islands import IslandsConfig
from vinefab.search.optimizers.nsga2 import NsgaConfig
from vinefab.search.optimizers.optimizer import OptimizerConfig
from vinefab.search.optimizers.particleswarm import AdaptiveSwarmConfig
from vinefab.search.optimizers.pso import SwarmConfig
from vinefab.search.optimizers.random_search import RandomConfig

OPTIMIZERS: Registry[Callable[..., OptimizerConfig]] = Registry(
    "optimizer",
    {
        "cmaes": CmaConfig,
        "evolution": EvolutionConfig,
        "islands": IslandsConfig,
        "nsga2": NsgaConfig,
        "particleswarm": AdaptiveSwarmConfig,
        "pso": SwarmConfig,
        "random": RandomConfig,
    },
    group="vinefab.optimizers",
)


def make_optimizer_config(
    name: str, parameters: Mapping[str, object] | None = None
) -> OptimizerConfig:
    """Return an optimizer's parameters, ready to start."""
    return with_parameters(OPTIMIZERS[name], "optimizer", parameters or {})
