"""Run files: TOML, schema ``vinefab/run-1``.

Only ``schema`` is required. Ranges are written ``[low, high]``, or as one number when the variable
is fixed. Further keys of ``[task]`` and ``[optimizer]`` are the parameters of the task and the
optimizer named there.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, Tag

from vinefab.core.errors import BadInputError, located, values_hidden
from vinefab.core.plain_text import counted
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import (
    DEFAULT_MOUNTING,
    DEFAULT_PRESSURE_KPA,
    DEFAULT_TAIL_MM,
    DEFAULT_TRUNK_WIDTH_MM,
    DEFAULT_WIDTH_RATIO,
    Mounting,
    PieceSettings,
    Pouch,
)
from vinefab.model.files.contacts_toml import read_contacts
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.shipped import locate, names, user_names
from vinefab.model.files.toml import Form, read_toml, validated
from vinefab.model.map import Start
from vinefab.model.start_place import StartPlace, StartTable, start_from
from vinefab.search.costs import COSTS
from vinefab.search.evaluator import make_other_task
from vinefab.search.front import check_objectives
from vinefab.search.optimizers.shipped_optimizers import make_optimizer_config
from vinefab.search.run import environment_options
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import (
    LIMITS,
    SYMMETRIC_PERCENT,
    Bounds,
    BuildSettings,
    Space,
    SpaceSettings,
)
from vinefab.tasks.shipped_tasks import TASKS, make_task


def _pair(value: object) -> object:
    """Return a fixed value as a range with equal ends."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [value, value]
    if isinstance(value, list) and len(value) == 2:
        return value
    raise ValueError("a number, or a range [low, high]")


RangeForm = Annotated[list[float], BeforeValidator(_pair)]


def _words_or_table(value: object) -> object:
    if isinstance(value, str | Mapping):
        return value
    raise ValueError('a table, or words such as "left side"')


def _form_of_start(value: object) -> str:
    return "Words" if isinstance(value, str) else "Table"


_StartTables = Annotated[
    Annotated[str, Tag("Words")] | Annotated[StartTable, Tag("Table")],
    Discriminator(_form_of_start),
    BeforeValidator(_words_or_table),
]


class MapsForm(Form):
    """Table ``[maps]``: generated maps, or files relative to the run file."""

    environment: str | None = None  # a generator; see `vinefab map --help`
    count: int | None = None  # of maps
    seed: int | None = None  # of the first map; the next have the next seeds
    options: dict[str, Any] | None = None  # of the generator
    files: list[str] | None = None  # map files, relative to the run file, in place of all above
    start: _StartTables | None = None  # of every map, in place of its own


class RunPartForm(Form):
    """A table that names a part; its other keys are the part's parameters."""

    model_config = ConfigDict(extra="allow")


class TaskForm(RunPartForm):
    """Table ``[task]``; that of another task among the objectives is ``[task.NAME]`` in it."""

    name: str = RunSettings().task.name  # coverage, reach, anchoring, or of another package
    objectives: list[str] = Field(default_factory=list)  # for a front: tasks and costs


class RunLevelForm(Form):
    """Table ``[[space.level]]``: ranges of one level; level 1 is the trunk."""

    number: int  # of the level; 1 is the trunk
    length_mm: RangeForm | None = None  # range of BL
    angle_deg: RangeForm | None = None  # range of theta
    branches: RangeForm | None = None  # range of SPL
    growth_percent: RangeForm | None = None  # range of LGF


class SpaceForm(Form):
    """Table ``[space]``: ranges of all levels."""

    levels: RangeForm | None = None  # range of their number, trunk included
    length_mm: RangeForm | None = None  # range of BL
    angle_deg: RangeForm | None = None  # range of theta, the whole fan
    branches: RangeForm | None = None  # range of SPL, children per parent
    growth_percent: RangeForm | None = None  # range of LGF
    most_film_length_mm: float | None = None  # planned length of all branches together
    most_film_area_mm2: float | None = None  # lay-flat area of all branches, one layer
    most_sheet_area_mm2: float | None = None  # of the rectangle that holds the flat robot
    most_branches: int | None = None  # trunk included
    symmetric: bool = False  # left mirrors right
    level: list[RunLevelForm] = Field(default_factory=list)  # other ranges for one level


