"""Starting places along the lower side of a map, and what else all generators share."""

import math
from typing import Protocol

import numpy as np
import shapely
from shapely import MultiPoint, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, number
from vinefab.model.map import Pose, Start

DECIMALS = 4
"""Generated coordinates are whole multiples of 1e-4 mm.

A file then holds exactly what was generated, and the last bit of somebody's cosine does not make
another map.
"""


_STRAIGHT_MM2 = 0.5 * 10.0 ** (-2 * DECIMALS)
"""Twice the area of a triangle whose corners count as on one line."""


def rounded(points_mm: Floats) -> Floats:
    """Return points on the grid of `DECIMALS`, without negative zeros."""
    return np.asarray(np.round(points_mm, DECIMALS) + 0.0, dtype=np.float64)


def box(width_mm: float, height_mm: float) -> Polygon:
    """Return the rectangle from the origin to (width, height), counter-clockwise."""
    corners = [(0.0, 0.0), (width_mm, 0.0), (width_mm, height_mm), (0.0, height_mm)]
    return Polygon(rounded(np.array(corners)))


def start_zone(start: Start) -> BaseGeometry:
    """Return all the positions within a start's range: a rectangle, a line or a point."""
    x, y = start.pose.x_mm, start.pose.y_mm
    half_x, half_y = start.spread_x_mm, start.spread_y_mm
    corners = [
        (x + sign_x * half_x, y + sign_y * half_y) for sign_x in (-1, 1) for sign_y in (-1, 1)
    ]
    # To 1e-9 mm: the distance to a rectangle a billionth of that high overflows.
    return shapely.convex_hull(MultiPoint(np.round(corners, 9)))


def upward_start(x_mm: float, y_mm: float, spreads: tuple[float, float, float]) -> Start:
    """Return a start that launches along +y."""
    return Start(
        pose=Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=math.pi / 2),
        spread_x_mm=spreads[0],
        spread_y_mm=spreads[1],
        spread_heading_rad=spreads[2],
    )


def canonical(geometry: BaseGeometry) -> tuple[Polygon, ...]:
    """Return the polygons of a geometry, written the same way whatever order they came in.

    Coordinates are rounded, corners on a straight line between their neighbours left out, rings
    begin at their smallest corner (outer ones counter-clockwise, holes clockwise) and polygons
    are sorted by theirs. Libraries of geometry leave all of this open.
    """
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
    rings = [_rings(part) for part in parts if part.area > 0.0]
    rings.sort(key=lambda own: own[0].tolist())
    return tuple(Polygon(own[0], own[1:]) for own in rings)


def _rings(polygon: Polygon) -> list[Floats]:
    outer = _ring(shapely.get_coordinates(polygon.exterior), clockwise=False)
    holes = [_ring(shapely.get_coordinates(ring), clockwise=True) for ring in polygon.interiors]
    return [outer, *sorted(holes, key=lambda ring: ring.tolist())]


def _ring(closed_mm: Floats, *, clockwise: bool) -> Floats:
    points = rounded(closed_mm[:-1])
    points = points[(points != np.roll(points, 1, axis=0)).any(axis=1)]
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    points = points[np.abs(turns) > _STRAIGHT_MM2]
    x, y = points.T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    if (area < 0.0) != clockwise:
        points = points[::-1]
    first = int(np.lexsort((points[:, 1], points[:, 0]))[0])
    return np.asarray(np.roll(points, -first, axis=0))


class StartRange(Protocol):
    """The options that say where robots start; every environment has them."""

    @property
    def start_clearance_mm(self) -> float:
        """Least distance from every possible starting position to walls."""

    @property
    def start_spread_x_mm(self) -> float:
        """Half-width of the range of positions along x."""

    @property
    def start_spread_y_mm(self) -> float:
        """Half-width of the range of positions along y."""

    @property
    def start_spread_heading_deg(self) -> float:
        """Half-width of the range of headings around straight up."""


def check_starts(
    options: StartRange, room_mm: tuple[float, float], count: int = 1, least_mm: float = 0.0
) -> None:
    """Raise BadInputError unless the ranges of the starts and their clearance have room."""
    width_mm, height_mm = room_mm
    number("start_clearance_mm", options.start_clearance_mm, 0.0, width_mm, "mm")
    number("start_spread_x_mm", options.start_spread_x_mm, 0.0, width_mm, "mm")
    number("start_spread_y_mm", options.start_spread_y_mm, 0.0, height_mm, "mm")
    number("start_spread_heading_deg", options.start_spread_heading_deg, 0.0, 180.0, "deg")
    clear_mm = max(options.start_clearance_mm, least_mm)
    wide_mm = 2.0 * (options.start_spread_x_mm + clear_mm)
    high_mm = 2.0 * (options.start_spread_y_mm + clear_mm)
    if wide_mm > width_mm / count or high_mm > height_mm:
        allowed = (
            f"less, or smaller spreads or fewer starts: {count} places of {wide_mm:g} x "
            f"{high_mm:g} mm have no room side by side in {width_mm:g} x {height_mm:g} mm"
        )
        raise BadInputError("start_clearance_mm", options.start_clearance_mm, allowed)


def lower_starts(
    options: StartRange, width_mm: float, count: int = 1, least_mm: float = 0.0
) -> tuple[Start, ...]:
    """Return starts evenly spread along the lower side, launching straight up."""
    spreads = (
        options.start_spread_x_mm,
        options.start_spread_y_mm,
        math.radians(options.start_spread_heading_deg),
    )
    y_mm = max(options.start_clearance_mm, least_mm) + options.start_spread_y_mm
    pitch_mm = width_mm / count
    return tuple(upward_start((index + 0.5) * pitch_mm, y_mm, spreads) for index in range(count))


def all_zones(starts: tuple[Start, ...]) -> BaseGeometry:
    """Return the positions that any of the starts allows."""
    return shapely.union_all([start_zone(start) for start in starts])
