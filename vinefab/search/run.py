"""A run of the optimizer: its maps, its loop, and its record."""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
from threadpoolctl import threadpool_limits

from vinefab.core.atomic import folder_to_fill
from vinefab.core.compiling import precompile, tuned_meanwhile
from vinefab.core.errors import BadInputError, UnfitInputError, located, values_hidden
from vinefab.core.foreign import calling, ensure_type, is_own
from vinefab.core.front_door import imported_later
from vinefab.core.progress import Progress, announce, each, phase
from vinefab.core.registry import parameter_names, parameter_values
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.growth.options import on_maps
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import MOST_BRANCHES
from vinefab.model.files.run_context import RunRecipe
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map
from vinefab.model.start import with_starts
from vinefab.model.target import out_of_reach
from vinefab.search.evaluator import (
    Begin,
    Evaluator,
    EvaluatorSpec,
    Ledger,
    Penalty,
    PointEvaluator,
    ThreadEvaluator,
)
from vinefab.search.finalists import choose_finalists, minimized, reevaluated, settled
from vinefab.search.free_search import FreeSearch
from vinefab.search.free_space import FreeSpace, space_of
from vinefab.search.manufacturability import (
    BestCheck,
    ManufacturabilityPenalty,
    SpaceQuery,
    refuse_infeasible_space,
    refuse_starts_without_room,
    rules_broken,
    run_profile,
    without_rules,
)
from vinefab.search.needed_code import needed_code
from vinefab.search.optimizers.optimizer import (
    FrontOptimizer,
    Optimizer,
    OptimizerConfig,
    RecommendingOptimizer,
    ScreeningOptimizer,
    StartingOptimizer,
    make_optimizer_config,
    started,
)
from vinefab.search.record.generations import SEARCHING, Finalist, Generation, RunIdentity
from vinefab.search.record.result import (
    RECORD_FILE,
    RunArchive,
    RunResult,
    damage_errors,
    design_of_finalist,
    resumed_limits,
    state_to_text,
)
from vinefab.search.record.store import Recorder, RunStore
from vinefab.search.record.winner import WinnerPrediction
from vinefab.search.settings import (
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
    check_objectives,
    check_only,
    has_own_targets,
    limit_option,
    with_limits,
)
from vinefab.tasks.evaluate import Conditions
from vinefab.tasks.reach import task_targets
from vinefab.tasks.task import Task

if TYPE_CHECKING:
    from vinefab.search import dask_cluster
else:
    dask_cluster = imported_later("vinefab.search.dask_cluster")


AHEAD = 8
"""Generations whose poses are drawn at once, which takes half the time of one by one."""


