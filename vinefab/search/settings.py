"""The settings of a run."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from vinefab.core import table
from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, number, positive, whole
from vinefab.growth.options import GrowthOptions
from vinefab.model.map import Start
from vinefab.model.start_place import StartPlace, start_from, start_record
from vinefab.search.costs import COSTS
from vinefab.search.space import LATER, BuildSettings, SpaceSettings
from vinefab.tasks.evaluate import COMPOSITES, STANDARD_DEVIATION

MOST_SECONDS = 1e8
FINALISTS_BY = ("fresh_maps", "training", "contact_range")


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSettings:
    """The training maps: generated, or from files.

    Parameters
    ----------
    environment
        Which generator.
    count
        How many maps.
    seed
        Seed of the first; each next map has the next seed.
    options
        The generator's options.
    files
        Map files in place of generated maps.
    start
        The start of every map, with its spread, in place of its own; or a place that is found on
        each of them, ``"left side"``.
    """

    environment: str = "grid"
    count: int = 4
    seed: int = 1
    options: Mapping[str, object] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    start: Start | StartPlace | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        if isinstance(self.start, str):
            object.__setattr__(self, "start", start_from(self.start, "maps.start"))
        listed = (self.files,) if isinstance(self.files, str | PathLike) else tuple(self.files)
        for one in listed:
            if not isinstance(one, str | PathLike):
                raise BadInputError("maps.files", one, "paths of map files; Map.write makes one")
        object.__setattr__(self, "files", tuple(Path(one) for one in listed))
        whole("maps.count", self.count, 1, 1000)
        whole("maps.seed", self.seed, 0, 2**62)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartSettings:
    """A part from a registry, with the parameters that differ from its defaults.

    Parameters
    ----------
    name
        Name in the registry.
    parameters
        Names and values.
    """

    name: str
    parameters: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchSettings:
    """How long and with what seed the optimizer searches.

    Parameters
    ----------
    population
        Designs per generation.
    generations
        Most generations.
    seed
        Seed of everything random in the run but the maps.
    stall_generations
        Stop when the best fitness has not improved for so many; 0: never.
    stall_tolerance
        What counts as an improvement, relative to the best fitness.
    evaluations
        Stop after the generation that reaches this number of evaluated designs; 0: never.
    wall_time_s
        Stop after the generation in which all sessions together exceed this time; 0: never. Runs
        that stop by time are not reproducible in length.
    """

    population: int = 20
    generations: int = 15
    seed: int = 1
    stall_generations: int = 0
    stall_tolerance: float = 0.0
    evaluations: int = 0
    wall_time_s: float = 0.0

    def __post_init__(self) -> None:
        whole("optimizer.population", self.population, 2, 100_000)
        whole("optimizer.generations", self.generations, 1, 1_000_000)
        whole("optimizer.seed", self.seed, 0, 2**62)
        whole("optimizer.stall_generations", self.stall_generations, 0, 1_000_000)
        number("optimizer.stall_tolerance", self.stall_tolerance, 0.0, 1.0)
        whole("optimizer.evaluations", self.evaluations, 0, 2**53)
        number("optimizer.wall_time_s", self.wall_time_s, 0.0, MOST_SECONDS, "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLimits:
    """The limits of a run that `--resume` may raise; None leaves one as it is.

    Parameters
    ----------
    generations, evaluations, wall_time_s
        As in `SearchSettings`, at least what the run has; 0 lifts the limit of the last two.
    """

    generations: int | None = None
    evaluations: int | None = None
    wall_time_s: float | None = None

    @property
    def given(self) -> dict[str, float]:
        """The limits that are given, by name."""
        named = {name: getattr(self, name) for name in LIMIT_NAMES}
        return {name: value for name, value in named.items() if value is not None}

    def raised(self, search: SearchSettings) -> SearchSettings:
        """Return settings with the limits that are given.

        Raises
        ------
        BadInputError
            For a limit below that of the settings.
        """
        for name, value in self.given.items():
            before = getattr(search, name)
            can_be_lifted = name != "generations"
            is_lifted = can_be_lifted and value == 0
            if not is_lifted and (value < before or (can_be_lifted and before == 0)):
                has = f"at least the {before} that the run has" if before else "0: it has no limit"
                lifted = ", or 0 for no limit" if can_be_lifted and before else ""
                raise BadInputError(limit_option(name), value, f"{has}{lifted}")
        try:
            return replace(search, **self.given)  # type: ignore[arg-type]
        except BadInputError as error:
            option = limit_option(error.key.removeprefix("optimizer."))
            raise BadInputError(option, error.value, error.allowed) from error


LIMIT_NAMES = ("generations", "evaluations", "wall_time_s")


def limit_option(name: str) -> str:
    """Return the command's option for a limit."""
    return f"--{name.replace('_', '-')}"


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluationSettings:
    """How a design's fitness is computed.

    Parameters
    ----------
    poses_per_map
        Poses that every design of a generation grows from on each map.
    maps_per_generation
        Training maps that the designs of a generation grow on, drawn for each generation; 0: all.
    pose_range
        How far poses may be from the maps' starts, over the range that each start gives: 0 takes
        the starts as they are (fixed initial conditions), 1 all of the range.
    composite
        How scores are combined: ``mean``, ``best`` or ``min_deviation``; ``single``: one
        evaluation, from one pose on one map; finalists are then ranked by their mean.
    reference_deviation
        Standard deviation of the scores that earns nothing in ``min_deviation``. The default
        suits scores from 0 to 1; anchoring needs a larger one.
    redraw
        Draw new poses, and maps where not all are used, for every generation; otherwise all
        generations use the same. All designs of a generation always use the same.
    fabricable
        Rank designs that are not manufacturable (a penalty above 0) below all that are.
    recipe
        Recipe whose limits apply: its name or file; empty for the default.
    head_on_weight
        Weight of branches that stop head-on: every score is reduced by this weight times their
        share of the deployed branches.
    penalty_weight
        Fitness that one unit of penalty costs.
    finalists
        Number of best designs that are evaluated again to choose the winner.
    final_poses_per_map
        Fresh poses on each map for that.
    finalists_by
        What their fitness is there: ``training``, on the training maps; ``contact_range``, the
        same over the head-on half-angles of `CONTACT_ANGLES_DEG`; ``fresh_maps``, on maps of the
        run's environment that the search did not see, where these are generated and the run
        names no places, and on the training maps elsewhere.
    joint_weight
        Fitness that every sleeve joint of a design in pieces costs.
    """

    poses_per_map: int = 1
    maps_per_generation: int = 0
    pose_range: float = 1.0
    composite: str = "mean"
    reference_deviation: float = STANDARD_DEVIATION
    redraw: bool = True
    fabricable: bool = True
    recipe: str = ""
    head_on_weight: float = 0.0
    penalty_weight: float = 1.0
    finalists: int = 8
    final_poses_per_map: int = 5
    finalists_by: str = "fresh_maps"
    joint_weight: float = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        whole("evaluation.poses_per_map", self.poses_per_map, 1, 10_000)
        whole("evaluation.finalists", self.finalists, 1, 10_000)
        whole("evaluation.final_poses_per_map", self.final_poses_per_map, 1, 10_000)
        positive("evaluation.penalty_weight", self.penalty_weight, 1e6, "")
        if self.composite not in COMPOSITES:
            raise BadInputError(
                "evaluation.composite", self.composite, f"one of {', '.join(COMPOSITES)}"
            )
        if self.finalists_by not in FINALISTS_BY:
            allowed = f"one of {', '.join(FINALISTS_BY)}"
            raise BadInputError("evaluation.finalists_by", self.finalists_by, allowed)
        whole("evaluation.maps_per_generation", self.maps_per_generation, 0, 1000)
        number("evaluation.pose_range", self.pose_range, 0.0, 10.0)
        positive("evaluation.reference_deviation", self.reference_deviation, 1e6, "")
        number("evaluation.head_on_weight", self.head_on_weight, 0.0, 1e3)
        number("evaluation.joint_weight", self.joint_weight, 0.0, 1e3)
        if self.composite == "single" and self.poses_per_map > 1:
            allowed = "1 with composite = 'single', which has one evaluation"
            raise BadInputError("evaluation.poses_per_map", self.poses_per_map, allowed)
        if self.composite == "single" and self.maps_per_generation > 1:
            allowed = "0 or 1 with composite = 'single', which has one evaluation"
            key = "evaluation.maps_per_generation"
            raise BadInputError(key, self.maps_per_generation, allowed)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """A whole run.

    Parameters
    ----------
    name
        Name of the run and its best design; valid as a design's name.
    maps, task, space, build, growth, optimizer, search, evaluation
        The parts.
    objectives
        Names of the objectives: the task, other tasks and costs; empty in a run for the best score
        alone.
    other_parameters
        Parameters of the other tasks among the objectives, by their names.
    start_from
        Points of the space at which the optimizer begins, beside its own.
    """

    name: str = "run"
    maps: MapSettings = MapSettings()
    task: PartSettings = PartSettings(name="coverage")
    space: SpaceSettings = field(default_factory=SpaceSettings)
    build: BuildSettings = field(default_factory=BuildSettings)
    growth: GrowthOptions = field(default_factory=GrowthOptions)
    optimizer: PartSettings = PartSettings(name="islands")
    search: SearchSettings = SearchSettings()
    evaluation: EvaluationSettings = EvaluationSettings()
    objectives: tuple[str, ...] = ()
    other_parameters: Mapping[str, Mapping[str, object]] = field(
        default_factory=dict, metadata=LATER
    )
    start_from: tuple[tuple[float, ...], ...] = field(default=(), metadata=LATER)

    def __post_init__(self) -> None:
        for name, kind in _PARTS.items():
            given = getattr(self, name)
            if kind is PartSettings and isinstance(given, str):
                given = PartSettings(name=given)
                object.__setattr__(self, name, given)
            if not isinstance(given, kind):
                words = "a name or " if kind is PartSettings else ""
                raise BadInputError(name, given, f"{words}{kind.__name__}")

    @classmethod
    def read(cls, name_or_path: str | PathLike[str]) -> "RunSettings":
        """Return the settings in a run file; `dataclasses.replace` changes them.

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
        # Run files are built on this module.
        from vinefab.model.files.shipped import locate  # noqa: PLC0415
        from vinefab.search.run_file import read_run  # noqa: PLC0415

        return read_run(locate("run file", name_or_path))

    @property
    def further_objectives(self) -> tuple[str, ...]:
        """The objectives beside the task's score, in their order: other tasks and costs."""
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


