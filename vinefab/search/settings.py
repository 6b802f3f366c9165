"""The settings of a run."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path

from vinefab.core.errors import BadInputError
from vinefab.core.validation import number, positive, whole
from vinefab.growth.options import GrowthOptions
from vinefab.search.space import BuildSettings, SpaceSettings
from vinefab.tasks.evaluate import COMPOSITES, STANDARD_DEVIATION

MOST_SECONDS = 1e8


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
    """

    environment: str = "grid"
    count: int = 4
    seed: int = 1
    options: Mapping[str, object] = field(default_factory=dict)
    files: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
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

    def __post_init__(self) -> None:
        whole("evaluation.poses_per_map", self.poses_per_map, 1, 10_000)
        whole("evaluation.finalists", self.finalists, 1, 10_000)
        whole("evaluation.final_poses_per_map", self.final_poses_per_map, 1, 10_000)
        positive("evaluation.penalty_weight", self.penalty_weight, 1e6, "")
        if self.composite not in COMPOSITES:
            raise BadInputError(
                "evaluation.composite", self.composite, f"one of {', '.join(COMPOSITES)}"
            )
        whole("evaluation.maps_per_generation", self.maps_per_generation, 0, 1000)
        number("evaluation.pose_range", self.pose_range, 0.0, 10.0)
        positive("evaluation.reference_deviation", self.reference_deviation, 1e6, "")
        number("evaluation.head_on_weight", self.head_on_weight, 0.0, 1e3)
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
        Names of the objectives, the task's and costs; empty in a run for the best score alone.
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

    @property
    def costs(self) -> tuple[str, ...]:
        """The objectives that are costs, in their order."""
        return tuple(name for name in self.objectives if name != self.task.name)


def plain_settings(settings: object) -> object:
    """Return settings as plain values for JSON, the same for the same settings."""
    if is_dataclass(settings):
        return {f.name: plain_settings(getattr(settings, f.name)) for f in fields(settings)}
    if isinstance(settings, Mapping):
        return {str(key): plain_settings(settings[key]) for key in sorted(settings)}
    if isinstance(settings, list | tuple):
        return [plain_settings(entry) for entry in settings]
    return settings if isinstance(settings, bool | int | float | str | None) else str(settings)
