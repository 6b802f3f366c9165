"""Poses drawn from the starts of a map, and the roomiest start where it has none."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import Floats, number, whole
from vinefab.model.map import Map, Pose, Start

_STREAM = 1201
_TRIES = 1000
_RAYS = 72
_START_SPREAD_RAD = math.radians(30.0)


def with_start(world: Map, start: Start) -> Map:
    """Return a map with one start in place of its own.

    Raises
    ------
    BadInputError
        If the start is outside the bounds or inside an obstacle, as ``maps.start`` of a run file.
    """
    spot = shapely.Point(start.pose.x_mm, start.pose.y_mm)
    solid = "outside the bounds"
    if world.bounds.covers(spot):
        if not shapely.contains(np.array(world.obstacles, dtype=np.object_), spot).any():
            return replace(world, starts=(start,))
        solid = "inside an obstacle"
    where = f"({spot.x:g}, {spot.y:g}) mm"
    allowed = f"a place in free space; it is {solid} of map {world.name!r}"
    raise BadInputError("maps.start", where, allowed)


def draw_poses(
    world: Map,
    count: int,
    seed: int,
    *,
    clearance_mm: float = 0.0,
    free: BaseGeometry | None = None,
    repeats: bool = False,
) -> tuple[Pose, ...]:
    """Draw poses, uniformly within the ranges of the map's starts, in free space.

    Pose ``i`` belongs to start ``i`` modulo the number of starts and depends only on the seed and
    ``i``, so a longer draw begins with the shorter one. A start without spread gives its own pose,
    and only once: growing twice from one pose is one sample.

    Parameters
    ----------
    repeats
        Whether it gives that pose every time: where contacts differ between growths.
    """
    whole("poses", count, 0, 10_000_000)
    whole("seed", seed, 0, 2**63 - 1)
    number("clearance_mm", clearance_mm, 0.0, 1e6, "mm")
    if not world.starts:
        needed = "at least one start: a Point with role 'start'"
        raise BadInputError(f"map {world.name!r}: starts", "empty", needed)
    free = world.free_space if free is None else free
    if clearance_mm > 0.0:
        free = shapely.buffer(free, -clearance_mm)
    shapely.prepare(free)
    drawn = (_draw(world, index, child(seed, _STREAM, index), free) for index in range(count))
    return tuple(drawn if repeats else dict.fromkeys(drawn))


def spread_notes(maps: Sequence[Map], count: int, *, repeats: bool = False) -> list[str]:
    """Return what a user should know of how many poses starts gave; nothing if all that were asked.

    Parameters
    ----------
    count, repeats
        As in `draw_poses`.
    """
    alike = [world for world in maps if not any(start.has_spread for start in world.starts)]
    given = max((len(world.starts) for world in alike), default=count)
    if given >= count:
        return []
    which = (
        "this start has" if len(maps) == 1 else f"starts of {len(alike)} of {len(maps)} maps have"
    )
    if repeats:
        return [
            f"{which} no spread: its {count} deployments per map differ in the head-on half-angle "
            "alone, so they are samples over contacts, not over starts"
        ]
    deployments = "1 deployment" if given == 1 else f"at most {given} deployments"
    return [
        f"{which} no spread: {deployments} per map; give spread_heading_deg, spread_x_mm and "
        "spread_y_mm beside heading_deg in the map file, or in the start of a run file's [maps], "
        "to draw more (see docs/maps.md)"
    ]


def _draw(world: Map, index: int, rng: np.random.Generator, free: BaseGeometry) -> Pose:
    place = index % len(world.starts)
    start = world.starts[place]
    for _ in range(_TRIES):
        pose = _pose_within(start, rng)
        if shapely.intersects_xy(free, pose.x_mm, pose.y_mm):
            return pose
    raise BadInputError(
        f"map {world.name!r}: starts[{place + 1}]",
        f"({start.pose.x_mm:g}, {start.pose.y_mm:g}) mm",
        f"a start with free space in its range (none found in {_TRIES} draws)",
    )


def _pose_within(start: Start, rng: np.random.Generator) -> Pose:
    x, y, turn = rng.uniform(-1.0, 1.0, 3)
    return Pose(
        x_mm=start.pose.x_mm + float(x) * start.spread_x_mm,
        y_mm=start.pose.y_mm + float(y) * start.spread_y_mm,
        heading_rad=start.pose.heading_rad + float(turn) * start.spread_heading_rad,
    )


def roomiest_start(free: Polygon, radius: LineString) -> Start:
    """Return the start at the first point of a radius, launching in the longest free direction.

    The radius is that of the largest circle in the free space.

    Poses drawn from it stay within a quarter of the clearance and 30 degrees.
    """
    x, y = (round(float(value), 3) for value in shapely.get_coordinates(radius)[0])
    clearance_mm = float(shapely.distance(free.boundary, shapely.points(x, y)))
    angles = np.arange(_RAYS) * 2.0 * math.pi / _RAYS
    points, ring = shapely.get_coordinates(shapely.get_rings(free), return_index=True)
    same = ring[1:] == ring[:-1]
    away = points - np.array([x, y])
    lengths = [_free_length(away[:-1][same], away[1:][same], float(angle)) for angle in angles]
    longest = int(np.argmax(np.round(lengths, 6)))
    return Start(
        pose=Pose(x_mm=x, y_mm=y, heading_rad=float(angles[longest])),
        spread_x_mm=round(0.25 * clearance_mm, 3),
        spread_y_mm=round(0.25 * clearance_mm, 3),
        spread_heading_rad=_START_SPREAD_RAD,
    )


def _free_length(first: Floats, last: Floats, angle: float) -> float:
    """Return the distance from the origin at an angle to the first wall."""
    cosine, sine = math.cos(angle), math.sin(angle)
    side_first = cosine * first[:, 1] - sine * first[:, 0]
    side_last = cosine * last[:, 1] - sine * last[:, 0]
    crossed = (side_first > 0.0) != (side_last > 0.0)
    share = side_first[crossed] / (side_first[crossed] - side_last[crossed])
    hits = first[crossed] + share[:, None] * (last[crossed] - first[crossed])
    ahead = hits @ np.array([cosine, sine])
    return float(ahead[ahead > 0.0].min())
