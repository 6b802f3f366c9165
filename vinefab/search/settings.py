"""The settings of a run: run files (TOML, schema ``vinefab/run-1``), nouns and records at once.

In a run file only ``schema`` is required. Further keys of ``[task]`` and ``[optimizer]`` are the
parameters of the task and the optimizer named there.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from annotated_types import Ge, Le, Unit
from pydantic import BeforeValidator, ConfigDict, Field, InstanceOf, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError, located, nearest, values_hidden
from vinefab.core.limits import MOST_FIRST_SEED
from vinefab.core.plain_text import counted, visible
from vinefab.core.registry import with_parameters
from vinefab.core.table import Table, validated
from vinefab.core.validation import SMALLEST
from vinefab.growth.options import GrowthOptions, measured_values
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.contacts import read_contacts
from vinefab.model.design import Design, check_levels
from vinefab.model.files import toml
from vinefab.model.files.shipped import locate, names, user_names
from vinefab.model.map import Start
from vinefab.model.score import STANDARD_DEVIATION
from vinefab.model.start import (
    AnyStart,
    StartPlace,
    start_given,
    start_record,
)
from vinefab.search.free_space import space_of
from vinefab.search.optimizers.optimizer import make_optimizer_config
from vinefab.search.space import COSTS, SYMMETRIC_PERCENT, BuildSettings, SpaceSettings
from vinefab.tasks import TASKS, make_task
from vinefab.tasks.task import Task

MOST_SECONDS = 1e8

MOST_MAPS = 1000

MAP_SETS = 20
"""Times as many maps as a generation is trained on that a search of free trees draws from."""


class MapSettings(Table):
    """Table ``[maps]``: the training maps, generated or from files."""

    environment: Annotated[str, Doc("a generator; see `vinefab map --help`")] = "grid"
    count: Annotated[int, Ge(1), Le(MOST_MAPS), Doc("of maps")] = 4
    seed: Annotated[
        int, Ge(0), Le(MOST_FIRST_SEED), Doc("of the first map; the next have the next seeds")
    ] = 1
    options: Annotated[Mapping[str, Any], Doc("of the generator")] = {}
    files: Annotated[
        tuple[Path, ...],
        Doc("map files, relative to the run file, in place of all above"),
    ] = ()
    start: Annotated[
        InstanceOf[Start] | InstanceOf[StartPlace] | None,
        BeforeValidator(lambda given: None if given is None else start_given(given, "")),
        Doc("of every map, in place of the map's start"),
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _paths(cls, given: Any) -> Any:  # noqa: ANN401  what pydantic hands on
        if not isinstance(given, Mapping):
            return given
        values = dict(given)
        if "files" in values:
            files = values["files"]
            listed = (files,) if isinstance(files, str | PathLike) else tuple(files)
            for one in listed:
                if not isinstance(one, str | PathLike):
                    raise BadInputError("files", one, "paths of map files; Map.write makes one")
            values["files"] = tuple(Path(one) for one in listed)
        return values

    def environment_options(self) -> Any:  # noqa: ANN401  every environment has its own
        """Return the options of the environment, checked."""
        options = ENVIRONMENTS[self.environment].options
        return with_parameters(options, "maps.options", self.options)


class PartSettings(Table):
    """A part from a registry, by its name, with the parameters that differ from its defaults."""

    name: Annotated[str, Doc("in the registry")]
    parameters: Annotated[Mapping[str, Any], Doc("names and values")] = {}

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, given: Any) -> Any:  # noqa: ANN401  what pydantic hands on
        return {"name": given} if isinstance(given, str) else given


class SearchSettings(Table):
    """How long and with which seed the optimizer searches: a part of ``[optimizer]``."""

    population: Annotated[int, Ge(2), Le(100_000), Doc("designs of a generation")] = 20
    generations: Annotated[int, Ge(1), Le(1_000_000), Doc("at most")] = 15
    seed: Annotated[int, Ge(0), Le(MOST_FIRST_SEED), Doc("of everything random but the maps")] = 1
    stall_generations: Annotated[
        int, Ge(0), Le(1_000_000), Doc("without improvement that end it; 0: never")
    ] = 0
    stall_tolerance: Annotated[
        float, Ge(0), Le(1), Doc("what counts as improvement, relative to the best fitness")
    ] = 0.0
    evaluations: Annotated[int, Ge(0), Le(2**53), Doc("of designs that end it; 0: never")] = 0
    wall_time_s: Annotated[
        float,
        Ge(0),
        Le(MOST_SECONDS),
        Unit("s"),
        Doc("of all sessions that ends it, not reproducibly; 0: never"),
    ] = 0.0


class EvaluationSettings(Table):
    """Table ``[evaluation]``: how a design's fitness is computed."""

    poses_per_map: Annotated[
        int, Ge(1), Le(10_000), Doc("drawn for every generation, the same for all its designs")
    ] = 1
    maps_per_generation: Annotated[int, Ge(0), Le(1000), Doc("drawn for each; 0: all")] = 0
    pose_range: Annotated[
        float, Ge(0), Le(10), Doc("share of the starts' range that poses are drawn from")
    ] = 1.0
    composite: Annotated[
        Literal["mean", "best", "min_deviation", "single"],
        Doc("how scores are combined; single: of one evaluation, from one pose on one map"),
    ] = "mean"
    reference_deviation: Annotated[
        float, Ge(SMALLEST), Le(1e6), Doc("of scores, that earns nothing in min_deviation")
    ] = STANDARD_DEVIATION
    redraw: Annotated[bool, Doc("new poses, and maps where not all, for every generation")] = True
    fabricable: Annotated[bool, Doc("designs that break rules rank below all others")] = True
    recipe: Annotated[
        str,
        Doc(
            "whose limits decide that: a file, relative to the run file, or a name; empty: the "
            "shipped one"
        ),
    ] = ""
    head_on_weight: Annotated[
        float, Ge(0), Le(1e3), Doc("of branches that stop head-on: what their share costs a score")
    ] = 0.0
    penalty_weight: Annotated[
        float, Ge(SMALLEST), Le(1e6), Doc("fitness that one unit of broken rules costs")
    ] = 1.0
    finalists: Annotated[
        int, Ge(1), Le(10_000), Doc("best designs that are scored again at the end")
    ] = 8
    final_poses_per_map: Annotated[int, Ge(1), Le(10_000), Doc("fresh ones, for them")] = 5
    finalists_by: Annotated[
        Literal["fresh_maps", "training", "contact_range"],
        Doc(
            "where that is: on maps that the search did not see, where maps are generated and the "
            "run names no places; on the training maps; or there over the range of contacts"
        ),
    ] = "fresh_maps"
    joint_weight: Annotated[
        float,
        Ge(0),
        Le(1e3),
        Doc("fitness that every sleeve joint costs, with build.pieces"),
    ] = 0.0

    @model_validator(mode="after")
    def _single_is_one(self) -> "EvaluationSettings":
        if self.composite == "single":
            for name, least in (("poses_per_map", "1"), ("maps_per_generation", "0 or 1")):
                if getattr(self, name) > 1:
                    allowed = f"{least} with composite = 'single', which has one evaluation"
                    raise BadInputError(name, getattr(self, name), allowed)
        return self


