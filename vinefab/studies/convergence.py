"""Figure 3A: how training rises, run after run."""

import numpy as np

from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture
from vinefab.studies.claims import Claim, PaperNumber, StudyResult, interval_text
from vinefab.studies.intervals import difference, interval
from vinefab.studies.paper_charts import curves
from vinefab.studies.study_jobs import JobStore
from vinefab.studies.study_runs import coverage_run, trained


def convergence(lab: JobStore) -> StudyResult:
    """Follow the fitness of repeated runs in the Grid."""
    size = lab.size
    found = trained(lab, [coverage_run(size, "grid", number) for number in range(size.repeats)])
    best = np.array([run["best"] for run in found])
    mean = np.array([run["mean"] for run in found])
    final = np.array([run["fitness"] for run in found])
    early, late = best[:, :1, None], best[:, -max(1, size.generations // 10) :, None]
    lines = {"best of the generation": best, "mean of the generation": mean}
    return StudyResult(
        name="convergence",
        title="Fitness over generations (Fig. 3A)",
        protocol=(
            f"{size.repeats} runs of sensor coverage in the Grid, which differ in the seed of the "
            "swarm and of the poses only. Every generation meets new poses, so a value is what the "
            "designs of that generation scored on them, not the best so far.",
        ),
        rows=(
            PaperNumber(
                what="best of the first generation, mean over runs",
                ours=interval_text(interval(early)),
            ),
            PaperNumber(
                what="best of the last tenth of the generations, mean over runs",
                ours=interval_text(interval(late)),
                paper="rising",
            ),
            PaperNumber(
                what="winners on fresh poses, standard deviation over runs",
                ours=f"{final.std():.3f} around {final.mean():.3f}",
                paper="repeatable",
            ),
        ),
        claims=(
            Claim(
                text="Fitness rises over the generations (best of the last tenth above the first)",
                tested=difference(late, early, same_maps=False),
            ),
        ),
        pictures=(
            Picture(
                image=svg_bytes(curves(lines, "generation", "fitness on the training maps")),
                caption=f"Mean of {size.repeats} runs and one standard error (simulated).",
                wide=True,
            ),
        ),
        data={"best": best.tolist(), "mean": mean.tolist(), "winners": final.tolist()},
    )
