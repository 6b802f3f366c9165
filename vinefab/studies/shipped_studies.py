"""The experiments, in the order in which `all` does them."""

from collections.abc import Callable

from vinefab.core.registry import Registry
from vinefab.studies.ablation import ablation
from vinefab.studies.anchor_holding import anchor
from vinefab.studies.claims import StudyResult
from vinefab.studies.convergence import convergence
from vinefab.studies.optimizers_compared import optimizer_study
from vinefab.studies.price import price
from vinefab.studies.redeployment import redeployment_study
from vinefab.studies.study_jobs import JobStore
from vinefab.studies.training_maps import maps
from vinefab.studies.transfer import transfer
from vinefab.studies.weighting import weighting

EXPERIMENTS: Registry[Callable[[JobStore], StudyResult]] = Registry(
    "experiment",
    {
        "transfer": transfer,
        "convergence": convergence,
        "maps": maps,
        "weighting": weighting,
        "reach": redeployment_study,
        "anchor": anchor,
        "search": optimizer_study,
        "ablation": ablation,
        "price": price,
    },
)
