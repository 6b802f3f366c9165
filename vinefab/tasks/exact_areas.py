"""Exact areas that sensors see: discs, discs within free space, and lines of sight past walls."""

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats, Ints

TOUCHING_MM = 1e-6
"""A wall this close to a tip or sensor is one that it lies on; tips are right to about 1e-9 mm."""

NUDGE_MM = 1e-5
"""A sensor on a wall is moved this far off it."""

_ARC_STEP_RAD = math.pi / 32.0
_SLACK = 1e-9

_QUARTER_SEGMENTS = 16
"""Sides of the polygon that stands for a quarter of a disc in a union. At 16 a disc and its
polygon, equal in area, differ on less than 0.07 % of the disc's area, so the union is off by less
than 0.07 % of the discs' summed area; errors of either sign make it about a thousand times less."""


def disc_union(
    centres_mm: Floats, radius_mm: float, segments: int = _QUARTER_SEGMENTS
) -> BaseGeometry:
    """Return the union of equal discs as polygons.

    Every disc is a regular polygon of the same area, so that discs that do not meet give their
    exact area.
    """
    return shapely.union_all(disc_polygons(centres_mm, radius_mm, segments))


def disc_polygons(
    centres_mm: Floats, radius_mm: float, segments: int = _QUARTER_SEGMENTS
) -> NDArray[np.object_]:
    """Return equal discs as regular polygons of the same area."""
    step = math.pi / (2 * segments)
    circumradius_mm = radius_mm * math.sqrt(step / math.sin(step))
    discs = shapely.buffer(shapely.points(centres_mm), circumradius_mm, quad_segs=segments)
    return np.asarray(discs)


def free_disc_areas_mm2(centres_mm: Floats, radius_mm: float, edges_mm: Floats) -> Floats:
    """Return the exact area of each disc within a free space, shape (n,).

    The area of a disc within a polygon is the sum over the polygon's edges of the signed area
    that the disc shares with the triangle from its centre to the edge: chords where the edge is
    inside the disc, sectors where it is outside.

    Parameters
    ----------
    edges_mm
        Directed edges with the free space on their left, shape (e, 2, 2).
    """
    start = edges_mm[None, :, 0] - centres_mm[:, None]
    along = (edges_mm[:, 1] - edges_mm[:, 0])[None]
    enter, leave = _within(start, along, radius_mm)
    sectors = _turn(start, start + along)
    chords = np.zeros_like(sectors)
    near = leave > enter
    if near.any():
        base, step = start[near], np.broadcast_to(along, start.shape)[near]
        first = base + enter[near][:, None] * step
        last = base + leave[near][:, None] * step
        sectors[near] = _turn(base, first) + _turn(last, base + step)
        chords[near] = _cross(first, last)
    areas: Floats = 0.5 * (radius_mm**2 * sectors + chords).sum(axis=1)
    return areas


def _within(start: Floats, along: Floats, radius_mm: float) -> tuple[Floats, Floats]:
    """Return the share of each edge at which it enters and leaves the disc about the origin."""
    square = (along * along).sum(axis=-1)
    half = (start * along).sum(axis=-1)
    rest = (start * start).sum(axis=-1) - radius_mm**2
    root = np.sqrt(np.maximum(half * half - square * rest, 0.0))
    return np.clip((-half - root) / square, 0.0, 1.0), np.clip((-half + root) / square, 0.0, 1.0)


def _turn(first: Floats, last: Floats) -> Floats:
    """Return the angle from one vector to another, -pi to pi, 0 when either has no length."""
    turn: Floats = np.arctan2(_cross(first, last), (first * last).sum(axis=-1))
    return turn


def seen_areas(
    centres_mm: Floats, radius_mm: float, edges_mm: Floats
) -> tuple[Floats, BaseGeometry]:
    """Return the area that each sensor sees, shape (n,), and the union of these areas.

    A point is seen when it lies within the radius and no wall is between. The areas are exact;
    in the union, arcs are polygons of the same area as their sectors. A sensor on a wall sees
    what a sensor 1e-5 mm off it would, in the widest wedge of free space that it lies at.

    Parameters
    ----------
    centres_mm
        Sensors in free space or on its border, shape (n, 2).
    edges_mm
        Directed edges with the free space on their left, shape (e, 2, 2).
    """
    regions = [_region(centre, radius_mm, edges_mm) for centre in centres_mm]
    areas_mm2 = np.array([area for area, _ in regions], dtype=np.float64)
    polygons = [shapely.Polygon(ring) for _, ring in regions]
    union = shapely.union_all([p if p.is_valid else shapely.make_valid(p) for p in polygons])
    return areas_mm2, union


