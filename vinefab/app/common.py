"""Shared parts of verbs: growth options, families of maps, tasks, and written files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from vinefab.core.atomic import ensure_own_folder, ensure_writable, write_bytes, write_text
from vinefab.core.errors import BadInputError, UnfitInputError, located
from vinefab.core.limits import deg
from vinefab.core.plain_text import counted
from vinefab.core.verbs import Doc, Kind, Within, also, note, registered_names, this_call, wrote
from vinefab.core.view import Block, Notes, Result, Rows, Text, lines, main_table
from vinefab.model.inputs import (
    FOLDER,
    PAIRS,
    PICTURE_ENDS,
    MapsLike,
    Pairs,
    PathText,
    StartsLike,
    TargetsLike,
    as_design,
    as_growth,
    as_map,
    as_mapping,
    as_maps,
    as_path,
    as_recipe,
    as_several,
    written,
)

if TYPE_CHECKING:
    from typing import Unpack

    from vinefab.growth.options import GrowthOptions
    from vinefab.model.design import Design
    from vinefab.model.files.run_context import RunContext
    from vinefab.model.finding import CheckReport
    from vinefab.model.inputs import GrowthShortcuts
    from vinefab.model.laser import LaserProfile
    from vinefab.model.map import Map
    from vinefab.prediction.aiming import AimResult
    from vinefab.prediction.comparison import DesignComparison
    from vinefab.prediction.family_deployments import MapFamily
    from vinefab.prediction.inflation_report import InflatedDesign
    from vinefab.prediction.predict import Predicted
    from vinefab.search.optimizers.optimizer import OptimizerConfig
    from vinefab.tasks.task import Task

    TaskLike = str | Task
    OptimizerLike = str | OptimizerConfig
    Answer = TypeVar("Answer", AimResult, DesignComparison, InflatedDesign, Predicted)
else:
    TaskLike = Annotated[
        object,
        Kind(metavar="TASK", known=registered_names("vinefab.tasks:TASKS")),
        Doc("The name of a task, in Python also a task of your own: an object with ``name``, "
            "``lowest`` and ``evaluate``."),
    ]  # fmt: skip
    OptimizerLike = Annotated[
        object,
        Kind(
            metavar="NAME", known=registered_names("vinefab.search.optimizers.optimizer:OPTIMIZERS")
        ),
    ]

MOST_POSES = 1_000_000
MOST_WORKERS = 1024

PoseCount = Annotated[int, Within(1, MOST_POSES), Doc("Poses drawn per map.")]
Workers = Annotated[
    int, Within(1, MOST_WORKERS), Doc("Threads or processes; no result depends on it.")
]
UnseenEnvironment = Annotated[
    str,
    Kind(
        metavar="NAME", known=registered_names("vinefab.maps.generators.environments:ENVIRONMENTS")
    ),
    Doc("Unseen maps of this environment too."),
]
UnseenCount = Annotated[int, Doc("How many unseen maps.")]
EnvironmentOptions = Annotated[Pairs | None, Doc("The environment's options, such as size_mm=300.")]
TaskParameters = Annotated[
    object, PAIRS, also("--set"), Doc("Parameters of a task that is named, such as radius_mm=60.")
]
EitherParameters = Annotated[
    object,
    PAIRS,
    also("--set"),
    Doc("Parameters of a task that is named, such as radius_mm=60, and options of the environment, "
        "such as size_mm=300: names that the environment has are its own."),
]  # fmt: skip
OutFolder = Annotated[
    PathText, FOLDER, Doc("The folder to write; an earlier one of its kind is replaced.")
]
PageFile = Annotated[PathText, written(".html", ".htm"), Doc("The page to write.")]
PictureFile = Annotated[
    PathText | None, written(*PICTURE_ENDS), also("--svg"), Doc("A picture to write.")
]
SKELETON_ENDS = (".csv", ".dxf", ".geojson", ".svg")
"""Endings of the files that skeletons are written to."""


def page_path(key: str, out: str | PathLike[str] | None, *, force: bool) -> Path | None:
    """Return the file to write, if one is asked for, once it may be written."""
    if out is None:
        return None
    path = as_path(key, out)
    ensure_writable(path, force=force)
    return path


def write_page(path: Path, content: str | bytes, *, force: bool) -> Path:
    """Write a file that was asked for, and say so."""
    if isinstance(content, str):
        write_text(path, content, force=force)
    else:
        write_bytes(path, content, force=force)
    wrote(path)
    return path


def write_shown(path: Path | None, found: Any, *, force: bool) -> None:
    """Write a result as the page or the picture that a file's name ends in, if one is asked for."""
    if path is not None:
        is_page = path.suffix.lower() in (".html", ".htm")
        write_page(path, found.page() if is_page else found.picture(path.suffix), force=force)


