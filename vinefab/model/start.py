"""Where robots start: a pose, a side, a line or an area, as text or table, and its free part.

The words of ``--start``, of ``start`` in run files and of ``Map.with_start``::

    250,15,90                    one pose: x and y in mm, heading in degrees
    250,15,90+-10, spread 20,0   and half-widths of the ranges around it
    left side                    anywhere on a side, launching inwards
    left side, inset 30, heading 0+-20
    line 0,20 0,480              anywhere on a line through these points
    area 0,0 50,480              in the box between two corners, or in a polygon of more
    area 0,0 50,480, clear 20    at least 20 mm from walls

Commas count as spaces.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any
from weakref import WeakSet

import numpy as np
import shapely
import shapely.affinity
from annotated_types import Interval, Unit
from numpy.typing import NDArray
from pydantic import Field
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError, nearest, shortened
from vinefab.core.limits import deg, rad, warn_of_radians
from vinefab.core.plain_text import counted
from vinefab.core.table import Table, validated
from vinefab.core.validation import LARGEST_MM, number

if TYPE_CHECKING:
    from vinefab.model.map import Map

_MANY_CORNERS = 1000
_FOUND_VALID = WeakSet[BaseGeometry]()
"""Polygons of many corners: looking at a jagged one takes time that grows with their square."""

START_CLEARANCE_MM = 15.0
"""From walls, of positions drawn from an area: room for a trunk of up to 47 mm lay-flat width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Position of a robot's base and direction in which its trunk is launched.

    Parameters
    ----------
    x_mm, y_mm
        Position in map coordinates.
    heading_rad
        Direction of growth, counter-clockwise from +x.
    """

    x_mm: float
    y_mm: float
    heading_rad: float

    def __post_init__(self) -> None:
        number("pose.x_mm", self.x_mm, -LARGEST_MM, LARGEST_MM, "mm")
        number("pose.y_mm", self.y_mm, -LARGEST_MM, LARGEST_MM, "mm")
        number("pose.heading", self.heading_rad, -1e6, 1e6, "rad")

    @classmethod
    def of(cls, given: "Pose | tuple[float, float, float]") -> "Pose":
        """Return the pose that a user means.

        Parameters
        ----------
        given
            A pose, or ``(x_mm, y_mm, heading_deg)``.

        Raises
        ------
        BadInputError
            If it is neither.

        Examples
        --------
        >>> Pose.of((250, 15, 90)).heading_deg
        90.0
        """
        if isinstance(given, Pose):
            return given
        try:
            x_mm, y_mm, heading_deg = given
        except (TypeError, ValueError):
            raise BadInputError("pose", given, "(x_mm, y_mm, heading_deg)") from None
        number("pose.heading_deg", heading_deg, -1e6, 1e6, "deg")
        warn_of_radians("pose.heading_deg", heading_deg)
        return cls(
            x_mm=number("pose.x_mm", x_mm, -LARGEST_MM, LARGEST_MM, "mm"),
            y_mm=number("pose.y_mm", y_mm, -LARGEST_MM, LARGEST_MM, "mm"),
            heading_rad=rad(float(heading_deg)),
        )

    @property
    def text(self) -> str:
        """The pose as a user types it: ``X,Y,DEG``."""
        return f"{self.x_mm:.2f},{self.y_mm:.2f},{self.heading_deg:.2f}"

    @property
    def content(self) -> dict[str, float]:
        """The pose as it stands in JSON."""
        return {"x_mm": self.x_mm, "y_mm": self.y_mm, "heading_deg": self.heading_deg}

    @property
    def heading_deg(self) -> float:
        """Direction of growth in degrees, counter-clockwise from +x."""
        return deg(self.heading_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """A start pose of a map, and the range that poses are drawn from.

    Parameters
    ----------
    pose
        What a single growth takes. The middle of the range; with an area, a free place in it and
        the middle of the headings.
    spread_x_mm, spread_y_mm
        Half-widths of the range of positions; not with an area.
    spread_heading_rad
        Half-width of the range of headings.
    area
        A line or a polygon in map coordinates: positions are drawn evenly from its free part.
    clearance_mm
        Least distance from walls of positions drawn from the area.
    """

    pose: Pose
    spread_x_mm: float = 0.0
    spread_y_mm: float = 0.0
    spread_heading_rad: float = 0.0
    area: LineString | Polygon | None = None
    clearance_mm: float = START_CLEARANCE_MM

    def __post_init__(self) -> None:
        number("start.spread_x_mm", self.spread_x_mm, 0.0, LARGEST_MM, "mm")
        number("start.spread_y_mm", self.spread_y_mm, 0.0, LARGEST_MM, "mm")
        number("start.spread_heading", self.spread_heading_rad, 0.0, 7.0, "rad")
        number("start.clearance_mm", self.clearance_mm, 0.0, LARGEST_MM, "mm")
        if self.area is None:
            return
        key = "start.area"
        if isinstance(self.area, Polygon):
            check_polygon(key, self.area)
        elif not isinstance(self.area, LineString) or self.area.is_empty:
            kind = self.area.geom_type if isinstance(self.area, BaseGeometry) else type(self.area)
            given = kind if isinstance(kind, str) else kind.__name__
            raise BadInputError(key, given, "a LineString or a Polygon")
        else:
            _check_near(key, self.area)
            if self.area.length == 0.0:
                raise UnfitInputError(key, "the line has no length", "give different points")
        for name in ("spread_x_mm", "spread_y_mm"):
            if getattr(self, name):
                problem = "means nothing with an area, from which positions are drawn"
                raise UnfitInputError(f"start.{name}", problem, "leave it out")

    @property
    def has_spread(self) -> bool:
        """Whether poses drawn from it differ."""
        spread = max(self.spread_x_mm, self.spread_y_mm, self.spread_heading_rad)
        return self.area is not None or spread > 0.0


def are_valid(polygons: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return the mask of valid polygons, shape (n,); jagged ones are looked at once."""
    valid: NDArray[np.bool_] = np.ones(len(polygons), dtype=np.bool_)
    many = shapely.get_num_coordinates(polygons) > _MANY_CORNERS
    valid[~many] = shapely.is_valid(polygons[~many])
    for index in np.flatnonzero(many):
        if polygons[index] not in _FOUND_VALID:
            valid[index] = shapely.is_valid(polygons[index])
            if valid[index]:
                _FOUND_VALID.add(polygons[index])
    return valid


