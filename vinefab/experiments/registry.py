"""The experiments, in the order in which `all` does them."""

from collections.abc import Callable

from vinefab.core.registry import Registry
from vinefab.experiments.ablation import ablation
from vinefab.experiments.anchor import anchor
from vinefab.experiments.convergence import convergence
from vinefab.experiments.finding import Finding
from vinefab.experiments.lab import Lab
from vinefab.experiments.maps import maps
from vinefab.experiments.price import price
from vinefab.experiments.reach import reach
from vinefab.experiments.search import search
from vinefab.experiments.transfer import transfer
from vinefab.experiments.weighting import weighting

EXPERIMENTS: Registry[Callable[[Lab], Finding]] = Registry(
    "experiment",
    {
        "transfer": transfer,
        "convergence": convergence,
        "maps": maps,
        "weighting": weighting,
        "reach": reach,
        "anchor": anchor,
        "search": search,
        "ablation": ablation,
        "price": price,
    },
)