def with_origin(
    found: Answer,
    designs: Sequence[Design],
    families: Sequence[MapFamily],
    profile: LaserProfile | None = None,
) -> Answer:
    """Return a result with the means to get it again: this call, and its inputs."""
    from dataclasses import replace

    from vinefab.prediction.family_deployments import origin_of

    return replace(found, origin=origin_of(this_call().text(), designs, profile, families))


def folder_to_write(key: str, out: str | PathLike[str], mark: str, *, force: bool) -> Path:
    """Return the folder to fill, once it may be."""
    folder = as_path(key, out)
    ensure_own_folder(folder, mark, force=force)
    return folder


def ensure_apart(key: str, path: Path, source: object, what: str) -> None:
    """Check that the file to write is another one than the source."""
    import os

    if not isinstance(source, str | PathLike):
        return
    read = Path(source)
    # Unlike Path.resolve, realpath takes a link that leads to itself.
    same = os.path.realpath(path) == os.path.realpath(read)
    if same or (path.exists() and read.exists() and path.samefile(read)):
        raise UnfitInputError(key, f"{path} is {what}", "write into another file")


def file_of(kind: str, given: object) -> object:
    """Return the file that a name or a path means; what is neither as it is."""
    from vinefab.model.files.shipped import locate

    return locate(kind, given) if isinstance(given, str | PathLike) else given


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """What a verb works with: what its caller gave, else what the design's run had, else defaults.

    Parameters
    ----------
    robots
        The designs.
    run
        What the designs remember; empty where none does.
    worlds
        The maps, with the targets of the run on those that it trained on and that have none.
    recipe
        Laser profile that the first design is made with; None where the verb asked for none.
    task
        The task, where the verb asked for one.
    growth
        How they grow, where the verb asked for that.
    given
        Growth options that the caller gave, by name.
    """

    robots: list[Design]
    run: RunContext
    worlds: list[Map]
    recipe: Any  # LaserProfile
    task: Any  # Task
    growth: Any  # GrowthChoice
    given: Mapping[str, Any]

    @property
    def as_grown(self) -> list[Design]:
        """The designs as they deploy, the first with the film of the recipe."""
        if all(one.build.compensation != "none" for one in self.robots):
            return self.robots
        from vinefab.inflation.pattern import as_grown

        first, *others = self.robots
        return [as_grown(first, self.recipe), *map(as_grown, others)]


