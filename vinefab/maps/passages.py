"""The narrow passages of a free space, exactly.

A passage is a local minimum of the width between two walls: the circle with the passage as its
diameter has no wall inside. (These circles' centres are the
saddles of the distance to the walls, see Lieutier, "Any open bounded subset of R^n has the same
homotopy type as its medial axis", 2004.) So both ends lie at the nearest points of two walls, and
at least one of them at a corner, unless the walls are parallel.

A notch in a wall has such a place too, but no body could go anywhere behind it. What tells it is
the free area that closing the passage would cut off: a passage between two walls cuts off
nothing, a door cuts off a room, a notch next to nothing.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints

_EXACT_SHARE = 1e-9
"""Lengths that differ by less than this share of the free space's size are equal."""

_PARALLEL_RAD = 1e-6
"""Walls whose directions differ by less are parallel."""


_LEAST_SHARE = 0.1
"""A dead end of at least this share of its free part is not a notch, however wide the body is."""


_SOME_PAIRS = 5e5
"""For fewer pairs of walls in a round it does not matter how they are found."""

_MANY_PAIRS = 2e6
"""For more pairs of walls in a round, walls are simplified: widths are good to 0.1 % from there."""

_MOST_PAIRS = 1e8
"""More pairs of simplified walls are refused."""

_COARSE_SHARE, _COARSE_NOTCH = 0.0001, 0.02
"""Of the least width looked for: how far simplified walls are off, and mouths of notches that are
filled, into which circles of that width reach by 0.0004 widths."""

_SAMPLES = 15
_POLYGON = shapely.GeometryType.POLYGON


@dataclass(frozen=True, slots=True, kw_only=True)
class Passage:
    """A narrow place between two walls."""

    width_mm: float  # distance between the walls
    ends_mm: tuple[tuple[float, float], tuple[float, float]]  # where it touches them
    # diameter of the circle with the area of the dead end that it leads to, islands counted in;
    # infinite where it leads to none, or to one with a start or a tenth of the free part in it
    dead_end_mm: float = math.inf

    @property
    def middle_mm(self) -> tuple[float, float]:
        """The point halfway between the walls."""
        (x_1, y_1), (x_2, y_2) = self.ends_mm
        return 0.5 * (x_1 + x_2), 0.5 * (y_1 + y_2)


def narrow_passages(
    free: BaseGeometry,
    most: int = 5,
    bodies_mm: Collection[float] = (),
    starts_mm: Collection[tuple[float, float]] = (),
) -> tuple[Passage, ...]:
    """Return the narrowest passages, the narrowest first.

    Parameters
    ----------
    most
        How many; of bodies, how many that the widest could use.
    bodies_mm
        Diameters of bodies: what is a notch for all of them is left out, that is a dead end with
        less free area than the narrowest body's cross-section.
    starts_mm
        Places that bodies come from, however small the dead end that they are in.

    Raises
    ------
    BadInputError
        If the walls are too many and too jagged to be searched in about a minute.

    Examples
    --------
    >>> room = shapely.box(0, 0, 100, 50) - shapely.box(40, 0, 60, 20) - shapely.box(40, 27, 60, 50)
    >>> [passage.width_mm for passage in narrow_passages(room, 1)]
    [7.0]
    """
    walls = _Walls(free)
    found: tuple[Passage, ...] = ()
    narrow_mm, wide_mm = min(bodies_mm, default=0.0), max(bodies_mm, default=0.0)
    places = np.array(list(starts_mm), dtype=np.float64).reshape(-1, 2)
    shares, rooms = [np.zeros((0, 2, 2))], [np.zeros(0)]
    least_mm, most_mm, count = 0.0, walls.typical_mm, 0
    seen = walls
    while count < most and least_mm < walls.widest_mm:
        if seen.pair_count(most_mm) > _MANY_PAIRS:
            # Without what hardly changes passages wider than the least.
            filled = without_notches(free, _COARSE_NOTCH * least_mm)
            seen = _Walls(shapely.simplify(filled, _COARSE_SHARE * least_mm))
            if seen.pair_count(most_mm) > _MOST_PAIRS:
                raise BadInputError(
                    "map: number of corners",
                    len(walls.start),
                    "fewer or smoother ones: vinefab map import --simplify-mm leaves corners out",
                )
        found_ends = seen.gaps(least_mm, most_mm)
        for ends in found_ends if seen is walls else map(walls.nearest, found_ends):
            room_mm = walls.dead_ends_mm(ends, places)
            shares.append(ends[room_mm >= narrow_mm])
            rooms.append(room_mm[room_mm >= narrow_mm])
        gaps = _Gaps(np.concatenate(shares), np.concatenate(rooms), _EXACT_SHARE * walls.size_mm)
        found = _apart(walls, gaps, most, wide_mm)
        count = sum(passage.dead_end_mm >= wide_mm for passage in found)
        least_mm, most_mm = most_mm, 2.0 * most_mm
    return found