class RunTables(Table):
    """The tables of a run that are the same in files and in Python."""

    maps: Annotated[MapSettings, Doc("the training maps")] = MapSettings()
    space: Annotated[SpaceSettings, Doc("what may vary")] = SpaceSettings()
    build: Annotated[BuildSettings, Doc("how every design is made")] = BuildSettings()
    growth: Annotated[GrowthOptions, Doc("how robots grow")] = GrowthOptions()
    evaluation: Annotated[EvaluationSettings, Doc("how a design is judged")] = EvaluationSettings()
    name: Annotated[str, Doc("of the run and its best design; left out of a file: the file's")] = (
        "run"
    )


class RunSettings(RunTables):
    """A whole run; `changed` gives another one."""

    task: Annotated[PartSettings, Doc("what is scored")] = PartSettings(name="coverage")
    optimizer: Annotated[PartSettings, Doc("what searches")] = PartSettings(name="islands")
    search: Annotated[SearchSettings, Doc("how long it searches")] = SearchSettings()
    objectives: Annotated[
        tuple[str, ...], Field(strict=False), Doc("for a front: the task, other tasks and costs")
    ] = ()
    other_parameters: Annotated[
        Mapping[str, Mapping[str, Any]], Doc("of the other tasks among the objectives")
    ] = {}
    start_from: Annotated[
        tuple[Annotated[tuple[float, ...], Field(strict=False)], ...],
        Field(strict=False),
        Doc("points of the space at which the optimizer begins, as well as at the usual ones"),
    ] = ()

    @classmethod
    def read(cls, name_or_path: str | PathLike[str]) -> "RunSettings":
        """Return the settings in a run file.

        Parameters
        ----------
        name_or_path
            A run file (TOML, ``vinefab/run-1``), or the name of a shipped one.

        Raises
        ------
        BadInputError
            If a value in the file cannot be used.
        UnknownNameError
            If there is no run file of that name.
        UnreadableFileError
            If there is no such file, or it is not TOML.

        Examples
        --------
        >>> RunSettings.read("grid_coverage").task.name
        'coverage'
        """
        return read_run(name_or_path)

    @property
    def takes_fresh_maps(self) -> bool:
        """Whether each generation trains on other maps: free trees fit few maps too well."""
        maps = self.maps
        places = maps.start is not None or has_own_targets(self)
        return self.space.tree == "free" and not maps.files and not places

    @property
    def map_count(self) -> int:
        """Number of training maps, all generations together."""
        return min(MOST_MAPS, self.maps.count * (MAP_SETS if self.takes_fresh_maps else 1))

    @property
    def maps_per_generation(self) -> int:
        """Number of maps that a generation is trained on; 0: all."""
        asked = self.evaluation.maps_per_generation
        if self.evaluation.composite == "single":
            return 1
        return asked or (self.maps.count if self.takes_fresh_maps else 0)

    @property
    def further_objectives(self) -> tuple[str, ...]:
        """The objectives other than the task's score, in their order: other tasks and costs."""
        return tuple(name for name in self.objectives if name != self.task.name)

    @property
    def costs(self) -> tuple[str, ...]:
        """The objectives that are costs, in their order."""
        return tuple(name for name in self.objectives if name in COSTS)

    @property
    def front_axis(self) -> str:
        """The further objective that fronts are ordered and drawn by: the first cost, if any."""
        return (*self.costs, *self.further_objectives)[0]

    @property
    def other_tasks(self) -> tuple[PartSettings, ...]:
        """The other tasks among the objectives, in their order."""
        names = [name for name in self.further_objectives if name not in COSTS]
        given = self.other_parameters
        return tuple(PartSettings(name=name, parameters=given.get(name, {})) for name in names)


