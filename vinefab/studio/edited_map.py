"""The open map with what the page changed: obstacles moved, placed, added, removed; targets."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import shapely
from annotated_types import Ge, Interval, Le, Unit
from shapely import Polygon
from shapely.affinity import rotate, scale, translate
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.hashing import sha256_of
from vinefab.core.limits import MOST_FIRST_SEED
from vinefab.core.registry import with_parameters
from vinefab.core.table import Table, validated
from vinefab.core.validation import LARGEST_MM, SMALLEST, number, whole
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.files.shipped import path_given
from vinefab.model.map import Map
from vinefab.model.target import targets_given

PAGE = "the page"
"""What messages call the source of a value that was set on the page."""

MOST_EDITS = 10_000

_Coordinate = Annotated[float, Ge(-LARGEST_MM), Le(LARGEST_MM), Unit("mm")]
_Size = Annotated[float, Ge(SMALLEST), Le(LARGEST_MM), Unit("mm")]


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
class Ground:
    """A map with its obstacles as they are edited; its targets are those of its source."""

    world: Map
    frames: tuple[Frame | None, ...]  # of obstacles that were placed; None: the smallest around it
    key: str  # the same for the same obstacles of the same map

    def frame(self, index: int) -> Frame:
        """Return the frame of an obstacle."""
        return self.frames[index] or Frame.around(self.world.obstacles[index])


def ground_of(content: Mapping[str, Any]) -> Ground:
    """Return the open map with the page's edits.

    Parameters
    ----------
    content
        ``source``: ``{"file": PATH}``, or ``{"environment": NAME, "seed": N, "options": {...}}``;
        ``edits``, a list that is applied in order: ``["move", INDEX, DX_MM, DY_MM]``, ``["place",
        INDEX, FRAME]``, ``["add", [[X, Y], ...]]``, ``["remove", INDEX]``.
    """
    source = content.get("source")
    if not isinstance(source, Mapping):
        raise BadInputError("map.source", source, "names with values", PAGE)
    edits = content.get("edits") or []
    if not isinstance(edits, list) or len(edits) > MOST_EDITS:
        raise BadInputError("map.edits", "edits", f"a list of at most {MOST_EDITS}", PAGE)
    stamp = file_stamp(path_given("map.file", source["file"])) if "file" in source else ""
    return _ground(json.dumps(source, sort_keys=True), json.dumps(edits), stamp)


def world_of(content: Mapping[str, Any]) -> Map:
    """Return the map that the page shows: see `ground_of`; ``targets`` replace the source's."""
    world, targets = ground_of(content).world, content.get("targets")
    if targets is None:
        return world
    try:
        return replace(world, targets=targets_given(targets, "map.targets"))
    except BadInputError as error:
        raise BadInputError(error.key, error.value, error.allowed, PAGE) from error


@lru_cache(maxsize=32)
def _ground(source: str, edits: str, stamp: str) -> Ground:
    world, changes = _source_world(source, stamp), json.loads(edits)
    obstacles = list(world.obstacles)
    frames: list[Frame | None] = [None] * len(obstacles)
    for place, edit in enumerate(changes):
        _apply(edit, obstacles, frames, f"map.edits.{place}")
    if changes:
        # Starts stay: one inside of an obstacle is told when a robot is to grow there.
        world = replace(world, obstacles=tuple(obstacles))
    key = sha256_of("\n".join((source, edits, stamp)).encode())[:16]
    return Ground(world=world, frames=tuple(frames), key=key)


@lru_cache(maxsize=256)
def _source_world(source: str, stamp: str) -> Map:  # noqa: ARG001  a changed file is read anew
    given = json.loads(source)
    if "file" in given:
        return Map.read(Path(_text("map.file", given["file"])))
    environment = _text("map.environment", given.get("environment"))
    options = given.get("options") or {}
    if not isinstance(options, Mapping):
        raise BadInputError("map.options", options, "names with values", PAGE)
    kind = ENVIRONMENTS[environment]
    seed = whole("map.seed", given.get("seed", 0), 0, MOST_FIRST_SEED)
    return kind.make(seed, with_parameters(kind.options, environment, options))


def _apply(edit: Any, obstacles: list[Polygon], frames: list[Frame | None], key: str) -> None:  # noqa: ANN401  JSON
    allowed = "['move', I, DX, DY], ['place', I, FRAME], ['add', [[X, Y], ...]] or ['remove', I]"
    if not isinstance(edit, list) or len(edit) < 2:
        raise BadInputError(key, edit, allowed, PAGE)
    kind, rest = edit[0], edit[1:]
    if kind == "add" and len(rest) == 1:
        obstacles.append(_polygon(key, rest[0]))
        frames.append(None)
        return
    if (kind, len(rest)) not in {("move", 3), ("place", 2), ("remove", 1)}:
        raise BadInputError(key, edit, allowed, PAGE)
    index = whole(key, rest[0], 0, len(obstacles) - 1)
    if kind == "remove":
        del obstacles[index], frames[index]
    elif kind == "move":
        dx_mm, dy_mm = (number(key, value, -LARGEST_MM, LARGEST_MM, "mm") for value in rest[1:])
        obstacles[index] = translate(obstacles[index], dx_mm, dy_mm)
        old = frames[index]
        frames[index] = None if old is None else old.moved(dx_mm, dy_mm)
    else:
        try:
            frame = validated(Frame, rest[1])
        except BadInputError as error:
            raise BadInputError(f"{key}.{error.key}", error.value, error.allowed, PAGE) from error
        old = frames[index] or Frame.around(obstacles[index])
        obstacles[index], frames[index] = old.taken_to(frame, obstacles[index]), frame


def _polygon(key: str, points: Any) -> Polygon:  # noqa: ANN401  JSON
    if not isinstance(points, list) or not 3 <= len(points) <= 10_000:
        raise BadInputError(key, points, "at least three points [x, y], mm", PAGE)
    pairs = [
        [number(key, value, -LARGEST_MM, LARGEST_MM, "mm") for value in _pair(key, point)]
        for point in points
    ]
    polygon = Polygon(pairs)
    if not polygon.is_valid or polygon.is_empty:
        raise BadInputError(key, shapely.is_valid_reason(polygon), "a polygon that is valid", PAGE)
    return polygon


def _pair(key: str, value: object) -> Sequence[Any]:
    if not isinstance(value, list) or len(value) != 2:
        raise BadInputError(key, value, "a point [x, y], mm", PAGE)
    return value


def _text(key: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise BadInputError(key, value, "a text", PAGE)
    return value


def file_stamp(path: Path) -> str:
    """Return what changes when a file does; nothing for one that is not there."""
    try:
        found = path.stat()
    except OSError:
        return ""
    return f"{found.st_mtime_ns}:{found.st_size}"