def context_of(
    designs: Sequence[object] | object,
    *,
    key: str = "design",
    recipe: Any = ...,
    task: Any = ...,
    usual_task: str = "coverage",
    parameters: Mapping[str, object] | None = None,
    growth: object = ...,
    worlds: Sequence[Map] = (),
    targets: object = (),
    **shortcuts: Unpack[GrowthShortcuts],
) -> Context:
    """Return the context of a verb, and name in one line the parts from the design's run.

    Parameters
    ----------
    designs
        One or several designs, as their caller named them.
    recipe, task, growth
        As the caller gave them, None where not; left out by a verb that does not use them.
    usual_task, parameters
        The task where neither caller nor run names one, ``reach`` where all maps have targets; and
        the caller's parameters of the task. Empty: no task there, and none of vinefab's own of a
        run.
    worlds, targets
        The maps, and the targets that the caller put on them: those of a run hold on the maps that
        it trained on, where the caller gave none.
    **shortcuts
        Growth options that are parameters of the verb themselves.
    """
    from vinefab.model.files.run_context import PLACES, RunContext

    named, typed = as_several(designs), parameters or {}
    robots = [as_design(one, key) for one in named]
    runs = list[RunContext]()
    for name, robot in zip(named, robots, strict=True):
        file = file_of("design", name)
        with located(fspath(file)) if isinstance(file, PathLike) else nullcontext():
            runs.append(RunContext.of(robot))
            _ = runs[-1].places  # refused here, where the file is known
            if growth is not ...:
                from vinefab.growth.options import trained_growth  # a check needs no growth

                trained_growth(robot)
    run = next((one for one in runs if one.kept), runs[0])
    profile, of_recipe = None, _NOTHING
    if recipe is not ... or robots[0].build.compensation == "none":
        profile, of_recipe = _recipe_of(robots[0], run, None if recipe is ... else recipe)
    used, others = list(of_recipe[0]), list(of_recipe[1])
    placed = list(worlds)
    if as_several(targets) or PLACES in typed:
        run = run.without_places
    elif worlds and run.places:
        if run.maps and not any(run.trained_on(worlds)):
            run = run.without_places
            others.append("without its targets, which are places on other maps")
        else:
            placed = run.with_places(worlds)
            moved = any(one is not world for one, world in zip(placed, worlds, strict=True))
            used += ["targets"] * (
                moved or (task is not ... and bool(usual_task) and run.has_places)
            )
    scored = None
    if task is not ...:
        scored, of_task = _task_of(run, task, usual_task, typed, placed)
        used += of_task[0]
        others += of_task[1]
    choice, given = None, as_growth(None if growth is ... else growth, **shortcuts)
    if growth is not ...:
        from vinefab.growth.options import GrowthChoice, on_surface

        if run.growth:
            used.append("growth options")
            others += [f"{', '.join(given)} as given"] * bool(given)
        given = on_surface(given, worlds)
        choice = GrowthChoice.of(robots, given)
    if used or (others and run.kept):
        of_run = f"{', '.join(used)} of {run.title}" if used else run.title
        others.insert(0, of_run)
    if others:
        note("; ".join(others), only_in_shell=True)
    return Context(
        robots=robots,
        run=run,
        worlds=placed,
        recipe=profile,
        task=scored,
        growth=choice,
        given=given,
    )


def note_surface(context: Context) -> None:
    """Say where the walls of the maps may stop tips that slide at the half-angle of growth."""
    options: GrowthOptions = context.growth.options
    low, high = options.known_half_angle.ends_deg
    if options.surface and not low <= deg(options.half_angle_range_rad[1]) <= high:
        known = f"{low:g} to {high:g} deg ({options.known_half_angle.standing})"
        note(
            f"walls are {options.surface}, half-angles of {known}; "
            f"grown at {options.half_angle_text}: report and compare show the range",
            only_in_shell=True,
        )


_Words = tuple[tuple[str, ...], tuple[str, ...]]
"""Words on the line about a context: the parts of it that are the run's, and other remarks."""

_NOTHING: _Words = (), ()


def _recipe_of(design: Design, run: RunContext, recipe: Any) -> tuple[LaserProfile, _Words]:
    """Return the recipe to make a design with, and whose it is."""
    from vinefab.model.files.run_context import ChosenRecipe

    if recipe is not None:
        profile = as_recipe(recipe)
        if run.recipe and profile.recipe.name != run.recipe.name:
            return profile, ((), (f"recipe {profile.recipe.name} in place of {run.recipe.name}",))
        return profile, _NOTHING
    chosen = ChosenRecipe.of(design)
    if chosen.is_other:
        note(chosen.note)
    elif chosen.note:
        return chosen.profile, ((f"recipe {chosen.profile.recipe.name} ({chosen.recipe})",), ())
    return chosen.profile, _NOTHING