# --- Limits that `--resume` raises ----------------------------------------------------------------

LIMIT_NAMES = ("generations", "evaluations", "wall_time_s")


def limit_option(name: str) -> str:
    """Return the command's option for a limit."""
    return f"--{name.replace('_', '-')}"


def with_limits(search: SearchSettings, limits: Mapping[str, float]) -> SearchSettings:
    """Return settings with limits that `--resume` raises.

    Parameters
    ----------
    limits
        Some of `LIMIT_NAMES`, each at least what the run has; 0 lifts the limit of the last two.

    Raises
    ------
    BadInputError
        For a limit below that of the settings.
    """
    for name, value in limits.items():
        before = getattr(search, name)
        can_be_lifted = name != "generations"
        is_lifted = can_be_lifted and value == 0
        if not is_lifted and (value < before or (can_be_lifted and before == 0)):
            has = f"at least the {before} that the run has" if before else "0: it has no limit"
            lifted = ", or 0 for no limit" if can_be_lifted and before else ""
            raise BadInputError(limit_option(name), value, f"{has}{lifted}")
    try:
        return search.changed(**limits)
    except BadInputError as error:
        raise error.under(limit_option(error.key)) from None


# --- As plain values ------------------------------------------------------------------------------


def plain_settings(settings: object) -> object:
    """Return settings as plain values for JSON, the same for the same settings."""
    if isinstance(settings, AnyStart):
        return start_record(settings)
    if isinstance(settings, Table):
        # What a field leaves out of files is left out here: earlier records have no such key.
        values = {
            name: getattr(settings, name)
            for name, field in type(settings).model_fields.items()
            if name != "schema_"
            and not (field.exclude_if and field.exclude_if(getattr(settings, name)))
        }
        return {name: plain_settings(value) for name, value in values.items()}
    if is_dataclass(settings):
        return {f.name: plain_settings(getattr(settings, f.name)) for f in fields(settings)}
    if isinstance(settings, Mapping):
        return {str(key): plain_settings(settings[key]) for key in sorted(settings)}
    if isinstance(settings, list | tuple):
        return [plain_settings(entry) for entry in settings]
    return settings if isinstance(settings, bool | int | float | str | None) else str(settings)