def _region(centre_mm: Floats, radius_mm: float, edges_mm: Floats) -> tuple[float, Floats]:
    """Return the area that one sensor sees and the ring around it, shape (k, 2).

    Between two neighbouring ends of walls, as seen from the sensor, one and the same wall is the
    nearest, or none is: what is seen there is a triangle or a sector.
    """
    # Walls that can hide something within the disc: those that face the sensor, which is on their
    # free side.
    near = edges_mm[_distances(edges_mm - centre_mm) < radius_mm]
    touched = near[_distances(near - centre_mm) < TOUCHING_MM]
    centre = centre_mm + NUDGE_MM * _off(touched - centre_mm)
    first, last = near[:, 0] - centre, near[:, 1] - centre
    faces = _cross(first, last) > 0.0
    first, along = first[faces], (last - first)[faces]
    begin, end = _within(first, along, radius_mm)
    some = end > begin
    first, along, begin, end = first[some], along[some], begin[some, None], end[some, None]
    first, last = first + begin * along, first + end * along
    along = last - first
    ends = np.concatenate([first, last])
    angles = np.unique(np.concatenate([np.arctan2(ends[:, 1], ends[:, 0]), [-math.pi, math.pi]]))
    middle = 0.5 * (angles[1:] + angles[:-1])
    wall, depth = _nearest(np.column_stack([np.cos(middle), np.sin(middle)]), first, along)
    area, ring = 0.0, list[Floats]()
    for index, (one, two) in enumerate(zip(angles[:-1].tolist(), angles[1:].tolist(), strict=True)):
        if depth[index] < radius_mm:
            hits = [_hit(angle, first[wall[index]], along[wall[index]]) for angle in (one, two)]
            area += 0.5 * float(_cross(hits[0], hits[1]))
            ring += hits
        else:
            area += 0.5 * radius_mm**2 * (two - one)
            ring.append(_arc(one, two, radius_mm))
    return area, centre + np.vstack(ring)


def _off(touched: Floats) -> Floats:
    """Return the direction off some walls at the origin: the middle of the widest wedge there."""
    runs = touched[:, 1] - touched[:, 0]
    runs /= np.hypot(runs[:, 0], runs[:, 1])[:, None]
    leaving, arriving = (
        np.hypot(touched[:, end, 0], touched[:, end, 1]) > TOUCHING_MM for end in (1, 0)
    )
    if not (leaving.any() and arriving.any()):
        return np.zeros(2)
    one, two = runs[leaving, None], -runs[None, arriving]
    wedges = np.arctan2(_cross(one, two), (one * two).sum(axis=-1)) % math.tau
    wedges = np.where(wedges > 0.0, wedges, math.tau).min(axis=1)
    widest = int(wedges.argmax())
    (x, y), half = runs[leaving][widest].tolist(), 0.5 * float(wedges[widest])
    cosine, sine = math.cos(half), math.sin(half)
    return np.array([cosine * x - sine * y, cosine * y + sine * x])


def _nearest(rays: Floats, first: Floats, along: Floats) -> tuple[Ints, Floats]:
    """Return the nearest wall on each ray and how far it is, infinite where there is none."""
    if len(first) == 0:
        return np.zeros(len(rays), dtype=np.int64), np.full(len(rays), np.inf)
    ahead = _cross(rays[:, None], along[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = _cross(first, along)[None] / ahead
        share = _cross(first[None], rays[:, None]) / ahead
    hits = (ahead > 0.0) & (share >= -_SLACK) & (share <= 1.0 + _SLACK)
    depth = np.where(hits, depth, np.inf)
    wall: Ints = depth.argmin(axis=1)
    nearest: Floats = depth.min(axis=1)
    return wall, nearest


def _hit(angle_rad: float, first: Floats, along: Floats) -> Floats:
    """Return where a ray meets a wall, at its end if that rounds to beyond it.

    A wall on whose line the sensor lies is seen edge-on, and a ray along it meets it anywhere.
    """
    ray = np.array([math.cos(angle_rad), math.sin(angle_rad)])
    ahead = float(_cross(ray, along))
    share = float(_cross(first, ray)) / ahead if ahead != 0.0 else 0.0
    return np.asarray(first + min(max(share, 0.0), 1.0) * along)


def _arc(one: float, two: float, radius_mm: float) -> Floats:
    """Return points of an arc, moved out so that the polygon has the sector's area."""
    count = max(1, math.ceil((two - one) / _ARC_STEP_RAD))
    step = (two - one) / count
    scale = math.sqrt(step / math.sin(step)) if step > 0.0 else 1.0
    angles = np.linspace(one, two, count + 1)
    return radius_mm * scale * np.column_stack([np.cos(angles), np.sin(angles)])


def _distances(edges: Floats) -> Floats:
    """Return the distance of edges from the origin, shape (e,)."""
    first, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    share = np.clip(-(first * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
    nearest = first + share[:, None] * along
    return np.asarray(np.hypot(nearest[:, 0], nearest[:, 1]))


def _cross(first: Floats, last: Floats) -> Floats:
    cross: Floats = first[..., 0] * last[..., 1] - first[..., 1] * last[..., 0]
    return cross
