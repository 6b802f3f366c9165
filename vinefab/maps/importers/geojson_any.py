"""GeoJSON of other programs: any geometry, also an invalid one."""

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError, UnfitInputError, UnreadableFileError, located
from vinefab.core.validation import positive
from vinefab.maps.importers.doubts import with_notes
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import (
    DrawingItem,
    DrawnPoint,
    Ring,
    SourceDrawing,
    Straight,
    drawing_map,
    drawn_points,
)
from vinefab.maps.importers.source_unit import TRIANGLES_ADVICE, SourceUnit, unit_of
from vinefab.model.files.shipped import read_text
from vinefab.model.map import Map, feature_key, geojson_document


def _scaled_map(world: Map, factor: float) -> Map:
    """Return a map with all lengths multiplied by a factor, about the origin."""
    positive("scale", factor, 1e6, "new over old")
    if factor == 1.0:
        return world

    def scaled(polygon: Polygon) -> Polygon:
        return shapely.transform(polygon, lambda points: points * factor)

    starts = tuple(
        replace(
            start,
            pose=replace(start.pose, x_mm=start.pose.x_mm * factor, y_mm=start.pose.y_mm * factor),
            spread_x_mm=start.spread_x_mm * factor,
            spread_y_mm=start.spread_y_mm * factor,
            area=start.area and shapely.transform(start.area, lambda points: points * factor),
            clearance_mm=start.clearance_mm * (1.0 if start.area is None else factor),
        )
        for start in world.starts
    )
    return replace(
        world,
        bounds=scaled(world.bounds),
        obstacles=tuple(map(scaled, world.obstacles)),
        starts=starts,
        facts={**world.facts, "scaled_by": factor},
    )


_DEEPEST = 20
_ONLY_DRAWINGS = (
    "simplify_mm",
    "start",
    "join_mm",
    "drawn",
    "bounds",
    "margin_mm",
    "wall_mm",
    "open_lines",
)
_ROLES = ("bounds", "obstacle")

_NAMED_BY = ("name", "layer", "role")
"""Properties that name a feature, in any case."""

_Leaf = tuple[str, dict[str, Any], dict[str, Any]]
"""Name in messages, a geometry that is not a collection, and the properties of its feature."""


def import_geojson(path: Path, options: ImportOptions) -> Map:
    """Return the map in a GeoJSON file.

    A map that vinefab wrote is read unchanged. In other files polygons are solid areas (the
    largest is the bounds, its holes are obstacles), closed lines are outlines and open ones are
    joined; points are counted and left out. ``properties.role`` may name bounds and obstacles.
    """
    options.refuse(("layers", "unknown", "least_obstacle_mm2"), "a GeoJSON file", path)
    document = _document(path)
    if "vinefab" in document:
        options.refuse(_ONLY_DRAWINGS, "a map that vinefab wrote", path)
        scale = 1.0 if options.scale_mm_per_unit is None else options.scale_mm_per_unit
        world = _scaled_map(Map.read(path), scale)
        return replace(world, facts={**world.facts, "source": path.name})
    world = drawing_map(path, _source(path, document, options), options)
    return with_notes(replace(world, environment="geojson"), *_sequence_note(document))


def geojson_source(path: Path, options: ImportOptions) -> SourceDrawing:
    """Return what a GeoJSON file shows."""
    options.refuse(("layers",), "a GeoJSON file", path)
    return _source(path, _document(path), options)


def _document(path: Path) -> dict[str, Any]:
    """Return the GeoJSON object in a file; a text sequence is one collection of features."""
    try:
        document = geojson_document(path)
    except UnreadableFileError:
        document = text_sequence(path)
        if document is None:
            raise
    kind = None
    if isinstance(document, dict) and document.get("type") == "Topology":
        kind = "TopoJSON"
    elif isinstance(document, dict) and {"geometryType", "features"} <= set(document):
        kind = "Esri JSON"
    if kind:
        raise BadInputError("type", kind, "GeoJSON; ogr2ogr plan.geojson FILE converts it", path)
    if not isinstance(document, dict) or "type" not in document:
        raise BadInputError("type", None, "a GeoJSON object such as a FeatureCollection", path)
    return document


def text_sequence(path: Path) -> dict[str, Any] | None:
    """Return the features of a GeoJSON text sequence as one collection; None of other files.

    A feature stands in each line, perhaps after a record separator (RFC 8142), as GDAL and
    tippecanoe write them.
    """
    lines = [line for line in read_text(path).replace("\x1e", "").splitlines() if line.strip()]
    if len(lines) < 2 or not all(line.lstrip().startswith("{") for line in lines[:2]):
        return None
    try:
        records = [json.loads(line) for line in lines]
    except (ValueError, RecursionError):
        return None
    features = [
        feature
        for record in records
        for feature in (record.get("features", [record]) if isinstance(record, dict) else [record])
    ]
    return {"type": "FeatureCollection", "features": features, _SEQUENCE: len(lines)}


_SEQUENCE = "vinefab:records"


def _sequence_note(document: dict[str, Any]) -> tuple[str, ...]:
    count = document.get(_SEQUENCE)
    return (f"a GeoJSON text sequence: {count} records, read as one collection",) if count else ()