class RunBuildForm(Form):
    """Table ``[build]``."""

    trunk_width_mm: float | None = None  # lay-flat
    widths_mm: list[float] | None = None  # of the first levels, in place of trunk_width_mm
    width_ratio: float = DEFAULT_WIDTH_RATIO  # of a level over the one before
    tail_mm: float = DEFAULT_TAIL_MM  # below the trunk
    pressure_kpa: float = DEFAULT_PRESSURE_KPA  # working gauge pressure
    pouch: Pouch | None = None  # at the tip of every leaf
    pieces: PieceSettings | None = None  # robots may be cut in flat pieces
    mounting: Mounting = DEFAULT_MOUNTING  # as in a design


class RunGrowthForm(Form):
    """Table ``[growth]``: options by their names in `GrowthOptions.content`."""

    # within it of head-on a tip stops; [low, high]: drawn
    head_on_half_angle_deg: RangeForm | None = None
    # stop: they stay inside; deploy: they grow
    children_of_stuck: Literal["stop", "deploy"] | None = None
    body: Literal["centerline", "inflated"] | None = None  # inflated, or centerline as in the paper
    pressure_stop: bool | None = None  # whether growth ends where pressure does not evert film
    storage_kpa: float | None = None  # tension of the film in its store
    fitted_diameter_mm: float | None = None  # of the tube of the published fit
    body_width_ratio: float | None = None  # real inflated width over the nominal one
    # a file of measured contacts, relative to the run file, or its name; or the numbers themselves
    contacts: str | dict[str, Any] | None = None


class OptimizerForm(RunPartForm):
    """Table ``[optimizer]``; without a name `_default_optimizer`."""

    name: str = ""  # islands, cmaes, evolution, particleswarm, pso, nsga2 or random; empty: as fits
    population: int = SearchSettings().population  # designs of a generation
    generations: int = SearchSettings().generations  # at most
    seed: int = SearchSettings().seed  # of everything random but the maps
    stall_generations: int = 0  # without improvement that end it; 0: never
    stall_tolerance: float = 0.0  # what counts as improvement, relative
    evaluations: int = 0  # that end it; 0: never
    wall_time_s: float = 0.0  # that ends it; 0: never
    # designs to begin at, files or names; islands only
    start_from: list[str] = Field(default_factory=list)


class EvaluationForm(Form):
    """Table ``[evaluation]``."""

    poses_per_map: int = EvaluationSettings().poses_per_map  # drawn for every generation
    maps_per_generation: int = EvaluationSettings().maps_per_generation  # drawn for each; 0: all
    # share of the starts' range that poses are drawn from
    pose_range: float = EvaluationSettings().pose_range
    composite: str = EvaluationSettings().composite  # mean, best, min_deviation or single
    # of scores, that earns nothing in min_deviation
    reference_deviation: float = EvaluationSettings().reference_deviation
    redraw: bool = True  # new poses for every generation
    fabricable: bool = True  # designs that break rules rank below all others
    # whose limits decide that: a file, relative to the run file, or a name; empty: the shipped one
    recipe: str = ""
    # fitness that every head-on stop costs
    head_on_weight: float = EvaluationSettings().head_on_weight
    penalty_weight: float = EvaluationSettings().penalty_weight  # of broken rules
    finalists: int = EvaluationSettings().finalists  # best designs that are scored again at the end
    final_poses_per_map: int = EvaluationSettings().final_poses_per_map  # for them
    finalists_by: str = EvaluationSettings().finalists_by  # fresh_maps, training or contact_range
    # fitness that every sleeve joint costs, with build.pieces
    joint_weight: float = EvaluationSettings().joint_weight