class Schedule:
    """Poses drawn some generations ahead, with their places on the maps."""

    def __init__(self, evaluator: Evaluator, seed: int) -> None:
        self._evaluator, self._seed = evaluator, seed
        self._drawn: dict[int, Conditions] = {}

    def conditions(self, generation: int) -> Conditions:
        """Return the poses of a generation."""
        redraw = self._evaluator.evaluation.redraw
        draw = generation if redraw else 0
        if draw not in self._drawn:
            count = AHEAD if redraw else 1
            drawn = {draw: self._evaluator.training_conditions(self._seed, draw)}
            # Poses that cannot be drawn further ahead do not matter if the run ends before.
            with suppress(BadInputError):
                for number in range(draw + 1, draw + count):
                    drawn[number] = self._evaluator.training_conditions(self._seed, number)
            self._drawn = drawn
            self._evaluator.prepare_launches(drawn.values())
        return self._drawn[draw]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """A run that is ready to start: all its inputs are valid.

    Examples
    --------
    A task of your own is a frozen dataclass with `name`, `lowest` and `evaluate`:

    >>> Search.of(settings, maps, task=MyTask()).run(workers=2)  # doctest: +SKIP
    """

    settings: RunSettings  # with the name and the parameters of the task
    maps: tuple[Map, ...]
    evaluator: Evaluator
    optimizer: Optimizer  # before its first generation
    fresh_maps: tuple[Map, ...] = ()  # unseen ones that the winner is chosen on
    own_optimizer: OptimizerConfig | None = None  # in place of the one that the settings name

    @classmethod
    def of(
        cls,
        settings: RunSettings,
        maps: Sequence[Map],
        penalty: Penalty | None = None,
        *,
        task: Task | None = None,
        optimizer: OptimizerConfig | None = None,
        fresh_maps: Sequence[Map] = (),
    ) -> "Search":
        """Prepare the search of a run; nothing is evaluated or written yet.

        Parameters
        ----------
        settings
            The run.
        maps
            The training maps.
        penalty
            How far a design is from manufacturable; needed when the settings ask for manufacturable
            designs, not used otherwise. When it is a `FullCheck` too, only designs that pass the
            full check can win, as long as there is one.
        task
            A task object, in place of the task that the settings name.
        optimizer
            An object with ``start``, in place of the optimizer that the settings name.
        fresh_maps
            Maps that the winner is chosen on; none: on fresh poses on the training maps.

        Raises
        ------
        BadInputError
            For settings that do not fit together, and spaces that no search could use.
        """
        if task is not None:
            own = {name: getattr(task, name) for name in parameter_names(type(task))}
            settings = settings.changed(task=PartSettings(name=task.name, parameters=own))
        if optimizer is not None:
            with calling(f"optimizer {type(optimizer).__name__!r}", optimizer):
                own = parameter_values(optimizer)
                named = PartSettings(name=type(optimizer).__name__, parameters=own)
            settings = settings.changed(optimizer=named)
        on_maps(settings.growth, maps)  # a surface that is not known is refused here
        spec = EvaluatorSpec(settings=settings, maps=tuple(maps), penalty=penalty, task=task)
        evaluator = Evaluator.of(spec)
        config = optimizer or make_optimizer_config(
            settings.optimizer.name, settings.optimizer.parameters
        )
        seed, population = settings.search.seed, settings.search.population
        axes = evaluator.space.levels.axes
        asked = started(config, settings.optimizer.name, axes, population, seed)
        check_objectives(settings.objectives, settings.task.name, settings.optimizer.name)
        check_only(settings.space.only, len(settings.start_from))
        with calling(f"optimizer {settings.optimizer.name!r}", asked):
            if settings.objectives and isinstance(asked, FrontOptimizer):
                asked.set_lowest(evaluator.lowest)
            # A user's own penalty may take longer than growth: screening asks for many.
            if evaluator.screens and isinstance(asked, ScreeningOptimizer):
                asked.screen_by(evaluator.penalties_of_levels)
        if isinstance(evaluator.space, FreeSpace):
            if settings.objectives:
                problem = "is 'free', and task.objectives names several"
                raise UnfitInputError("space.tree", problem, "name one objective, or leave it out")
            asked = FreeSearch.of(evaluator.space, asked, settings.search)
            if evaluator.screens:
                asked.screen_by(evaluator.penalties)
        if settings.start_from and not isinstance(asked, StartingOptimizer):
            problem = f"optimizer {settings.optimizer.name!r} cannot begin at designs"
            remedy = "leave it out, or use the optimizer islands"
            raise UnfitInputError("optimizer.start_from", problem, remedy)
        if settings.start_from and isinstance(asked, StartingOptimizer):
            with calling(f"optimizer {settings.optimizer.name!r}", asked):
                asked.start_from([np.array(point) for point in settings.start_from])
        search = cls(
            settings=settings,
            maps=spec.maps,
            evaluator=evaluator,
            optimizer=asked,
            fresh_maps=tuple(fresh_maps),
            own_optimizer=optimizer,
        )
        conditions = evaluator.training_conditions(seed, 0)
        evaluator.launches(conditions)
        space = evaluator.space
        if int(space.smallest.sizes[0]) > MOST_BRANCHES:
            problem = f"its smallest design has more than {MOST_BRANCHES} branches"
            raise UnfitInputError("space", problem, "allow fewer levels or branches")
        space.refuse_limits_without_designs()
        refuse_starts_without_room(evaluator, conditions)
        refuse_distant_targets(evaluator.spec)
        return search

    def run(
        self,
        *,
        store: RunStore | None = None,
        workers: int | PointEvaluator = 1,
    ) -> RunResult:
        """Search, and evaluate the finalists; every generation is announced as a `SearchProgress`.

        A generation is recorded while the next one is evaluated, so that recording takes no time.

        Parameters
        ----------
        store
            Record of the run; what it holds already is not evaluated again. None keeps no record.
        workers
            Number of threads, or a point evaluator. Results do not depend on it.

        Raises
        ------
        BadInputError
            When no point of the space had a valid design, or the optimizer left the space.
        CannotWriteError, UnreadableFileError
            For a record that cannot be written, or is damaged.
        """
        settings, history = self.settings, list[Generation]()
        if store is not None:
            history = store.generations()
            if history:
                with self._asking(), damage_errors(store.path):
                    self.optimizer.restore(store.optimizer_state())
        points = ThreadEvaluator(workers) if isinstance(workers, int) else workers
        ledger = Ledger(points.count)
        schedule = Schedule(self.evaluator, settings.search.seed)
        check = BestCheck(self.evaluator, history)
        with (
            # Decompositions of small matrices: on more threads they take far longer, and their
            # last digits, and so the whole search, would depend on the number of processors.
            threadpool_limits(limits=1, user_api="blas"),
            points.started(self.evaluator, ledger) as begin,
            Recorder(store, settings.search, ledger, check.judged) as recorder,
        ):
            announce(
                Progress(phase=SEARCHING, done=len(history), total=settings.search.generations)
            )
            while (stopped := why_stop(history, settings.search)) is None:
                number = len(history)
                last = self._generation(number, schedule, begin, recorder, ledger, check)
                history.append(last)
                recorder.note(history, self._state())
            finalists, repair = self._final(history, store, begin, ledger, recorder)
        identity = store.identity if store is not None else RunIdentity.of(settings, self.maps)
        notes = (*check.notes(finalists), *self._without_rules(finalists))
        if store is not None:
            with ledger.spending("store"):
                store.finish(finalists, stopped, ledger.split(), repair, notes)
        return RunResult(
            run_id=identity.run_id,
            best=design_of_finalist(
                finalists[0], settings, identity.run_id, identity.versions, self.maps
            ),
            finalists=finalists,
            history=tuple(history),
            stopped=stopped,
            times=ledger.split(),
            checked=settings.evaluation.fabricable,
            repair=repair,
            notes=(*self.evaluator.notes, *points.notes, *notes),
            drift=store.drift if store is not None else (),
            extensions=store.extensions if store is not None else (),
        )

    def _without_rules(self, finalists: Sequence[Finalist]) -> tuple[str, ...]:
        """Return the reason for a winner's missed targets: the rules, or the space; empty without.

        A short search without rules tells them apart.
        """
        settings, targets = self.settings, finalists[0].score.targets
        asked = self.evaluator.penalty is not None and not settings.objectives
        if targets is None or targets.all_touched or not asked:
            return ()
        with phase("a search without rules"):
            free = Search.of(without_rules(settings), self.maps, optimizer=self.own_optimizer).run()
        if free.targets is None or len(free.targets.missed) >= len(targets.missed):
            return ("robots that may break the rules touch no more: length or levels are missing",)
        rules = rules_broken(self.evaluator, [one.x for one in free.finalists])
        more = f"robots that may break the rules touch more ({free.targets.headline})"
        return (f"{more}, but break {rules}",)

    def _generation(
        self,
        number: int,
        schedule: Schedule,
        begin: Begin,
        recorder: Recorder,
        ledger: Ledger,
        check: BestCheck,
    ) -> Generation:
        """Ask, evaluate and tell."""
        began = time.perf_counter()
        with ledger.spending("optimizer"), self._asking():
            asked = self.optimizer.ask()
        ensure_type(self._what, self.optimizer, "points", asked, np.ndarray)
        shaped = asked.ndim == 2 and len(asked) > 0 and asked.shape[1] == len(self.evaluator.space)
        if not (shaped and asked.dtype.kind == "f" and ((asked >= 0.0) & (asked <= 1.0)).all()):
            key = f"optimizer {self.settings.optimizer.name}"
            raise UnfitInputError(key, "it asks for points outside the space", "ask for 0 to 1")
        # Copied, because an optimizer may reuse the arrays that it returns or is given.
        x = np.array(asked, dtype=np.float64)
        with ledger.spending("evaluating"):
            conditions = schedule.conditions(number)
            finish = begin(x, conditions)
            recorder.write()
            if number + 1 < self.settings.search.generations:
                schedule.conditions(number + 1)
            evaluations = finish()
        composite = self.evaluator.composites(evaluations.score, conditions.weights)
        costs = self.evaluator.joint_costs(x)
        with ledger.spending("evaluating"):
            penalty = check.penalties(x, composite, evaluations.penalty, costs)
        fitness = self.evaluator.fitness(composite, penalty, costs)
        terms = self.evaluator.term_means(evaluations.terms, conditions.weights)
        with ledger.spending("optimizer"), self._asking():
            further = self.settings.further_objectives
            if further and isinstance(self.optimizer, FrontOptimizer):
                values = minimized(asked, terms, self.evaluator.space, further)
                self.optimizer.tell_costs(asked, fitness.copy(), values)
            else:
                self.optimizer.tell(asked, fitness.copy())
        return Generation(
            number=number,
            x=x,
            fitness=fitness,
            composite=composite,
            penalty=penalty,
            terms=terms,
            seconds=time.perf_counter() - began,
        )

    @property
    def _what(self) -> str:
        return f"optimizer {self.settings.optimizer.name!r}"

    def _asking(self) -> AbstractContextManager[None]:
        """Return the boundary around the optimizer."""
        return calling(self._what, self.optimizer)

    def _state(self) -> Mapping[str, object]:
        """Return the optimizer's state; that of a foreign one must be one that can be recorded."""
        with self._asking():
            state = self.optimizer.state()
            if not is_own(self.optimizer):
                state_to_text(state)
        return state

    def _final(
        self,
        history: Sequence[Generation],
        store: RunStore | None,
        begin: Begin,
        ledger: Ledger,
        recorder: Recorder,
    ) -> tuple[tuple[Finalist, ...], str]:
        """Return the finalists, from the record or evaluated now, and the repair's message."""
        evaluator, settings = self.evaluator, self.settings
        if store is not None and (recorded := store.finalists(evaluator.space)):
            return recorded, store.repair
        count, further = settings.evaluation.finalists, settings.further_objectives
        held = list[Floats]()
        if isinstance(self.optimizer, RecommendingOptimizer):
            with self._asking():
                held = self.optimizer.recommended()
        conditions = evaluator.final_conditions(settings.search.seed)
        for by_table in (True, False):
            recorder.report()
            choice = choose_finalists(
                history, evaluator, count, further, held=held, by_table=by_table
            )
            with ledger.spending("evaluating"):
                finalists = reevaluated(choice, begin, conditions, evaluator, self.fresh_maps)
            if not (choice.checked and by_table):
                break
            if found := settled(finalists, conditions, evaluator):
                return found, choice.repair
        return finalists, choice.repair