def _source(path: Path, document: dict[str, Any], options: ImportOptions) -> SourceDrawing:
    with located(path):
        drawing = _drawing(document)
        if options.scale_mm_per_unit is not None or not drawing.items:
            return drawing
        system = document.get("crs")
        named = system.get("properties") if isinstance(system, dict) else None
        name = str(named.get("name") or "") if isinstance(named, dict) else ""
        unit = unit_of(name, drawn_points(drawing.items), drawing.unit)
        return replace(drawing, unit=unit)


def _drawing(document: dict[str, Any]) -> SourceDrawing:
    items: list[DrawingItem] = []
    points: list[DrawnPoint] = []
    kinds: Counter[str] = Counter()
    unclosed = 0
    for key, geometry, properties in _geometries(document):
        kind = str(geometry.get("type"))
        names = tuple(str(value) for name, value in properties.items() if name.lower() in _NAMED_BY)
        width: Any = properties.get("width")
        wide = type(width) in (int, float) and width > 0.0
        found = [
            replace(item, names=names, width=float(width) if wide else None)
            for item in _items(key, geometry, properties.get("role"))
        ]
        place: Any = geometry.get("coordinates")
        if kind == "Point" and _is_position(place):
            points.append(DrawnPoint(place=(float(place[0]), float(place[1])), names=names))
        kinds[kind] += 1
        rings = [ring.hull() for item in found if item.closed for ring in item.rings]
        unclosed += sum(bool((points[0] != points[-1]).any()) for points in rings)
        items += found
    facts: dict[str, object] = {"geometries": dict(kinds)}
    if unclosed:
        facts["rings_closed"] = unclosed
    unit = SourceUnit(name="mm", mm=1.0, known="guess", by="GeoJSON names none")
    return SourceDrawing(
        items=tuple(items), unit=unit, points=tuple(points), facts=facts, curved=False
    )


def _geometries(document: dict[str, Any]) -> Iterator[_Leaf]:
    """Yield every single geometry of a document."""
    named = {str(document["type"]): document}
    if document["type"] == "FeatureCollection":
        features = document.get("features")
        if not isinstance(features, list):
            raise BadInputError("features", features, "a list of features")
        named = {feature_key(index): feature for index, feature in enumerate(features)}
    for key, feature in named.items():
        if not isinstance(feature, dict):
            raise BadInputError(key, feature, "a GeoJSON Feature")
        if feature.get("type") != "Feature":
            yield from _leaves(key, feature, {}, 0)
            continue
        properties, geometry = feature.get("properties"), feature.get("geometry")
        if geometry is not None:
            named = properties if isinstance(properties, dict) else {}
            yield from _leaves(key, geometry, named, 0)


def _leaves(key: str, geometry: object, properties: dict[str, Any], depth: int) -> Iterator[_Leaf]:
    if not isinstance(geometry, dict) or depth > _DEEPEST:
        raise BadInputError(key, geometry, "a geometry with type and coordinates")
    kind, parts = geometry.get("type"), geometry.get("coordinates")
    if kind == "GeometryCollection":
        for index, part in enumerate(_list(key, geometry.get("geometries")), start=1):
            yield from _leaves(f"{key} geometry {index}", part, properties, depth + 1)
    elif isinstance(kind, str) and kind.startswith("Multi"):
        for index, part in enumerate(_list(key, parts), start=1):
            single = {"type": kind.removeprefix("Multi"), "coordinates": part}
            yield f"{key} part {index}", single, properties
    else:
        yield key, geometry, properties


def _items(key: str, geometry: dict[str, Any], role: Any) -> list[DrawingItem]:  # noqa: ANN401  JSON
    role = role if role in _ROLES else None
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if kind == "LineString":
        ring = _ring(key, coordinates)
        return (
            [DrawingItem(rings=(ring,), where=key, closed=role is not None, role=role)]
            if ring
            else []
        )
    if kind == "Polygon":
        rings = [
            _ring(f"{key} ring {index}", ring)
            for index, ring in enumerate(_list(key, coordinates), start=1)
        ]
        if not rings or rings[0] is None:
            return []
        holes = tuple(ring for ring in rings[1:] if ring is not None)
        return [DrawingItem(rings=(rings[0],), where=key, filled=True, holes=holes, role=role)]
    if kind == "Point":
        return []
    if kind in ("TIN", "Triangle", "PolyhedralSurface"):
        raise UnfitInputError(key, f"is a surface of triangles ({kind}), no plan", TRIANGLES_ADVICE)
    raise BadInputError(f"{key}.geometry.type", kind, "a GeoJSON geometry")


def _ring(key: str, points: object) -> Ring | None:
    """Return a ring, None without positions."""
    positions = _list(key, points)
    for number, point in enumerate(positions, start=1):
        if not _is_position(point):
            raise BadInputError(f"{key} position {number}", point, "[x, y], finite numbers")
    if not positions:
        return None
    array = np.array([point[:2] for point in positions], dtype=np.float64)
    return Ring(pieces=(Straight(array),))


def _is_position(point: Any) -> bool:  # noqa: ANN401  JSON
    return (
        isinstance(point, list)
        and len(point) >= 2
        and all(type(value) in (int, float) and abs(value) < 1e300 for value in point[:2])
    )


def _list(key: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise BadInputError(f"{key}.geometry.coordinates", value, "a list")
    return value
