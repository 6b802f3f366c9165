"""Maps as GeoJSON files in millimetres, and GeoJSON geometry checked feature by feature."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import shapely
from pydantic import ConfigDict, Field
from shapely import LineString, Polygon

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.jsontext import GENERATOR, plain
from vinefab.core.plain_text import counted
from vinefab.core.table import Table, declared_keys, validated
from vinefab.core.units import deg
from vinefab.core.validation import LARGEST_MM, Floats, check_plain
from vinefab.model.files.shipped import read_text
from vinefab.model.start import Pose, Start, are_valid, refuse_jagged
from vinefab.model.start_place import StartPlace, StartTable, with_starts
from vinefab.model.target import Target, check_targets, targets_given

if TYPE_CHECKING:
    from vinefab.model.map import Map

_LARGEST_BYTES = 1 << 30
_DECIMALS = 6
"""Coordinates are written to 1e-6 mm: below any machine's precision, above rounding noise."""


def geojson_document(path: Path) -> Any:  # noqa: ANN401  JSON
    """Return the JSON document in a file."""
    text = read_text(path, _LARGEST_BYTES)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        hint = ", but TOML, as designs are" if "vinefab/" in text[:4096] else ""
        raise UnreadableFileError(path, f"is not JSON{hint}: {error}") from error


