"""A run of the optimizer, with its maps, its penalty and its record."""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from vinefab.core.atomic import folder_to_fill
from vinefab.core.errors import BadInputError, located
from vinefab.core.jsontext import json_text
from vinefab.core.registry import with_parameters
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.files.map_geojson import read_map
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.map import Map
from vinefab.search.evaluator import Penalty
from vinefab.search.loop import Search
from vinefab.search.manufacturability import (
    ManufacturabilityPenalty,
    SpaceQuery,
    refuse_infeasible_space,
)
from vinefab.search.parallel.evaluators import PointEvaluator, ThreadEvaluator
from vinefab.search.record.identity import RunIdentity
from vinefab.search.record.result import Progress, RunResult
from vinefab.search.record.store import RunStore
from vinefab.search.settings import MapSettings, RunSettings


def environment_options(maps: MapSettings) -> Any:  # noqa: ANN401 - every environment has its own
    """Return the options of a run's environment."""
    return with_parameters(ENVIRONMENTS[maps.environment].options, "maps.options", maps.options)


def generated_maps(maps: MapSettings) -> tuple[Map, ...]:
    """Return the maps that an environment gives for a run's seeds.

    Maps from files are read by whoever may read files.
    """
    options = environment_options(maps)
    make = ENVIRONMENTS[maps.environment].make
    return tuple(make(maps.seed + index, options) for index in range(maps.count))


Tell = Callable[[Progress], None]


def training_maps(settings: RunSettings) -> tuple[Map, ...]:
    """Return the maps that a run trains on: read from its files, or generated."""
    if settings.maps.files:
        return tuple(read_map(path) for path in settings.maps.files)
    return generated_maps(settings.maps)


def penalty_of(settings: RunSettings) -> Penalty | None:
    """Return how far designs are from being made with a run's recipe, or None if it asks not."""
    if not settings.evaluation.fabricable:
        return None
    making = _making(settings)
    refuse_infeasible_space(SpaceQuery.of(settings, making.profile, making.sheet_mm))
    return making


def _making(settings: RunSettings) -> ManufacturabilityPenalty:
    return ManufacturabilityPenalty(
        profile=read_profile(settings.evaluation.recipe or DEFAULT_RECIPE)
    )


def complaint_of(result: RunResult, settings: RunSettings) -> str:
    """Return which rules forbid to make a run's winner; empty if none does, or nobody asked."""
    if result.fabricable or not result.asked:
        return ""
    return _making(settings).complaint(result.best)


def workforce(workers: int, cluster: str | None) -> PointEvaluator:
    """Return who evaluates: threads, or the workers of a cluster."""
    if cluster is None:
        return ThreadEvaluator(workers)
    if workers != 1:
        raise BadInputError("--workers", workers, "not beside --cluster")
    from vinefab.search.parallel.dask_cluster import DaskEvaluator  # noqa: PLC0415 - for those who ask

    return DaskEvaluator(cluster)


def run_search(
    settings: RunSettings,
    folder: Path,
    *,
    resume: bool = False,
    workers: int | PointEvaluator = 1,
    tell: Tell | None = None,
    source: Path | None = None,
) -> RunResult:
    """Run the optimizer and keep its record in a folder."""
    with located(source) if source else nullcontext():
        maps = training_maps(settings)
        penalty = penalty_of(settings)
        job = Search.of(settings, maps, penalty)
    identity = RunIdentity.of(settings, maps, penalty)
    with (
        folder_to_fill(folder),
        RunStore.open(folder, identity, maps=maps, resume=resume) as store,
    ):
        return job.run(store=store, progress=tell, workers=workers)


def progress_words(progress: Progress) -> str:
    """Return where a run stands in a few words."""
    return (
        f"generation {progress.generation}/{progress.generations}  best {progress.best:.4f}  "
        f"mean {progress.mean:.4f} +- {progress.spread:.4f}  "
        f"can be made {100 * progress.fabricable_share:.0f} %"
    )


def result_lines(result: RunResult, complaint: str = "") -> list[str]:
    """Return how a run ended as lines for the user."""
    best, score = result.best, result.score
    weighed = ", ".join(f"{name} {value:.4f}" for name, value in score.composite.items())
    repair = [f"repair: {result.repair}"] if result.repair else []
    drift = "; ".join(result.drift)
    newer = [f"went on with other packages, so the last digits may differ: {drift}"]
    failed = f"found no robot that can be made: the winner breaks {complaint}"
    return [
        f"run {result.run_id}: {len(result.history)} generations, {result.evaluations} designs "
        f"evaluated, stopped by {result.stopped}",
        *(newer if drift else []),
        *repair,
        f"winner {best.name}: {best.branch_count} branches on {best.depth} levels; "
        f"{_made(result, complaint)}",
        f"on {len(score.evaluations)} fresh poses on the training maps (simulated): {weighed}",
        result.times.words,
        *([failed] if complaint else []),
    ]


def _made(result: RunResult, complaint: str) -> str:
    if not result.asked:
        return "nobody asked whether it can be made"
    if complaint:
        return "breaks rules of making"
    if result.fabricable:
        return "passes the rules of making"
    return "passes the check, though not the search's stricter rules: see vinefab check"


def result_json(result: RunResult) -> str:
    """Return how a run ended as JSON: ``vinefab/run-result-1``."""
    content = {
        "run": result.run_id,
        "winner": result.best.name,
        "stopped": result.stopped,
        "evaluations": result.evaluations,
        "fabricable": result.fabricable,
        "repair": result.repair,
        "composite": dict(result.score.composite),
        "finalists": [
            {"fitness": f.fitness, "penalty": f.penalty, "composite": dict(f.score.composite)}
            for f in result.finalists
        ],
        "generations": [
            {
                "best": g.best,
                "mean": float(np.nanmean(g.composite)) if g.has_designs else None,
                "spread": float(np.nanstd(g.composite)) if g.has_designs else None,
                "fabricable_share": g.fabricable_share,
                "seconds": g.seconds,
            }
            for g in result.history
        ],
        "times": {**result.times.plain(), "shares": result.times.shares},
    }
    return json_text("vinefab/run-result-1", content)