def settings_from_plain(record: Mapping[str, Any]) -> RunSettings:
    """Return the settings of `plain_settings`."""
    return RunSettings(**{name: record[name] for name in RunSettings.model_fields})


# --- Run files ------------------------------------------------------------------------------------


class TaskTable(Table):
    """Table ``[task]``; that of another task among the objectives is ``[task.NAME]`` in it."""

    model_config = ConfigDict(extra="allow")

    name: Annotated[str, Doc("coverage, reach, anchoring, or of another package")] = "coverage"
    objectives: Annotated[
        tuple[str, ...], Field(strict=False), Doc("for a front: tasks and costs")
    ] = ()


class OptimizerTable(SearchSettings):
    """Table ``[optimizer]``; without a name the optimizer that does best."""

    model_config = ConfigDict(extra="allow")

    name: Annotated[
        str,
        Doc("islands, cmaes, evolution, particleswarm, pso, nsga2 or random; empty: as fits"),
    ] = ""
    start_from: Annotated[
        tuple[str, ...],
        Field(strict=False),
        Doc("designs to begin at, files or names; islands only"),
    ] = ()


class RunFile(RunTables):
    """A whole run file."""

    schema_: Annotated[
        Literal["vinefab/run-1"], Field(alias="schema"), Doc("kind of file and its version")
    ] = "vinefab/run-1"
    task: Annotated[TaskTable, Doc("what is scored")] = TaskTable()
    optimizer: Annotated[OptimizerTable, Doc("how it is searched")] = OptimizerTable()


_MOST_LETTERS = 90
"""Of a run's name: the best designs are called after it, some with a number behind."""


def read_run(name_or_path: str | PathLike[str]) -> RunSettings:
    """Return the settings of a run file, given as a path or the name of a shipped example."""
    path = locate("run file", name_or_path)
    content = toml.read_toml(path)
    with located(path):
        _read_files_in(content, path.parent)
    file = validated(RunFile, content, path)
    with located(path):
        name = file.name if "name" in file.model_fields_set else visible(path.stem)
        if not name or name.startswith(".") or not all(c.isalnum() or c in "_-." for c in name):
            raise BadInputError("name", name, "letters, digits, '_', '-' and '.'")
        if len(name) > _MOST_LETTERS:
            raise BadInputError("name", name, f"at most {_MOST_LETTERS} characters")
        _refuse_together(file)
        task, optimizer = file.task, file.optimizer
        parameters, others = dict(task.model_extra or {}), dict[str, Mapping[str, object]]()
        for key in [key for key, value in parameters.items() if isinstance(value, Mapping)]:
            if key in task.objectives and key != task.name:
                others[key] = cast("Mapping[str, object]", parameters.pop(key))
            elif key in TASKS:
                problem = "the table is for another task, which is not among task.objectives"
                raise UnfitInputError(
                    f"task.{key}", problem, "add it there, or leave the table out"
                )
        # Islands do best only where designs have to be manufacturable.
        best = "islands" if file.evaluation.fabricable else "cmaes"
        settings = RunSettings(
            name=name,
            maps=_with_files(file.maps, path.parent),
            task=PartSettings(name=task.name, parameters=parameters),
            space=file.space,
            build=file.build,
            growth=file.growth,
            optimizer=PartSettings(
                name=optimizer.name or ("nsga2" if task.objectives else best),
                parameters=optimizer.model_extra or {},
            ),
            search=SearchSettings(
                **{n: getattr(optimizer, n) for n in SearchSettings.model_fields}
            ),
            evaluation=file.evaluation.changed(recipe=_beside(path.parent, file.evaluation.recipe)),
            objectives=task.objectives,
            other_parameters=others,
        )
        begun = _designs(optimizer.start_from, settings, path)
        only = _ids(settings.space.only, begun)
        space = settings.space.changed(only=only) if only else settings.space
        points = (space_of(space, settings.build).vector(design) for design in begun)
        settings = settings.changed(
            space=space, start_from=tuple(tuple(point.tolist()) for point in points)
        )
        check_objectives(settings.objectives, settings.task.name, settings.optimizer.name)
        # Built once here, so that a wrong name or parameter is reported with the file.
        settings.maps.environment_options()
        make_task(settings.task.name, settings.task.parameters)
        for other in settings.other_tasks:
            make_other_task(other)
        make_optimizer_config(settings.optimizer.name, settings.optimizer.parameters)
        return settings


