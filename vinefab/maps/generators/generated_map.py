"""What generated maps share: start options, canonical polygons, their name and facts."""

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from shapely import MultiPoint, Polygon
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.table import Table
from vinefab.core.validation import SMALLEST, Floats, whole
from vinefab.model.map import Map, Pose, Start

COORDINATE_DECIMALS = 4
"""Generated coordinates are whole multiples of 1e-4 mm.

A file then holds exactly what was generated, and the last bit of a platform's cosine does not make
another map.
"""

COORDINATE_GRID_MM = 10.0**-COORDINATE_DECIMALS

_STRAIGHT_MM2 = 0.5 * 10.0 ** (-2 * COORDINATE_DECIMALS)
"""Twice the area of a triangle whose corners count as on one line."""


def rounded_points(points_mm: Floats) -> Floats:
    """Return points on the grid of `COORDINATE_DECIMALS`, without negative zeros."""
    return np.asarray(np.round(points_mm, COORDINATE_DECIMALS) + 0.0, dtype=np.float64)


def directions(angles_rad: Floats) -> Floats:
    """Return unit vectors at some angles, shape (..., 2)."""
    return np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=-1)


def signed_area_mm2(ring_mm: Floats) -> float:
    """Return the area in a ring, shape (n, 2), not closed; negative if it runs clockwise."""
    x, y = ring_mm.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def box(width_mm: float, height_mm: float) -> Polygon:
    """Return the rectangle from the origin to (width, height), counter-clockwise."""
    corners = [(0.0, 0.0), (width_mm, 0.0), (width_mm, height_mm), (0.0, height_mm)]
    return Polygon(rounded_points(np.array(corners)))


def start_zone(start: Start) -> BaseGeometry:
    """Return all the positions within a start's range: a rectangle, a line or a point."""
    x, y = start.pose.x_mm, start.pose.y_mm
    half_x, half_y = start.spread_x_mm, start.spread_y_mm
    corners = [
        (x + sign_x * half_x, y + sign_y * half_y) for sign_x in (-1, 1) for sign_y in (-1, 1)
    ]
    # To 1e-9 mm: the distance to a rectangle a billionth of that high overflows.
    return shapely.convex_hull(MultiPoint(np.round(corners, 9)))


def canonical(geometry: BaseGeometry) -> tuple[Polygon, ...]:
    """Return the polygons of a geometry, written the same way whatever order they came in.

    Coordinates are rounded, corners on a straight line between their neighbours left out, rings
    begin at their smallest corner (outer ones counter-clockwise, holes clockwise) and polygons
    are sorted by theirs. Libraries of geometry leave all of this open.
    """
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
    rings = []
    for part in (part for part in parts if part.area > 0.0):
        outer = _ring(shapely.get_coordinates(part.exterior), clockwise=False)
        holes = [_ring(shapely.get_coordinates(ring), clockwise=True) for ring in part.interiors]
        rings.append([outer, *sorted(holes, key=lambda ring: ring.tolist())])
    rings.sort(key=lambda own: own[0].tolist())
    return tuple(Polygon(own[0], own[1:]) for own in rings)


def _ring(closed_mm: Floats, *, clockwise: bool) -> Floats:
    points = rounded_points(closed_mm[:-1])
    points = points[(points != np.roll(points, 1, axis=0)).any(axis=1)]
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    points = points[np.abs(turns) > _STRAIGHT_MM2]
    if (signed_area_mm2(points) < 0.0) != clockwise:
        points = points[::-1]
    first = int(np.lexsort((points[:, 1], points[:, 0]))[0])
    return np.asarray(np.roll(points, -first, axis=0))


Share = Annotated[float, Ge(0), Le(1)]
Length = Annotated[float, Ge(SMALLEST), Le(1e6), Unit("mm")]
"""Of a map."""
StartSpread = Annotated[
    float, Ge(0), Le(1e6), Unit("mm"), Doc("half-width of the range that starting poses lie in")
]


class StartOptions(Table):
    """Where robots start: in the middle of the lower side, launching straight up."""

    start_clearance_mm: Annotated[
        float,
        Ge(0),
        Le(1e6),
        Unit("mm"),
        Doc("least distance from every possible starting position to walls"),
    ] = 15.0
    start_spread_x_mm: StartSpread = 10.0
    start_spread_y_mm: StartSpread = 0.0
    start_spread_heading_deg: Annotated[
        float,
        Ge(0),
        Le(180),
        Unit("deg"),
        Doc("half-width of the range of headings"),
    ] = 30.0

    @property
    def start_count(self) -> int:
        """Number of starting places, side by side."""
        return 1

    def check_starts(self, room_mm: tuple[float, float], least_mm: float = 0.0) -> None:
        """Raise BadInputError unless the starts fit, each with its clearance or ``least_mm``."""
        count, (width_mm, height_mm) = self.start_count, room_mm
        clear_mm = max(self.start_clearance_mm, least_mm)
        wide_mm = 2.0 * (self.start_spread_x_mm + clear_mm)
        high_mm = 2.0 * (self.start_spread_y_mm + clear_mm)
        if wide_mm > width_mm / count or high_mm > height_mm:
            allowed = (
                f"less, or smaller spreads or fewer starts: {counted(count, 'place')} of "
                f"{wide_mm:g} x "
                f"{high_mm:g} mm have no room side by side in {width_mm:g} x {height_mm:g} mm"
            )
            raise BadInputError("start_clearance_mm", self.start_clearance_mm, allowed)

    def lower_starts(self, width_mm: float, least_mm: float = 0.0) -> tuple[Start, ...]:
        """Return starts evenly spread along the lower side, see `check_starts`."""
        y_mm = max(self.start_clearance_mm, least_mm) + self.start_spread_y_mm
        pitch_mm = width_mm / self.start_count
        return tuple(
            Start(
                pose=Pose(x_mm=(index + 0.5) * pitch_mm, y_mm=y_mm, heading_rad=math.pi / 2),
                spread_x_mm=self.start_spread_x_mm,
                spread_y_mm=self.start_spread_y_mm,
                spread_heading_rad=math.radians(self.start_spread_heading_deg),
            )
            for index in range(self.start_count)
        )


class SeveralStartOptions(StartOptions):
    """Where robots start, from one of several places."""

    starts: Annotated[
        int, Ge(1), Le(1000), Doc("places, evenly spread along the lower side; one: in its middle")
    ] = 1

    @property
    def start_count(self) -> int:
        """Number of starting places, side by side."""
        return self.starts


def start_zones(starts: tuple[Start, ...]) -> BaseGeometry:
    """Return the positions that any of the starts allows."""
    return shapely.union_all([start_zone(start) for start in starts])


def check_seed(seed: int) -> None:
    """Raise BadInputError unless a seed is a whole number below 2^63."""
    whole("seed", seed, 0, 2**63 - 1)


def generated_map(
    environment: str,
    seed: int,
    options: StartOptions,
    *,
    bounds: Polygon,
    obstacles: Sequence[Polygon],
    starts: tuple[Start, ...],
    **counted: object,
) -> Map:
    """Return the map of an environment; its facts are the options and the counts."""
    names = type(options).model_fields
    # Starts last.
    ordered = sorted(names, key=lambda name: (name.startswith("start"), name != "starts"))
    return Map(
        name=f"{environment}_{seed}",
        bounds=bounds,
        obstacles=tuple(obstacles),
        starts=starts,
        environment=environment,
        seed=seed,
        facts={**{name: getattr(options, name) for name in ordered}, **counted},
    )
