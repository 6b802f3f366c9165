"""Figure 3B: what varied poses and more training maps bring."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.files.design_toml import read_design
from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture
from vinefab.search.settings import RunSettings
from vinefab.studies.claims import Claim, PaperNumber, StudyResult, interval_text
from vinefab.studies.intervals import difference, interval, spread
from vinefab.studies.paper_charts import Bar, grouped_bars
from vinefab.studies.study_designs import plain_design
from vinefab.studies.study_jobs import JobStore
from vinefab.studies.study_runs import (
    coverage_run,
    judged_claim,
    study_scores,
    unseen_test,
    with_evaluation,
)
from vinefab.studies.study_sizes import StudySize

BY_HAND = "three_level_tree"
"""The shipped design that was drawn by hand, before any search."""

NOT_OPTIMIZED = "not optimized"
FIXED = "1 map, fixed pose"
VARIABLE = "1 map, variable pose"


def maps(lab: JobStore) -> StudyResult:
    """Train on one map or many, from one pose or many, with one evaluation per generation."""
    size = lab.size
    settings = _settings(size)
    runs = [run for group in settings.values() for run in group]
    tested, best_tested = judged_claim(lab, list(settings), runs)
    by_hand = study_scores(lab, [unseen_test(size, plain_design(read_design(BY_HAND)), "grid")])
    scores, best = {NOT_OPTIMIZED: by_hand, **tested}, {NOT_OPTIMIZED: by_hand, **best_tested}
    return StudyResult(
        name="maps",
        title="Variety in training (Fig. 3B)",
        protocol=(
            "Sensor coverage in the Grid. Every design has one evaluation per generation: on the "
            "only map or, with several, on one that is drawn for the generation. A fixed pose is "
            "the middle of the map's start; variable ones are drawn from its range (10 mm to "
            f"either side, 30 degrees). {size.seeds} seeds each, the best in training is kept; "
            f"{size.unseen_maps} unseen maps, {size.poses} poses each.",
            f"The design that is not optimized is the shipped {BY_HAND}, drawn by hand for a "
            "bench before any search was run.",
        ),
        rows=(
            *(row for name in best for row in _rows(name, best[name], scores[name])),
            *(_more(two, one, scores, best) for one, two in pairwise(list(settings)[1:])),
        ),
        claims=_claims(scores, best, list(settings)),
        remarks=(
            "All runs spend the same number of evaluations, and the swarm keeps the luckiest ones "
            "of noisy evaluations as its bests: a fixed pose has no such noise. Variety helps the "
            "kept designs when it comes from more maps; from poses on one map alone it does not "
            "show here.",
        ),
        pictures=(_picture(best),),
        data={name: values.tolist() for name, values in scores.items()},
    )


def _settings(size: StudySize) -> dict[str, list[RunSettings]]:
    """Return the runs of every way to train."""
    base = [
        with_evaluation(
            coverage_run(size, "grid", number), composite="single", maps_per_generation=1
        )
        for number in range(size.seeds)
    ]

    def on(count: int, pose_range: float) -> list[RunSettings]:
        runs = [replace(run, maps=replace(run.maps, count=count)) for run in base]
        return [with_evaluation(run, pose_range=pose_range) for run in runs]

    several = {
        f"{n} maps, variable pose": on(n, 1.0) for n in (size.maps_at_once, size.training_maps)
    }
    return {FIXED: on(1, 0.0), VARIABLE: on(1, 1.0), **several}


def _rows(name: str, best: Floats, scores: Floats) -> list[PaperNumber]:
    paper = {NOT_OPTIMIZED: "worst and widest", FIXED: "over-fitted"}.get(name, "-")
    rows = [
        PaperNumber(what=f"{name}: score", ours=interval_text(interval(best)), paper=paper),
        PaperNumber(what=f"{name}: spread over maps", ours=interval_text(interval(best, spread))),
    ]
    if len(scores) > 1:
        rows.append(
            PaperNumber(what=f"{name}: score, all seeds", ours=interval_text(interval(scores)))
        )
    return rows


def _more(name: str, than: str, scores: dict[str, Floats], best: dict[str, Floats]) -> PaperNumber:
    """Return what more training maps bring, which the paper calls within error."""
    kept_ones = interval_text(difference(best[name], best[than]))
    every = interval_text(difference(scores[name], scores[than]))
    return PaperNumber(
        what=f"{name}, above {than}",
        ours=f"{kept_ones}; all seeds {every}",
        paper="better, within error",
    )


def _claims(
    scores: dict[str, Floats], best: dict[str, Floats], trained_names: list[str]
) -> tuple[Claim, ...]:
    def above(text: str, one: str, two: str) -> Claim:
        return Claim(
            text=text,
            tested=difference(scores[one], scores[two]),
            kept=difference(best[one], best[two]),
        )

    fixed, variable, several, many = trained_names
    every = np.concatenate([scores[name] for name in trained_names])
    return (
        Claim(
            text="Optimized designs score above the one drawn by hand",
            tested=difference(every, scores[NOT_OPTIMIZED]),
            kept=difference(best[fixed], best[NOT_OPTIMIZED]),
        ),
        Claim(
            text="The one drawn by hand has the widest spread",
            tested=difference(scores[NOT_OPTIMIZED], every, spread),
            kept=difference(best[NOT_OPTIMIZED], best[many], spread),
        ),
        above("Variable poses beat a fixed pose (1 map)", variable, fixed),
        above("Several maps beat a fixed pose on one", several, fixed),
    )


def _picture(best: dict[str, Floats]) -> Picture:
    groups = {
        name.replace(", ", ",\n").replace(" pose", "\npose"): [
            Bar(label="score on unseen maps", found=interval(values))
        ]
        for name, values in best.items()
    }
    return Picture(
        image=svg_bytes(grouped_bars(groups, {}, "fitness (simulated)")),
        caption="Kept designs on unseen Grid maps (simulated), with 95 % intervals over maps.",
        wide=True,
    )
