"""What a sensor sees that walls can hide things from."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.model.checked import Floats, Ints
from vinefab.tasks.cells import TOUCHING_MM

NUDGE_MM = 1e-5
"""How far off such a wall it is taken to be."""

_ARC_STEP_RAD = math.pi / 32.0
_SLACK = 1e-9


def seen_areas(
    centres_mm: Floats, radius_mm: float, edges_mm: Floats
) -> tuple[Floats, BaseGeometry]:
    """Return the area that each sensor sees, shape (n,), and the union of what they see.

    A point is seen when it lies within the radius and no wall is between. The areas are exact;
    in the union, arcs are polygons of the same area as their sectors. A sensor on a wall sees
    what a sensor 1e-5 mm off it would, in the widest wedge of free space that it lies at.

    Parameters
    ----------
    centres_mm
        Sensors in free space or on its border, shape (n, 2).
    radius_mm
        How far they see.
    edges_mm
        Directed edges with the free space on their left, shape (e, 2, 2).
    """
    regions = [_region(centre, radius_mm, edges_mm) for centre in centres_mm]
    areas_mm2 = np.array([area for area, _ in regions], dtype=np.float64)
    return areas_mm2, _union([ring for _, ring in regions])


def _union(rings: Sequence[Floats]) -> BaseGeometry:
    polygons = [shapely.Polygon(ring) for ring in rings]
    return shapely.union_all([p if p.is_valid else shapely.make_valid(p) for p in polygons])


def _region(centre_mm: Floats, radius_mm: float, edges_mm: Floats) -> tuple[float, Floats]:
    """Return the area that one sensor sees and the ring around it, shape (k, 2).

    Between two neighbouring ends of walls, as seen from the sensor, one and the same wall is the
    nearest, or none is: what is seen there is a triangle or a sector.
    """
    first, last, centre = _walls(centre_mm, radius_mm, edges_mm)
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


def _walls(centre_mm: Floats, radius_mm: float, edges_mm: Floats) -> tuple[Floats, Floats, Floats]:
    """Return ends of the walls that can hide something, within the disc about the sensor.

    Only walls that face the sensor can: it is on their free side. The third is the sensor's place.
    """
    near = edges_mm[_distances(edges_mm - centre_mm) < radius_mm]
    touched = near[_distances(near - centre_mm) < TOUCHING_MM]
    centre = centre_mm + NUDGE_MM * _off(touched - centre_mm)
    first, last = near[:, 0] - centre, near[:, 1] - centre
    faces = _cross(first, last) > 0.0
    first, along = first[faces], (last - first)[faces]
    square, half = (along * along).sum(axis=1), (first * along).sum(axis=1)
    room = half * half - square * ((first * first).sum(axis=1) - radius_mm**2)
    within = room > 0.0
    first, along, square, half = first[within], along[within], square[within], half[within]
    root = np.sqrt(room[within])
    begin = np.clip((-half - root) / square, 0.0, 1.0)[:, None]
    end = np.clip((-half + root) / square, 0.0, 1.0)[:, None]
    some = (end > begin)[:, 0]
    return (first + begin * along)[some], (first + end * along)[some], centre


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
