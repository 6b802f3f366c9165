"""State of the page, read and validated: design, map with edits, start, recipe, family; forms."""

import json
import math
import re
import types
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import shapely
from annotated_types import Ge, Interval, Le, MinLen, Unit
from pydantic import BaseModel, Field
from shapely import Polygon
from shapely.affinity import rotate, scale, translate
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.hashing import sha256_of
from vinefab.core.limits import MOST_FIRST_SEED
from vinefab.core.plain_text import counted
from vinefab.core.registry import with_parameters
from vinefab.core.table import DeclaredKey, Slider, Table, declared_keys, inner_table, validated
from vinefab.core.validation import LARGEST_MM, SMALLEST, number, whole
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.inflation.pattern import as_grown
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import (
    MOST_LEVELS,
    PER_LEVEL,
    BendPlace,
    BendTurn,
    Build,
    Design,
    design_of,
)
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate, path_given
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.map import Map, Pose
from vinefab.model.target import targets_given

PAGE = "the page"
"""The source of a value of the page, in messages."""

MOST_EDITS, MOST_TEXTS = 10_000, 1000

_Coordinate = Annotated[float, Ge(-LARGEST_MM), Le(LARGEST_MM), Unit("mm")]
_Size = Annotated[float, Ge(SMALLEST), Le(LARGEST_MM), Unit("mm")]


