"""GeoJSON geometry, checked: every error says which feature, what is wrong and where."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.files.shipped import read_text
from vinefab.model.checked import LARGEST_MM, Floats

LARGEST_GEOJSON_BYTES = 1 << 30
DECIMALS = 6
"""Coordinates are written to 1e-6 mm: far below what can be made, above rounding noise."""


def read_features(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return a FeatureCollection's document and its features.

    Raises
    ------
    UnreadableFileError
        If the file cannot be read or is not JSON.
    BadInputError
        If it is JSON but not a FeatureCollection.
    """
    text = read_text(path, LARGEST_GEOJSON_BYTES)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {error}") from error
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
    """Return what messages call a feature; they count from 1."""
    return f"features[{index + 1}]"


def polygons_in(key: str, feature: dict[str, Any]) -> list[Polygon]:
    """Return the valid polygons of a feature; a MultiPolygon gives each of its parts.

    Raises
    ------
    BadInputError
        If the geometry is something else, or a ring is short, crosses itself or has coordinates
        that are not finite or too large.
    """
    kind, coordinates = _geometry(key, feature)
    if kind == "Polygon":
        return [_polygon(key, coordinates)]
    if kind == "MultiPolygon" and isinstance(coordinates, list):
        parts = enumerate(coordinates)
        return [_polygon(f"{key} part {number + 1}", part) for number, part in parts]
    raise BadInputError(f"{key}.geometry.type", kind, "Polygon or MultiPolygon")


def point_in(key: str, feature: dict[str, Any]) -> tuple[float, float]:
    """Return the position of a Point feature, or raise BadInputError."""
    kind, coordinates = _geometry(key, feature)
    if kind != "Point":
        raise BadInputError(f"{key}.geometry.type", kind, "Point")
    x, y = _positions(key, [coordinates])[0]
    return float(x), float(y)


def polygon_text(polygon: Polygon) -> str:
    """Return a polygon as GeoJSON: outer ring counter-clockwise, holes clockwise (RFC 7946)."""
    oriented = shapely.orient_polygons(polygon)
    rings = [oriented.exterior, *oriented.interiors]
    coordinates = [np.round(shapely.get_coordinates(ring), DECIMALS) + 0.0 for ring in rings]
    return json.dumps(
        {"type": "Polygon", "coordinates": [ring.tolist() for ring in coordinates]},
        allow_nan=False,
    )


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
    if not polygon.is_valid:
        raise BadInputError(key, _reason(polygon), "rings that do not cross or touch themselves")
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


def _reason(polygon: Polygon) -> str:
    """Return what is wrong with a polygon, and where: ``Self-intersection at (5, 5)``."""
    what, _, where = shapely.is_valid_reason(polygon).partition("[")
    x, _, y = where.rstrip("]").partition(" ")
    return f"{what} at ({x}, {y})" if where else what