class _Gaps:
    """Candidates: ends (n, 2, 2), widths (n,), dead ends (n,), the narrowest first."""

    def __init__(self, ends: Floats, dead_end_mm: Floats, same_mm: float) -> None:
        width = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        order = np.argsort(np.round(width / same_mm), kind="stable")
        self.ends, self.width = ends[order], width[order]
        self.dead_end_mm = dead_end_mm[order]
        self.middle = self.ends.mean(axis=1)


class _Walls:
    """Walls of a free space, the free side on the left, with spatial indices."""

    def __init__(self, free: BaseGeometry) -> None:
        parts = shapely.get_parts(free)
        self.parts = parts[(shapely.get_type_id(parts) == _POLYGON) & ~shapely.is_empty(parts)]
        shapely.prepare(self.parts)
        rings, part = shapely.get_rings(shapely.orient_polygons(self.parts), return_index=True)
        points, ring = shapely.get_coordinates(rings, return_index=True)
        real = (ring[1:] == ring[:-1]) & (points[1:] != points[:-1]).any(axis=1)
        self.start, self.end = points[:-1][real], points[1:][real]
        self.ring = ring[:-1][real]
        before = np.arange(len(self.ring)) - 1
        begins = np.flatnonzero(np.diff(self.ring, prepend=-1))
        before[begins] = np.append(begins[1:], len(self.ring))[: len(begins)] - 1
        self.before = before
        # Of loops along walls: twice the areas of the triangles that walls make with a point.
        self.middle = points.mean(axis=0) if len(points) else np.zeros(2)
        self.swept = np.append(0.0, np.cumsum(_doubled(self.start, self.end, self.middle)))
        self.enclosed = np.bincount(self.ring, np.diff(self.swept), len(rings)) / 2.0
        # of the outer ring around each ring: the first of its part
        self.outside = self.enclosed[np.searchsorted(part, part)]
        self.lines = np.asarray(shapely.linestrings(np.stack([self.start, self.end], axis=1)))
        self.tree, self.inside = STRtree(self.lines), STRtree(self.parts)
        self.size_mm = float(np.hypot(*np.ptp(points, axis=0))) if len(points) else 0.0
        # No passage is wider than the largest inscribed circle, known to within a tolerance.
        near_mm = 0.01 * self.size_mm
        radii = (shapely.maximum_inscribed_circle(part, near_mm).length for part in self.parts)
        self.widest_mm = max((2.0 * (radius + near_mm) for radius in radii), default=0.0)
        # The search begins here: a circle of this diameter meets about one wall, also where
        # walls of short pieces are far apart.
        spread_mm = 0.5 * self.size_mm / np.sqrt(len(self.start) + 1.0)
        self.typical_mm = spread_mm
        # The search begins with circles over no more median pieces of wall: few pairs to look at.
        few_pieces = 2.0
        if len(self.lines):
            typical_mm = few_pieces * float(np.median(shapely.length(self.lines)))
            self.typical_mm = min(spread_mm, typical_mm)

    def gaps(self, least_mm: float, most_mm: float) -> list[Floats]:
        """Return all passages within a range of widths, each shape (n, 2, 2), some twice.

        Where walls run next to each other, the middle of that stretch comes first.
        """
        least_mm = max(least_mm, _EXACT_SHARE * self.size_mm)
        return [*self._parallel_gaps(least_mm, most_mm), *self._corner_gaps(least_mm, most_mm)]

    def pair_count(self, reach_mm: float) -> float:
        """Return an estimate of how many pairs of walls lie within reach of each other."""
        return self._neighbour_count(reach_mm) * len(self.lines)

    def nearest(self, ends: Floats) -> Floats:
        """Return the points of walls nearest to the ends of gaps."""
        points = ends.reshape(-1, 2)
        return self._foot(points, self._wall_at(points)).reshape(ends.shape)

    def are_empty(self, ends: Floats) -> NDArray[np.bool_]:
        """Return for which ends the circle between them is free and has no wall inside."""
        middle, half = ends.mean(axis=1), 0.5 * np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        empty = self.clearance(middle) >= half - _EXACT_SHARE * self.size_mm
        empty[empty] = self.is_free(middle[empty])
        return np.asarray(empty)

    def dead_ends_mm(self, ends: Floats, starts: Floats) -> Floats:
        """Return the diameters of circles with the areas that gaps would cut off, shape (n,).

        Infinite where it cuts off nothing, a start, or a large part of the free space. A gap cuts
        off what the loop along one ring encloses, from one end to the other and straight back.
        """
        wall = np.stack([self._wall_at(ends[:, end]) for end in (0, 1)], axis=1)
        order = np.argsort(wall, axis=1)
        first, last = np.take_along_axis(wall, order, axis=1).T
        begin, end = np.moveaxis(np.take_along_axis(ends, order[..., None], axis=1), 1, 0)
        doubled = self.swept[last] - self.swept[first + 1] + _doubled(end, begin, self.middle)
        doubled += _doubled(begin, self.end[first], self.middle)
        doubled += _doubled(self.start[last], end, self.middle)
        ring = self.ring[first]
        loops = np.stack([0.5 * doubled, self.enclosed[ring] - 0.5 * doubled])
        # Of the loops along a hole, one goes around the hole: the other one's outside is meant.
        sides = np.where(loops < 0.0, self.outside[ring] - loops.max(axis=0), loops)
        room = np.where(ring == self.ring[last], sides.min(axis=0), np.inf)
        room[room >= _LEAST_SHARE * self.outside[ring]] = np.inf
        for number in np.flatnonzero(np.isfinite(room)) if len(starts) else ():
            side = int(sides[:, number].argmin())
            around = loops[side, number] < 0.0
            two = begin[number], end[number]
            loop = self._loop(two, (first[number], last[number]), 1 - side if around else side)
            if (shapely.contains_xy(loop, starts) != around).any():
                room[number] = np.inf
        return np.asarray(np.sqrt(4.0 / math.pi * np.maximum(room, 0.0)))

    def _loop(self, ends: tuple[Floats, Floats], walls: tuple[int, int], side: int) -> Polygon:
        """Return the area in one of the loops along a ring: 0 from the first wall to the last."""
        first, last = walls
        begin, end = ends
        if side == 0:
            return Polygon([begin, *self.end[first:last], end])
        ring = self.ring[first]
        low, high = np.searchsorted(self.ring, [ring, ring + 1])
        return Polygon([end, *self.end[last:high], *self.end[low:first], begin])

    def _wall_at(self, points: Floats) -> Ints:
        """Return the wall that each point lies on."""
        found = self.tree.query_nearest(shapely.points(points), all_matches=False)
        return np.asarray(found[1][np.argsort(found[0], kind="stable")], dtype=np.int64)

    def clearance(self, points: Floats) -> Floats:
        """Return the distance of points to the nearest wall, shape (n,)."""
        if not len(points):
            return np.zeros(0)
        index, distance = self.tree.query_nearest(
            shapely.points(points), return_distance=True, all_matches=False
        )
        return np.asarray(distance[np.argsort(index[0], kind="stable")])

    def is_free(self, points: Floats) -> NDArray[np.bool_]:
        """Return the mask of the points in the free space, shape (n,)."""
        free = np.zeros(len(points), dtype=np.bool_)
        point, part = self.inside.query(shapely.points(points))
        free[point[shapely.contains_xy(self.parts[part], points[point])]] = True
        return free

    def _corner_gaps(self, least_mm: float, most_mm: float) -> Iterator[Floats]:
        """Yield passages that have at least one end at a corner."""
        corners = self._corners(least_mm)
        for index, wall in self._near(shapely.points(self.start[corners]), most_mm):
            corner = corners[index]
            point, foot = self.start[corner], self._foot(self.start[corner], wall)
            across = foot - point
            width = np.hypot(*across.T)
            keep = (width > least_mm) & (width <= most_mm)
            # Walls that leave the corner towards the other end lie inside of the circle.
            for neighbour in (self.end[corner], self.start[self.before[corner]]):
                leaving = np.sum((neighbour - point) * across, axis=1)
                keep &= leaving <= _EXACT_SHARE * self.size_mm**2
            ends = np.stack([point[keep], foot[keep]], axis=1)
            yield ends[self.are_empty(ends)]

    def _corners(self, least_mm: float) -> Ints:
        """Return the corners that a circle of some diameter can touch without meeting a wall."""
        into, out = _unit(self.end - self.start)[self.before], _unit(self.end - self.start)
        turn = np.arctan2(
            into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], np.sum(into * out, axis=1)
        )
        corners = np.flatnonzero(turn < 0.0)
        towards = (into + out)[corners] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        centre = self.start[corners] + 0.5 * least_mm * _unit(towards)
        # The circle may lie to either side of the middle, by up to half of the corner's turn.
        sure = 1.0 + 0.5 * turn[corners] - 1e-6
        return np.asarray(corners[self.clearance(centre) >= 0.5 * least_mm * sure])

    def _parallel_gaps(self, least_mm: float, most_mm: float) -> Iterator[Floats]:
        """Yield passages halfway along parallel walls that are longer than they are apart."""
        along = self.end - self.start
        length, unit = np.hypot(*along.T), _unit(along)
        long = np.flatnonzero(length >= least_mm)
        for one, other in self._parallels(long, most_mm):
            # Each pair once; walls with free space between them run in opposite directions.
            cross = unit[one, 0] * unit[other, 1] - unit[one, 1] * unit[other, 0]
            facing = np.sum(unit[one] * unit[other], axis=1) < 0.0
            pair = (one < other) & facing & (np.abs(cross) < _PARALLEL_RAD)
            ends, overlap = self._halfway(one[pair], other[pair], unit)
            width = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
            keep = (overlap >= width) & (width > least_mm) & (width <= most_mm)
            yield ends[keep][self.are_empty(ends[keep])]

    def _parallels(self, walls: Ints, reach_mm: float) -> Iterator[tuple[Ints, Ints]]:
        """Yield pairs of walls that hold all parallel ones within reach: few, or all that are near.

        Long walls that stand close have many others near them, but few in the same direction.
        """
        along = self.end[walls] - self.start[walls]
        angle = np.arctan2(along[:, 1], along[:, 0]) % np.pi
        order = np.argsort(angle, kind="stable")
        # Those just under half a turn are parallel to those just above none.
        angle = np.concatenate([angle[order], angle[order] + np.pi])
        last = np.searchsorted(angle, angle[: len(walls)] + 2.0 * _PARALLEL_RAD)
        count = last - np.arange(len(walls)) - 1
        if max(_SOME_PAIRS, count.sum()) >= self.pair_count(reach_mm):
            for index, other in self._near(self.lines[walls], reach_mm):
                yield walls[index], other
            return
        one = np.repeat(np.arange(len(walls)), count)
        step = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count) + 1
        pair = walls[order[np.stack([one, (one + step) % len(walls)])]]
        yield pair.min(axis=0), pair.max(axis=0)

    def _halfway(self, one: Ints, other: Ints, unit: Floats) -> tuple[Floats, Floats]:
        """Return the ends halfway along the overlap of two walls, and the length of the overlap."""
        origin, towards = self.start[one], unit[one]
        first = np.sum((self.end[other] - origin) * towards, axis=1)
        last = np.sum((self.start[other] - origin) * towards, axis=1)
        length = np.hypot(*(self.end[one] - origin).T)
        low, high = np.maximum(first, 0.0), np.minimum(last, length)
        middle = origin + (0.5 * (low + high))[:, None] * towards
        return np.stack([middle, self._foot(middle, other)], axis=1), high - low

    def _near(self, shapes: NDArray[np.object_], reach_mm: float) -> Iterator[tuple[Ints, Ints]]:
        """Yield pairs of a shape and a wall within reach, in batches that bound the memory."""
        pairs_at_once = 2_000_000
        step = max(1, int(pairs_at_once / max(1.0, self._neighbour_count(reach_mm))))
        for begin in range(0, len(shapes), step):
            pair = self.tree.query(
                shapes[begin : begin + step], predicate="dwithin", distance=reach_mm
            )
            yield (pair[0] + begin).astype(np.int64), pair[1].astype(np.int64)

    def _neighbour_count(self, reach_mm: float) -> float:
        """Return an estimate of the number of walls within reach of a wall."""
        some = self.lines[:: max(1, len(self.lines) // 50)]
        near = self.tree.query(some, predicate="dwithin", distance=reach_mm)
        return float(near.shape[1]) / len(some)

    def _foot(self, points: Floats, wall: Ints) -> Floats:
        """Return the nearest point of a wall to each point, shape (n, 2)."""
        start, along = self.start[wall], self.end[wall] - self.start[wall]
        share = np.sum((points - start) * along, axis=1) / np.sum(along * along, axis=1)
        return np.asarray(start + np.clip(share, 0.0, 1.0)[:, None] * along)


def _doubled(start: Floats, end: Floats, middle: Floats) -> Floats:
    """Return twice the signed areas of triangles with a common corner."""
    one, two = (start - middle).T, (end - middle).T
    return np.asarray(one[0] * two[1] - one[1] * two[0])


def _unit(vectors: Floats) -> Floats:
    """Return vectors of length 1; zero vectors stay zero."""
    length = np.hypot(*vectors.T)[:, None]
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0))


