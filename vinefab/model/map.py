"""Maps: bounds, obstacles, starts and targets; their GeoJSON files, and their corner markers."""

import json
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from pydantic import ConfigDict, Field, PlainValidator, create_model
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.atomic import write_text
from vinefab.core.errors import BadInputError, UnreadableFileError, inside, located
from vinefab.core.front_door import ABOVE, Pictured
from vinefab.core.frozen import FrozenMapping
from vinefab.core.limits import DEFAULT_MARKER_MM, deg
from vinefab.core.plain_text import GENERATOR, counted, plain, visible
from vinefab.core.table import Table, TablePart, declared_keys, validated
from vinefab.core.validation import LARGEST_MM, Floats, check_plain, frozen_floats, number, positive
from vinefab.model.files.shipped import path_given, read_text
from vinefab.model.start import (
    AnyStart,
    Pose,
    Start,
    StartLike,
    StartTable,
    are_valid,
    check_polygon,
    refuse_jagged,
    start_given,
    with_starts,
)
from vinefab.model.target import Target, check_targets, target_from, targets_given

__all__ = ["Map", "Pose", "Start"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map(Pictured):
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
    targets
        Places that robots are to touch; those without a name are called A, B, C ...
    environment
        Generator or importer of the map.
    seed
        The generator's seed, None for imported maps.
    facts
        Parameters of the generator or settings of the import; plain values.
    surface
        What walls are like: ``smooth``, ``rough``, or a surface of your contacts file. Empty: not
        known.
    """

    name: str
    bounds: Polygon
    obstacles: tuple[Polygon, ...] = ()
    starts: tuple[Start, ...] = ()
    targets: tuple[Target, ...] = ()
    environment: str = "unknown"
    seed: int | None = None
    facts: Mapping[str, object] = field(default_factory=dict)
    surface: str = ""

    def __post_init__(self) -> None:
        for key, kind in (("obstacles", Polygon), ("starts", Start)):
            given = getattr(self, key)
            if not isinstance(given, Sequence) or not all(isinstance(one, kind) for one in given):
                raise BadInputError(key, given, f"a {kind.__name__} for each, in a tuple")
            object.__setattr__(self, key, tuple(given))
        object.__setattr__(self, "targets", targets_given(self.targets, "targets"))
        check_polygon("bounds", self.bounds)
        # Those that are to be refused are found for all at once.
        items = np.array(self.obstacles, dtype=np.object_)
        near = (np.abs(shapely.bounds(items).reshape(-1, 4)) <= LARGEST_MM).all(axis=1)
        plain = shapely.get_type_id(items) == shapely.GeometryType.POLYGON
        for index in np.flatnonzero(near & plain):
            refuse_jagged(f"obstacle {index}", items[index])
        for index in np.flatnonzero(~(near & plain & are_valid(items))):
            check_polygon(f"obstacle {index}", self.obstacles[index])
        object.__setattr__(self, "facts", FrozenMapping(self.facts))

    def __repr__(self) -> str:
        width_mm, height_mm = self.size_mm
        counts = (
            (len(self.obstacles), "obstacle"),
            (self.wall_count, "wall"),
            (len(self.starts), "start"),
            *(((len(self.targets), "target"),) if self.targets else ()),
        )
        words = ", ".join(counted(count, word) for count, word in counts)
        return f"<Map {reprlib.repr(self.name)}: {width_mm:.5g} x {height_mm:.5g} mm, {words}>"

    @property
    def free_space(self) -> BaseGeometry:
        """Bounds minus obstacles: a Polygon or MultiPolygon, computed anew at each call."""
        many_obstacles = 1000
        # The second is as exact, and fast for scattered obstacles, but orders its parts otherwise.
        many = len(self.obstacles) > many_obstacles
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
            If it cannot be a path, or a value in the file cannot be used.
        UnreadableFileError
            If there is no such file, or it is not JSON.

        Examples
        --------
        >>> Map.read("moon.geojson")
        Traceback (most recent call last):
        vinefab.core.errors.UnreadableFileError: moon.geojson: there is no such file
        """
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
            If ``path`` cannot be a path.
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
        return write_text(path_given("path", path), map_text(self), force=force)

    def with_start(self, *starts: StartLike) -> "Map":
        """Return the map with other starts instead.

        Parameters
        ----------
        *starts
            A `Start`, a pose ``(x_mm, y_mm, heading_deg)``, a table with the keys of a run file's
            ``start``, or words as of ``--start``:
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
        return with_starts(self, [start_given(one) for one in starts])

    def with_targets(
        self, *targets: "Target | tuple[float, float] | Mapping[str, object] | str"
    ) -> "Map":
        """Return the map with other targets instead.

        Parameters
        ----------
        *targets
            Points ``(x_mm, y_mm)``, targets, tables with the keys of one, or words as of
            ``--target``: ``"130,330"``, ``"shelf=130,330+-15"``.

        Raises
        ------
        BadInputError
            If one has nothing in free space, or two have one name.

        Examples
        --------
        >>> from vinefab import maps
        >>> world = maps.pegs(seed=1).with_targets((100, 100), "shelf=20,300+-15")
        >>> [(one.name, one.tolerance_mm) for one in world.targets]
        [('A', 20.0), ('shelf', 15.0)]
        """
        read = [target_from(one) if isinstance(one, str) else one for one in targets]
        named = targets_given(read, "targets")
        check_targets(self, named)
        return replace(self, targets=named)

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
        return ABOVE.map_info(self, width_mm=width_mm, passages=passages)

    @property
    def summary(self) -> tuple[str, ...]:
        """Its size, its starts, what is odd about it and how it was made, a line each."""
        lines: tuple[str, ...] = ABOVE.map_summary(self)
        return lines

    def json_text(self) -> str:
        """Return the map as its file holds it: GeoJSON, ``vinefab/map-1``."""
        return map_text(self)


MARKER_CELLS: tuple[tuple[str, str, str, str], ...] = (
    ("#.##", ".#.#", "..##", "..#."),
    ("....", "####", "#..#", "#.#."),
    ("..##", "..##", "..#.", "##.#"),
    ("#..#", "#..#", ".#..", ".##."),
)
"""Inner cells of each marker by its number, rows from the top; ``#`` is white, ``.`` is black. A
frame of black cells, one cell wide, lies around them, and white paper around that."""

MARKER_SIDE_CELLS = 6
"""Cells along the side of a marker, frame included."""

DEFAULT_MARKER_GAP_MM = 12.0
"""From the box of the bounds to a marker along both axes: border and quiet zone, as printed."""


def _four_corners(given: Any) -> Floats:  # noqa: ANN401  any content of a file
    try:
        return frozen_floats("corners_mm", np.reshape(given, (4, 2)), 2)
    except (TypeError, ValueError) as error:
        raise ValueError("four corners, each x and y in mm") from error


class CornerMarker(TablePart):
    """One marker in map coordinates, as files of rigs have it."""

    number: Annotated[
        int,
        Ge(0),
        Le(3),
        Doc("0 at the lower left corner, then counter-clockwise: lower right, upper right ..."),
    ]
    corners_mm: Annotated[
        Floats,
        PlainValidator(_four_corners),
        Unit("mm"),
        Doc(
            "outer corners of its black frame, shape (4, 2): upper left first, then clockwise, as "
            "it is seen upright from above with y upwards"
        ),
    ]
    z_mm: Annotated[
        float, Ge(-1e6), Le(1e6), Unit("mm"), Doc("height of its face above the floor")
    ] = 0.0


def corner_markers(
    world: Map,
    *,
    side_mm: float = DEFAULT_MARKER_MM,
    gap_mm: float = DEFAULT_MARKER_GAP_MM,
    z_mm: float = 0.0,
) -> tuple[CornerMarker, ...]:
    """Return the four markers of a map, upright, each outside its corner of the bounds' box.

    Parameters
    ----------
    side_mm, gap_mm, z_mm
        In millimetres of the map: of a rig at another scale, the printed sizes divided by it.

    Raises
    ------
    BadInputError
        If a size is out of range.
    """
    positive("marker.side_mm", side_mm, 1e6)
    number("marker.gap_mm", gap_mm, 0.0, 1e6, "mm")
    number("marker.z_mm", z_mm, -1e6, 1e6, "mm")
    left, low, right, top = world.bounds.bounds
    near, far = gap_mm, gap_mm + side_mm
    places = (
        (left - far, low - far),
        (right + near, low - far),
        (right + near, top + near),
        (left - far, top + near),
    )
    square = side_mm * np.array([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)])
    return tuple(
        CornerMarker(number=index, corners_mm=square + place, z_mm=z_mm)
        for index, place in enumerate(places)
    )


# --- As files ------------------------------------------------------------------------------------

MAP_SCHEMA = "vinefab/map-1"
_LARGEST_BYTES = 1 << 30
_DECIMALS = 6
"""Coordinates are written to 1e-6 mm: below any machine's precision, above rounding noise."""


class _AboutForm(Table):
    """The foreign member of a map that vinefab wrote; other keys in it are left alone."""

    model_config = ConfigDict(extra="ignore")

    schema_: Annotated[Literal["vinefab/map-1"], Field(alias="schema")] = "vinefab/map-1"


_about_fields: dict[str, Any] = {
    name: (Map.__annotations__[name] | None, None)
    for name in ("name", "environment", "seed", "facts", "surface")
}
_About = create_model("_About", __base__=_AboutForm, **_about_fields)
"""With fields of `Map`, any of which may be missing."""


def map_text(world: Map) -> str:
    """Return a map as GeoJSON text, one feature per line, coordinates to 1e-6 mm."""
    about = {
        "schema": MAP_SCHEMA,
        "generator": GENERATOR,
        "name": world.name,
        "environment": world.environment,
        "seed": world.seed,
        "facts": dict(world.facts),
        **({"surface": world.surface} if world.surface else {}),
    }
    lines = [_feature_line(world.bounds, role="bounds")]
    lines += [_feature_line(polygon, role="obstacle") for polygon in world.obstacles]
    for start in world.starts:
        pose = start.pose
        turned = {"heading_deg": pose.heading_deg}
        spread = {"spread_heading_deg": deg(start.spread_heading_rad)}
        if start.area is None:
            ranges = {"spread_x_mm": start.spread_x_mm, "spread_y_mm": start.spread_y_mm}
            spot = shapely.Point(pose.x_mm, pose.y_mm)
            lines.append(_feature_line(spot, role="start", **turned, **ranges, **spread))
        else:
            at = {"x_mm": round(pose.x_mm, _DECIMALS), "y_mm": round(pose.y_mm, _DECIMALS)}
            spread["clearance_mm"] = start.clearance_mm
            lines.append(_feature_line(start.area, role="start", **at, **turned, **spread))
    lines += [
        _feature_line(one.shape, role="target", name=one.name, tolerance_mm=one.tolerance_mm)
        for one in world.targets
    ]
    head = json.dumps(about, allow_nan=False, default=plain)
    body = ",\n".join(lines)
    return f'{{"type": "FeatureCollection",\n"vinefab": {head},\n"features": [\n{body}\n]}}\n'


def _feature_line(shape: BaseGeometry, **properties: object) -> str:
    """Return a feature; outer rings run counter-clockwise, holes clockwise (RFC 7946)."""
    is_area = isinstance(shape, Polygon)
    lines = shapely.get_rings(shapely.orient_polygons(shape)) if is_area else [shape]
    # Adding 0 turns -0.0 into 0.0.
    found = [(np.round(shapely.get_coordinates(one), _DECIMALS) + 0.0).tolist() for one in lines]
    place = found if is_area else found[0] if isinstance(shape, LineString) else found[0][0]
    geometry = {"type": shape.geom_type, "coordinates": place}
    feature = {"type": "Feature", "properties": properties, "geometry": geometry}
    return json.dumps(feature, allow_nan=False)


def geojson_document(path: Path) -> Any:  # noqa: ANN401  JSON
    """Return the JSON document in a file."""
    text = read_text(path, _LARGEST_BYTES)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        hint = ", but TOML, as designs are" if "vinefab/" in text[:4096] else ""
        raise UnreadableFileError(path, f"is not JSON{hint}: {error}") from None


def feature_key(index: int) -> str:
    """Return the name of a feature in messages, counted from 1."""
    return f"features[{index + 1}]"


def read_map(path: Path) -> Map:
    """Return the map in a GeoJSON file.

    A file that vinefab wrote gives every feature a role. In a file without any roles the largest
    polygon must contain all others and is the bounds; the others are obstacles.
    """
    document = geojson_document(path)
    with located(path):
        if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
            kind = document.get("type") if isinstance(document, dict) else type(document).__name__
            raise BadInputError("type", kind, "FeatureCollection (a GeoJSON map)")
        features = document.get("features")
        if not isinstance(features, list):
            raise BadInputError("features", features, "a list of features")
        for index, feature in enumerate(features):
            if not isinstance(feature, dict) or feature.get("type") != "Feature":
                raise BadInputError(feature_key(index), feature, "a GeoJSON Feature")
        about = dict[str, Any]()
        if (member := document.get("vinefab", about)) is not about:
            if not isinstance(member, dict):
                allowed = f'an object with "schema": "{MAP_SCHEMA}"'
                raise BadInputError("vinefab", member, allowed)
            with inside("vinefab"):
                read = validated(_About, member)
                about = {key: value for key, value in read if value is not None}
                check_plain(about)
        return _map_of(features, about, visible(path.stem))


def _map_of(features: list[dict[str, Any]], about: Mapping[str, Any], stem: str) -> Map:
    bounds, obstacles = list[Polygon](), list[Polygon]()
    starts, targets = list[tuple[str, AnyStart]](), list[tuple[str, Target]]()
    properties = [feature.get("properties") for feature in features]
    roles = [one.get("role") if isinstance(one, dict) else None for one in properties]
    if all(role is None for role in roles):
        bounds, obstacles = _nested(features)
        roles = []
    for index, (feature, role) in enumerate(zip(features, roles, strict=False)):
        key = feature_key(index)
        match role:
            case "bounds":
                bounds += _polygons(key, feature)
            case "obstacle":
                obstacles += _polygons(key, feature)
            case "start":
                starts.append((key, _start(key, feature)))
            case "target":
                targets.append((key, _target(key, feature)))
            case _:
                allowed = "bounds, obstacle, start, target"
                raise BadInputError(f"{key}.properties.role", role, allowed)
    if len(bounds) != 1:
        raise BadInputError("bounds", counted(len(bounds), "polygon"), "exactly one")
    world = Map(
        name=about.get("name") or stem,
        bounds=bounds[0],
        obstacles=tuple(obstacles),
        environment=about.get("environment") or "geojson",
        seed=about.get("seed"),
        facts=about.get("facts", {}),
        surface=about.get("surface", ""),
    )
    for key, target in targets:
        check_targets(world, (target,), key)
    found = [one for key, start in starts for one in with_starts(world, (start,), key).starts]
    named = targets_given([target for _, target in targets], "targets")
    return replace(world, starts=tuple(found), targets=named)


def _nested(features: list[dict[str, Any]]) -> tuple[list[Polygon], list[Polygon]]:
    """Return the largest polygon of features without roles, alone in a list, and the others."""
    named = [
        (feature_key(index), polygon)
        for index, feature in enumerate(features)
        for polygon in _polygons(feature_key(index), feature)
    ]
    if not named:
        raise BadInputError("features", "no polygons", "at least one polygon, the bounds")
    key, largest = max(named, key=lambda item: Polygon(item[1].exterior).area)
    others = [(name, polygon) for name, polygon in named if polygon is not largest]
    slack_mm = 1e-6
    reach = shapely.buffer(Polygon(largest.exterior), slack_mm)
    for name, polygon in others:
        if not reach.covers(polygon):
            spot = polygon.difference(reach).representative_point()
            raise BadInputError(
                f"{name}: position ({spot.x:.6g}, {spot.y:.6g})",
                f"outside the largest polygon, {key}",
                "inside it, as it is taken for the bounds; or a role for every feature",
            )
    return [largest], [polygon for _, polygon in others]


def _geometry(key: str, feature: dict[str, Any]) -> tuple[object, Any]:
    geometry = feature.get("geometry")
    if not isinstance(geometry, dict):
        raise BadInputError(f"{key}.geometry", geometry, "a geometry with type and coordinates")
    return geometry.get("type"), geometry.get("coordinates")


def _polygons(key: str, feature: dict[str, Any]) -> list[Polygon]:
    """Return the valid polygons of a feature; a MultiPolygon gives each of its parts."""
    kind, coordinates = _geometry(key, feature)
    if kind == "Polygon":
        return [_polygon(key, coordinates)]
    if kind == "MultiPolygon" and isinstance(coordinates, list):
        return [_polygon(f"{key} part {n}", part) for n, part in enumerate(coordinates, start=1)]
    raise BadInputError(f"{key}.geometry.type", kind, "Polygon or MultiPolygon")


def _polygon(key: str, rings: object) -> Polygon:
    if not isinstance(rings, list) or not rings:
        raise BadInputError(f"{key}.geometry.coordinates", rings, "an outer ring, then holes")
    shell, *holes = (_ring(f"{key} ring {n}", ring) for n, ring in enumerate(rings, start=1))
    polygon = Polygon(shell, holes)
    refuse_jagged(key, polygon)
    if not are_valid(np.array([polygon], dtype=np.object_))[0]:
        # What is wrong with it, and where: ``Self-intersection at (5, 5)``.
        what, _, where = shapely.is_valid_reason(polygon).partition("[")
        x, _, y = where.rstrip("]").partition(" ")
        reason = f"{what} at ({x}, {y})" if where else what
        raise BadInputError(key, reason, "rings that do not cross or touch themselves")
    return polygon


def _ring(key: str, points: object) -> Floats:
    """Return a ring's positions; one that is not closed is closed later, by Polygon."""
    if not isinstance(points, list):
        raise BadInputError(key, points, "a list of positions")
    positions = _positions(key, points)
    distinct = len(np.unique(positions, axis=0)) if len(positions) else 0
    if distinct < 3:
        raise BadInputError(key, f"{distinct} different points", "at least 3")
    return positions


def _positions(key: str, points: Sequence[Any]) -> Floats:
    """Return [x, y] or [x, y, z] of usable numbers, shape (n, 2); NaN fails the comparison."""
    for point in points:
        if not (
            isinstance(point, list)
            and len(point) in (2, 3)
            and all(type(value) in (int, float) for value in point)
            and all(abs(value) <= LARGEST_MM for value in point[:2])
        ):
            raise BadInputError(key, point, f"positions [x, y], numbers up to {LARGEST_MM:g} mm")
    return np.array([point[:2] for point in points], dtype=np.float64).reshape(-1, 2)


def _target(key: str, feature: dict[str, Any]) -> Target:
    kind, coordinates = _geometry(key, feature)
    properties = {name: value for name, value in feature["properties"].items() if name != "role"}
    for name, value in properties.items():
        if name not in ("name", "tolerance_mm"):
            raise BadInputError(f"{key}.properties.{name}", value, "name, tolerance_mm")
    if kind == "Point":
        (position,) = _positions(f"{key}.geometry", [coordinates]).tolist()
        place: dict[str, Any] = {"point_mm": tuple(position)}
    elif kind == "Polygon":
        area = _polygon(key, coordinates)
        if area.interiors:
            holes = counted(len(area.interiors), "hole")
            raise BadInputError(f"{key}.geometry", f"an area with {holes}", "an area without holes")
        ring = shapely.get_coordinates(area.exterior)[:-1].tolist()
        place = {"area_mm": tuple(map(tuple, ring))}
    else:
        raise BadInputError(f"{key}.geometry.type", kind, "Point, Polygon")
    with inside(f"{key}.properties"):
        return Target(**properties, **place)


def _start(key: str, feature: dict[str, Any]) -> AnyStart:
    """Return a start at a point, on a line, in an area or on a side; a pose in it is kept."""
    properties = feature["properties"]
    # GeoJSON has lines and areas in the geometry.
    names = [one.name for one in declared_keys(StartTable) if one.name not in ("line", "area")]
    given = {name: properties[name] for name in names if properties.get(name) is not None}
    kind, coordinates = None, None
    area: LineString | Polygon | None = None
    if feature.get("geometry") is not None or "side" not in properties:
        kind, coordinates = _geometry(key, feature)
    if kind == "Polygon":
        area = _polygon(key, coordinates)
    elif kind == "LineString":
        if not isinstance(coordinates, list) or len(coordinates) < 2:
            raise BadInputError(f"{key}.geometry.coordinates", coordinates, "two or more positions")
        area = LineString(_positions(key, coordinates))
    elif kind not in ("Point", None):
        raise BadInputError(f"{key}.geometry.type", kind, "Point, LineString, Polygon")
    try:
        table = validated(StartTable, given)
        if area is None and table.side is None:
            table.only_without("x_mm", "y_mm", at="a point")
            ((x_mm, y_mm),) = _positions(key, [coordinates]).tolist()
            return table.changed(x_mm=x_mm, y_mm=y_mm).start
        place = table.place(area)
    except BadInputError as error:
        if error.key.startswith(key):
            raise
        name = error.key.removeprefix("start.")
        where = "geometry" if name == "area" else f"properties.{name}"
        raise error.under(f"{key}.{where}") from None
    if area is None or place.heading_rad is None or table.x_mm is None or table.y_mm is None:
        return place
    return Start(
        pose=Pose(x_mm=table.x_mm, y_mm=table.y_mm, heading_rad=place.heading_rad),
        spread_heading_rad=place.spread_heading_rad,
        area=area,
        clearance_mm=place.least_clearance_mm,
    )
