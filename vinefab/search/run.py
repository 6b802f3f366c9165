"""A run of the optimizer with its maps, penalty and record, and its messages to the user."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vinefab.core.atomic import folder_to_fill
from vinefab.core.compiling import imported_later
from vinefab.core.errors import BadInputError, located, values_hidden
from vinefab.core.rng import child
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.files.run_context import RunRecipe
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map
from vinefab.model.start_place import with_starts
from vinefab.search.evaluator import Penalty
from vinefab.search.loop import Search, why_stop
from vinefab.search.manufacturability import (
    ManufacturabilityPenalty,
    SpaceQuery,
    refuse_infeasible_space,
    run_profile,
)
from vinefab.search.parallel.point_evaluator import PointEvaluator, ThreadEvaluator
from vinefab.search.record.generations import Progress, RunIdentity
from vinefab.search.record.result import RECORD_FILE, RunArchive, RunResult, resumed_limits
from vinefab.search.record.store import RunStore
from vinefab.search.settings import (
    MapSettings,
    RunLimits,
    RunSettings,
    has_own_targets,
    limit_option,
)
from vinefab.search.space import Space
from vinefab.tasks.task import Task

if TYPE_CHECKING:
    from vinefab.search.parallel import dask_cluster
else:
    dask_cluster = imported_later("vinefab.search.parallel.dask_cluster")


def generated_maps(maps: MapSettings) -> tuple[Map, ...]:
    """Return the maps that an environment generates for a run's seeds."""
    options = maps.environment_options()
    make = ENVIRONMENTS[maps.environment].make
    return _started((make(maps.seed + index, options) for index in range(maps.count)), maps)


def training_maps(settings: RunSettings) -> tuple[Map, ...]:
    """Return the training maps of a run: read from its files, or generated."""
    if settings.maps.files:
        with values_hidden():
            worlds = [Map.read(path) for path in settings.maps.files]
        return _started(worlds, settings.maps)
    return generated_maps(settings.maps)


FRESH_MAPS, _STREAM = 20, 1417
"""Maps by which a winner is chosen that the search has not seen, and the stream of their seeds."""


def chooses_on_fresh_maps(settings: RunSettings) -> bool:
    """Return whether the winner of a run is chosen on maps that the search has not seen."""
    maps = settings.maps
    places = maps.start is not None or has_own_targets(settings)
    return settings.evaluation.finalists_by == "fresh_maps" and not maps.files and not places


def fresh_maps(settings: RunSettings) -> tuple[Map, ...]:
    """Return maps by which the winner is chosen; none where that is done on the training maps.

    Their seeds lie where nobody begins to count, so that they are neither training maps of another
    run nor maps that winners are tested on.
    """
    if not chooses_on_fresh_maps(settings):
        return ()
    first = int(child(settings.search.seed, _STREAM).integers(2**40, 2**41))
    return generated_maps(settings.maps.changed(seed=first, count=FRESH_MAPS))


def first_map(settings: RunSettings) -> Map:
    """Return the first of the training maps."""
    maps = settings.maps.changed(count=1, files=settings.maps.files[:1])
    return training_maps(settings.changed(maps=maps))[0]


def _started(worlds: Iterable[Map], maps: MapSettings) -> tuple[Map, ...]:
    """Return maps with the start that a run gives them, or with their own."""
    if maps.start is None:
        return tuple(worlds)
    return tuple(with_starts(world, (maps.start,), "maps.start") for world in worlds)


def penalty_of(settings: RunSettings) -> Penalty | None:
    """Return the penalty of a run's recipe; None if manufacturability is not checked."""
    if not settings.evaluation.fabricable:
        return None
    penalty = ManufacturabilityPenalty(profile=run_profile(settings.evaluation))
    refuse_infeasible_space(SpaceQuery.of(settings, penalty.profile, penalty.sheet_mm))
    return penalty


def recipe_of(settings: RunSettings) -> RunRecipe | None:
    """Return the recipe of a run with its files; None where it names and asks for none."""
    evaluation = settings.evaluation
    if not (evaluation.fabricable or evaluation.recipe):
        return None
    return RunRecipe.of(evaluation.recipe or DEFAULT_RECIPE)


