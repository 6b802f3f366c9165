"""A run of the optimizer with its maps, penalty and record, and its messages to the user."""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from vinefab.core.atomic import folder_to_fill
from vinefab.core.errors import BadInputError, located
from vinefab.core.jsontext import json_text
from vinefab.core.registry import with_parameters
from vinefab.growth.options import growth_text, trained_growth
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import Design
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
from vinefab.search.parallel.point_evaluator import PointEvaluator, ThreadEvaluator
from vinefab.search.record.result import Progress, RunIdentity, RunResult
from vinefab.search.record.store import RunStore
from vinefab.search.settings import MapSettings, RunSettings
from vinefab.tasks.evaluate import composites_text
from vinefab.tasks.task import Task


def environment_options(maps: MapSettings) -> Any:  # noqa: ANN401 - every environment has its own
    """Return the options of a run's environment."""
    return with_parameters(ENVIRONMENTS[maps.environment].options, "maps.options", maps.options)


def generated_maps(maps: MapSettings) -> tuple[Map, ...]:
    """Return the maps that an environment generates for a run's seeds."""
    options = environment_options(maps)
    make = ENVIRONMENTS[maps.environment].make
    return tuple(make(maps.seed + index, options) for index in range(maps.count))


def training_maps(settings: RunSettings) -> tuple[Map, ...]:
    """Return the training maps of a run: read from its files, or generated."""
    if settings.maps.files:
        return tuple(read_map(path) for path in settings.maps.files)
    return generated_maps(settings.maps)


def penalty_of(settings: RunSettings) -> Penalty | None:
    """Return the penalty of a run's recipe; None if manufacturability is not checked."""
    if not settings.evaluation.fabricable:
        return None
    penalty = _recipe_penalty(settings)
    refuse_infeasible_space(SpaceQuery.of(settings, penalty.profile, penalty.sheet_mm))
    return penalty


def _recipe_penalty(settings: RunSettings) -> ManufacturabilityPenalty:
    return ManufacturabilityPenalty(
        profile=read_profile(settings.evaluation.recipe or DEFAULT_RECIPE)
    )


def violations_of(result: RunResult, settings: RunSettings) -> str:
    """Return which rules block a run's winner; empty if none does, or none was checked."""
    if result.fabricable or not result.checked:
        return ""
    return _recipe_penalty(settings).violations(result.best)


def make_point_evaluator(workers: int | None, cluster: str | None) -> PointEvaluator:
    """Return the point evaluator: threads, or the workers of a cluster with threads beside them."""
    if cluster is None:
        if workers == 0:
            raise BadInputError("--workers", 0, "1 or more; 0 only with --cluster")
        return ThreadEvaluator(1 if workers is None else workers)
    from vinefab.search.parallel.dask_cluster import DaskEvaluator  # noqa: PLC0415 - optional

    return DaskEvaluator(cluster, threads=workers)


def run_search(  # noqa: PLR0913  options by keyword
    settings: RunSettings,
    folder: Path,
    *,
    resume: bool = False,
    workers: int | PointEvaluator = 1,
    progress: Callable[[Progress], None] | None = None,
    source: Path | None = None,
    task: Task | None = None,
) -> RunResult:
    """Run the optimizer and keep its record in a folder.

    Parameters
    ----------
    folder
        Where the record is, or will be.
    resume
        Whether to continue a record that is there.
    source
        The run file, for error messages.
    workers, progress, task
        As in `vinefab.search.loop.Search`.

    Raises
    ------
    BadInputError
        For settings that do not fit together, infeasible spaces, and a folder with a record that
        is not to be resumed, or is of another run.
    CannotWriteError
        Where the record cannot be written.
    """
    with located(source) if source else nullcontext():
        maps = training_maps(settings)
        penalty = penalty_of(settings)
        search = Search.of(settings, maps, penalty, task=task)
    identity = RunIdentity.of(search.settings, maps, penalty)
    with (
        folder_to_fill(folder),
        RunStore.open(folder, identity, maps=maps, resume=resume) as store,
    ):
        return search.run(store=store, progress=progress, workers=workers)


def progress_line(progress: Progress, *, checked: bool) -> str:
    """Return the progress of a run as a line for the user."""
    share = f"  manufacturable {100 * progress.fabricable_share:.0f} %" if checked else ""
    return (
        f"generation {progress.generation}/{progress.generations}  best {progress.best:.4f}  "
        f"mean {progress.mean:.4f} +- {progress.spread:.4f}{share}"
    )


def result_lines(result: RunResult, violations: str = "") -> list[str]:
    """Return the result of a run as lines for the user."""
    best, score = result.best, result.score
    repair = [f"repair: {result.repair}"] if result.repair else []
    drift = "; ".join(result.drift)
    newer = [f"resumed with other package versions, so the last digits may differ: {drift}"]
    failed = f"found no manufacturable robot: the winner violates {violations}"
    return [
        f"run {result.run_id}: {len(result.history)} generations, {result.evaluations} designs "
        f"evaluated, stopped by {result.stopped}",
        *(newer if drift else []),
        *repair,
        f"winner {best.name}: {best.branch_count} branches on {best.depth} levels; "
        f"{_manufacturability(result, violations)}",
        f"on {len(score.evaluations)} fresh poses on the training maps (simulated): "
        f"{composites_text(score.composite)}",
        f"growth: {growth_text(trained_growth(best), [best])}",
        *_repeat_line(best),
        *result.notes,
        result.times.summary,
        *([failed] if violations else []),
    ]


def _repeat_line(best: Design) -> list[str]:
    """Return how to get the winner's score again; nothing where the record does not say."""
    if "seed_of_score" not in best.origin:
        return []
    task, poses, seed = (best.origin[k] for k in ("task", "poses_of_score", "seed_of_score"))
    return [
        f"the same again: vinefab score best.toml --task {task} --poses {poses} --seed {seed} "
        "--map ..., with the training maps in their order and the run's task parameters"
    ]


def _manufacturability(result: RunResult, violations: str) -> str:
    if not result.checked:
        return "manufacturability not checked (`fabricable = false`)"
    if violations:
        return "not manufacturable"
    if result.fabricable:
        return "manufacturable"
    return "manufacturable, but beyond the stricter limits of the search (see `vinefab check`)"


def result_json(result: RunResult) -> str:
    """Return the result of a run as JSON: ``vinefab/run-result-1``."""
    content = {
        "run": result.run_id,
        "winner": result.best.name,
        "growth": trained_growth(result.best).content,
        "notes": list(result.notes),
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