_SIMPLER = "a simpler outline: import the drawing again (vinefab map import --simplify-mm)"


def refuse_jagged(key: str, polygon: Polygon, allowed: str = _SIMPLER) -> None:
    """Refuse an outline of so many and so long teeth that no command would end with it."""
    corners = int(shapely.get_num_coordinates(polygon))
    if corners <= _MANY_CORNERS:
        return
    steps = np.abs(np.diff(shapely.get_coordinates(polygon), axis=0)).sum(axis=0)
    x0, y0, x1, y1 = polygon.bounds
    crossed = float((steps / np.maximum([x1 - x0, y1 - y0], 1e-9)).max())
    # Corners of an outline times the walls of it that a line across meets, on average. What sweeps
    # across an outline takes as long as that: at the limit some seconds to validate and to clip.
    most_crossings = 5e7
    if corners * crossed > most_crossings:
        given = f"{counted(corners, 'corner')}, {counted(round(crossed), 'wall')} across"
        raise BadInputError(key, given, allowed)


def check_polygon(key: str, polygon: Polygon) -> None:
    """Refuse all but a valid polygon of finite size."""
    if not isinstance(polygon, BaseGeometry):
        raise BadInputError(key, polygon, "a Polygon: shapely.box(0, 0, 500, 400)")
    if polygon.is_empty or polygon.geom_type != "Polygon":
        raise BadInputError(key, polygon.geom_type, "one polygon with an area")
    _check_near(key, polygon)
    refuse_jagged(key, polygon)
    if not are_valid(np.array([polygon], dtype=np.object_))[0]:
        problem = f"the polygon is not valid: {shapely.is_valid_reason(polygon)}"
        raise UnfitInputError(key, problem, "let its sides not cross")


def _check_near(key: str, shape: BaseGeometry) -> None:
    box = shape.bounds
    if not all(abs(value) <= LARGEST_MM for value in box):
        raise BadInputError(key, box, f"finite coordinates up to {LARGEST_MM:g} mm")


SIDES = {"left": 0.0, "right": 180.0, "bottom": 90.0, "top": -90.0}
"""The sides of a map and the headings inwards from them, in degrees."""

START_WAYS = (
    "X,Y,DEG, or left, right, top or bottom side, or line X,Y X,Y, or area X,Y X,Y; "
    "then heading DEG+-SPREAD, inset MM, clear MM"
)
"""What may be said, in one line."""

