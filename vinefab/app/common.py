"""What several verbs share: growth options, families of maps, tasks, and what is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from vinefab.core.atomic import ensure_own_folder, ensure_writable, write_bytes, write_text
from vinefab.core.errors import BadInputError, located
from vinefab.core.verbs import Doc, Kind, Within, also, note, registered_names, this_call, wrote
from vinefab.model.inputs import (
    FOLDER,
    PAIRS,
    MapsLike,
    Pairs,
    PathText,
    StartsLike,
    TargetsLike,
    as_growth,
    as_map,
    as_mapping,
    as_maps,
    as_path,
    written,
)

if TYPE_CHECKING:
    from vinefab.growth.options import GrowthChoice
    from vinefab.model.design import Design
    from vinefab.model.laser import LaserProfile
    from vinefab.prediction.aiming import AimResult
    from vinefab.prediction.comparison import DesignComparison
    from vinefab.prediction.family_deployments import MapFamily
    from vinefab.prediction.inflation_report import InflatedDesign
    from vinefab.prediction.predict import Predicted
    from vinefab.tasks.task import Task

    TaskLike = str | Task
    Answer = TypeVar("Answer", AimResult, DesignComparison, InflatedDesign, Predicted)
else:
    TaskLike = Annotated[
        object,
        Kind(metavar="TASK", known=registered_names("vinefab.tasks.shipped_tasks:TASKS")),
        Doc("The name of a task, in Python also a task of your own: an object with ``name``, "
            "``lowest`` and ``evaluate``."),
    ]  # fmt: skip

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
EnvironmentOptions = Annotated[
    Pairs | None, also("--set"), Doc("The environment's options, such as size_mm=300.")
]
TaskParameters = Annotated[
    object, PAIRS, also("--set"), Doc("Parameters of a task that is named, such as radius_mm=60.")
]
BodyWidth = Annotated[
    Literal["inflated", "centerline"],
    Doc("How wide a body is; default: as the design was trained."),
]
OutFolder = Annotated[
    PathText, FOLDER, Doc("The folder to write; an earlier one of its kind is replaced.")
]
PageFile = Annotated[PathText, written(".html", ".htm"), Doc("The page to write.")]
PictureFile = Annotated[
    PathText | None, written(".svg", ".png"), also("--svg"), Doc("A picture to write.")
]


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


def with_origin(
    found: Answer,
    designs: Sequence[Design],
    families: Sequence[MapFamily],
    profile: LaserProfile | None = None,
) -> Answer:
    """Return a result with what it takes to get it again: this call, and what went in."""
    from dataclasses import replace

    from vinefab.prediction.provenance import origin_of

    return replace(found, origin=origin_of(this_call().text(), designs, profile, families))


def folder_to_write(key: str, out: str | PathLike[str], mark: str, *, force: bool) -> Path:
    """Return the folder to fill, once it may be; name what lies beside it from a killed run."""
    from vinefab.core.replacement import moved_aside

    folder = as_path(key, out)
    ensure_own_folder(folder, mark, force=force)
    for aside in moved_aside(folder):
        note(
            f"note: {aside} has files of {folder} from before a run was killed; vinefab leaves "
            "it alone: move out what you miss, then remove it"
        )
    return folder


def ensure_apart(key: str, path: Path, source: object, what: str) -> None:
    """Check that what is to be written is another file than what is read."""
    import os

    if not isinstance(source, str | PathLike):
        return
    read = Path(source)
    # Unlike Path.resolve, realpath takes a link that leads to itself.
    same = os.path.realpath(path) == os.path.realpath(read)
    if same or (path.exists() and read.exists() and path.samefile(read)):
        raise BadInputError(key, str(path), f"another file than {what}")


def file_of(kind: str, given: object) -> object:
    """Return the file that a name or a path means; what is neither as it is."""
    from vinefab.model.files.shipped import locate

    return locate(kind, given) if isinstance(given, str | PathLike) else given


def growth_choice(
    named: Sequence[object],
    designs: Sequence[Design],
    growth: object,
    body: str | None = None,
    head_on_half_angle_deg: object = None,
    contacts: object = None,
    *,
    children_of_stuck: str | None = None,
) -> tuple[GrowthChoice, Mapping[str, Any]]:
    """Return the growth options for designs, and those that were passed.

    An error in the origin of a design names its file.
    """
    from vinefab.growth.options import GrowthChoice, trained_growth

    given = as_growth(
        growth,
        body=body,
        head_on_half_angle_deg=head_on_half_angle_deg,
        contacts=contacts,
        children_of_stuck=children_of_stuck,
    )
    for name, design in zip(named, designs, strict=True):
        file = file_of("design", name)
        with located(fspath(file)) if isinstance(file, PathLike) else nullcontext():
            trained_growth(design)
    return GrowthChoice.of(designs, given), given


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


def task_of(task: str | Task, parameters: Mapping[str, object]) -> Task:
    """Return a task by its name, or the one passed."""
    from vinefab.tasks.shipped_tasks import TASKS, make_task

    if isinstance(task, str):
        return make_task(task, parameters)
    if isinstance(task, type) or not all(hasattr(task, n) for n in ("name", "lowest", "evaluate")):
        allowed = f"{', '.join(TASKS)}, or an object with name, lowest and evaluate"
        raise BadInputError("task", task, allowed)
    for name, value in parameters.items():
        raise BadInputError(name, value, "a parameter of a task that is named, not of an object")
    return task