def _beside(folder: Path, given: str) -> str:
    """Return the path of a file in the folder of the run file; else the name as it is."""
    return str(folder / given) if (folder / given).is_file() else given


def _read_files_in(content: dict[str, Any], folder: Path) -> None:
    """Put into the content of a run file what stands in the files that it names."""
    growth = content.get("growth")
    if isinstance(growth, dict) and "contacts" in growth:
        contacts = growth["contacts"]
        if isinstance(contacts, str):
            with values_hidden():
                contacts = read_contacts(_beside(folder, contacts))
        try:
            growth |= {**measured_values(contacts), **growth, "contacts": contacts}
        except BadInputError as error:
            key = f"growth.contacts.{error.key}".removesuffix(".contacts")
            raise error.under(key) from None


def _refuse_together(file: RunFile) -> None:
    """Refuse keys of a run file that contradict each other."""
    build, space = file.build, file.space
    if isinstance(space.most_branches, float):
        raise BadInputError("space.most_branches", space.most_branches, "a valid integer")
    if "widths_mm" in build.model_fields_set:
        if "trunk_width_mm" in build.model_fields_set:
            problem = "is given together with build.widths_mm"
            raise UnfitInputError("build.trunk_width_mm", problem, "leave one of them out")
        if not build.widths_mm:
            raise UnfitInputError("build.widths_mm", "is empty", "give at least the trunk's width")
    if space.symmetric:
        given = {f"space.level {level.number}": level.growth_percent for level in space.level}
        if "growth_percent" in space.model_fields_set:
            given["space"] = space.growth_percent
        for table, growth in given.items():
            if growth is not None and (growth.low, growth.high) != (SYMMETRIC_PERCENT,) * 2:
                key, ends = f"{table}.growth_percent", [growth.low, growth.high]
                allowed = (
                    "100, or left out: with symmetric = true children of a fan are all as long"
                )
                raise BadInputError(key, ends, allowed)


def _with_files(maps: MapSettings, folder: Path) -> MapSettings:
    """Return maps with the paths of their files, which are relative to a run file."""
    if "files" not in maps.model_fields_set:
        return maps
    for name in maps.model_fields_set - {"files", "start"}:
        raise UnfitInputError(
            f"maps.{name}", "is given together with maps.files", "leave one of them out"
        )
    if not maps.files:
        raise UnfitInputError("maps.files", "is empty", "name at least one map file")
    for index, file in enumerate(maps.files, start=1):
        if not (folder / file).is_file():
            problem = f"there is no file {folder / file}"
            remedy = "name a map file, relative to the folder of the run file"
            raise UnfitInputError(f"maps.files[{index}]", problem, remedy)
    paths = tuple(folder / name for name in maps.files)
    return MapSettings(count=len(paths), files=paths, start=maps.start)


