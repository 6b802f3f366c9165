"""What a sensor sees that walls can hide things from: exactly, and fast along lines."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats, Ints
from vinefab.tasks.wall_cells import TOUCHING_MM, WallCells

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


LINES_PER_RADIUS = 40
"""Lines per radius of the discs of sight."""

LEAST_LINES = 160
"""Lines across a square map that is smaller than the discs."""

DIRECTIONS = 16
"""Directions between which that of the lines is chosen."""

MOST_LINES = 1_000_000
"""More would not pay: every growth looks at all of them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SightLines:
    """The walls of a free space, by cells of the sensors that they can hide something from.

    Everything is turned, so that the lines run along x.
    """

    radius_mm: float  # how far sensors see
    # cosine and sine of the angle between x and the lines on the map
    direction: tuple[float, float]
    # walls that come within the radius of each cell, with free space on their left, turned
    cells: WallCells
    line: Floats  # lower side of the lowest strip and how high each is, mm; shape (2,)
    lines: int  # how many there are, each in the middle of its strip

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "SightLines | None":
        """Return the lines on a free space, or None if it is too large for such discs.

        Parameters
        ----------
        edges_mm
            Directed edges with the free space on their left, shape (e, 2, 2).
        """
        # What walls hide is as fine as the map, however far sensors see.
        side_mm = math.sqrt(np.ptp(edges_mm.reshape(-1, 2), axis=0).prod())
        step_mm = min(radius_mm / LINES_PER_RADIUS, side_mm / LEAST_LINES)
        direction = _direction(edges_mm, step_mm)
        walls_mm = _turned(edges_mm, direction)
        low_mm, high_mm = float(walls_mm[..., 1].min()), float(walls_mm[..., 1].max())
        lines = max(1, math.ceil((high_mm - low_mm) / step_mm))
        if lines > MOST_LINES:
            return None
        # Sensors that lie outside by rounding have the walls of the nearest cell.
        reach_mm = radius_mm + 2.0 * TOUCHING_MM
        cells = WallCells.of(walls_mm.reshape(-1, 4), radius_mm, reach_mm)
        if cells is None:
            return None
        return cls(
            radius_mm=radius_mm,
            direction=direction,
            cells=cells,
            line=np.array([low_mm, step_mm]),
            lines=lines,
        )

    def covered_mm2(self, tips_mm: Floats, first: Ints) -> tuple[Floats, Floats]:
        """Return the area that sensors see together, and the sum of what each sees.

        On every line, what is seen is exact; its length stands for the strip about the line. In a
        strip, the seen length differs from that on its line by no more than the outline of what is
        seen runs along the lines in between. The result is therefore off by less than half a
        strip, at most an eightieth of the radius, times the length of the outline. That bound is
        far from reached, because errors have either sign and arise only where the outline runs
        along the lines, whose direction is the one that the walls run along the least:
        `tests/tasks/errors.py` measures it on random deployments.

        Parameters
        ----------
        tips_mm
            All sensors, in free space or on its border, set after set, shape (m, 2).
        first
            Where each set begins, with the total at the end, shape (j + 1,).
        """
        from vinefab.tasks.kernels import sight_kernel  # noqa: PLC0415  numba takes a second to import

        tips_mm = _turned(tips_mm, self.direction)
        sensors = int(np.diff(first).max(initial=0))
        number = np.concatenate([[0], np.cumsum(self.cells.numbers_at(tips_mm))])
        walls = int(np.diff(number[first]).max(initial=0))
        seen, summed = np.zeros((2, len(first) - 1))
        sight_kernel.seen_areas_by_lines(
            tips_mm,
            first,
            np.array([self.radius_mm, TOUCHING_MM, NUDGE_MM]),
            self.cells.walls_mm,
            self.cells.grid,
            self.cells.first,
            self.cells.item,
            self.line,
            np.empty((walls, 4)),
            np.empty((4, sensors + 1), dtype=np.int64),
            np.empty(self.lines, dtype=np.int64),
            np.empty((2, walls + sensors)),
            seen,
            summed,
        )
        return seen, summed


def _turned(points_mm: Floats, direction: tuple[float, float]) -> Floats:
    """Return points in a frame whose x runs in a direction, shape (..., 2)."""
    x, y = points_mm[..., 0], points_mm[..., 1]
    cosine, sine = direction
    return np.stack([x * cosine + y * sine, y * cosine - x * sine], axis=-1)


def _direction(edges_mm: Floats, step_mm: float) -> tuple[float, float]:
    """Return the direction for lines in which walls run along them the least.

    How far a wall runs between two neighbouring lines is what the result can be wrong by.
    """
    runs = edges_mm[:, 1] - edges_mm[:, 0]
    best, least = (1.0, 0.0), math.inf
    for k in range(DIRECTIONS):
        direction = math.cos(math.pi * k / DIRECTIONS), math.sin(math.pi * k / DIRECTIONS)
        along, across = np.abs(_turned(runs, direction)).T
        flat = across <= step_mm
        cost = along[flat].sum() + (along[~flat] * step_mm / across[~flat]).sum()
        if cost < least:
            best, least = direction, float(cost)
    return best