_FILLERS = frozenset(("anywhere", "on", "the", "side", "in", "from", "mm", "deg"))
_KEYS = (*SIDES, "line", "area", "heading", "inset", "clear", "spread")
_PARTS = re.compile(
    r"[\s,;]*(?:(?P<either>\+/?-|±)|(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)"
    r"|(?P<word>[^\W\d]+)|(?P<rest>\S))"
)
_SLACK_MM = 1e-6
"""A line just as far from a wall as asked for is far enough."""

_DECIMALS = 6
_ALL = 0.995


@dataclass(frozen=True, slots=True, kw_only=True)
class StartPlace:
    """A start that is found on each map: somewhere on a side, a line or in an area.

    Parameters
    ----------
    side
        ``left``, ``right``, ``top`` or ``bottom`` of the bounds' box; or an area.
    inset_mm
        How far inside the line along the side lies; None: as far as the clearance.
    area
        A line or a polygon in map coordinates.
    heading_rad
        Middle of the headings; None: inwards from the side, across the line towards the middle of
        the map, or away from the side of the map that is nearest to the area.
    spread_heading_rad
        Half-width of the range of headings.
    clearance_mm
        Least distance from walls; None: 15 mm, or the inset if that is less.
    """

    side: str | None = None
    inset_mm: float | None = None
    area: LineString | Polygon | None = None
    heading_rad: float | None = None
    spread_heading_rad: float = 0.0
    clearance_mm: float | None = None

    def __post_init__(self) -> None:
        if (self.side is None) == (self.area is None):
            raise UnfitInputError("start", "needs a side or an area", "give one of them")
        if self.side is not None and self.side not in SIDES:
            allowed = f"{', '.join(SIDES)}{nearest(str(self.side), SIDES)}"
            raise BadInputError("start.side", self.side, allowed)
        if self.inset_mm is not None:
            if self.side is None:
                raise UnfitInputError(
                    "start.inset_mm", "belongs to a side", "give a side, or leave it out"
                )
            number("start.inset_mm", self.inset_mm, 0.0, LARGEST_MM, "mm")
        middle = Pose(x_mm=0.0, y_mm=0.0, heading_rad=self.heading_rad or 0.0)
        Start(
            pose=middle,
            area=self.area,
            spread_heading_rad=self.spread_heading_rad,
            clearance_mm=self.least_clearance_mm,
        )

    @property
    def least_clearance_mm(self) -> float:
        """Least distance of the base from walls."""
        if self.clearance_mm is not None:
            return self.clearance_mm
        return min(START_CLEARANCE_MM, math.inf if self.inset_mm is None else self.inset_mm)

    @property
    def text(self) -> str:
        """The place as text that `start_from` reads, without holes of an area."""
        parts = [f"{self.side} side" if self.area is None else _shape_text(self.area)]
        if self.inset_mm is not None:
            parts.append(f"inset {self.inset_mm:.12g}")
        if self.heading_rad is not None or self.spread_heading_rad:
            heading = "" if self.heading_rad is None else f"{deg(self.heading_rad):.12g}"
            spread = f"+-{deg(self.spread_heading_rad):.12g}" if self.spread_heading_rad else ""
            parts.append(f"heading {heading}{spread}")
        if self.clearance_mm is not None:
            parts.append(f"clear {self.clearance_mm:.12g}")
        return ", ".join(parts)

    def on(self, world: "Map") -> Start:
        """Return the start on a map, its pose at a free place near the middle.

        Raises
        ------
        BadInputError
            If nothing of the place is free there.
        """
        box = world.bounds.bounds
        inset_mm = self.least_clearance_mm if self.inset_mm is None else self.inset_mm
        area = self.area or _side_line(str(self.side), inset_mm, box)
        heading_deg = SIDES[self.side] if self.side else _inwards_deg(area, box)
        heading_rad = rad(heading_deg) if self.heading_rad is None else self.heading_rad
        start = Start(
            pose=Pose(x_mm=area.centroid.x, y_mm=area.centroid.y, heading_rad=heading_rad),
            spread_heading_rad=self.spread_heading_rad,
            area=area,
            clearance_mm=self.least_clearance_mm,
        )
        pieces = pieces_on(world, start, f"{self.text!r} on map {world.name!r}")
        x_mm, y_mm = _middle_mm(area, pieces)
        return replace(start, pose=replace(start.pose, x_mm=x_mm, y_mm=y_mm))


AnyStart = Start | StartPlace
"""What every form of a start becomes (`start_given`): a pose with its range, or a place that is
found on each map."""

StartLike = AnyStart | Pose | tuple[float, float, float] | Mapping[str, object] | str
"""What `start_given` takes."""

