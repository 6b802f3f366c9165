"""Figure 3C: what the weighting of several scores in training does to a design."""

import numpy as np

from vinefab.core.validation import Floats
from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture
from vinefab.search.settings import RunSettings
from vinefab.studies.claims import Claim, PaperNumber, StudyResult, interval_text
from vinefab.studies.intervals import Statistic, difference, interval, peak, seed_mean, spread
from vinefab.studies.paper_charts import densities
from vinefab.studies.study_jobs import JobStore
from vinefab.studies.study_runs import coverage_run, judged_claim, with_evaluation

WAYS = {"none": "single", "mean": "mean", "best": "best", "min deviation": "min_deviation"}
"""What the paper's figure calls them, and what run files do."""

STATISTICS: dict[str, Statistic] = {
    "mean": seed_mean,
    "standard deviation": spread,
    "95th percentile": peak,
}

Ordering = tuple[str, str, str, Statistic]

ORDERINGS: tuple[Ordering, ...] = (
    ("'best' reaches a higher peak than 'mean' (95th percentile)", "best", "mean", peak),
    ("'best' reaches a higher peak than 'min deviation'", "best", "min deviation", peak),
    ("'best' spreads wider than 'mean'", "best", "mean", spread),
    ("'best' spreads wider than 'min deviation'", "best", "min deviation", spread),
    ("'min deviation' has a higher mean than 'mean'", "min deviation", "mean", seed_mean),
    ("'min deviation' spreads less than 'mean'", "mean", "min deviation", spread),
    ("'mean' scores above 'none'", "mean", "none", seed_mean),
    ("'best' scores above 'none'", "best", "none", seed_mean),
    ("'min deviation' scores above 'none'", "min deviation", "none", seed_mean),
)
"""What is claimed: the statistic of the first is above that of the second."""


def weighting(lab: JobStore) -> StudyResult:
    """Train with every weighting in the Grid, and compare the scores on unseen maps."""
    size = lab.size
    runs = [
        _weighted(coverage_run(size, "grid", number), way)
        for way in WAYS.values()
        for number in range(size.seeds)
    ]
    scores, best = judged_claim(lab, list(WAYS), runs)
    return StudyResult(
        name="weighting",
        title="Weighting of several evaluations (Fig. 3C)",
        protocol=(
            f"Sensor coverage in the Grid on {size.training_maps} training maps. 'none': one "
            "evaluation per generation, on a map drawn for it; the others weigh one evaluation on "
            f"each of {size.maps_at_once} maps drawn for it: their mean, their best, or 25 % mean "
            f"and 75 % small deviation. {size.seeds} seeds each, the best by its own weighting on "
            "fresh poses is kept.",
            "The paper says that a quarter of 'min deviation' is the mean; the form of the rest, "
            "1 - std / 0.5, is vinefab's.",
        ),
        rows=tuple(
            PaperNumber(
                what=f"{name}: {statistic} on unseen maps",
                ours=f"{interval_text(interval(best[name], function))}; all seeds "
                f"{interval_text(interval(scores[name], function))}",
            )
            for name in WAYS
            for statistic, function in STATISTICS.items()
        ),
        claims=tuple(_claim(order, scores, best) for order in ORDERINGS),
        pictures=(
            Picture(
                image=svg_bytes(
                    densities({name: np.ravel(values) for name, values in best.items()}, "fitness")
                ),
                caption="Scores of the kept designs on unseen Grid maps (simulated).",
                wide=True,
            ),
        ),
        data={name: values.tolist() for name, values in scores.items()},
    )


def _weighted(run: RunSettings, way: str) -> RunSettings:
    """Return a run with another weighting; a single evaluation is on one map."""
    if way == "single":
        return with_evaluation(run, composite=way, maps_per_generation=1)
    return with_evaluation(run, composite=way)


def _claim(order: Ordering, scores: dict[str, Floats], best: dict[str, Floats]) -> Claim:
    text, one, two, statistic = order
    return Claim(
        text=text,
        tested=difference(scores[one], scores[two], statistic),
        kept=difference(best[one], best[two], statistic),
    )