def _task_of(
    run: RunContext, task: Any, usual: str, parameters: Mapping[str, object], worlds: Sequence[Map]
) -> tuple[Task | None, _Words]:
    """Return the task to score by, if there is one, and whose it is."""
    from vinefab.tasks import TASKS

    words: _Words = _NOTHING
    if task is None and not usual and not _is_plugin(run.task):
        for name, value in parameters.items():
            problem = f"{name} = {value!r} is not an option of the environment"
            raise UnfitInputError("", problem, f"name the task whose parameter {name} is (--task)")
        return None, words
    if task is None and worlds and usual != "reach" and all(world.targets for world in worlds):
        usual, words = "reach", ((), ("task reach: the maps have targets",))
    if task is not None and task != run.task:
        if run.task:
            words = (), (f"task {getattr(task, 'name', task)} in place of {run.task}",)
        return task_of(task, parameters), words
    if run.task in TASKS:
        return (
            task_of(run.task, {**run.task_parameters, **parameters}),
            ((f"task {run.task}",), ()),
        )
    if run.task and usual:
        note(f"task {run.task} of {run.title} is not installed here: used is {usual}")
    return task_of(usual, parameters), words


def _is_plugin(name: str) -> bool:
    """Return whether a task is one that another package offers."""
    from vinefab.core.foreign import is_own
    from vinefab.tasks import TASKS

    return name in TASKS and not is_own(TASKS[name])


def note_seen(context: Context, families: Sequence[MapFamily]) -> None:
    """Say on how many maps the run of the designs trained, where it remembers them."""
    if seen := context.run.seen_words(one for family in families for one in family.worlds):
        note(seen, only_in_shell=True)


def families_of(
    maps: MapsLike,
    start: StartsLike,
    environment: str | None,
    count: int,
    seed: int,
    options: object,
    *,
    targets: TargetsLike = (),
) -> tuple[MapFamily, ...]:
    """Return the maps passed, with targets, and unseen ones of an environment, as families."""
    from dataclasses import replace

    from vinefab.prediction.family_deployments import map_families, unseen_maps

    chosen, unseen = as_mapping("options", options), None
    if environment is not None:
        unseen = unseen_maps(environment, count, seed, chosen)
        worlds = tuple(as_map(world, "maps", start) for world in unseen.worlds)
        unseen = replace(unseen, worlds=worlds)
    return map_families(as_maps(maps, start, targets), unseen)


def parted(
    environment: str | None, options: object, given: Mapping[str, object]
) -> tuple[dict[str, object], dict[str, object]]:
    """Return the options of an environment, and the parameters that are left for a task."""
    from vinefab.core.registry import parameter_names
    from vinefab.maps.generators.environments import ENVIRONMENTS

    known = () if environment is None else parameter_names(ENVIRONMENTS[environment].options)
    of_environment = {name: value for name, value in given.items() if name in known}
    chosen = dict(as_mapping("options", options))
    for name in of_environment.keys() & chosen.keys():
        raise UnfitInputError(name, "is given twice", "leave one of them out")
    left = {name: value for name, value in given.items() if name not in known}
    return {**chosen, **of_environment}, left


def task_of(task: str | Task, parameters: Mapping[str, object]) -> Task:
    """Return a task by its name, or the one passed."""
    from vinefab.tasks import TASKS, make_task

    if isinstance(task, str):
        return make_task(task, parameters)
    if isinstance(task, type) or not all(hasattr(task, n) for n in ("name", "lowest", "evaluate")):
        allowed = f"{', '.join(TASKS)}, or an object with name, lowest and evaluate"
        raise BadInputError("task", task, allowed)
    for name in parameters:
        problem = "goes with a task that is named, and this is an object"
        raise UnfitInputError(name, problem, "give it to the task itself")
    from vinefab.tasks.task import ensure_task

    ensure_task(task)
    return task