Spread = Annotated[float, Interval(ge=0.0, le=LARGEST_MM), Unit("mm")]
Place = Annotated[float, Interval(ge=-LARGEST_MM, le=LARGEST_MM), Unit("mm")]
Point = Annotated[list[float], Field(min_length=2, max_length=2)]


class StartTable(Table):
    """A start in a file: a pose and the range around it, or a side, a line or an area."""

    x_mm: Annotated[Place | None, Doc("in map coordinates")] = None
    y_mm: Annotated[Place | None, Doc("in map coordinates")] = None
    heading_deg: Annotated[
        float | None,
        Interval(ge=-1e6, le=1e6),
        Unit("deg"),
        Doc("counter-clockwise from +x; of a side: inwards if left out"),
    ] = None
    spread_x_mm: Annotated[Spread | None, Doc("half-width of the range of positions")] = None
    spread_y_mm: Annotated[Spread | None, Doc("half-width of the range of positions")] = None
    spread_heading_deg: Annotated[
        float, Interval(ge=0.0, le=360.0), Unit("deg"), Doc("half-width of the range of headings")
    ] = 0.0
    side: Annotated[str | None, Doc("left, right, bottom or top: anywhere on it")] = None
    inset_mm: Annotated[Spread | None, Doc("how far from the side")] = None
    line: Annotated[list[Point] | None, Doc("points of a line: anywhere on it")] = None
    area: Annotated[
        list[Point] | None, Doc("corners of a box, or of a polygon: anywhere in it")
    ] = None
    clearance_mm: Annotated[Spread | None, Doc("least distance of a line or area from walls")] = (
        None
    )

    @property
    def start(self) -> AnyStart:
        """The start that the table says.

        Raises
        ------
        BadInputError
            If it says none, or two; its key is one of the table.
        """
        places = [name for name in ("side", "line", "area") if getattr(self, name) is not None]
        if not places:
            return self._pose()
        if len(places) > 1:
            raise UnfitInputError(
                places[1], f"is given together with {places[0]}", "leave one of them out"
            )
        self.only_without("x_mm", "y_mm", "spread_x_mm", "spread_y_mm", at=places[0])
        points = self.line if places[0] == "line" else self.area
        if points is not None and len(points) < 2:
            raise BadInputError(places[0], points, "two or more points")
        try:
            return self.place(None if points is None else shape_of(places[0], points))
        except BadInputError as error:
            name = error.key.removeprefix("start.")
            key = places[0] if name in ("area", "x", "y") else name
            raise error.under(key) from None

    def place(self, area: LineString | Polygon | None) -> StartPlace:
        """Return the start on the table's side, or anywhere in an area."""
        for name in ("spread_x_mm", "spread_y_mm"):
            if getattr(self, name):
                raise UnfitInputError(name, "means nothing with a line or an area", "leave it out")
        if self.side is not None and area is not None:
            raise UnfitInputError(
                "side", "is given together with a geometry", "leave one of them out"
            )
        return StartPlace(
            side=self.side,
            area=area,
            inset_mm=self.inset_mm,
            heading_rad=None if self.heading_deg is None else rad(self.heading_deg),
            spread_heading_rad=rad(self.spread_heading_deg),
            clearance_mm=self.clearance_mm,
        )

    def _pose(self) -> Start:
        for name in ("x_mm", "y_mm", "heading_deg"):
            if getattr(self, name) is None:
                raise UnfitInputError(name, "is missing", "give it, or a side, line or area")
        self.only_without("inset_mm", "clearance_mm", at="a pose")
        return Start(
            pose=Pose(
                x_mm=self.x_mm or 0.0,
                y_mm=self.y_mm or 0.0,
                heading_rad=rad(self.heading_deg or 0.0),
            ),
            spread_x_mm=self.spread_x_mm or 0.0,
            spread_y_mm=self.spread_y_mm or 0.0,
            spread_heading_rad=rad(self.spread_heading_deg),
        )

    def only_without(self, *names: str, at: str) -> None:
        """Refuse keys that mean nothing there."""
        for name in names:
            if getattr(self, name) is not None:
                raise UnfitInputError(name, f"is given together with {at}", "leave one of them out")