def _text(key: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise BadInputError(key, value, "a text", PAGE)
    return value


def texts_at(key: str, value: object) -> list[str]:
    """Return a value of the page that must be a list of texts."""
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        raise BadInputError(key, value, "a list of texts", PAGE)
    if len(value) > MOST_TEXTS:
        raise BadInputError(key, counted(len(value), "text"), f"at most {MOST_TEXTS}", PAGE)
    return value


def mapping_at(key: str, value: object) -> Mapping[str, Any]:
    """Return a value of the page that must be an object: names with values."""
    if not isinstance(value, Mapping):
        raise BadInputError(key, value, "names with values", PAGE)
    return value


class Frame(Table):
    """The smallest rectangle around an obstacle: what is typed and dragged of it."""

    x_mm: Annotated[_Coordinate, Doc("of its middle")]
    y_mm: Annotated[_Coordinate, Doc("of its middle")]
    width_mm: Annotated[_Size, Doc("along its first axis")]
    height_mm: Annotated[_Size, Doc("across it")]
    turn_deg: Annotated[
        float, Interval(ge=-360, le=360), Unit("deg"), Doc("of its first axis from x")
    ] = 0.0

    @classmethod
    def around(cls, obstacle: Polygon) -> "Frame":
        """Return the frame of an obstacle, turned by at most 45 degrees either way."""
        box = shapely.oriented_envelope(obstacle)
        x, y = shapely.get_coordinates(box).T.tolist()
        first, second = complex(x[1] - x[0], y[1] - y[0]), complex(x[2] - x[1], y[2] - y[1])
        along, across = (first, second) if abs(first.real) >= abs(first.imag) else (second, first)
        along = along if along.real > 0.0 else -along
        middle = box.centroid
        turn_deg = math.degrees(math.atan2(along.imag, along.real))
        return cls(
            x_mm=middle.x, y_mm=middle.y, width_mm=abs(along), height_mm=abs(across),
            turn_deg=turn_deg,
        )  # fmt: skip

    def moved(self, dx_mm: float, dy_mm: float) -> "Frame":
        """Return the frame elsewhere."""
        return self.changed(x_mm=self.x_mm + dx_mm, y_mm=self.y_mm + dy_mm)

    def taken_to(self, other: "Frame", shape: Polygon) -> Polygon:
        """Return a shape in this frame as it lies in another."""
        shape = rotate(translate(shape, -self.x_mm, -self.y_mm), -self.turn_deg, origin=(0, 0))
        by = other.width_mm / self.width_mm, other.height_mm / self.height_mm
        shape = rotate(scale(shape, *by, origin=(0, 0)), other.turn_deg, origin=(0, 0))
        return translate(shape, other.x_mm, other.y_mm)

    def place_mm(self, along: float, across: float) -> tuple[float, float]:
        """Return a place of the frame, from -1 to 1 along its axes."""
        turn = math.radians(self.turn_deg)
        a_mm, b_mm = 0.5 * self.width_mm * along, 0.5 * self.height_mm * across
        return (
            self.x_mm + a_mm * math.cos(turn) - b_mm * math.sin(turn),
            self.y_mm + a_mm * math.sin(turn) + b_mm * math.cos(turn),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EditedMap:
    """A map with its obstacles as they are edited; its targets are those of its source."""

    world: Map
    frames: tuple[Frame | None, ...]  # of obstacles that were placed; None: the smallest around it
    key: str  # the same for the same obstacles of the same map
    more: int  # obstacles than the source has

    def frame(self, index: int) -> Frame:
        """Return the frame of an obstacle."""
        return self.frames[index] or Frame.around(self.world.obstacles[index])


def edited_map(content: Mapping[str, Any]) -> EditedMap:
    """Return the open map with the page's edits.

    Parameters
    ----------
    content
        ``source``: ``{"file": PATH}``, or ``{"environment": NAME, "seed": N, "options": {...}}``;
        ``edits``, a list that is applied in order: ``["move", INDEX, DX_MM, DY_MM]``, ``["place",
        INDEX, FRAME]`` with all or some values of a frame, ``["add", [[X, Y], ...]]``, ``["remove",
        INDEX]``.
    """
    source = mapping_at("map.source", content.get("source"))
    edits = content.get("edits") or []
    if not isinstance(edits, list):
        raise BadInputError("map.edits", edits, "a list of edits", PAGE)
    if len(edits) > MOST_EDITS:
        raise BadInputError("map.edits", counted(len(edits), "edit"), f"at most {MOST_EDITS}", PAGE)
    stamp = file_stamp(path_given("map.file", source["file"])) if "file" in source else ""
    return _edited_map(json.dumps(source, sort_keys=True), json.dumps(edits), stamp)


def world_of(content: Mapping[str, Any]) -> Map:
    """Return the map that the page shows: see `edited_map`; ``targets`` replace the source's."""
    world, targets = edited_map(content).world, content.get("targets")
    if targets is None:
        return world
    try:
        return replace(world, targets=targets_given(targets, "map.targets"))
    except BadInputError as error:
        raise error.at(PAGE) from None


def start_of(given: object) -> Pose | None:
    """Return the start that the page sent; None where it is the map's own."""
    if given is None:
        return None
    place = mapping_at("pose", given)
    try:
        return Pose.of((place["x_mm"], place["y_mm"], place["heading_deg"]))
    except KeyError:
        raise BadInputError("pose", dict(place), "x_mm, y_mm and heading_deg", PAGE) from None


@lru_cache(maxsize=32)
def _edited_map(source: str, edits: str, stamp: str) -> EditedMap:
    world, changes = _source_world(source, stamp), json.loads(edits)
    obstacles = list(world.obstacles)
    count = len(obstacles)
    frames: list[Frame | None] = [None] * len(obstacles)
    for place, edit in enumerate(changes):
        _apply(edit, obstacles, frames, f"map.edits.{place}")
    if changes:
        # Starts stay: one inside of an obstacle is told when a robot is to grow there.
        world = replace(world, obstacles=tuple(obstacles))
    key = sha256_of("\n".join((source, edits, stamp)).encode())[:16]
    return EditedMap(world=world, frames=tuple(frames), key=key, more=len(obstacles) - count)


@lru_cache(maxsize=256)
def _source_world(source: str, stamp: str) -> Map:  # noqa: ARG001  a changed file is read anew
    given = json.loads(source)
    if "file" in given:
        return Map.read(Path(_text("map.file", given["file"])))
    environment = _text("map.environment", given.get("environment"))
    options = mapping_at("map.options", given.get("options") or {})
    kind = ENVIRONMENTS[environment]
    seed = whole("map.seed", given.get("seed", 0), 0, MOST_FIRST_SEED)
    return kind.generate(seed, with_parameters(kind.options, environment, options))


def _apply(edit: Any, obstacles: list[Polygon], frames: list[Frame | None], key: str) -> None:  # noqa: ANN401  JSON
    allowed = "['move', I, DX, DY], ['place', I, FRAME], ['add', [[X, Y], ...]] or ['remove', I]"
    if not isinstance(edit, list) or len(edit) < 2:
        raise BadInputError(key, edit, allowed, PAGE)
    kind, rest = edit[0], edit[1:]

    def coordinate(value: Any) -> float:  # noqa: ANN401  JSON
        return number(key, value, -LARGEST_MM, LARGEST_MM, "mm")

    if kind == "add" and len(rest) == 1:
        points = rest[0]
        if not isinstance(points, list) or not 3 <= len(points) <= 10_000:
            raise BadInputError(key, points, "at least three points [x, y], mm", PAGE)
        for point in points:
            if not isinstance(point, list) or len(point) != 2:
                raise BadInputError(key, point, "a point [x, y], mm", PAGE)
        added = Polygon([[coordinate(value) for value in two] for two in points])
        if not added.is_valid or added.is_empty:
            reason = shapely.is_valid_reason(added)
            raise BadInputError(key, reason, "a polygon that is valid", PAGE)
        obstacles.append(added)
        frames.append(None)
        return
    if (kind, len(rest)) not in {("move", 3), ("place", 2), ("remove", 1)}:
        raise BadInputError(key, edit, allowed, PAGE)
    index = whole(key, rest[0], 0, len(obstacles) - 1)
    if kind == "remove":
        del obstacles[index], frames[index]
    elif kind == "move":
        dx_mm, dy_mm = map(coordinate, rest[1:])
        obstacles[index] = translate(obstacles[index], dx_mm, dy_mm)
        old = frames[index]
        frames[index] = None if old is None else old.moved(dx_mm, dy_mm)
    else:
        old = frames[index] or Frame.around(obstacles[index])
        try:
            frame = validated(Frame, {**old.content, **mapping_at(key, rest[1])})
        except BadInputError as error:
            raise error.under(f"{key}.{error.key}", PAGE) from None
        obstacles[index], frames[index] = old.taken_to(frame, obstacles[index]), frame


def file_stamp(path: Path) -> str:
    """Return a stamp that changes with a file; empty if it does not exist."""
    try:
        found = path.stat()
    except OSError:
        return ""
    return f"{found.st_mtime_ns}:{found.st_size}"


MOST_FAMILY, MOST_POSES = 200, 5


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
            raise error.under(f"family.{error.key}", PAGE) from None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StudioState:
    """The validated state of the page.

    The page sends it whole with every question, so that the server remembers nothing of a tab.
    """

    design: Design
    world: Map | None  # with the page's edits and targets; None where no map is open
    ground: EditedMap | None  # the same without the page's targets
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
        given = mapping_at("state", content)
        content = mapping_at("design", given.get("design"))
        tables = content.get("branch")
        tables = tables if isinstance(tables, list) else []
        names = [one.get("name") if isinstance(one, Mapping) else None for one in tables]
        with branches_named(names):
            design = design_of(content, PAGE)
        recipe = _text("recipe", given.get("recipe") or DEFAULT_RECIPE)
        shown = None if given.get("map") is None else mapping_at("map", given["map"])
        # Many maps are of the open map's kind until the page asks for another.
        source = {} if shown is None else member(shown, "source")
        usual = {"environment": source["environment"]} if "environment" in source else {}
        return cls(
            design=design,
            world=None if shown is None else world_of(shown),
            ground=None if shown is None else edited_map(shown),
            pose=start_of(given.get("pose")),
            profile=current_profile(recipe),
            recipe=recipe,
            task=_text("task", given.get("task") or "coverage"),
            family=Family.of({**usual, **mapping_at("family", given.get("family") or {})}),
            growth=GrowthChoice.of(
                [design], mapping_at("growth", given.get("growth") or {})
            ).options,
            locks=frozenset(texts_at("locks", given.get("locks") or [])),
        )

    @property
    def grown(self) -> Design:
        """The design as it deploys."""
        return as_grown(self.design, self.profile)

    @property
    def grown_now(self) -> Design:
        """The design as it deploys, by the values known without simulating joints."""
        return as_grown(self.design, self.profile, known_only=True)

    @property
    def start(self) -> Pose | None:
        """The start of the robot: the page's pose, or the map's first start."""
        if self.pose is not None or self.world is None or not self.world.starts:
            return self.pose
        return self.world.starts[0].pose


def is_name(given: object) -> bool:
    """Tell whether this is a bare name, as of a shipped design, and no path."""
    return isinstance(given, str) and not Path(given).suffix and Path(given).parent == Path()


def files_named_in(content: Mapping[str, Any]) -> list[tuple[str, object]]:
    """Return the files that a state names, each with its key: `StudioState.of` reads no others."""
    source = member(member(content, "map"), "source")
    files = member(content, "family").get("files")
    named = [("map.source.file", source.get("file")), ("recipe", content.get("recipe") or None)]
    named += [("family.files", name) for name in files] if isinstance(files, list) else []
    return [(key, given) for key, given in named if given is not None]


_OF_BRANCH = re.compile(r"branch\[(\d+)\]\.(.+)")


@contextmanager
def branches_named(names: Sequence[object]) -> Iterator[None]:
    """Name the branch in an error about one: the page shows no numbers of tables.

    Parameters
    ----------
    names
        Of all branches, in the order of their tables.
    """
    try:
        yield
    except BadInputError as error:
        found = _OF_BRANCH.fullmatch(error.key)
        if found is None or int(found[1]) > len(names):
            raise
        name = names[int(found[1]) - 1]
        raise error.under(f"{found[2]} of branch {name!r}", error.source) from None


def member(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return what is at a key if it is an object, and an empty one otherwise."""
    value = content.get(key)
    return value if isinstance(value, Mapping) else {}


def current_profile(recipe: str) -> LaserProfile:
    """Return the laser profile of a recipe, read anew when its file has changed."""
    path = locate("recipe", recipe)
    return _profile(recipe, file_stamp(path))


@lru_cache(maxsize=16)
def _profile(recipe: str, stamp: str) -> LaserProfile:  # noqa: ARG001  a changed file is read anew
    return read_profile(recipe)


_UNITS = {"deg": "°"}


def design_form() -> dict[str, Any]:
    """Return the rows of a design's tables: keys with a slider, with a choice, with own rows."""
    return {"most_levels": MOST_LEVELS - 1, "rows": _rows(Design), "bend": _rows(_Bend)}


class _Bend(Table):
    """The two numbers of a preformed bend, which a file has in a list."""

    at_mm: Annotated[
        BendPlace,
        Unit("mm"),
        Field(alias="0", title="at"),
        Slider(1, 400),
        Doc("from the base of the branch"),
    ]
    turn_deg: Annotated[
        BendTurn,
        Unit("deg"),
        Field(alias="1", title="turn"),
        Slider(-120, 120),
        Doc("counter-clockwise: the tube is cut with it"),
    ]


def growth_form() -> list[dict[str, Any]]:
    """Return the rows of the growth options; measured contacts have their own file."""
    return [row for row in _rows(GrowthOptions) if "rows" not in row]


def _rows(table: type[BaseModel]) -> list[dict[str, Any]]:
    rows = []
    for key in declared_keys(table):
        mark = PER_LEVEL.get(key.field) if table is Build else None
        shown = _shown(key) | ({"first": mark.first, "absent": mark.absent} if mark else {})
        if shown and key.name != "schema":
            rows.append({"key": key.name, "label": label_of(key), "about": key.meaning, **shown})
    return rows


def _shown(key: DeclaredKey) -> dict[str, Any]:
    """Return the control of a key; empty for one that the page does not show."""
    inner, kind = inner_table(key.annotation), key.annotation
    if inner is not None:
        rows = _rows(inner)
        many = tuple in (get_origin(kind), *map(get_origin, get_args(kind)))
        return {"rows": rows, "many": many} if rows else {}
    if get_origin(kind) in (Union, types.UnionType):  # of an optional value
        kind = get_args(kind)[0]
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    if get_origin(kind) is Literal:
        return {"choices": list(get_args(kind)), "default": key.default}
    if kind is bool:
        return {"flag": True, "default": key.default}
    if key.slider is None:
        return {}
    return {
        "unit": _UNITS.get(key.unit, key.unit),
        "least": next((limit.ge for limit in key.limits if isinstance(limit, Ge)), None),
        "most": next((limit.le for limit in key.limits if isinstance(limit, Le)), None),
        "slider": [key.slider.low, key.slider.high],
        "step": key.slider.step,
        "whole": kind is int,
        "default": key.default if isinstance(key.default, int | float) else None,
    }


def label_of(key: DeclaredKey) -> str:
    """Return the label of a key: its title, or its name without the unit."""
    unit = "percent" if key.unit == "%" else key.unit.lower()
    return key.title or key.name.removesuffix(f"_{unit}").replace("_", " ").capitalize()
