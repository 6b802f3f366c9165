"""Maps: bounds, obstacles and starts of robots."""

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any
from weakref import WeakSet

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.atomic import write_text
from vinefab.core.errors import BadInputError
from vinefab.core.front_door import front_door
from vinefab.core.plain_text import counted
from vinefab.core.units import deg, rad, warn_of_radians
from vinefab.core.validation import LARGEST_MM, number

_MANY_OBSTACLES = 1000

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
        except (TypeError, ValueError) as error:
            raise BadInputError("pose", given, "(x_mm, y_mm, heading_deg)") from error
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
        Half-widths of the range of positions; not beside an area.
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
        _check_start_area(self.area)
        for name in ("spread_x_mm", "spread_y_mm"):
            if getattr(self, name):
                allowed = "left out: positions are drawn from the area"
                raise BadInputError(f"start.{name}", getattr(self, name), allowed)

    @property
    def has_spread(self) -> bool:
        """Whether poses drawn from it differ."""
        spread = max(self.spread_x_mm, self.spread_y_mm, self.spread_heading_rad)
        return self.area is not None or spread > 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map:
    """One instance of an environment, coordinates in millimetres.

    Parameters
    ----------
    name
        Name in reports.
    bounds
        Outer limit of the free space; a valid polygon (holes in it count as obstacles).
    obstacles
        Valid polygons, holes allowed; their interiors are solid. They may touch each other and
        reach over the bounds.
    starts
        Start poses, in free space.
    environment
        Generator or importer of the map.
    seed
        The generator's seed, None for imported maps.
    facts
        Parameters of the generator or settings of the import; plain values.
    """

    name: str
    bounds: Polygon
    obstacles: tuple[Polygon, ...] = ()
    starts: tuple[Start, ...] = ()
    environment: str = "unknown"
    seed: int | None = None
    facts: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key, kind in (("obstacles", Polygon), ("starts", Start)):
            given = getattr(self, key)
            if not isinstance(given, Sequence) or not all(isinstance(one, kind) for one in given):
                raise BadInputError(key, given, f"a {kind.__name__} for each, in a tuple")
            object.__setattr__(self, key, tuple(given))
        _check_polygon("bounds", self.bounds)
        for index in _unsound(self.obstacles):
            _check_polygon(f"obstacle {index}", self.obstacles[index])
        object.__setattr__(self, "facts", MappingProxyType(dict(self.facts)))

    def __repr__(self) -> str:
        width_mm, height_mm = self.size_mm
        counts = (
            (len(self.obstacles), "obstacle"),
            (self.wall_count, "wall"),
            (len(self.starts), "start"),
        )
        words = ", ".join(counted(count, word) for count, word in counts)
        return f"<Map {reprlib.repr(self.name)}: {width_mm:.5g} x {height_mm:.5g} mm, {words}>"

    @property
    def free_space(self) -> BaseGeometry:
        """Bounds minus obstacles: a Polygon or MultiPolygon, computed anew at each call."""
        # The second is as exact, and fast for scattered obstacles, but orders its parts otherwise.
        many = len(self.obstacles) > _MANY_OBSTACLES
        union = shapely.disjoint_subset_union_all if many else shapely.union_all
        return shapely.difference(self.bounds, union(np.array(self.obstacles, dtype=np.object_)))

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the bounds' box."""
        x_min, y_min, x_max, y_max = self.bounds.bounds
        return x_max - x_min, y_max - y_min

    @property
    def wall_count(self) -> int:
        """Number of straight edges of bounds and obstacles together."""
        polygons = (self.bounds, *self.obstacles)
        rings = sum(1 + len(polygon.interiors) for polygon in polygons)
        return int(shapely.get_num_coordinates(list(polygons)).sum()) - rings

    @classmethod
    def read(cls, path: str | PathLike[str]) -> "Map":
        """Return the map in a GeoJSON file, coordinates in millimetres.

        Files of other programs go through ``vinefab.maps.import_``.

        Parameters
        ----------
        path
            A file that `write` or ``vinefab map`` wrote, or plain polygons: the largest is the
            bounds and contains all others, the obstacles.

        Raises
        ------
        BadInputError
            If it is no path, or a value in the file cannot be used.
        UnreadableFileError
            If there is no such file, or it is not JSON.

        Examples
        --------
        >>> Map.read("moon.geojson")
        Traceback (most recent call last):
        vinefab.core.errors.UnreadableFileError: moon.geojson: there is no such file
        """
        # The file form of maps is built on this module.
        from vinefab.model.files.map_geojson import read_map  # noqa: PLC0415
        from vinefab.model.files.shipped import path_given  # noqa: PLC0415

        return read_map(path_given("map", path, "the path of a map file (GeoJSON)"))

    def write(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the map as GeoJSON, coordinates to 1e-6 mm; `read` gives it back.

        Parameters
        ----------
        path
            The file; missing folders are made.
        force
            Overwrite a file that vinefab did not write, or of another kind.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        BadInputError
            If ``path`` is no path.
        CannotWriteError
            If the system refuses.
        ForeignFileError
            If the place is taken.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from vinefab import maps
        >>> with TemporaryDirectory() as folder:
        ...     Map.read(maps.pegs(seed=1).write(f"{folder}/pegs.geojson")).name
        'pegs_1'
        """
        from vinefab.model.files.map_geojson import map_text  # noqa: PLC0415  as above
        from vinefab.model.files.shipped import path_given  # noqa: PLC0415

        return write_text(path_given("path", path), map_text(self), force=force)

    def with_start(self, *starts: "Start | Pose | tuple[float, float, float] | str") -> "Map":
        """Return the map with other starts in place of its own.

        Parameters
        ----------
        *starts
            A `Start`, a pose ``(x_mm, y_mm, heading_deg)``, or words as of ``--start``:
            ``"250,15,90+-10"``, ``"left side"``, ``"line 20,20 20,480, heading 0+-20"``,
            ``"area 0,0 50,480"`` (docs/maps.md has all of them).

        Raises
        ------
        BadInputError
            If the words are no start, or nothing of a start is in free space.

        Examples
        --------
        >>> from vinefab import maps
        >>> start = maps.pegs(seed=1).with_start("left side, heading 0+-20").starts[0]
        >>> start.area.geom_type, start.pose.heading_deg
        ('LineString', 0.0)
        """
        # Starts in words are built on this module.
        from vinefab.model.start_place import start_given, with_starts  # noqa: PLC0415

        return with_starts(self, [start_given(one) for one in starts])

    def info(self, *, width_mm: float | None = None, passages: int = 5) -> Any:  # noqa: ANN401
        """Return size, free area, narrowest passages and room for robots (computed).

        Parameters
        ----------
        width_mm
            Lay-flat width of a body: how much of the free area it has room in.
        passages
            How many of the narrowest passages to find.

        Returns
        -------
        MapInfo
            It shows itself in a notebook; ``summary`` in lines, ``numbers`` as plain values, and
            ``passages``, ``starts``, ``widest_mm`` and ``body``.

        Raises
        ------
        BadInputError
            If a value cannot be used.

        Examples
        --------
        >>> from vinefab import maps
        >>> maps.pegs(seed=1).info(width_mm=20).summary[0]
        'map: pegs_1'
        """
        return front_door().info_of(self, width_mm=width_mm, passages=passages)

    @property
    def summary(self) -> tuple[str, ...]:
        """Its size, its starts, what is odd about it and how it was made, a line each."""
        lines: tuple[str, ...] = front_door().map_summary(self)
        return lines

    def json_text(self) -> str:
        """Return the map as its file holds it: GeoJSON, ``vinefab/map-1``."""
        from vinefab.model.files.map_geojson import map_text  # noqa: PLC0415  as above

        return map_text(self)

    def _repr_svg_(self) -> str | None:
        """Show the plan in a notebook."""
        drawn: str | None = front_door().svg_of(self)
        return drawn


def _unsound(polygons: tuple[Polygon, ...]) -> list[int]:
    """Return which polygons `_check_polygon` refuses, found for all at once."""
    items = np.array(polygons, dtype=np.object_)
    near = (np.abs(shapely.bounds(items).reshape(-1, 4)) <= LARGEST_MM).all(axis=1)
    plain = shapely.get_type_id(items) == shapely.GeometryType.POLYGON
    for index in np.flatnonzero(near & plain):
        refuse_jagged(f"obstacle {index}", items[index])
    return [int(index) for index in np.flatnonzero(~(near & plain & are_valid(items)))]


def are_valid(polygons: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Tell which polygons are valid, shape (n,); jagged ones are looked at once."""
    valid: NDArray[np.bool_] = np.ones(len(polygons), dtype=np.bool_)
    many = shapely.get_num_coordinates(polygons) > _MANY_CORNERS
    valid[~many] = shapely.is_valid(polygons[~many])
    for index in np.flatnonzero(many):
        if polygons[index] not in _FOUND_VALID:
            valid[index] = shapely.is_valid(polygons[index])
            if valid[index]:
                _FOUND_VALID.add(polygons[index])
    return valid


_MOST_CROSSINGS = 5e7
"""Corners of an outline times the walls of it that a line across meets, on average. What sweeps
across an outline takes as long as that: at the limit some seconds to validate and to clip."""


_SIMPLER = "a simpler outline: import the drawing again (vinefab map import --simplify-mm)"


def refuse_jagged(key: str, polygon: Polygon, allowed: str = _SIMPLER) -> None:
    """Refuse an outline of so many and so long teeth that no command would end with it."""
    corners = int(shapely.get_num_coordinates(polygon))
    if corners <= _MANY_CORNERS:
        return
    steps = np.abs(np.diff(shapely.get_coordinates(polygon), axis=0)).sum(axis=0)
    x0, y0, x1, y1 = polygon.bounds
    crossed = float((steps / np.maximum([x1 - x0, y1 - y0], 1e-9)).max())
    if corners * crossed > _MOST_CROSSINGS:
        given = f"{counted(corners, 'corner')}, {counted(round(crossed), 'wall')} across"
        raise BadInputError(key, given, allowed)


def _check_start_area(area: BaseGeometry) -> None:
    key = "start.area"
    if isinstance(area, Polygon):
        _check_polygon(key, area)
        return
    if not isinstance(area, LineString) or area.is_empty:
        given = area.geom_type if isinstance(area, BaseGeometry) else type(area).__name__
        raise BadInputError(key, given, "a LineString or a Polygon")
    _check_near(key, area)
    if area.length == 0.0:
        raise BadInputError(key, "a line without length", "a line between different points")


def _check_polygon(key: str, polygon: Polygon) -> None:
    if not isinstance(polygon, BaseGeometry):
        raise BadInputError(key, polygon, "a Polygon: shapely.box(0, 0, 500, 400)")
    if polygon.is_empty or polygon.geom_type != "Polygon":
        raise BadInputError(key, polygon.geom_type, "one polygon with an area")
    _check_near(key, polygon)
    refuse_jagged(key, polygon)
    if not are_valid(np.array([polygon], dtype=np.object_))[0]:
        raise BadInputError(key, shapely.is_valid_reason(polygon), "a polygon that is valid")


def _check_near(key: str, shape: BaseGeometry) -> None:
    box = shape.bounds
    if not all(abs(value) <= LARGEST_MM for value in box):
        raise BadInputError(key, box, f"finite coordinates up to {LARGEST_MM:g} mm")