def start_given(given: object, key: str = "start") -> AnyStart:
    """Return the start that a user means, in whichever of its forms.

    Parameters
    ----------
    given
        A start, a pose or its three numbers, words (`start_from`), a table with the keys of
        `StartTable`, as run files have it, or the record of a start.
    key
        What messages call it; empty where the caller names it.

    Raises
    ------
    BadInputError
        If it is none of these; its key is ``key``, or one of the table below it.
    """
    if isinstance(given, AnyStart):
        return given
    if isinstance(given, Mapping):
        if "spread_heading_rad" in given:
            return start_of_record(given)
        try:
            return validated(StartTable, given).start
        except BadInputError as error:
            raise error.under(".".join(filter(None, (key, error.key)))) from None
    if isinstance(given, Pose):
        return Start(pose=given)
    if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) and len(given) == 3:
        x_mm, y_mm, heading_deg = given
        return Start(pose=Pose.of((x_mm, y_mm, heading_deg)))
    if not isinstance(given, str):
        raise BadInputError(
            key, given, f"a table, (x_mm, y_mm, heading_deg), or words: {START_WAYS}"
        )
    return start_from(given, key)


def start_from(text: str, key: str = "start") -> AnyStart:
    """Return the start that words say, see above: a pose with its range, or a place on any map.

    Parameters
    ----------
    key
        What messages call it: the option, or the key of a file.

    Raises
    ------
    BadInputError
        If the words are no start.
    """
    most_letters = 10_000
    if not isinstance(text, str) or len(text) > most_letters:
        raise BadInputError(key, text, START_WAYS)
    said = _Said.of(text, key)
    places = [name for name in said.numbers if name in (*SIDES, "line", "area", "pose")]
    if len(places) != 1:
        raise BadInputError(key, text, f"one place: {START_WAYS}")
    try:
        return said.pose() if places == ["pose"] else said.place(places[0])
    except BadInputError as error:
        if error.key == key:
            raise
        what = "" if error.key == "start.area" else f"{error.key.rpartition('.')[2]} "
        if isinstance(error, UnfitInputError):
            raise UnfitInputError(key, f"{what}{error.value}", error.allowed) from None
        raise BadInputError(key, text, f"{what}{error.allowed}") from None


@dataclass(frozen=True, slots=True)
class _Said:
    """The numbers behind each word of a start."""

    text: str
    key: str
    numbers: dict[str, list[float]]  # those before any word are the pose's
    either_way: dict[str, float]  # what stands behind +-

    @classmethod
    def of(cls, text: str, key: str) -> "_Said":
        said, current, either = cls(text, key, {}, {}), "pose", False
        for part in _PARTS.finditer(text.strip().strip(",;").lower()):
            if part["rest"] or (either and not part["number"]):
                raise said.wrong(START_WAYS)
            if part["number"]:
                said.take(current, float(part["number"]), either=either)
            elif part["word"] and part["word"] not in _FILLERS:
                current = said.begin(part["word"])
            either = part["either"] is not None
        if either:
            raise said.wrong("a number behind +-")
        return said

    def take(self, key: str, value: float, *, either: bool) -> None:
        """Add a number to those behind a word, or after ``+-``."""
        if key in self.either_way:
            raise self.wrong("+-SPREAD last of its numbers")
        numbers = self.numbers.setdefault(key, [])
        if either:
            self.either_way[key] = value
        else:
            numbers.append(value)

    def begin(self, word: str) -> str:
        """Return the key that a word stands for, its numbers still to come."""
        if word not in _KEYS:
            raise self.wrong(f"{START_WAYS}{nearest(word, _KEYS)}")
        if word in self.numbers:
            raise self.wrong(f"{word} once")
        self.numbers[word] = []
        return word

    def wrong(self, allowed: str) -> BadInputError:
        """Return the error with the allowed values."""
        return BadInputError(self.key, self.text, allowed)

    def pose(self) -> Start:
        """Return the start of a pose with its ranges."""
        self.only("pose", "spread", either=("pose",))
        pose = self.counted("pose", 3, "X,Y,DEG: three numbers, mm and degrees")
        spread_mm = self.counted("spread", 2, "spread X,Y") or [0.0, 0.0]
        return Start(
            pose=Pose.of((pose[0], pose[1], pose[2])),
            spread_x_mm=spread_mm[0],
            spread_y_mm=spread_mm[1],
            spread_heading_rad=self.spread_rad("pose"),
        )

    def place(self, name: str) -> StartPlace:
        """Return the side, line or area that is said."""
        self.only(name, "heading", "inset", "clear", either=("heading",))
        inset_mm, clear_mm = (self.counted(word, 1, f"{word} MM") for word in ("inset", "clear"))
        heading = self.numbers.get("heading", [])
        if len(heading) > 1 or ("heading" in self.numbers and not (heading or self.either_way)):
            raise self.wrong("heading DEG, heading DEG+-SPREAD or heading +-SPREAD")
        if name in SIDES and self.numbers[name]:
            raise self.wrong(f"{name} side without numbers, then heading DEG, inset MM, clear MM")
        area = None
        if name not in SIDES:
            numbers = self.numbers[name]
            points = list(zip(numbers[::2], numbers[1::2], strict=False))
            if len(numbers) % 2 or len(points) < 2:
                raise self.wrong(f"{name} X,Y X,Y: two or more points")
            area = shape_of(name, points)
        return StartPlace(
            side=name if name in SIDES else None,
            area=area,
            inset_mm=inset_mm[0] if inset_mm else None,
            clearance_mm=clear_mm[0] if clear_mm else None,
            heading_rad=rad(heading[0]) if heading else None,
            spread_heading_rad=self.spread_rad("heading"),
        )

    def only(self, *names: str, either: Sequence[str]) -> None:
        """Refuse words and ranges that mean nothing here."""
        for word in self.numbers:
            if word not in names:
                raise self.wrong(f"no {word} together with {names[0]}")
        for word in self.either_way:
            if word not in either:
                raise self.wrong(f"+-SPREAD behind {' or '.join(either)} only")

    def counted(self, name: str, count: int, allowed: str) -> list[float]:
        """Return the numbers behind a word; none where it was not said."""
        if name in self.numbers and len(self.numbers[name]) != count:
            raise self.wrong(allowed)
        return self.numbers.get(name, [])

    def spread_rad(self, name: str) -> float:
        """Return the range of headings that is said, either way."""
        return rad(number("+-SPREAD", self.either_way.get(name, 0.0), 0.0, 360.0, "deg"))


