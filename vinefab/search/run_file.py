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

from vinefab.core.errors import BadInputError, located
from vinefab.core.units import rad
from vinefab.core.validation import LARGEST_MM, number
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import (
    DEFAULT_PRESSURE_KPA,
    DEFAULT_TAIL_MM,
    DEFAULT_TRUNK_WIDTH_MM,
    DEFAULT_WIDTH_RATIO,
    PieceSettings,
    Pouch,
)
from vinefab.model.files.design_toml import PiecesForm, PouchForm, read_design
from vinefab.model.files.shipped import names, user_names
from vinefab.model.files.toml import Form, read_toml, validated
from vinefab.model.map import Pose, Start
from vinefab.model.start_place import StartPlace, shape_of, start_from
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


class StartForm(Form):
    """``start`` of ``[maps]`` as a table: a pose and the range around it, a side, line or area."""

    x_mm: float | None = None
    y_mm: float | None = None
    heading_deg: float | None = None
    spread_x_mm: float | None = None
    spread_y_mm: float | None = None
    spread_heading_deg: float = 0.0
    side: str | None = None
    inset_mm: float | None = None
    line: list[Annotated[list[float], Field(min_length=2, max_length=2)]] | None = None
    area: list[Annotated[list[float], Field(min_length=2, max_length=2)]] | None = None
    clearance_mm: float | None = None


def _words_or_table(value: object) -> object:
    if isinstance(value, str | Mapping):
        return value
    raise ValueError('a table, or words such as "left side"')


def _form_of_start(value: object) -> str:
    return "Words" if isinstance(value, str) else "Table"


_StartForms = Annotated[
    Annotated[str, Tag("Words")] | Annotated[StartForm, Tag("Table")],
    Discriminator(_form_of_start),
    BeforeValidator(_words_or_table),
]


class MapsForm(Form):
    """Table ``[maps]``: generated maps, or files relative to the run file."""

    environment: str | None = None
    count: int | None = None
    seed: int | None = None
    options: dict[str, Any] | None = None
    files: list[str] | None = None
    start: _StartForms | None = None


class RunPartForm(Form):
    """A table that names a part; its other keys are the part's parameters."""

    model_config = ConfigDict(extra="allow")


class TaskForm(RunPartForm):
    """Table ``[task]``; that of another task among the objectives is ``[task.NAME]`` in it."""

    name: str = RunSettings().task.name
    objectives: list[str] = Field(default_factory=list)


class RunLevelForm(Form):
    """Table ``[[space.level]]``: ranges of one level; level 1 is the trunk."""

    number: int
    length_mm: RangeForm | None = None
    angle_deg: RangeForm | None = None
    branches: RangeForm | None = None
    growth_percent: RangeForm | None = None


class SpaceForm(Form):
    """Table ``[space]``: ranges of all levels."""

    levels: RangeForm | None = None
    length_mm: RangeForm | None = None
    angle_deg: RangeForm | None = None
    branches: RangeForm | None = None
    growth_percent: RangeForm | None = None
    most_film_length_mm: float | None = None
    most_film_area_mm2: float | None = None
    most_sheet_area_mm2: float | None = None
    most_branches: int | None = None
    symmetric: bool = False
    level: list[RunLevelForm] = Field(default_factory=list)


class RunBuildForm(Form):
    """Table ``[build]``."""

    trunk_width_mm: float | None = None
    widths_mm: list[float] | None = None
    width_ratio: float = DEFAULT_WIDTH_RATIO
    tail_mm: float = DEFAULT_TAIL_MM
    pressure_kpa: float = DEFAULT_PRESSURE_KPA
    pouch: PouchForm | None = None
    pieces: PiecesForm | None = None


class RunGrowthForm(Form):
    """Table ``[growth]``: options by their names in `GrowthOptions.content`."""

    head_on_half_angle_deg: RangeForm | None = None
    children_of_stuck: Literal["stop", "deploy"] | None = None
    body: Literal["centerline", "inflated"] | None = None
    pressure_stop: bool | None = None
    storage_kpa: float | None = None
    fitted_diameter_mm: float | None = None
    body_width_ratio: float | None = None
    # a file of measured contacts, relative to the run file, or its name; or the numbers themselves
    contacts: str | dict[str, Any] | None = None


class OptimizerForm(RunPartForm):
    """Table ``[optimizer]``; without a name `_default_optimizer`."""

    name: str = ""
    population: int = SearchSettings().population
    generations: int = SearchSettings().generations
    seed: int = SearchSettings().seed
    stall_generations: int = 0
    stall_tolerance: float = 0.0
    evaluations: int = 0
    wall_time_s: float = 0.0
    start_from: list[str] = Field(default_factory=list)


class EvaluationForm(Form):
    """Table ``[evaluation]``."""

    poses_per_map: int = EvaluationSettings().poses_per_map
    maps_per_generation: int = EvaluationSettings().maps_per_generation
    pose_range: float = EvaluationSettings().pose_range
    composite: str = EvaluationSettings().composite
    reference_deviation: float = EvaluationSettings().reference_deviation
    redraw: bool = True
    fabricable: bool = True
    recipe: str = ""
    head_on_weight: float = EvaluationSettings().head_on_weight
    penalty_weight: float = EvaluationSettings().penalty_weight
    finalists: int = EvaluationSettings().finalists
    final_poses_per_map: int = EvaluationSettings().final_poses_per_map
    finalists_by: str = EvaluationSettings().finalists_by
    joint_weight: float = EvaluationSettings().joint_weight