def _apart(walls: _Walls, gaps: _Gaps, most: int, wide_mm: float) -> tuple[Passage, ...]:
    """Return the narrowest gaps that do not belong to the same passage.

    No gap belongs to one that fewer bodies could use: a notch in the wall of a door hides no door.
    """
    kept: list[int] = []
    count, use = 0, np.minimum(gaps.dead_end_mm, wide_mm)  # the widest body that could use each
    for number in range(len(gaps.width)):
        if count == most:
            break
        others = [other for other in kept if use[other] >= use[number]]
        if not others or not _belongs(walls, gaps, number, others):
            kept.append(number)
            count += use[number] >= wide_mm
    found = []
    for number in kept:
        (x_1, y_1), (x_2, y_2) = gaps.ends[number].tolist()
        found.append(
            Passage(
                width_mm=float(np.hypot(x_2 - x_1, y_2 - y_1)),
                ends_mm=((x_1, y_1), (x_2, y_2)),
                dead_end_mm=float(gaps.dead_end_mm[number]),
            )
        )
    return tuple(found)


def _belongs(walls: _Walls, gaps: _Gaps, number: int, kept: list[int]) -> bool:
    """Return whether a narrower gap is near, or the free space between them hardly widens.

    It does not widen if the straight line between the gaps is free and the lines that join their
    ends on either side run along walls.
    """
    width, middle = gaps.width[number], gaps.middle[number]
    if (np.hypot(*(gaps.middle[kept] - middle).T) <= 0.5 * width).any():
        return True
    ends, others = gaps.ends[number], gaps.ends[kept]
    straight = np.hypot(*(others - ends).T).sum(axis=0)
    crossed = np.hypot(*(others[:, ::-1] - ends).T).sum(axis=0)
    others = np.where((crossed < straight)[:, None, None], others[:, ::-1], others)
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, None, None]
    way = middle + share * (others.mean(axis=1) - middle)
    is_open = walls.is_free(way.reshape(-1, 2)).reshape(_SAMPLES, -1).all(axis=0)
    sides = (ends + share[..., None] * (others - ends)).reshape(-1, 2)
    bulge = np.where(walls.is_free(sides), walls.clearance(sides), 0.0)
    # Two narrow places are one passage unless the free space between them widens by this factor.
    widening = 1.3
    keeps_narrow = bulge.reshape(_SAMPLES, -1, 2).max(axis=(0, 2)) <= 0.5 * (widening - 1.0) * width
    return bool((is_open & keeps_narrow).any())