def shape_of(name: str, points: Sequence[Sequence[float]]) -> LineString | Polygon:
    """Return the line through points; or the area within: a box between two, else a polygon."""
    for x_mm, y_mm in points:
        number("x", x_mm, -LARGEST_MM, LARGEST_MM, "mm")
        number("y", y_mm, -LARGEST_MM, LARGEST_MM, "mm")
    if name == "line":
        return LineString(points)
    if len(points) > 2:
        return Polygon(points)
    (x_0, y_0), (x_1, y_1) = points
    if x_0 == x_1 or y_0 == y_1:
        problem = f"({x_0:g}, {y_0:g}) and ({x_1:g}, {y_1:g}) are no opposite corners of a box"
        raise UnfitInputError("start.area", problem, "give such, or three or more points")
    return _box(min(x_0, x_1), min(y_0, y_1), max(x_0, x_1), max(y_0, y_1))


def _box(x_min: float, y_min: float, x_max: float, y_max: float) -> Polygon:
    return Polygon([(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)])


def _shape_text(area: LineString | Polygon) -> str:
    """Return a line, or the outline of a polygon, as text."""
    if area == _box(*area.bounds):
        x_min, y_min, x_max, y_max = area.bounds
        return f"area {x_min:.12g},{y_min:.12g} {x_max:.12g},{y_max:.12g}"
    points = shapely.get_coordinates(area if isinstance(area, LineString) else area.exterior)
    if isinstance(area, Polygon):
        points = points[:-1]
    name = "line" if isinstance(area, LineString) else "area"
    return " ".join((name, *(f"{x:.12g},{y:.12g}" for x, y in points.tolist())))


# --- As plain values ------------------------------------------------------------------------------


def start_record(start: AnyStart) -> dict[str, Any]:
    """Return a start as plain values with all its bits; without an area, no key speaks of one."""
    record: dict[str, Any] = asdict(start)
    area = record.pop("area")
    if area is not None:
        record["area"] = shapely.to_wkb(start.area, hex=True)
    elif isinstance(start, Start):
        del record["clearance_mm"]
    return record


def start_of_record(record: Mapping[str, Any]) -> AnyStart:
    """Return the start of `start_record`."""
    values = dict(record)
    if values.get("area") is not None:
        values["area"] = shapely.from_wkb(values["area"])
    if "pose" in values:
        return Start(**{**values, "pose": Pose(**values["pose"])})
    return StartPlace(**values)


def start_text(start: AnyStart) -> str:
    """Return a start as a run file gives it."""
    if isinstance(start, StartPlace):
        return start.text
    pose = start.pose
    numbers = {
        "x_mm": pose.x_mm,
        "y_mm": pose.y_mm,
        "heading_deg": pose.heading_deg,
        "spread_x_mm": start.spread_x_mm,
        "spread_y_mm": start.spread_y_mm,
        "spread_heading_deg": deg(start.spread_heading_rad),
    }
    words = [f"{name} = {value:g}" for name, value in numbers.items()]
    if start.area is not None:
        words += [_shape_text(start.area), f"clearance_mm = {start.clearance_mm:g}"]
    return ", ".join(words)


