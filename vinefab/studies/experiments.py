"""The registry of the paper's experiments; each is loaded when it is done."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from vinefab.core.registry import Registry

if TYPE_CHECKING:
    from vinefab.studies.claims import StudyResult
    from vinefab.studies.study_jobs import JobStore

_HERE = "vinefab.studies"

EXPERIMENTS: Registry["Callable[[JobStore], StudyResult]"] = Registry(
    "experiment",
    {
        "transfer": f"{_HERE}.transfer:transfer",
        "convergence": f"{_HERE}.training_studies:convergence",
        "maps": f"{_HERE}.training_studies:maps",
        "weighting": f"{_HERE}.training_studies:weighting",
        "reach": f"{_HERE}.redeployment:redeployment_study",
        "anchor": f"{_HERE}.anchor_holding:anchor",
        "search": f"{_HERE}.optimizers_compared:optimizer_study",
        "ablation": f"{_HERE}.ablation:ablation",
        "price": f"{_HERE}.price:price",
    },
)