def refuse_distant_targets(spec: EvaluatorSpec) -> None:
    """Refuse targets that lie beyond the longest robot of the space from every start."""
    longest_mm = spec.settings.space.longest_mm
    for task in spec.tasks:
        for world in spec.maps:
            starts = [
                shapely.Point(start.pose.x_mm, start.pose.y_mm).buffer(
                    max(math.hypot(start.spread_x_mm, start.spread_y_mm), 1e-6)
                )
                if start.area is None
                else start.area
                for start in world.starts
            ]
            targets = task_targets(task, world)
            for place, far, most in out_of_reach(targets, starts, longest_mm):
                key = "task.targets" if getattr(task, "own", ()) else "targets"
                raise BadInputError(f"{key}[{place}]", far, f"within {most} (space.length_mm)")


def why_stop(history: Sequence[Generation], search: SearchSettings) -> str | None:
    """Return the reason why a run with such a history ends, or None if it continues."""
    if len(history) >= search.generations:
        return "generations"
    if search.evaluations and sum(len(g.fitness) for g in history) >= search.evaluations:
        return "evaluations"
    if search.stall_generations and len(history) > search.stall_generations:
        best = [generation.best for generation in history]
        before = max(best[: -search.stall_generations])
        if max(best[-search.stall_generations :]) <= before + search.stall_tolerance * abs(before):
            return "stall"
    if search.wall_time_s and sum(g.seconds for g in history) >= search.wall_time_s:
        return "wall_time"
    return None