def start_words(start: Start) -> str:
    """Return a start for a user: its pose, and the area and headings that poses are drawn from."""
    pose = start.pose
    words = f"{pose.x_mm:.1f},{pose.y_mm:.1f},{pose.heading_deg:.1f}"
    if start.area is None:
        return words
    spread = f"+-{deg(start.spread_heading_rad):g}" if start.spread_heading_rad else ""
    drawn = f"{_shape_text(start.area)}, heading {pose.heading_deg:g}{spread}"
    most_shown = 120
    return f"{shortened(drawn, most_shown)} (one growth: {words})"


# --- On a map -------------------------------------------------------------------------------------


def with_starts(world: "Map", given: Iterable[AnyStart], key: str = "start") -> "Map":
    """Return a map with other starts.

    Parameters
    ----------
    key
        What messages call a start.

    Raises
    ------
    BadInputError
        If a start is outside the bounds or inside an obstacle.
    """
    starts: list[Start] = []
    for one in given:
        try:
            start = one.on(world) if isinstance(one, StartPlace) else one
            _check_start(world, start)
        except BadInputError as error:
            raise error.under(key) from None
        starts.append(start)
    return replace(world, starts=tuple(starts))


def _check_start(world: "Map", start: Start) -> None:
    """Raise BadInputError unless a start's pose, and something of its area, is free on a map."""
    spot, solid = shapely.Point(start.pose.x_mm, start.pose.y_mm), ""
    if not world.bounds.covers(spot):
        solid = "outside the bounds"
    elif shapely.contains(np.array(world.obstacles, dtype=np.object_), spot).any():
        solid = "inside an obstacle"
    if solid:
        where = f"({spot.x:g}, {spot.y:g}) mm"
        problem = f"{where} is {solid} of map {world.name!r}"
        raise UnfitInputError("start", problem, "move it into free space")
    if start.area is not None:
        pieces_on(world, start)


def start_pieces(
    start: Start, free: BaseGeometry, clearance_mm: float = 0.0, *, named: str = ""
) -> list[LineString | Polygon]:
    """Return the pieces of a start's area that are free and far enough from walls.

    Parameters
    ----------
    clearance_mm
        Least distance from walls, if it is more than the start's own.
    named
        What the user calls it, for the error.

    Raises
    ------
    BadInputError
        If there are none.
    """
    area = start.area
    if area is None:
        raise UnfitInputError("start", "a pose has no area", "give a side, a line or an area")
    clear_mm = max(start.clearance_mm, clearance_mm)
    near = shapely.intersection(free, _box_around(area, clear_mm))
    segments_per_quarter = 32
    if clear_mm > _SLACK_MM:
        near = shapely.buffer(near, _SLACK_MM - clear_mm, quad_segs=segments_per_quarter)
    parts = shapely.get_parts(shapely.intersection(area, near)).tolist()
    pieces = [part for part in parts if isinstance(part, type(area)) and not part.is_empty]
    if not pieces:
        away, less = f" at least {clear_mm:g} mm from walls", ", or give a smaller clear MM"
        if not clear_mm > 0.0:
            away = less = ""
        problem, remedy = f"meets no free space{away}", f"move it (a side by inset MM){less}"
        raise UnfitInputError("start", f"{named or _shape_text(area)} {problem}", remedy)
    return pieces


def area_notes(worlds: "Sequence[Map]") -> list[str]:
    """Return from how much of the lines and areas of starts poses are drawn, if not from all."""
    drawn = [(world, start) for world in worlds for start in world.starts if start.area is not None]
    shares = []
    for world, start in drawn:
        measure = shapely.area if isinstance(start.area, Polygon) else shapely.length
        whole = float(measure(start.area))
        shares.append(min(1.0, float(measure(pieces_on(world, start)).sum()) / whole))
    if not shares or min(shares) > _ALL:
        return []
    clearances_mm = {start.clearance_mm for _, start in drawn}
    away = f", at least {min(clearances_mm):g} mm from walls" if max(clearances_mm) > 0.0 else ""
    kind = "line" if all(isinstance(start.area, LineString) for _, start in drawn) else "area"
    if len(shares) == 1:
        share = 100.0 * shares[0]
        return [f"poses are drawn from the {share:.0f} % of the start's {kind} that is free{away}"]
    low, high = 100.0 * min(shares), 100.0 * max(shares)
    return [
        f"poses are drawn from the {low:.0f} to {high:.0f} % of {len(shares)} starts' {kind}s that "
        f"are free{away}"
    ]


