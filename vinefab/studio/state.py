"""What is open on the page: design, map with edits, start, recipe, task, family of maps."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import shapely
from annotated_types import Interval, MinLen
from pydantic import Field
from shapely import Polygon
from shapely.affinity import translate
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.limits import MOST_FIRST_SEED
from vinefab.core.registry import with_parameters
from vinefab.core.table import Table, validated
from vinefab.core.validation import LARGEST_MM, number, whole
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import Design, design_of
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate, path_given
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map, Pose
from vinefab.prediction.deploy import as_grown

PAGE = "the page"
"""What messages call the source of a value that was set on the page."""

MOST_EDITS = 10_000
MOST_FAMILY, MOST_POSES = 200, 5

MapSource = Mapping[str, Any]
"""``{"file": PATH}``, or ``{"environment": NAME, "seed": N, "options": {...}}``."""


class Family(Table):
    """The maps of the panel with many maps: seeds of an environment, or files."""

    environment: Annotated[str, MinLen(1)] = "grid"
    count: Annotated[int, Interval(ge=1, le=MOST_FAMILY)] = 40
    seed: Annotated[int, Interval(ge=0, le=2**31), Doc("of the first map; the others follow")] = (
        1000
    )
    poses: Annotated[
        int, Interval(ge=1, le=MOST_POSES), Doc("on each map, drawn from its starts")
    ] = 1
    files: Annotated[
        tuple[str, ...],
        Field(strict=False, max_length=MOST_FAMILY),
        Doc("in place of an environment"),
    ] = ()
    stamp: Annotated[str, Doc("changes when a file has changed")] = ""

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Family":
        """Return the family that the page asks for."""
        given = {key: value for key, value in content.items() if key != "files" or value}
        try:
            return validated(cls, given, PAGE)
        except BadInputError as error:
            raise BadInputError(f"family.{error.key}", error.value, error.allowed, PAGE) from error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StudioState:
    """What is open on the page, read and validated.

    The page sends it whole with every question, so that the server remembers nothing of a tab.
    """

    design: Design
    world: Map | None  # with the page's edits; None where no map is open
    pose: Pose | None  # None: the map's first start
    profile: LaserProfile
    recipe: str  # what the profile was opened by
    task: str
    family: Family
    growth: GrowthOptions
    locks: frozenset[str]  # dotted keys of the design that must not change: ``level.0.angle_deg``

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "StudioState":
        """Return the state that the page sent.

        Raises
        ------
        VinefabError
            If a value or a file cannot be used.
        """
        given = _mapping("state", content)
        design = design_of(_mapping("design", given.get("design")), PAGE)
        recipe = _text("recipe", given.get("recipe") or DEFAULT_RECIPE)
        return cls(
            design=design,
            world=None if given.get("map") is None else world_of(_mapping("map", given["map"])),
            pose=_pose(given.get("pose")),
            profile=current_profile(recipe),
            recipe=recipe,
            task=_text("task", given.get("task") or "coverage"),
            family=Family.of(_mapping("family", given.get("family") or {})),
            growth=GrowthChoice.of([design], _mapping("growth", given.get("growth") or {})).options,
            locks=frozenset(_texts("locks", given.get("locks") or [])),
        )

    @property
    def grown(self) -> Design:
        """The design as it deploys."""
        return as_grown(self.design, self.profile)

    @property
    def grown_now(self) -> Design:
        """The design as it deploys, by what is known without simulating joints."""
        return as_grown(self.design, self.profile, known_only=True)

    @property
    def start(self) -> Pose | None:
        """Where the robot starts: the page's pose, or the map's first start."""
        if self.pose is not None or self.world is None or not self.world.starts:
            return self.pose
        return self.world.starts[0].pose


def is_name(given: object) -> bool:
    """Tell whether this is a bare name, as of a shipped design, and no path."""
    return isinstance(given, str) and not Path(given).suffix and Path(given).parent == Path()


def files_named_in(content: Mapping[str, Any]) -> list[tuple[str, object]]:
    """Return the files that a state names, each with its key: `StudioState.of` reads no others."""
    source = _member(_member(content, "map"), "source")
    files = _member(content, "family").get("files")
    named = [("map.source.file", source.get("file")), ("recipe", content.get("recipe") or None)]
    named += [("family.files", name) for name in files] if isinstance(files, list) else []
    return [(key, given) for key, given in named if given is not None]


def _member(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content.get(key)
    return value if isinstance(value, Mapping) else {}


def world_of(content: Mapping[str, Any]) -> Map:
    """Return the map that the page shows: its source with the page's edits.

    Parameters
    ----------
    content
        ``source`` (see `MapSource`) and ``edits``, a list that is applied in order:
        ``["move", INDEX, DX_MM, DY_MM]``, ``["add", [[X, Y], ...]]``, ``["remove", INDEX]``.
    """
    source = _mapping("map.source", content.get("source"))
    edits = content.get("edits") or []
    if not isinstance(edits, list) or len(edits) > MOST_EDITS:
        raise BadInputError("map.edits", "edits", f"a list of at most {MOST_EDITS}", PAGE)
    stamp = _stamp(path_given("map.file", source["file"])) if "file" in source else ""
    return _edited_world(json.dumps(source, sort_keys=True), json.dumps(edits), stamp)


@lru_cache(maxsize=32)
def _edited_world(source: str, edits: str, stamp: str) -> Map:
    world, changes = _source_world(source, stamp), json.loads(edits)
    if not changes:
        return world
    obstacles = list(world.obstacles)
    for place, edit in enumerate(changes):
        _apply(edit, obstacles, f"map.edits.{place}")
    # Starts stay: one inside of an obstacle is told when a robot is to grow there.
    return replace(world, obstacles=tuple(obstacles))


@lru_cache(maxsize=256)
def _source_world(source: str, stamp: str) -> Map:  # noqa: ARG001  a changed file is read anew
    given = json.loads(source)
    if "file" in given:
        return Map.read(Path(_text("map.file", given["file"])))
    environment = _text("map.environment", given.get("environment"))
    options = _mapping("map.options", given.get("options") or {})
    kind = ENVIRONMENTS[environment]
    seed = whole("map.seed", given.get("seed", 0), 0, MOST_FIRST_SEED)
    return kind.make(seed, with_parameters(kind.options, environment, options))


def _apply(edit: Any, obstacles: list[Polygon], key: str) -> None:  # noqa: ANN401  JSON
    allowed = "['move', INDEX, DX, DY], ['add', [[X, Y], ...]] or ['remove', INDEX]"
    if not isinstance(edit, list) or len(edit) < 2:
        raise BadInputError(key, edit, allowed, PAGE)
    kind, rest = edit[0], edit[1:]
    if kind == "add" and len(rest) == 1:
        obstacles.append(_polygon(key, rest[0]))
    elif kind == "remove" and len(rest) == 1:
        obstacles.pop(whole(key, rest[0], 0, len(obstacles) - 1))
    elif kind == "move" and len(rest) == 3:
        index = whole(key, rest[0], 0, len(obstacles) - 1)
        by_mm = [number(key, value, -LARGEST_MM, LARGEST_MM, "mm") for value in rest[1:]]
        obstacles[index] = translate(obstacles[index], *by_mm)
    else:
        raise BadInputError(key, edit, allowed, PAGE)


def _polygon(key: str, points: Any) -> Polygon:  # noqa: ANN401  JSON
    if not isinstance(points, list) or not 3 <= len(points) <= 10_000:
        raise BadInputError(key, points, "at least three points [x, y], mm", PAGE)
    pairs = [
        [number(key, value, -LARGEST_MM, LARGEST_MM, "mm") for value in _sequence(key, point)]
        for point in points
    ]
    polygon = Polygon(pairs)
    if not polygon.is_valid or polygon.is_empty:
        raise BadInputError(key, shapely.is_valid_reason(polygon), "a polygon that is valid", PAGE)
    return polygon


def current_profile(recipe: str) -> LaserProfile:
    """Return the laser profile of a recipe, read anew when its file has changed."""
    path = locate("recipe", recipe)
    return _profile(recipe, _stamp(path))


@lru_cache(maxsize=16)
def _profile(recipe: str, stamp: str) -> LaserProfile:  # noqa: ARG001  see profile_of
    return read_profile(recipe)


def _stamp(path: Path) -> str:
    """Return what changes when a file does; nothing for one that is not there."""
    try:
        found = path.stat()
    except OSError:
        return ""
    return f"{found.st_mtime_ns}:{found.st_size}"


def _pose(content: Any) -> Pose | None:  # noqa: ANN401  JSON
    if content is None:
        return None
    given = _mapping("pose", content)
    try:
        return Pose.of((given["x_mm"], given["y_mm"], given["heading_deg"]))
    except KeyError as error:
        raise BadInputError("pose", dict(given), "x_mm, y_mm and heading_deg", PAGE) from error


def _text(key: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise BadInputError(key, value, "a text", PAGE)
    return value


def _texts(key: str, value: object) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        raise BadInputError(key, value, "a list of texts", PAGE)
    return value


def _mapping(key: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise BadInputError(key, value, "names with values", PAGE)
    return value


def _sequence(key: str, value: object) -> Sequence[Any]:
    if not isinstance(value, list) or len(value) != 2:
        raise BadInputError(key, value, "a point [x, y], mm", PAGE)
    return value