def _features(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return a FeatureCollection's document and its features."""
    document = geojson_document(path)
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        kind = document.get("type") if isinstance(document, dict) else type(document).__name__
        raise BadInputError("type", kind, "FeatureCollection (a GeoJSON map)", path)
    features = document.get("features")
    if not isinstance(features, list):
        raise BadInputError("features", features, "a list of features", path)
    for index, feature in enumerate(features):
        if not isinstance(feature, dict) or feature.get("type") != "Feature":
            raise BadInputError(feature_key(index), feature, "a GeoJSON Feature", path)
    return document, features


def feature_key(index: int) -> str:
    """Return the name of a feature in messages, counted from 1."""
    return f"features[{index + 1}]"


def _polygons(key: str, feature: dict[str, Any]) -> list[Polygon]:
    """Return the valid polygons of a feature; a MultiPolygon gives each of its parts."""
    kind, coordinates = _geometry(key, feature)
    if kind == "Polygon":
        return [_polygon(key, coordinates)]
    if kind == "MultiPolygon" and isinstance(coordinates, list):
        parts = enumerate(coordinates)
        return [_polygon(f"{key} part {number + 1}", part) for number, part in parts]
    raise BadInputError(f"{key}.geometry.type", kind, "Polygon or MultiPolygon")


def _shape_text(shape: LineString | Polygon) -> str:
    """Return a shape as GeoJSON: outer ring counter-clockwise, holes clockwise (RFC 7946)."""

    def rounded(line: LineString) -> list[list[float]]:
        points: list[list[float]] = (
            np.round(shapely.get_coordinates(line), _DECIMALS) + 0.0
        ).tolist()
        return points

    if isinstance(shape, LineString):
        return json.dumps({"type": "LineString", "coordinates": rounded(shape)}, allow_nan=False)
    oriented = shapely.orient_polygons(shape)
    rings = [rounded(ring) for ring in (oriented.exterior, *oriented.interiors)]
    return json.dumps({"type": "Polygon", "coordinates": rings}, allow_nan=False)


def _geometry(key: str, feature: dict[str, Any]) -> tuple[object, Any]:
    geometry = feature.get("geometry")
    if not isinstance(geometry, dict):
        raise BadInputError(f"{key}.geometry", geometry, "a geometry with type and coordinates")
    return geometry.get("type"), geometry.get("coordinates")


def _polygon(key: str, rings: object) -> Polygon:
    if not isinstance(rings, list) or not rings:
        raise BadInputError(f"{key}.geometry.coordinates", rings, "an outer ring, then holes")
    shell, *holes = [_ring(f"{key} ring {number + 1}", ring) for number, ring in enumerate(rings)]
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


def _positions(key: str, points: Sequence[object]) -> Floats:
    for point in points:
        if not _is_position(point):
            raise BadInputError(key, point, f"positions [x, y], numbers up to {LARGEST_MM:g} mm")
    array = np.array([point[:2] for point in points], dtype=np.float64)  # type: ignore[index]
    return array.reshape(-1, 2)


def _is_position(point: object) -> bool:
    """Tell whether this is [x, y] or [x, y, z] of usable numbers; NaN fails the comparison."""
    return (
        isinstance(point, list)
        and len(point) in (2, 3)
        and all(type(value) in (int, float) for value in point)
        and all(abs(value) <= LARGEST_MM for value in point[:2])
    )


MAP_SCHEMA = "vinefab/map-1"
_ROLES = ("bounds", "obstacle", "start", "target")
_OF_GEOMETRY = ("line", "area")
"""Keys of a start whose place GeoJSON has in the geometry."""
_SLACK_MM = 1e-6


class _About(Table):
    """The foreign member of a map that vinefab wrote; other keys in it are left alone."""

    model_config = ConfigDict(extra="ignore")

    schema_: Annotated[Literal["vinefab/map-1"], Field(alias="schema")] = "vinefab/map-1"
    name: str | None = None
    environment: str | None = None
    seed: int | None = None
    facts: dict[str, Any] | None = None


_Content = tuple[
    Polygon, list[Polygon], list[tuple[str, Start | StartPlace]], list[tuple[str, Target]]
]
"""Bounds, obstacles, and starts and targets, each with its name in messages."""


def read_map(path: Path, made: "type[Map]") -> "Map":
    """Return the map in a GeoJSON file.

    A file that vinefab wrote gives every feature a role. In a file without any roles the largest
    polygon must contain all others and is the bounds; the others are obstacles.

    Parameters
    ----------
    made
        The class of maps, which has this function as its `Map.read`.

    Raises
    ------
    UnreadableFileError
        If the file is missing, not UTF-8 or not JSON.
    BadInputError
        If it is not a map; the message names the feature and the position.
    """
    document, features = _features(path)
    try:
        about = _about(document)
        properties = [feature.get("properties") for feature in features]
        roles = [one.get("role") if isinstance(one, dict) else None for one in properties]
        has_roles = any(role is not None for role in roles)
        bounds, obstacles, starts, targets = (
            _with_roles(features, roles) if has_roles else _without_roles(features)
        )
        world = made(
            name=about.name or path.stem,
            bounds=bounds,
            obstacles=tuple(obstacles),
            environment=about.environment or "geojson",
            seed=about.seed,
            facts=about.facts or {},
        )
        for key, target in targets:
            check_targets(world, (target,), key)
        found = [one for key, start in starts for one in with_starts(world, (start,), key).starts]
        named = targets_given([target for _, target in targets], "targets")
        return replace(world, starts=tuple(found), targets=named)
    except BadInputError as error:
        raise error.at(path) from error


def map_text(world: "Map") -> str:
    """Return a map as GeoJSON text, one feature per line, coordinates to 1e-6 mm."""
    about = {
        "schema": MAP_SCHEMA,
        "generator": GENERATOR,
        "name": world.name,
        "environment": world.environment,
        "seed": world.seed,
        "facts": dict(world.facts),
    }
    lines = [_polygon_line("bounds", world.bounds)]
    lines += [_polygon_line("obstacle", polygon) for polygon in world.obstacles]
    lines += [_start_line(start) for start in world.starts]
    lines += [_target_line(target) for target in world.targets]
    head = json.dumps(about, allow_nan=False, default=plain)
    body = ",\n".join(lines)
    return f'{{"type": "FeatureCollection",\n"vinefab": {head},\n"features": [\n{body}\n]}}\n'


def _polygon_line(role: str, polygon: Polygon) -> str:
    return (
        f'{{"type": "Feature", "properties": {{"role": "{role}"}}, '
        f'"geometry": {_shape_text(polygon)}}}'
    )


def _start_line(start: Start) -> str:
    position = [round(start.pose.x_mm, _DECIMALS), round(start.pose.y_mm, _DECIMALS)]
    turned = {"heading_deg": deg(start.pose.heading_rad)}
    spread_deg = deg(start.spread_heading_rad)
    if start.area is None:
        ranges = {"spread_x_mm": start.spread_x_mm, "spread_y_mm": start.spread_y_mm}
        about = {**turned, **ranges, "spread_heading_deg": spread_deg}
        shape = json.dumps({"type": "Point", "coordinates": position})
    else:
        pose = {"x_mm": position[0], "y_mm": position[1], **turned}
        about = {**pose, "spread_heading_deg": spread_deg, "clearance_mm": start.clearance_mm}
        shape = _shape_text(start.area)
    properties = json.dumps({"role": "start", **about}, allow_nan=False)
    return f'{{"type": "Feature", "properties": {properties}, "geometry": {shape}}}'


def _target_line(target: Target) -> str:
    shape = target.shape
    if isinstance(shape, Polygon):
        written = _shape_text(shape)
    else:
        position = [round(place_mm, _DECIMALS) + 0.0 for place_mm in target.middle_mm]
        written = json.dumps({"type": "Point", "coordinates": position})
    about = {"role": "target", "name": target.name, "tolerance_mm": target.tolerance_mm}
    properties = json.dumps(about, allow_nan=False)
    return f'{{"type": "Feature", "properties": {properties}, "geometry": {written}}}'


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
    try:
        return Target(**properties, **place)
    except BadInputError as error:
        raise BadInputError(f"{key}.properties.{error.key}", error.value, error.allowed) from error


def _about(document: dict[str, Any]) -> _About:
    """Return the foreign member, checked; an empty one for a file that other programs wrote."""
    if "vinefab" not in document:
        return _About()
    about = document["vinefab"]
    if not isinstance(about, dict):
        raise BadInputError("vinefab", about, f'an object with "schema": "{MAP_SCHEMA}"')
    try:
        found = validated(_About, about)
        check_plain({key: value for key, value in found if value is not None})
    except BadInputError as error:
        raise BadInputError(f"vinefab.{error.key}", error.value, error.allowed) from error
    return found


def _with_roles(features: list[dict[str, Any]], roles: list[object]) -> _Content:
    bounds, obstacles = list[Polygon](), list[Polygon]()
    starts, targets = list[tuple[str, Start | StartPlace]](), list[tuple[str, Target]]()
    for index, (feature, role) in enumerate(zip(features, roles, strict=True)):
        key = feature_key(index)
        if role == "bounds":
            bounds += _polygons(key, feature)
        elif role == "obstacle":
            obstacles += _polygons(key, feature)
        elif role == "start":
            starts.append((key, _start(key, feature)))
        elif role == "target":
            targets.append((key, _target(key, feature)))
        else:
            raise BadInputError(f"{key}.properties.role", role, ", ".join(_ROLES))
    if len(bounds) != 1:
        raise BadInputError("bounds", counted(len(bounds), "polygon"), "exactly one")
    return bounds[0], obstacles, starts, targets


def _without_roles(features: list[dict[str, Any]]) -> _Content:
    named = [
        (feature_key(index), polygon)
        for index, feature in enumerate(features)
        for polygon in _polygons(feature_key(index), feature)
    ]
    if not named:
        raise BadInputError("features", "no polygons", "at least one polygon, the bounds")
    key, largest = max(named, key=lambda item: Polygon(item[1].exterior).area)
    others = [(name, polygon) for name, polygon in named if polygon is not largest]
    reach = shapely.buffer(Polygon(largest.exterior), _SLACK_MM)
    for name, polygon in others:
        if not reach.covers(polygon):
            spot = polygon.difference(reach).representative_point()
            raise BadInputError(
                f"{name}: position ({spot.x:.6g}, {spot.y:.6g})",
                f"outside the largest polygon, {key}",
                "inside it, as it is taken for the bounds; or a role for every feature",
            )
    return largest, [polygon for _, polygon in others], [], []


_START_SHAPES = ("Point", "LineString", "Polygon")


def _start(key: str, feature: dict[str, Any]) -> Start | StartPlace:
    properties = feature["properties"]
    names = [one.name for one in declared_keys(StartTable) if one.name not in _OF_GEOMETRY]
    given = {name: properties[name] for name in names if properties.get(name) is not None}
    try:
        area = _start_area(key, feature)
        point = None
        if area is None and "side" not in properties:
            point = _positions(key, [_geometry(key, feature)[1]])[0].tolist()
    except BadInputError as error:
        if error.key.startswith(key):
            raise
        raise BadInputError(f"{key}: {error.key}", error.value, error.allowed) from error
    try:
        table = validated(StartTable, given)
        if point is not None:
            table.only_without("x_mm", "y_mm", at="a point")
            return table.changed(x_mm=point[0], y_mm=point[1]).start
        return _start_place(table, area)
    except BadInputError as error:
        name = error.key.removeprefix("start.")
        where = "geometry" if name == "area" else f"properties.{name}"
        raise BadInputError(f"{key}.{where}", error.value, error.allowed) from error


def _start_area(key: str, feature: dict[str, Any]) -> LineString | Polygon | None:
    """Return the line or polygon of a start; None for a point, or a side without geometry."""
    if feature.get("geometry") is None and "side" in feature["properties"]:
        return None
    kind, coordinates = _geometry(key, feature)
    if kind not in _START_SHAPES:
        raise BadInputError(f"{key}.geometry.type", kind, ", ".join(_START_SHAPES))
    if kind == "Polygon":
        return _polygon(key, coordinates)
    if kind == "LineString":
        if not isinstance(coordinates, list) or len(coordinates) < 2:
            raise BadInputError(f"{key}.geometry.coordinates", coordinates, "two or more positions")
        return LineString(_positions(key, coordinates))
    return None


def _start_place(table: StartTable, area: LineString | Polygon | None) -> Start | StartPlace:
    """Return the start on a side or in an area; with a pose in it, the pose is kept."""
    for name in ("spread_x_mm", "spread_y_mm"):
        if getattr(table, name):
            raise BadInputError(name, getattr(table, name), "0 for a line or an area")
    if table.side is not None and area is not None:
        raise BadInputError("side", table.side, "a side or a geometry, not both")
    place = table.place(area)
    if area is None or place.heading_rad is None or table.x_mm is None or table.y_mm is None:
        return place
    return Start(
        pose=Pose(x_mm=table.x_mm, y_mm=table.y_mm, heading_rad=place.heading_rad),
        spread_heading_rad=place.spread_heading_rad,
        area=area,
        clearance_mm=place.least_clearance_mm,
    )
