"""The optimizers that come with vinefab."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from vinefab.core.registry import Registry, with_parameters

if TYPE_CHECKING:
    from vinefab.search.optimizers.optimizer import OptimizerConfig

OPTIMIZERS: Registry["Callable[..., OptimizerConfig]"] = Registry(
    "optimizer",
    {
        "cmaes": "vinefab.search.optimizers.cmaes:CmaConfig",
        "evolution": "vinefab.search.optimizers.evolution:EvolutionConfig",
        "islands": "vinefab.search.optimizers.islands:IslandsConfig",
        "nsga2": "vinefab.search.optimizers.evolution:NsgaConfig",
        "particleswarm": "vinefab.search.optimizers.particleswarm:AdaptiveSwarmConfig",
        "pso": "vinefab.search.optimizers.pso:SwarmConfig",
        "random": "vinefab.search.optimizers.random_search:RandomConfig",
    },
    group="vinefab.optimizers",
)


def make_optimizer_config(
    name: str, parameters: Mapping[str, object] | None = None
) -> "OptimizerConfig":
    """Return an optimizer's parameters, ready to start."""
    return with_parameters(OPTIMIZERS[name], "optimizer", parameters or {})