class Rings(NamedTuple):
    """Corners of all rings, concatenated: their ring, and their neighbours in it."""

    corner: Floats
    ring: Ints
    before: Ints
    after: Ints


def rings_of(free: BaseGeometry) -> Rings:
    """Return the corners of polygons, what is inside on the left."""
    polygons = shapely.get_parts(shapely.orient_polygons(free))
    rings = shapely.get_rings(polygons)
    corner, owner = shapely.get_coordinates(rings, return_index=True)
    # Every ring repeats its first corner at its end.
    closing = np.append(owner[1:] != owner[:-1], True)[: len(owner)]
    # Adding zero turns -0.0 into 0.0, so that equal places have equal bytes.
    return linked(corner[~closing] + 0.0, owner[~closing])


def linked(corner: Floats, ring: Ints) -> Rings:
    """Return corners with their neighbours; ``ring`` rises."""
    begins = np.append(True, ring[1:] != ring[:-1])[: len(ring)]
    first, last = np.flatnonzero(begins), np.flatnonzero(np.roll(begins, -1))
    index = np.arange(len(ring))
    before, after = index - 1, index + 1
    before[first], after[last] = last, first
    return Rings(corner, ring, before, after)


def without_notches(
    free: BaseGeometry, mouth_mm: float, at_least: int = 1, rings: Rings | None = None
) -> BaseGeometry:
    """Return a free space less its sharp notches whose mouths are no wider than some length.

    Side by side, narrow notches cost time that grows with the square of their number, because each
    thickened wall meets all others that are near it. Fewer than ``at_least`` stay as they are.
    ``rings`` are those of the free space, where they are known.
    """
    rings = walls = rings or rings_of(free)
    corners: shapely.STRtree | None = None
    while len(notch := _notches(walls, mouth_mm)) >= max(at_least, 1):
        at_least = 1
        corners = corners or shapely.STRtree(np.asarray(shapely.points(rings.corner)))
        around = np.stack([walls.before[notch], notch, walls.after[notch]], axis=1)
        filled = shapely.polygons(walls.corner[around])
        # Its own three corners are in it; what holds another one stays open.
        count = np.bincount(corners.query(filled, "intersects")[0], minlength=len(notch))
        if not (count <= 3).any():
            break
        kept = np.delete(np.arange(len(walls.ring)), notch[count <= 3])
        walls = linked(walls.corner[kept], walls.ring[kept])
    return free if walls is rings else _as_polygons(walls, free)


def _notches(rings: Rings, mouth_mm: float) -> Ints:
    """Return corners of less than a right angle of free space; no two are neighbours."""
    back, on = rings.corner[rings.before] - rings.corner, rings.corner[rings.after] - rings.corner
    sharp = (np.sum(back * on, axis=1) > 0.0) & (np.hypot(*(back - on).T) <= mouth_mm)
    sharp &= on[:, 0] * back[:, 1] - on[:, 1] * back[:, 0] > 0.0
    sharp &= ~sharp[rings.before]
    # A ring of five could be left with two.
    return np.flatnonzero(sharp & (np.bincount(rings.ring)[rings.ring] > 5))


def _as_polygons(rings: Rings, free: BaseGeometry) -> BaseGeometry:
    """Return rings as the polygons that they had in a free space."""
    _, part = shapely.get_rings(shapely.get_parts(free), return_index=True)
    lines = np.asarray(shapely.linearrings(rings.corner, indices=rings.ring))
    first = np.searchsorted(part, np.unique(part))
    polygons = [shapely.polygons(shell, holes) for shell, *holes in np.split(lines, first[1:])]
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
