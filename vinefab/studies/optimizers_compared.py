"""Supplement B: the particle swarm against other optimizers, with equal evaluations."""

import numpy as np

from vinefab.core.validation import Floats
from vinefab.core.view import Picture
from vinefab.pages.figure import svg_bytes
from vinefab.search.settings import PartSettings
from vinefab.studies.claims import (
    Claim,
    PaperNumber,
    StudyResult,
    difference,
    interval,
    interval_text,
)
from vinefab.studies.paper_charts import curves
from vinefab.studies.study_jobs import JobStore
from vinefab.studies.study_runs import coverage_run, study_scores, trained, unseen_test

OPTIMIZER_NAMES = {
    "particleswarm": "particle swarm (MATLAB's)",
    "evolution": "evolutionary algorithm",
    "cmaes": "CMA-ES",
    "pso": "particle swarm (pyswarms)",
    "random": "random search",
}
SIMILAR = 0.95
_LEVEL = 0.9
SMOOTHED = 5


def optimizer_study(store: JobStore) -> StudyResult:
    """Run every optimizer on the same problem with the same number of evaluations."""
    size = store.size
    runs = [
        coverage_run(size, "grid", number).changed(optimizer=PartSettings(name=name))
        for name in OPTIMIZER_NAMES
        for number in range(size.repeats)
    ]
    found = trained(store, runs)
    groups = {
        name: found[place * size.repeats : (place + 1) * size.repeats]
        for place, name in enumerate(OPTIMIZER_NAMES)
    }
    scores = {
        name: study_scores(store, [unseen_test(size, run["design"], "grid") for run in group])
        for name, group in groups.items()
    }
    best = {name: np.array([run["best"] for run in group]) for name, group in groups.items()}
    level = _LEVEL * float(smoothed(best["particleswarm"])[:, -1].mean())
    needed = {name: evaluations_to(best[name], level, size.population) for name in OPTIMIZER_NAMES}
    swarm, evolution = scores["particleswarm"], scores["evolution"]
    return StudyResult(
        name="search",
        title="Search methods (S.I.-B)",
        protocol=(
            f"Sensor coverage in the Grid, {size.repeats} seeds each, "
            f"{size.population * size.generations} designs each, each seed on training maps of "
            "its own. The winners are tested on "
            f"{size.unseen_maps} unseen maps with {size.poses} poses. The paper's own evolutionary "
            "algorithm is not published; this one is vinefab's.",
            f"Speed is the number of designs evaluated until the best of a generation, averaged "
            f"over {SMOOTHED} generations, reaches {100 * _LEVEL:.0f} % of where the swarm of the "
            f"paper ends on average ({level:.3f}).",
        ),
        rows=tuple(
            PaperNumber(
                what=f"{words}: winners on unseen maps; designs to {100 * _LEVEL:.0f} %",
                ours=f"{interval_text(interval(scores[name]))}; "
                f"{interval_text(interval(needed[name]), 0)}",
                paper="similar" if name in ("particleswarm", "evolution") else "-",
            )
            for name, words in OPTIMIZER_NAMES.items()
        ),
        claims=(
            Claim(
                text="Swarm and evolution are similar: swarm above 95 % of evolution",
                tested=difference(swarm, SIMILAR * evolution),
                kind="our threshold",
            ),
            Claim(
                text="Swarm and evolution are similar: evolution above 95 % of swarm",
                tested=difference(evolution, SIMILAR * swarm),
                kind="our threshold",
            ),
            Claim(
                text="The swarm is faster than evolution (designs saved)",
                tested=difference(needed["evolution"], needed["particleswarm"], same_maps=False),
                digits=0,
            ),
            Claim(
                text="The swarm finds better designs than random search",
                tested=difference(swarm, scores["random"]),
                kind="our threshold",
            ),
        ),
        pictures=(
            Picture(
                image=svg_bytes(
                    curves(
                        {words: best[name] for name, words in OPTIMIZER_NAMES.items()},
                        "generation",
                        "best of the generation",
                    )
                ),
                caption=f"Mean of {size.repeats} runs and one standard error (simulated).",
            ),
        ),
        data={
            name: {
                "unseen": scores[name].tolist(),
                "best": best[name].tolist(),
                "designs_to_level": needed[name].ravel().tolist(),
            }
            for name in OPTIMIZER_NAMES
        },
    )


def smoothed(best: Floats) -> Floats:
    """Return the means over the last few generations, shape (runs, generations)."""
    sums = np.cumsum(best, axis=1)
    sums[:, SMOOTHED:] -= sums[:, :-SMOOTHED].copy()
    return np.asarray(sums / np.minimum(np.arange(1, best.shape[1] + 1), SMOOTHED))


def evaluations_to(best: Floats, level: float, population: int) -> Floats:
    """Return designs evaluated until a level is reached, or all of them, shape (runs, 1, 1)."""
    reached = smoothed(best) >= level
    count = np.where(reached.any(axis=1), reached.argmax(axis=1) + 1, best.shape[1])
    return np.asarray(count * population, dtype=np.float64)[:, None, None]
