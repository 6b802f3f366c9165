"""How much room a map has for bodies of some width, from a start.

A body that has room somewhere would fit there if it were led; whether growth leads it there is for
`vinefab grow`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np
import shapely
from shapely import Point
from shapely.geometry.base import BaseGeometry

from vinefab.model.map import Pose
from vinefab.physics.lumen import inflated_radius_mm

SHARES = (0.9, 0.5)
"""Shares of the free area for which the widest body is looked for."""

HALVINGS = 7
COARSE = 0.01
"""The widest bodies are known to about 1 % of the one that just fits at the start: walls are
smoothed by so much, and the range is halved so often."""

ARC_SEGMENTS_PER_QUARTER = 8
"""Rounded corners of swept areas: within 0.5 % of a radius."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRoom:
    """A start of a map and the room there.

    Parameters
    ----------
    pose
        The start.
    clearance_mm
        Distance to the nearest wall; 0 on a wall, or outside the free space.
    """

    pose: Pose
    clearance_mm: float

    @property
    def body_mm(self) -> float:
        """Lay-flat width of the widest body that fits there."""
        return math.pi * self.clearance_mm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """How far a body of one width could get from the first start.

    Parameters
    ----------
    width_mm
        Lay-flat width.
    region
        The part of the free space that it can sweep without leaving it.
    share
        Area of that part over the free area.
    """

    width_mm: float
    region: BaseGeometry
    share: float


def start_room(free: BaseGeometry, pose: Pose) -> StartRoom:
    """Return how much room a start has in the free space."""
    point = Point(pose.x_mm, pose.y_mm)
    inside = shapely.contains_xy(free, pose.x_mm, pose.y_mm)
    clearance_mm = float(shapely.distance(free.boundary, point)) if inside else 0.0
    return StartRoom(pose=pose, clearance_mm=clearance_mm)


def widest_bodies(free: BaseGeometry, starts: tuple[StartRoom, ...]) -> dict[float, float | None]:
    """Return the lay-flat width of the widest body that sweeps each share of the free area."""
    if not starts or starts[0].clearance_mm <= 0.0:
        return dict.fromkeys(SHARES)
    start = starts[0]
    home = shapely.simplify(_home(free, start), COARSE * start.clearance_mm)

    @cache
    def share_of(radius_mm: float) -> float:
        return float(_swept(home, start, radius_mm).area / free.area)

    return {share: _widest_mm(share_of, share, start.clearance_mm) for share in SHARES}


def body_room(free: BaseGeometry, starts: tuple[StartRoom, ...], width_mm: float) -> Body:
    """Return how far a body of a lay-flat width could get from the first start."""
    radius_mm = inflated_radius_mm(width_mm)
    region: BaseGeometry = Point()
    if starts and radius_mm <= starts[0].clearance_mm:
        home = _home(free, starts[0])
        region = shapely.intersection(_swept(home, starts[0], radius_mm), home)
    return Body(width_mm=width_mm, region=region, share=float(region.area / max(free.area, 1e-300)))


def _swept(home: BaseGeometry, start: StartRoom, radius_mm: float) -> BaseGeometry:
    """Return what a body can sweep of a region that holds its start.

    The middle of the body stays a radius away from all walls, in one piece with the start; the
    body fills a radius around that. The area falls as the radius grows.
    """
    arcs = ARC_SEGMENTS_PER_QUARTER
    point = Point(start.pose.x_mm, start.pose.y_mm)
    parts = shapely.get_parts(shapely.buffer(home, -radius_mm, quad_segs=arcs))
    away_mm = shapely.distance(parts, point)
    if not np.any(away_mm <= COARSE * start.clearance_mm):
        return Point()
    return cast(
        "BaseGeometry", shapely.buffer(parts[np.argmin(away_mm)], radius_mm, quad_segs=arcs)
    )


def _home(free: BaseGeometry, start: StartRoom) -> BaseGeometry:
    """Return the part of the free space that a start is in."""
    point = Point(start.pose.x_mm, start.pose.y_mm)
    return next((part for part in shapely.get_parts(free) if part.intersects(point)), Point())


def _widest_mm(
    share_of: Callable[[float], float], share: float, clearance_mm: float
) -> float | None:
    low_mm, high_mm = 0.0, clearance_mm
    if share_of(high_mm) >= share:
        return math.pi * high_mm
    for _ in range(HALVINGS):
        middle_mm = 0.5 * (low_mm + high_mm)
        if share_of(middle_mm) >= share:
            low_mm = middle_mm
        else:
            high_mm = middle_mm
    return math.pi * low_mm if low_mm > 0.0 else None