class RunForm(Form):
    """A whole run file."""

    schema_: Literal["vinefab/run-1"] = Field(alias="schema")  # kind of file and its version
    name: str | None = None  # of the run and its best design; default: the file's
    maps: MapsForm = MapsForm()  # the training maps
    task: TaskForm = TaskForm()  # what is scored
    space: SpaceForm = SpaceForm()  # what may vary
    build: RunBuildForm = RunBuildForm()  # how every design is made
    growth: RunGrowthForm = RunGrowthForm()  # how robots grow
    optimizer: OptimizerForm = OptimizerForm()  # how it is searched
    evaluation: EvaluationForm = EvaluationForm()  # how a design is judged


def read_run(name_or_path: str | Path) -> RunSettings:
    """Return the settings of a run file, given as a path or the name of a shipped example."""
    path = locate("run file", name_or_path)
    form = validated(RunForm, read_toml(path), path)
    with located(path):
        return _settings(form, path)


def _settings(form: RunForm, path: Path) -> RunSettings:
    search = form.optimizer.model_dump(include=set(SearchSettings.__dataclass_fields__))
    parameters, others = _task_tables(form.task)
    evaluation = EvaluationSettings(**form.evaluation.model_dump())
    settings = RunSettings(
        name=_name(form, path),
        maps=_maps(form.maps, path.parent),
        task=PartSettings(name=form.task.name, parameters=parameters),
        space=_space(form.space),
        build=_build(form.build),
        growth=_growth(form.growth, path.parent),
        optimizer=PartSettings(
            name=form.optimizer.name or _default_optimizer(form),
            parameters=form.optimizer.model_extra or {},
        ),
        search=SearchSettings(**search),
        evaluation=replace(evaluation, recipe=_beside(path.parent, evaluation.recipe)),
        objectives=tuple(form.task.objectives),
        other_parameters=others,
    )
    settings = replace(settings, start_from=_starts(form.optimizer.start_from, settings, path))
    check_objectives(settings.objectives, settings.task.name, settings.optimizer.name)
    # Built once here, so that a wrong name or parameter is reported with the file.
    environment_options(settings.maps)
    make_task(settings.task.name, settings.task.parameters)
    for other in settings.other_tasks:
        make_other_task(other)
    make_optimizer_config(settings.optimizer.name, settings.optimizer.parameters)
    return settings


def _growth(form: RunGrowthForm, folder: Path) -> GrowthOptions:
    given = form.model_dump(exclude_none=True)
    if isinstance(given.get("contacts"), str):
        with values_hidden():
            given["contacts"] = read_contacts(_beside(folder, given["contacts"]))
    return GrowthOptions.of(given)


def _beside(folder: Path, given: str) -> str:
    """Return the path of a file beside the run file, or what was given if there is none."""
    return str(folder / given) if (folder / given).is_file() else given


def _default_optimizer(form: RunForm) -> str:
    """Return the optimizer that does best: islands only where designs have to be manufacturable."""
    if form.task.objectives:
        return "nsga2"
    return RunSettings().optimizer.name if form.evaluation.fabricable else "cmaes"


def _starts(given: list[str], settings: RunSettings, path: Path) -> tuple[tuple[float, ...], ...]:
    """Return the points of the designs to begin at: the nearest within the space's bounds."""
    space, points = Space(settings.space, settings.build), []
    low, high = int(settings.space.levels.low), int(settings.space.levels.high)
    for place, name in enumerate(given, start=1):
        file, key = path.parent / name, f"optimizer.start_from[{place}]"
        if not file.is_file() and name not in {*names("design"), *user_names("design")}:
            raise BadInputError(key, name, f"a design file, {file}, or the name of a design")
        with values_hidden():
            design = read_design(file if file.is_file() else name)
        if not low <= design.depth <= high:
            found = f"{name}, a design with {counted(design.depth, 'level')}"
            allowed = f"designs with {low} to {counted(high, 'level')}, as in space.levels"
            raise BadInputError(key, found, allowed)
        points.append(tuple(space.vector(design).tolist()))
    return tuple(points)


def _task_tables(
    form: TaskForm,
) -> tuple[dict[str, object], dict[str, Mapping[str, object]]]:
    """Return the parameters of the task, and those of other tasks by their names."""
    parameters, others = dict(form.model_extra or {}), dict[str, Mapping[str, object]]()
    for name in [name for name, value in parameters.items() if isinstance(value, Mapping)]:
        if name in form.objectives and name != form.name:
            others[name] = cast("Mapping[str, object]", parameters.pop(name))
        elif name in TASKS:
            allowed = f"no table: {name!r} is not another task among task.objectives"
            raise BadInputError(f"task.{name}", "a table", allowed)
    return parameters, others