def _designs(given: Sequence[str], settings: RunSettings, path: Path) -> list[Design]:
    """Return the designs to begin at: searches take the nearest within the space's bounds."""
    designs = []
    low, high = int(settings.space.levels.low), int(settings.space.levels.high)
    for place, name in enumerate(given, start=1):
        file, key = path.parent / name, f"optimizer.start_from[{place}]"
        if not file.is_file() and name not in {*names("design"), *user_names("design")}:
            problem = f"there is neither a file {file} nor a design called {name!r}"
            raise UnfitInputError(key, problem, "name a design or its file")
        with values_hidden():
            design = Design.read(file if file.is_file() else name)
        if settings.space.tree == "levels":
            with located(path):
                check_levels(design, 'a search begins at levels; tree = "free" in [space] does not')
        if not low <= design.depth <= high:
            found = f"{name}, a design with {counted(design.depth, 'level')}"
            allowed = f"designs with {low} to {counted(high, 'level')}, as in space.levels"
            raise BadInputError(key, found, allowed)
        designs.append(design)
    return designs


def check_only(only: Sequence[str], begun: int) -> None:
    """Raise `BadInputError` for branches that alone may change without one design to begin at."""
    if only and begun != 1:
        problem = "is given without a single design to begin at"
        raise UnfitInputError("space.only", problem, "give one in optimizer.start_from")


def _ids(only: Sequence[str], begun: Sequence[Design]) -> tuple[str, ...]:
    """Return the ids of the branches that may change, which a run file names."""
    check_only(only, len(begun))
    if not only:
        return ()
    ids = begun[0].tree.ids
    names = begun[0].names or ids
    for name in only:
        if name not in names:
            allowed = f"branches of {begun[0].name}{nearest(name, names)}"
            raise BadInputError("space.only", name, allowed)
    return tuple(ids[names.index(name)] for name in only)


def check_objectives(objectives: Sequence[str], task: str, optimizer: str) -> None:
    """Raise `BadInputError` for objectives that do not fit together."""
    key = "task.objectives"
    if not objectives:
        return
    for name in objectives:
        if name not in (task, *COSTS) and name not in TASKS:
            others, known = [other for other in TASKS if other != task], (task, *TASKS, *COSTS)
            allowed = (
                f"{task!r}, other tasks ({', '.join(others)}) and costs ({', '.join(COSTS)})"
                f"{nearest(name, known)}"
            )
            raise BadInputError(key, name, allowed)
        if list(objectives).count(name) > 1:
            raise UnfitInputError(key, f"{name!r} stands there twice", "name each objective once")
    if task not in objectives:
        raise BadInputError(key, list(objectives), f"the task's score, {task!r}, among them")
    if len(objectives) < 2:
        allowed = (
            f"a cost ({', '.join(COSTS)}) or another task with the score, or no objectives at all"
        )
        raise BadInputError(key, list(objectives), allowed)
    if optimizer != "nsga2":
        problem = f"{optimizer!r} has one objective, and task.objectives names several"
        raise UnfitInputError("optimizer.name", problem, "use 'nsga2', or name one objective")


# --- Tasks of a run -------------------------------------------------------------------------------


def make_other_task(named: PartSettings) -> Task:
    """Return another objective's task; errors name its table in the run file."""
    with keys_of_other_task(named.name):
        return make_task(named.name, named.parameters)


@contextmanager
def keys_of_other_task(name: str) -> Iterator[None]:
    """Name the keys of another task in errors as the run file does; as they are without a name."""
    try:
        yield
    except BadInputError as error:
        key = error.key.replace("task.", f"task.{name}." if name else "task.", 1)
        raise error.under(key) from None


def run_task(settings: RunSettings) -> Task | None:
    """Return the first of a run's registered tasks with its own targets, or just the first.

    None for a task of the user's own.
    """
    named = [one for one in (settings.task, *settings.other_tasks) if one.name in TASKS]
    tasks = [make_task(one.name, one.parameters) for one in named]
    return next((task for task in tasks if getattr(task, "own", ())), next(iter(tasks), None))


def has_own_targets(settings: RunSettings) -> bool:
    """Tell whether a task of a run has targets: places on its own maps, not on others."""
    return bool(getattr(run_task(settings), "targets", ()))
