"""The paper's experiments, the optimizer contest and the benchmark; only the commands load them.

`study_runs` does the experiments of `EXPERIMENTS` (`do_experiments`), `optimizer_contest`
compares optimizers on run files, `benchmark` measures speed (`run_benchmark`).
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from vinefab.core.registry import Registry

if TYPE_CHECKING:
    from vinefab.studies.claims import StudyResult
    from vinefab.studies.study_runs import JobStore

EXPERIMENTS: Registry["Callable[[JobStore], StudyResult]"] = Registry(
    "experiment",
    {
        "transfer": "vinefab.studies.training_studies:transfer",
        "convergence": "vinefab.studies.training_studies:convergence",
        "maps": "vinefab.studies.training_studies:maps",
        "weighting": "vinefab.studies.training_studies:weighting",
        "reach": "vinefab.studies.deployment_studies:redeployment_study",
        "anchor": "vinefab.studies.deployment_studies:anchor",
        "search": "vinefab.studies.training_studies:optimizer_study",
        "ablation": "vinefab.studies.assumption_studies:ablation",
        "price": "vinefab.studies.assumption_studies:price",
        "scale": "vinefab.studies.scale_study:scale_study",
    },
)
"""The paper's experiments; each is loaded when it is done."""