def violations_of(
    result: RunResult, settings: RunSettings, profile: LaserProfile | None = None
) -> str:
    """Return which rules and limits a run's winner violates; empty if none, or none was checked.

    Parameters
    ----------
    profile
        The recipe that designs were checked with; None: read as the run's settings name it.
    """
    if result.fabricable:
        return ""
    rules = ""
    if result.checked:
        penalty = ManufacturabilityPenalty(profile=profile or run_profile(settings.evaluation))
        rules = penalty.violations(result.best)
    limits = Space(settings.space, settings.build).exceeded_limits(result.best)
    return ", ".join([*([rules] if rules else []), *limits])


def make_point_evaluator(workers: int | None, cluster: str | None) -> PointEvaluator:
    """Return the point evaluator: threads, or the workers of a cluster with threads beside them."""
    if cluster is None:
        if workers == 0:
            raise BadInputError("--workers", 0, "1 or more; 0 only with --cluster")
        return ThreadEvaluator(1 if workers is None else workers)
    return dask_cluster.DaskEvaluator(cluster, threads=workers)


def run_search(  # noqa: PLR0913  options by keyword
    settings: RunSettings,
    folder: Path,
    *,
    resume: bool = False,
    limits: RunLimits | None = None,
    workers: int | PointEvaluator = 1,
    progress: Callable[[Progress], None] | None = None,
    predict: Callable[[Search, RunResult], Mapping[str, Any]] | None = None,
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
    limits
        Limits to raise in it.
    predict
        Returns what is predicted of the winner elsewhere, in plain values; it is recorded, and
        what it has under ``origin`` stands in the winner's origin.
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
    if resume:
        settings = _raised(resumed_limits(folder, settings), limits or RunLimits(), folder)
    with located(source) if source else nullcontext():
        maps = training_maps(settings)
        penalty = penalty_of(settings)
        search = Search.of(settings, maps, penalty, task=task, fresh_maps=fresh_maps(settings))
    identity = RunIdentity.of(search.settings, maps, penalty)
    with (
        folder_to_fill(folder),
        RunStore.open(
            folder, identity, maps=maps, resume=resume, raises_limits=limits is not None
        ) as store,
    ):
        kept = store.kept("recipe")
        recipe = RunRecipe(**kept) if kept else recipe_of(settings)
        if recipe is not None and not kept:
            store.keep("recipe", asdict(recipe))
        result = search.run(store=store, progress=progress, workers=workers)
        if recipe is not None:
            result = result.with_recipe(recipe, folder)
        prediction = store.kept("prediction")
        if predict is not None and not prediction:
            prediction = predict(search, result)
            store.keep("prediction", prediction)
    return result.with_prediction(prediction) if prediction else result


def _raised(settings: RunSettings, limits: RunLimits, folder: Path) -> RunSettings:
    """Return settings with raised limits, unless a run that has ended would end all the same."""
    raised = settings.changed(search=limits.raised(settings.search))
    path = folder / RECORD_FILE
    if raised == settings or not path.is_file():
        return raised
    archive = RunArchive.read(path)
    stopped = why_stop(archive.history, raised.search)
    if archive.stopped and stopped is not None:
        option, value = next(iter(limits.given.items()))
        if stopped in ("generations", "evaluations", "wall_time"):
            name = "wall_time_s" if stopped == "wall_time" else stopped
            allowed = f"more of {limit_option(name)}, by which the run has stopped"
        else:
            allowed = "nothing: the run has stopped because its best design improves no more"
        raise BadInputError(limit_option(option), value, allowed, path)
    return raised


def progress_line(progress: Progress, *, checked: bool) -> str:
    """Return the progress of a run as a line for the user."""
    if progress.stage:
        return progress.stage
    made = f"  manufacturable: {progress.manufacturable}" if checked else ""
    touched = f" ({progress.targets_text})" if progress.targets_text else ""
    return (
        f"generation {progress.generation}/{progress.generations}  "
        f"best {progress.best:.4f}{touched}  "
        f"mean {progress.mean:.4f} +- {progress.spread:.4f}{made}"
    )