_PARTS: Mapping[str, type] = {
    "maps": MapSettings,
    "task": PartSettings,
    "space": SpaceSettings,
    "build": BuildSettings,
    "growth": GrowthOptions,
    "optimizer": PartSettings,
    "search": SearchSettings,
    "evaluation": EvaluationSettings,
}
"""What the parts of a run are."""


def targets_mm(settings: RunSettings) -> Floats:
    """Return the targets of a run's tasks, for its pictures, shape (t, 2)."""
    tasks = (settings.task, *settings.other_tasks)
    points = [task.parameters.get("target_mm", ()) for task in tasks]
    return np.concatenate([np.array(some, dtype=np.float64).reshape(-1, 2) for some in points])


def plain_settings(settings: object) -> object:
    """Return settings as plain values for JSON, the same for the same settings."""
    if isinstance(settings, Start | StartPlace):
        return start_record(settings)
    if isinstance(settings, table.Table):
        declared = type(settings).model_fields
        later_keys = {name for name, one in declared.items() if table.LATER in one.metadata}
        return {n: plain_settings(v) for n, v in settings if n not in later_keys}
    if is_dataclass(settings):
        values = {f.name: getattr(settings, f.name) for f in fields(settings)}
        later = {f.name: f.default for f in fields(settings) if f.metadata.get("later")}
        said = {n: v for n, v in values.items() if n not in later or (v and v != later[n])}
        return {n: plain_settings(v) for n, v in said.items()}
    if isinstance(settings, BaseModel):
        return settings.model_dump()
    if isinstance(settings, Mapping):
        return {str(key): plain_settings(settings[key]) for key in sorted(settings)}
    if isinstance(settings, list | tuple):
        return [plain_settings(entry) for entry in settings]
    return settings if isinstance(settings, bool | int | float | str | None) else str(settings)
