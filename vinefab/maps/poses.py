"""Poses drawn from the starts of a map, and the roomiest start where it has none."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import UnfitInputError, located
from vinefab.core.plain_text import counted
from vinefab.core.rng import child
from vinefab.core.validation import Floats, number, whole
from vinefab.model.map import Map, Pose, Start
from vinefab.model.start import area_notes, start_pieces

_STREAM = 1201
_TRIES = 1000
_START_SPREAD_RAD = math.radians(30.0)


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
    and only once: growing twice from one pose is one sample. Of a start with an area, positions are
    drawn evenly from the part that is free and has its clearance.

    Parameters
    ----------
    repeats
        Whether it gives that pose every time: where contacts differ between growths.
    """
    whole("poses", count, 0, 10_000_000)
    whole("seed", seed, 0, 2**63 - 1)
    number("clearance_mm", clearance_mm, 0.0, 1e6, "mm")
    if not world.starts:
        remedy = "give it one: a Point with role 'start'"
        raise UnfitInputError(f"map {world.name!r}", "it has no start", remedy)
    free = world.free_space if free is None else free
    areas = {
        place: _FreeArea.of(world, place, free, clearance_mm)
        for place, start in enumerate(world.starts[:count])
        if start.area is not None
    }
    if clearance_mm > 0.0:
        free = shapely.buffer(free, -clearance_mm)
    shapely.prepare(free)
    drawn = (
        _draw(world, index, child(seed, _STREAM, index), areas.get(index % len(world.starts), free))
        for index in range(count)
    )
    return tuple(drawn if repeats else dict.fromkeys(drawn))


def spread_notes(maps: Sequence[Map], count: int, *, repeats: bool = False) -> list[str]:
    """Return notes for the user on the number of poses that starts gave; empty if all asked.

    Parameters
    ----------
    count, repeats
        As in `draw_poses`.
    """
    alike = [world for world in maps if not any(start.has_spread for start in world.starts)]
    given = max((len(world.starts) for world in alike), default=count)
    notes = area_notes(maps)
    if given >= count:
        return notes
    which = (
        "this start has"
        if len(maps) == 1
        else f"starts of {len(alike)} of {counted(len(maps), 'map')} have"
    )
    if repeats:
        return [
            *notes,
            f"{which} no spread: its {counted(count, 'deployment')} per map differ in the head-on "
            "half-angle "
            "alone, so they are samples over contacts, not over starts",
        ]
    deployments = "1 deployment" if given == 1 else f"at most {given} deployments"
    return [
        *notes,
        f"{which} no spread: {deployments} per map; give spread_heading_deg, spread_x_mm and "
        "spread_y_mm with heading_deg in the map file, or in the start of a run file's [maps], "
        "or --start, to draw more (see docs/maps.md)",
    ]


def _draw(
    world: Map, index: int, rng: np.random.Generator, free: "BaseGeometry | _FreeArea"
) -> Pose:
    place = index % len(world.starts)
    start = world.starts[place]
    if isinstance(free, _FreeArea):
        return free.pose(start, rng)
    for _ in range(_TRIES):
        x, y, turn = rng.uniform(-1.0, 1.0, 3)
        pose = Pose(
            x_mm=start.pose.x_mm + float(x) * start.spread_x_mm,
            y_mm=start.pose.y_mm + float(y) * start.spread_y_mm,
            heading_rad=start.pose.heading_rad + float(turn) * start.spread_heading_rad,
        )
        if shapely.intersects_xy(free, pose.x_mm, pose.y_mm):
            return pose
    where = f"({start.pose.x_mm:g}, {start.pose.y_mm:g}) mm"
    raise UnfitInputError(
        f"map {world.name!r}: starts[{place + 1}]",
        f"no free space is in the range around {where} ({_TRIES} draws)",
        "move the start, or lessen its spread",
    )


@dataclass(frozen=True, slots=True)
class _FreeArea:
    """The free part of a start's area as segments or triangles, shape (n, 2 or 3, 2), to draw in.

    A place is drawn in one step wherever it lies: thin areas take no longer than wide ones.
    """

    corners_mm: Floats
    sizes: Floats  # lengths or areas added up, shape (n,)

    @classmethod
    def of(cls, world: Map, place: int, free: BaseGeometry, clearance_mm: float) -> "_FreeArea":
        start = world.starts[place]
        with located(f"map {world.name!r}: starts[{place + 1}]"):
            pieces = start_pieces(start, free, clearance_mm)
        if isinstance(start.area, Polygon):
            covers = shapely.get_parts(shapely.constrained_delaunay_triangles(pieces))
            points = shapely.get_coordinates(covers).reshape(-1, 4, 2)[:, :3]
            sizes = shapely.area(covers)
        else:
            points, line = shapely.get_coordinates(pieces, return_index=True)
            points = np.stack([points[:-1], points[1:]], axis=1)[line[1:] == line[:-1]]
            sizes = np.hypot(*(points[:, 1] - points[:, 0]).T)
        return cls(points, np.cumsum(sizes))

    def pose(self, start: Start, rng: np.random.Generator) -> Pose:
        """Return a pose with its place drawn evenly in the area."""
        which, one, other = rng.random(3)
        piece = int(np.searchsorted(self.sizes, which * self.sizes[-1], side="right"))
        corners = self.corners_mm[min(piece, len(self.sizes) - 1)]
        if len(corners) == 3 and one + other > 1.0:
            one, other = 1.0 - one, 1.0 - other
        spot = corners[0] + one * (corners[1] - corners[0])
        if len(corners) == 3:
            spot = spot + other * (corners[2] - corners[0])
        turn = rng.uniform(-1.0, 1.0) * start.spread_heading_rad
        return Pose(
            x_mm=float(spot[0]),
            y_mm=float(spot[1]),
            heading_rad=start.pose.heading_rad + float(turn),
        )


def roomiest_start(free: Polygon, radius: LineString) -> Start:
    """Return the start at the first point of a radius, launching in the longest free direction.

    The radius is that of the largest circle in the free space.

    Poses drawn from it stay within a quarter of the clearance and 30 degrees.
    """
    x, y = (round(float(value), 3) for value in shapely.get_coordinates(radius)[0])
    clearance_mm = float(shapely.distance(free.boundary, shapely.points(x, y)))
    rays = 72
    angles = np.arange(rays) * 2.0 * math.pi / rays
    points, ring = shapely.get_coordinates(shapely.get_rings(free), return_index=True)
    same = ring[1:] == ring[:-1]
    away = points - np.array([x, y])
    first, last = away[:-1][same], away[1:][same]
    lengths = []  # at each angle, to the first wall
    for angle in angles.tolist():
        cosine, sine = math.cos(angle), math.sin(angle)
        side_first = cosine * first[:, 1] - sine * first[:, 0]
        side_last = cosine * last[:, 1] - sine * last[:, 0]
        crossed = (side_first > 0.0) != (side_last > 0.0)
        share = side_first[crossed] / (side_first[crossed] - side_last[crossed])
        hits = first[crossed] + share[:, None] * (last[crossed] - first[crossed])
        ahead = hits @ np.array([cosine, sine])
        lengths.append(float(ahead[ahead > 0.0].min()))
    longest = int(np.argmax(np.round(lengths, 6)))
    return Start(
        pose=Pose(x_mm=x, y_mm=y, heading_rad=float(angles[longest])),
        spread_x_mm=round(0.25 * clearance_mm, 3),
        spread_y_mm=round(0.25 * clearance_mm, 3),
        spread_heading_rad=_START_SPREAD_RAD,
    )
