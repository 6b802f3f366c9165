"""The part of a map in a picture, without detail too fine to be seen; loads no plotting."""

import math
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Map
from vinefab.model.start import pieces_on, start_range

Box = tuple[float, float, float, float]
"""Least x, least y, greatest x, greatest y, mm."""

SMALL = 0.4
"""A robot that takes up less than this share of the map's longer side is drawn enlarged."""

UNSEEN_DETAIL = 4e-4
"""Detail below this share of a picture's longer side is left out: a fifth of a point on paper."""

FAN = 0.1
"""Reach of the sector of headings at a start, as a share of a picture's longer side."""

_FAN_POINTS = 33


LEAST_SEEN = 0.3
"""Share of the map's longer side that is shown at least, if the robot was planned that long: walls
show the cause of a stub."""


def robot_view(world: Map, deployment: Deployment) -> Box:
    """Return the box to draw: the whole map, or the robot's surroundings on a much larger map."""
    whole = world.bounds.bounds
    if not len(deployment.points_mm):
        return whole
    low, high = deployment.points_mm.min(axis=0), deployment.points_mm.max(axis=0)
    side_mm = max(*(high - low).tolist(), 0.02 * max(world.size_mm))
    if side_mm >= SMALL * max(world.size_mm):
        return whole
    middle, half = (low + high) / 2.0, (high - low) / 2.0 + 0.25 * side_mm
    planned_mm = float((deployment.base_mm + deployment.tree.length_mm).max())
    least_mm = min(LEAST_SEEN * max(world.size_mm), planned_mm)
    half = np.maximum(half, 0.5 * least_mm)
    x_min, y_min = np.maximum(middle - half, whole[:2]).tolist()
    x_max, y_max = np.minimum(middle + half, whole[2:]).tolist()
    return x_min, y_min, x_max, y_max


def robot_box(deployment: Deployment) -> Box:
    """Return a box around a robot whose map is not known."""
    pose = deployment.pose
    points = np.vstack([deployment.points_mm, [(pose.x_mm, pose.y_mm)]])
    (x_min, y_min), (x_max, y_max) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    rim_mm = max(0.05 * (x_max - x_min), 0.05 * (y_max - y_min), 10.0)
    return x_min - rim_mm, y_min - rim_mm, x_max + rim_mm, y_max + rim_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class LostPlace:
    """An end of a body at which branches should have emerged and never did."""

    at_mm: tuple[float, float]
    front_mm: float  # front length at which the body ended there
    count: int  # of the branches, descendants included


def lost_places(deployment: Deployment) -> list[LostPlace]:
    """Return the places where branches never emerged: ends of the body, the base for a trunk."""
    tree, pose, counts = deployment.tree, deployment.pose, Counter[int]()
    for branch in np.flatnonzero(~deployment.deployed).tolist():
        end = branch
        while end >= 0 and not deployment.deployed[end]:
            end = int(tree.parent[end])
        counts[end] += 1
    fronts_mm = deployment.base_mm + deployment.grown_mm
    return [
        LostPlace(
            at_mm=(pose.x_mm, pose.y_mm) if end < 0 else tuple(deployment.chain_mm(end)[-1]),
            front_mm=0.0 if end < 0 else float(fronts_mm[end]),
            count=count,
        )
        for end, count in counts.items()
    ]


def at_least_wide(box: Box) -> Box:
    """Return a box, no side of it shorter than a tenth of the other: a straight line has none."""
    least_mm = max(0.1 * longer_mm(box), 1e-3)
    dx, dy = (max(0.0, least_mm - box[axis + 2] + box[axis]) / 2.0 for axis in (0, 1))
    return box[0] - dx, box[1] - dy, box[2] + dx, box[3] + dy


def longer_mm(box: Box) -> float:
    """Return the longer side of a box."""
    return max(box[2] - box[0], box[3] - box[1])


def rock_in(world: Map, box: Box) -> list[BaseGeometry]:
    """Return the solids in and around a box, without detail too fine to be seen there."""
    outside = shapely.box(*world.bounds.bounds) - world.bounds
    return _seen([*shapely.get_parts(outside), *world.obstacles], box)


def bounds_in(world: Map, box: Box) -> BaseGeometry:
    """Return the bounds in and around a box, likewise; they end well outside of the box."""
    return _seen([world.bounds], box)[0]


def _seen(polygons: list[Polygon], box: Box) -> list[BaseGeometry]:
    longest_mm = longer_mm(box)
    # The cut lies outside of the shown part, margin included.
    window = shapely.buffer(shapely.box(*box), 0.2 * longest_mm, join_style="mitre")
    near = [polygon for polygon in polygons if window.intersects(polygon)]
    inside = [p if window.covers(p) else shapely.intersection(p, window) for p in near]
    return list(shapely.simplify(inside, UNSEEN_DETAIL * longest_mm))


@dataclass(frozen=True, slots=True, kw_only=True)
class StartMark:
    """The drawing of the range that poses are drawn from, without the pose."""

    whole: BaseGeometry | None  # line, polygon or box of positions; None for a single one
    free: tuple[BaseGeometry, ...]  # the pieces of it that positions are drawn from
    fan: BaseGeometry | None  # the headings, as a sector around the pose; None for a single one


def start_marks(world: Map, box: Box) -> list[StartMark]:
    """Return the ranges of a map's starts, as they are drawn in a box of it."""
    reach_mm, marks = FAN * longer_mm(box), []
    for start in world.starts:
        whole, fan = start_range(start), None
        free: tuple[BaseGeometry, ...] = () if whole is None else (whole,)
        if start.area is not None:
            free = ()
            with suppress(BadInputError):  # obstacles may have been moved over it
                free = tuple(pieces_on(world, start))
        if start.spread_heading_rad:  # the sector of its headings; a circle for all of them
            pose, spread_rad = start.pose, min(start.spread_heading_rad, math.pi)
            angles = pose.heading_rad + spread_rad * np.linspace(-1.0, 1.0, _FAN_POINTS)
            x = pose.x_mm + reach_mm * np.cos(angles)
            y = pose.y_mm + reach_mm * np.sin(angles)
            base = [] if spread_rad == math.pi else [(pose.x_mm, pose.y_mm)]
            fan = Polygon([*base, *zip(x.tolist(), y.tolist(), strict=True)])
        marks.append(StartMark(whole=whole, free=free, fan=fan))
    return marks


STOP_WORDS = {
    Stop.FULL_LENGTH: "grown in full",
    Stop.HEAD_ON: "stopped head-on",
    Stop.CORNER: "stopped in a corner",
    Stop.PRESSURE: "out of pressure",
    Stop.BRANCH: "stopped at another branch",
    Stop.NOT_EVERTED: "did not come out",
    Stop.NOT_DEPLOYED: "never emerged",
}