# --- What verbs return that no room has a result for: what was written, what was listed -----------


def _document(schema: str, content: Mapping[str, object]) -> str:
    from vinefab.core.plain_text import json_text

    return json_text(schema, content)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class WrittenFile(Result):
    """A file to begin with that `new` wrote, or a page that `studio` wrote.

    Parameters
    ----------
    path
        The file; what is returned can be passed as a path.
    summary
        What a user should know, a line each.
    is_new
        Whether it was written now; False where it was there already and is left as it is.
    """

    path: Path
    summary: tuple[str, ...] = ()
    is_new: bool = True

    def __fspath__(self) -> str:
        """Return the path."""
        return str(self.path)

    def view(self) -> Iterator[Block]:
        """Yield the file and notes on it."""
        yield from [Text(f"written: {self.path}")] * self.is_new
        yield Notes(self.summary)

    def json_text(self) -> str:
        """Return the written files as JSON: ``vinefab/written-1``."""
        return _document("vinefab/written-1", {"files": [str(self.path)]})


class Names(tuple[str, ...]):
    """Names of shipped files and the user's own, with the lines that a shell prints.

    Examples
    --------
    >>> Names(["a", "b"])
    ('a', 'b')
    """

    lines: tuple[str, ...] = ()  # what a shell prints, a line each

    @classmethod
    def of(cls, names: Any, lines: Any = ()) -> Names:
        """Return names with lines about them; without lines the names alone."""
        found = cls(names)
        found.lines = tuple(lines)
        return found

    @property
    def summary(self) -> tuple[str, ...]:
        """A line for each."""
        return self.lines or tuple(self)

    def json_text(self) -> str:
        """Return the names as JSON: ``vinefab/names-1``."""
        return _document("vinefab/names-1", {"names": list(self)})


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class WrittenFolder(Result):
    """A folder of files that `fabricate`, `rig` or `coupon` wrote.

    Parameters
    ----------
    path
        The folder.
    files
        Names of the files in it.
    report
        What the design rules say.
    summary
        What a user should know, a line each.
    """

    path: Path
    files: tuple[str, ...]
    report: CheckReport
    summary: tuple[str, ...] = ()

    def __fspath__(self) -> str:
        """Return the path: the folder can be passed where one is expected."""
        return str(self.path)

    def view(self) -> Iterator[Block]:
        """Yield the files and the findings."""
        yield Text(f"written: {self.path}: {counted(len(self.files), 'file')}")
        files = tuple((name,) for name in self.files)
        yield Rows(caption="files", headings=("file",), rows=files)
        yield from self.report.view()

    def __repr__(self) -> str:
        return "\n".join([f"<WrittenFolder {self.path}>", *lines(self.view())])

    def json_text(self) -> str:
        """Return the names of the files as JSON: ``vinefab/written-1``."""
        content = {"folder": str(self.path), "files": list(self.files)}
        return _document("vinefab/written-1", content)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StudyOutcome(Result):
    """What a study or the demonstration found.

    Parameters
    ----------
    found
        The result of the room that did the work.
    blocks
        The numbers to take away.
    text
        The JSON document.
    exit_code
        Of the command.
    table
        Its main table; by default the first one of the document.
    """

    found: Any
    blocks: tuple[Block, ...]
    text: str = field(repr=False)
    exit_code: int = 0
    table: tuple[dict[str, Any], ...] = field(default=(), repr=False)

    @property
    def records(self) -> list[dict[str, Any]]:
        """Its main table as plain values, a dict for each row: claims, optimizers, speeds."""
        return [*self.table] or main_table(self.numbers)

    def view(self) -> tuple[Block, ...]:
        """Return the numbers to take away."""
        return self.blocks

    def json_text(self) -> str:
        """Return everything as JSON."""
        return self.text