def generated_maps(maps: MapSettings) -> tuple[Map, ...]:
    """Return the maps that an environment generates for a run's seeds."""
    options = maps.environment_options()
    make = ENVIRONMENTS[maps.environment].generate
    seeds = each("maps", range(maps.seed, maps.seed + maps.count))
    return _started((make(seed, options) for seed in seeds), maps)


def training_maps(settings: RunSettings) -> tuple[Map, ...]:
    """Return the training maps of a run: read from its files, or generated."""
    if settings.maps.files:
        with values_hidden():
            files = each("maps", settings.maps.files)
            worlds = [Map.read(path) for path in files]
        return _started(worlds, settings.maps)
    return generated_maps(settings.maps.changed(count=settings.map_count))


FRESH_MAPS, _STREAM = 20, 1417
"""Maps by which a winner is chosen that the search has not seen, and the stream of their seeds."""


def chooses_on_fresh_maps(settings: RunSettings) -> bool:
    """Return whether the winner of a run is chosen on maps that the search has not seen."""
    maps = settings.maps
    places = maps.start is not None or has_own_targets(settings)
    return settings.evaluation.finalists_by == "fresh_maps" and not maps.files and not places


def fresh_maps(settings: RunSettings) -> tuple[Map, ...]:
    """Return maps by which the winner is chosen; none where that is done on the training maps.

    Their seeds lie far from usual first seeds, so that they are neither training maps of another
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
    """Return the rules and limits that a run's winner violates; empty if none, or none was checked.

    Without a profile it is read as the run's settings name it.
    """
    if result.fabricable:
        return ""
    rules = ""
    if result.checked:
        penalty = ManufacturabilityPenalty(profile=profile or run_profile(settings.evaluation))
        rules = penalty.violations(result.best)
    limits = space_of(settings.space, settings.build).exceeded_limits(result.best)
    return ", ".join([*([rules] if rules else []), *limits])


def make_point_evaluator(workers: int | None, cluster: str | None) -> PointEvaluator:
    """Return the point evaluator: threads, or the workers of a cluster and threads."""
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
    limits: Mapping[str, float] | None = None,
    workers: int | PointEvaluator = 1,
    predict: Callable[[Search, RunResult], WinnerPrediction] | None = None,
    source: Path | None = None,
    task: Task | None = None,
    optimizer: OptimizerConfig | None = None,
) -> RunResult:
    """Run the optimizer and keep its record in a folder.

    Parameters
    ----------
    folder
        Where the record is, or will be.
    resume
        Whether to continue a record that is there.
    limits
        Limits to raise in it, by their names in `LIMIT_NAMES`.
    predict
        Returns what is predicted of the winner elsewhere; it is recorded, and its ``origin``
        stands in the winner's.
    source
        The run file, for error messages.
    workers, task, optimizer
        As in `vinefab.search.run.Search`.

    Raises
    ------
    BadInputError
        For settings that do not fit together, infeasible spaces, and a folder with a record that
        is not to be resumed, or is of another run.
    CannotWriteError
        Where the record cannot be written.
    """
    if resume:
        settings = _raised(resumed_limits(folder, settings), limits or {}, folder)
    with located(source) if source else nullcontext():
        maps = training_maps(settings)
        penalty = penalty_of(settings)
        fresh = fresh_maps(settings)
        search = Search.of(
            settings, maps, penalty, task=task, optimizer=optimizer, fresh_maps=fresh
        )
    # Whatever is refused is refused before; compiling may take a minute.
    code = needed_code(settings, maps) if task is None else ()
    precompile(code)
    identity = RunIdentity.of(search.settings, maps, penalty)
    with (
        tuned_meanwhile(code),
        folder_to_fill(folder),
        RunStore.open(
            folder, identity, maps=maps, resume=resume, raises_limits=limits is not None
        ) as store,
    ):
        kept = store.kept("recipe", RunRecipe)
        recipe = kept or recipe_of(settings)
        if recipe is not None and kept is None:
            store.keep("recipe", recipe)
        result = search.run(store=store, workers=workers)
        if recipe is not None:
            result = result.with_recipe(recipe, folder)
        prediction = store.kept("prediction", WinnerPrediction)
        if predict is not None and prediction is None:
            prediction = predict(search, result)
            store.keep("prediction", prediction)
    return result.with_prediction(prediction) if prediction else result


def _raised(settings: RunSettings, limits: Mapping[str, float], folder: Path) -> RunSettings:
    """Return settings with raised limits, unless a run that has ended would end all the same."""
    raised = settings.changed(search=with_limits(settings.search, limits))
    path = folder / RECORD_FILE
    if raised == settings or not path.is_file():
        return raised
    archive = RunArchive.read(path)
    stopped = why_stop(archive.history, raised.search)
    if archive.stopped and stopped is not None:
        option = next(iter(limits))
        if stopped in ("generations", "evaluations", "wall_time"):
            name = "wall_time_s" if stopped == "wall_time" else stopped
            problem = f"the run has stopped by {limit_option(name)}"
            remedy = f"give more of {limit_option(name)}"
        else:
            problem = "the run has stopped because its best design improves no more"
            remedy = "begin another run"
        raise UnfitInputError(limit_option(option), problem, remedy, path)
    return raised