def _build(form: RunBuildForm) -> BuildSettings:
    others = form.model_dump(exclude={"pouch", "pieces", "trunk_width_mm", "widths_mm"})
    trunk_mm, widths_mm = form.trunk_width_mm, form.widths_mm
    if widths_mm is not None and trunk_mm is not None:
        raise BadInputError("build.trunk_width_mm", trunk_mm, "not beside build.widths_mm")
    if widths_mm == []:
        raise BadInputError("build.widths_mm", widths_mm, "at least the trunk's width")
    return BuildSettings(
        trunk_width_mm=DEFAULT_TRUNK_WIDTH_MM if trunk_mm is None else trunk_mm,
        widths_mm=tuple(widths_mm or ()),
        pouch=form.pouch,
        pieces=form.pieces,
        **others,
    )


_MOST_LETTERS = 90
"""Of a run's name: the best designs are called after it, some with a number behind."""


def _name(form: RunForm, path: Path) -> str:
    name = path.stem if form.name is None else form.name
    if not name or name.startswith(".") or not all(c.isalnum() or c in "_-." for c in name):
        raise BadInputError("name", name, "letters, digits, '_', '-' and '.'")
    if len(name) > _MOST_LETTERS:
        raise BadInputError("name", name, f"at most {_MOST_LETTERS} characters")
    return name


def _maps(form: MapsForm, folder: Path) -> MapSettings:
    given = form.model_dump(exclude_none=True, exclude={"start"})
    start = None if form.start is None else _start_of(form.start)
    files = given.pop("files", None)
    if files is None:
        return MapSettings(**given, start=start)
    if given:
        raise BadInputError(
            f"maps.{next(iter(given))}", next(iter(given.values())), "not together with maps.files"
        )
    if not files:
        raise BadInputError("maps.files", files, "at least one map file")
    for index, name in enumerate(files, start=1):
        if not (folder / name).is_file():
            allowed = f"a map file, relative to the folder of the run file: {folder / name}"
            raise BadInputError(f"maps.files[{index}]", name, allowed)
    paths = tuple(folder / name for name in files)
    return MapSettings(count=len(files), files=paths, start=start)


_START_KEY = "maps.start"


def _start_of(form: str | StartTable) -> Start | StartPlace:
    if isinstance(form, str):
        return start_from(form, _START_KEY)
    try:
        return form.start
    except BadInputError as error:
        raise BadInputError(f"{_START_KEY}.{error.key}", error.value, error.allowed) from error


def _space(form: SpaceForm) -> SpaceSettings:
    numbers = [level.number for level in form.level]
    for index, given in enumerate(numbers):
        if given in numbers[:index]:
            raise BadInputError(f"space.level[{index + 1}].number", given, "each level once")
    if form.symmetric:
        _check_symmetric("space", form.growth_percent)
        for level in form.level:
            _check_symmetric(f"space.level {level.number}", level.growth_percent)
    limits = {name: getattr(form, cost.limit_key) for name, cost in COSTS.items()}
    return SpaceSettings(
        by_level={level.number: _ranges(level) for level in form.level},
        most={name: limit for name, limit in limits.items() if limit is not None},
        symmetric=form.symmetric,
        **_ranges(form),
    )


def _check_symmetric(table: str, growth_percent: list[float] | None) -> None:
    if growth_percent not in (None, [SYMMETRIC_PERCENT] * 2):
        allowed = "100, or left out: with symmetric = true children of a fan are all as long"
        raise BadInputError(f"{table}.growth_percent", growth_percent, allowed)


def _ranges(form: SpaceForm | RunLevelForm) -> dict[str, Bounds]:
    """Return the ranges that a table gives."""
    given = form.model_dump(include={"levels", *LIMITS}, exclude_none=True)
    return {name: Bounds(low=low, high=high) for name, (low, high) in given.items()}