def start_range(start: Start) -> BaseGeometry | None:
    """Return all positions of a start: its area, the box or line of its spreads; None for one."""
    if start.area is not None:
        return start.area
    x, y = start.pose.x_mm, start.pose.y_mm
    dx, dy = start.spread_x_mm, start.spread_y_mm
    if dx > 0.0 and dy > 0.0:
        return _box(x - dx, y - dy, x + dx, y + dy)
    return LineString([(x - dx, y - dy), (x + dx, y + dy)]) if dx + dy > 0.0 else None


def pieces_on(world: "Map", start: Start, named: str = "") -> list[LineString | Polygon]:
    """Return the pieces of a start's area that poses are drawn from on a map, `start_pieces`."""
    around = _box_around(start.area or world.bounds, start.clearance_mm)
    solid = np.array(world.obstacles, dtype=np.object_)
    near = solid[shapely.intersects(shapely.box(*shapely.bounds(solid).T), around)]
    inside = shapely.intersection(world.bounds, around)
    return start_pieces(start, shapely.difference(inside, shapely.union_all(near)), named=named)


def _box_around(area: BaseGeometry, clearance_mm: float) -> Polygon:
    """Return a box with all that may be within a clearance of an area."""
    x_min, y_min, x_max, y_max = area.bounds
    reach_mm = clearance_mm + 1.0
    box: Polygon = shapely.box(
        x_min - reach_mm, y_min - reach_mm, x_max + reach_mm, y_max + reach_mm
    )
    return box


def share_around(start: Start, share: float) -> LineString | Polygon | None:
    """Return a start's area drawn together around its pose, within the area; None for nothing."""
    if start.area is None or share <= 0.0:
        return None
    base = (start.pose.x_mm, start.pose.y_mm)
    smaller = shapely.affinity.scale(start.area, share, share, origin=base)
    if isinstance(start.area, Polygon) and share < 1.0:
        parts = shapely.get_parts(shapely.intersection(smaller, start.area)).tolist()
        pieces = [part for part in parts if isinstance(part, Polygon)]
        spot = shapely.Point(base)
        return min(pieces, key=lambda piece: piece.distance(spot), default=smaller)
    return smaller


def _side_line(side: str, inset_mm: float, box: tuple[float, ...]) -> LineString:
    x_min, y_min, x_max, y_max = box
    if side in ("left", "right"):
        x = x_min + inset_mm if side == "left" else x_max - inset_mm
        return LineString([(x, y_min), (x, y_max)])
    y = y_min + inset_mm if side == "bottom" else y_max - inset_mm
    return LineString([(x_min, y), (x_max, y)])


def _inwards_deg(area: LineString | Polygon, box: tuple[float, ...]) -> float:
    """Return the heading of an area that has none, see `StartPlace`."""
    x_min, y_min, x_max, y_max = box
    middle = area.centroid
    if isinstance(area, LineString):
        (x_0, y_0), (x_1, y_1) = area.coords[0], area.coords[-1]
        if (x_0, y_0) != (x_1, y_1):
            left_x, left_y = y_0 - y_1, x_1 - x_0
            across = left_x * (0.5 * (x_min + x_max) - middle.x)
            across += left_y * (0.5 * (y_min + y_max) - middle.y)
            sign = 1.0 if across >= 0.0 else -1.0
            return math.degrees(math.atan2(sign * left_y, sign * left_x)) + 0.0
    away_mm = {
        "left": middle.x - x_min,
        "right": x_max - middle.x,
        "bottom": middle.y - y_min,
        "top": y_max - middle.y,
    }
    return SIDES[min(away_mm, key=lambda side: away_mm[side])]


def _middle_mm(
    area: LineString | Polygon, pieces: Sequence[LineString | Polygon]
) -> tuple[float, float]:
    """Return a free place of an area: its middle, or the middle of its largest free piece."""
    if isinstance(area, LineString):
        longest = max(pieces, key=shapely.length)
        spots = [line.interpolate(0.5, normalized=True) for line in (area, longest)]
    else:
        largest = max(pieces, key=shapely.area)
        spots = [area.centroid, largest.centroid, largest.representative_point()]
    free = shapely.union_all(pieces)
    spot = next((one for one in spots if shapely.dwithin(free, one, _SLACK_MM)), spots[-1])
    return round(spot.x, _DECIMALS) + 0.0, round(spot.y, _DECIMALS) + 0.0