class RunForm(Form):
    """A whole run file."""

    schema_: Literal["vinefab/run-1"] = Field(alias="schema")
    name: str | None = None
    maps: MapsForm = MapsForm()
    task: TaskForm = TaskForm()
    space: SpaceForm = SpaceForm()
    build: RunBuildForm = RunBuildForm()
    growth: RunGrowthForm = RunGrowthForm()
    optimizer: OptimizerForm = OptimizerForm()
    evaluation: EvaluationForm = EvaluationForm()


def read_run(path: Path) -> RunSettings:
    """Return the settings of a run file."""
    form = validated(RunForm, read_toml(path), path)
    with located(path):
        return _settings(form, path)


def _settings(form: RunForm, path: Path) -> RunSettings:
    search = form.optimizer.model_dump(include=set(SearchSettings.__dataclass_fields__))
    parameters, others = _task_tables(form.task)
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
        evaluation=EvaluationSettings(**form.evaluation.model_dump()),
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
        beside = folder / given["contacts"]
        given["contacts"] = str(beside) if beside.is_file() else given["contacts"]
    return GrowthOptions.of(given)


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
        design = read_design(file if file.is_file() else name)
        if not low <= design.depth <= high:
            found = f"{name}, a design with {design.depth} levels"
            allowed = f"designs with {low} to {high} levels, as in space.levels"
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
    pouch = None if form.pouch is None else Pouch(**form.pouch.model_dump())
    pieces = None if form.pieces is None else PieceSettings(**form.pieces.model_dump())
    others = form.model_dump(exclude={"pouch", "pieces", "trunk_width_mm", "widths_mm"})
    trunk_mm, widths_mm = form.trunk_width_mm, form.widths_mm
    if widths_mm is not None and trunk_mm is not None:
        raise BadInputError("build.trunk_width_mm", trunk_mm, "not beside build.widths_mm")
    if widths_mm == []:
        raise BadInputError("build.widths_mm", widths_mm, "at least the trunk's width")
    return BuildSettings(
        trunk_width_mm=DEFAULT_TRUNK_WIDTH_MM if trunk_mm is None else trunk_mm,
        widths_mm=tuple(widths_mm or ()),
        pouch=pouch,
        pieces=pieces,
        **others,
    )


MOST_LETTERS = 90
"""Of a run's name: the best designs are called after it, some with a number behind."""


def _name(form: RunForm, path: Path) -> str:
    name = path.stem if form.name is None else form.name
    if not name or name.startswith(".") or not all(c.isalnum() or c in "_-." for c in name):
        raise BadInputError("name", name, "letters, digits, '_', '-' and '.'")
    if len(name) > MOST_LETTERS:
        raise BadInputError("name", name, f"at most {MOST_LETTERS} characters")
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
_PLACES = ("side", "line", "area")


def _start_of(form: str | StartForm) -> Start | StartPlace:
    if isinstance(form, str):
        return start_from(form, _START_KEY)
    given = form.model_dump(exclude_none=True)
    places = [name for name in _PLACES if name in given]
    if not places:
        return _start_pose(form)
    if len(places) > 1:
        raise BadInputError(f"{_START_KEY}.{places[1]}", given[places[1]], "not beside another one")
    for name in ("x_mm", "y_mm", "spread_x_mm", "spread_y_mm"):
        if name in given:
            allowed = f"not beside {places[0]}: poses are drawn from it"
            raise BadInputError(f"{_START_KEY}.{name}", given[name], allowed)
    try:
        return _start_place(form, places[0])
    except BadInputError as error:
        name = error.key.removeprefix(f"{_START_KEY}.").removeprefix("start.")
        key = f"{_START_KEY}.{places[0] if name in ('area', 'x', 'y') else name}"
        raise BadInputError(key, error.value, error.allowed) from error


def _start_place(form: StartForm, name: str) -> StartPlace:
    points = form.line if name == "line" else form.area
    if points is not None and len(points) < 2:
        raise BadInputError("start.area", points, "two or more points")
    return StartPlace(
        side=form.side,
        area=None if points is None else shape_of(name, points),
        inset_mm=form.inset_mm,
        clearance_mm=form.clearance_mm,
        heading_rad=None if form.heading_deg is None else rad(_heading_deg(form)),
        spread_heading_rad=_spread_rad(form),
    )


def _start_pose(form: StartForm) -> Start:
    key = _START_KEY
    for name in ("x_mm", "y_mm", "heading_deg"):
        if getattr(form, name) is None:
            raise BadInputError(f"{key}.{name}", None, "it must be given, or side, line or area")
    for name in ("inset_mm", "clearance_mm"):
        if getattr(form, name) is not None:
            allowed = "beside side, line or area only"
            raise BadInputError(f"{key}.{name}", getattr(form, name), allowed)
    return Start(
        pose=Pose(
            x_mm=_length_mm(form, "x_mm", -LARGEST_MM),
            y_mm=_length_mm(form, "y_mm", -LARGEST_MM),
            heading_rad=rad(_heading_deg(form)),
        ),
        spread_x_mm=_length_mm(form, "spread_x_mm", 0.0),
        spread_y_mm=_length_mm(form, "spread_y_mm", 0.0),
        spread_heading_rad=_spread_rad(form),
    )


def _length_mm(form: StartForm, name: str, least_mm: float) -> float:
    return number(f"{_START_KEY}.{name}", getattr(form, name) or 0.0, least_mm, LARGEST_MM, "mm")


def _heading_deg(form: StartForm) -> float:
    return number(f"{_START_KEY}.heading_deg", form.heading_deg or 0.0, -1e6, 1e6, "deg")


def _spread_rad(form: StartForm) -> float:
    key = f"{_START_KEY}.spread_heading_deg"
    return rad(number(key, form.spread_heading_deg, 0.0, 360.0, "deg"))


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
