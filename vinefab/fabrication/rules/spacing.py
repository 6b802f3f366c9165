"""A flat robot as capsules, and which of them come near each other."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.model.design import Build, Pouch
from vinefab.outline.body_outline import FlatLayout
from vinefab.outline.ends import Leaf, corner_radii_mm, level_fillets_mm
from vinefab.outline.joint import Point


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Capsules:
    """Capsules of a flat robot, m of them."""

    start_mm: Floats  # starts of their segments, shape (m, 2); the trunk's includes the tail
    end_mm: Floats  # ends of their segments, shape (m, 2)
    half_mm: Floats  # half widths at the start, shape (m,)
    end_half_mm: Floats  # half widths at the end, shape (m,)
    branch: Ints  # index of the branch that each belongs to, shape (m,)
    pouch: NDArray[np.bool_]  # whether each belongs to a pouch, shape (m,)
    parent: Ints  # parent of each branch (not of each capsule), shape (n,)

    def __len__(self) -> int:
        return len(self.branch)

    @property
    def most_half_mm(self) -> Floats:
        """The larger half width of each, shape (m,)."""
        return np.maximum(self.half_mm, self.end_half_mm)

    def hulls(self, rows: Ints) -> "Hulls":
        """Return some of the capsules as hulls of two discs."""
        start, half = self.start_mm[rows], self.half_mm[rows]
        run, growth = self.end_mm[rows] - start, self.end_half_mm[rows] - half
        return Hulls(start_mm=start, run_mm=run, half_mm=half, growth_mm=growth)


def capsules_of(layout: FlatLayout, build: Build) -> Capsules:
    """Return the capsules of a flat layout with its pouches.

    A round pouch is a disc around the leaf's tip. A rectangular one, centred on the tip, is the
    capsules around its four sides with the corners' radius as half width, and one along its
    middle: exact for everything outside it.
    """
    start = layout.start_mm.copy()
    start[0, 0] -= layout.tail_mm
    rows = np.arange(len(layout.tree), dtype=np.int64)
    end_half = layout.end_width_mm / 2.0
    starts, ends = [start], [layout.end_mm]
    halves, end_halves, branches = [layout.width_mm / 2.0], [end_half], [rows]
    for low_mm, high_mm, half_mm in tail_capsules(build):
        starts.append(np.array([low_mm]))
        ends.append(np.array([high_mm]))
        halves.append(np.array([half_mm]))
        end_halves.append(halves[-1])
        branches.append(rows[:1])
    tails = sum(map(len, branches))
    kinds: dict[tuple[Pouch, float, int], list[int]] = {}
    for row, pouch in enumerate(layout.pouches):
        if pouch is not None:
            kind = pouch, float(end_half[row]), int(layout.tree.level[row])
            kinds.setdefault(kind, []).append(row)
    for (pouch, half_mm, level), own in kinds.items():
        leaf = Leaf(half_mm=half_mm, lean_rad=0.0, fillet_mm=level_fillets_mm(build)[level - 1])
        for low_mm, high_mm, own_mm in pouch_capsules(pouch, leaf):
            starts.append(_at_tips(layout, np.array(own), low_mm))
            ends.append(_at_tips(layout, np.array(own), high_mm))
            halves.append(np.full(len(own), own_mm))
            end_halves.append(halves[-1])
            branches.append(np.array(own))
    branch = np.concatenate(branches)
    return Capsules(
        start_mm=np.concatenate(starts),
        end_mm=np.concatenate(ends),
        half_mm=np.concatenate(halves),
        end_half_mm=np.concatenate(end_halves),
        branch=branch,
        pouch=np.arange(len(branch)) >= tails,
        parent=layout.tree.parent,
    )


def tail_capsules(build: Build) -> list[tuple[Point, Point, float]]:
    """Return ends and half widths of the tail and collar outside the trunk's own capsule.

    They begin so far from the mouth that their round ends do not reach beyond it. A collar's
    transition counts as if it were as wide as the mouth.
    """
    half, wide = build.widths_mm[0] / 2.0, build.mouth_width_mm / 2.0
    found = []
    if build.taper and build.taper[0] < 1.0:
        found.append(((min(0.0, half - build.tail_mm), 0.0), (0.0, 0.0), half))
    if build.collar is not None and wide > half:
        end_mm = min(0.0, build.collar.reach_mm - build.tail_mm)
        found.append(((min(end_mm, wide - build.tail_mm), 0.0), (end_mm, 0.0), wide))
    return found


def pouch_capsules(pouch: Pouch | None, leaf: Leaf) -> list[tuple[Point, Point, float]]:
    """Return ends and half widths of a pouch's capsules in the frame of the tip."""
    if pouch is None:
        return []
    if pouch.shape == "round":
        return [((0.0, 0.0), (0.0, 0.0), pouch.radius_mm or 0.0)]
    _, corner_mm = corner_radii_mm(pouch, leaf)
    corner_mm = max(0.0, corner_mm)
    x, y = (pouch.length_mm or 0.0) / 2.0 - corner_mm, (pouch.width_mm or 0.0) / 2.0 - corner_mm
    corners = [(x, y), (-x, y), (-x, -y), (x, -y)]
    sides = [(a, b, corner_mm) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    # A disc that touches the long sides, slid along the middle between the short ones.
    along_mm, across_mm = max(0.0, x - y), max(0.0, y - x)
    middle = ((-along_mm, -across_mm), (along_mm, across_mm), min(x, y) + corner_mm)
    return [*sides, middle]


def _at_tips(layout: FlatLayout, leaves: Ints, point_mm: Point) -> Floats:
    """Return where a point of the tip's frame lies on the sheet, for each leaf, shape (k, 2)."""
    cos, sin = np.cos(layout.heading_rad[leaves]), np.sin(layout.heading_rad[leaves])
    x, y = point_mm
    return layout.end_mm[leaves] + np.column_stack([cos * x - sin * y, sin * x + cos * y])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closest:
    """Where k pairs of segments are closest."""

    distance_mm: Floats  # between the closest points, shape (k,); 0 where the segments cross
    along_a: Floats  # closest point on the first, 0 at its start and 1 at its end, shape (k,)
    along_b: Floats  # closest point on the second, likewise


def closest(start_a_mm: Floats, end_a_mm: Floats, start_b_mm: Floats, end_b_mm: Floats) -> Closest:
    """Return the closest points of pairs of segments.

    Parameters
    ----------
    start_a_mm, end_a_mm, start_b_mm, end_b_mm
        Ends of the segments, shape (k, 2) each; a segment may be a single point.

    Notes
    -----
    The closest points of two segments by clamping first one and then the other parameter
    (Ericson, Real-Time Collision Detection, section 5.1.9).

    Examples
    --------
    >>> square = np.array([[0.0, 0.0]]), np.array([[10.0, 0.0]])
    >>> closest(*square, np.array([[4.0, 3.0]]), np.array([[4.0, 9.0]])).distance_mm.tolist()
    [3.0]
    """
    ax, ay = (end_a_mm - start_a_mm).T
    bx, by = (end_b_mm - start_b_mm).T
    rx, ry = (start_a_mm - start_b_mm).T
    tiny = 1e-12
    aa = np.maximum(ax * ax + ay * ay, tiny)
    bb = np.maximum(bx * bx + by * by, tiny)
    ab, ar, br = ax * bx + ay * by, ax * rx + ay * ry, bx * rx + by * ry
    cross = aa * bb - ab * ab
    flat = cross <= tiny * aa * bb  # parallel, or a point: any place on a will do at first
    along_a = np.where(flat, 0.0, (ab * br - ar * bb) / np.where(flat, 1.0, cross)).clip(0.0, 1.0)
    along_b = ((ab * along_a + br) / bb).clip(0.0, 1.0)
    along_a = ((ab * along_b - ar) / aa).clip(0.0, 1.0)
    gap_x = rx + along_a * ax - along_b * bx
    gap_y = ry + along_a * ay - along_b * by
    return Closest(
        distance_mm=np.sqrt(gap_x * gap_x + gap_y * gap_y), along_a=along_a, along_b=along_b
    )


_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_STEPS = 48
"""Golden-section steps: 1e-10 of a branch is left of the search interval."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hulls:
    """Hulls of two discs, k of them."""

    start_mm: Floats  # centre of the first disc, shape (k, 2)
    run_mm: Floats  # from there to the centre of the second, shape (k, 2)
    half_mm: Floats  # radius of the first, shape (k,)
    growth_mm: Floats  # radius of the second less that of the first, shape (k,)

    def place_mm(self, along: Floats) -> Floats:
        """Return places on the axes, 0 at the first disc and 1 at the second, shape (k, 2)."""
        return self.start_mm + along[:, None] * self.run_mm

    def twice(self) -> "Hulls":
        """Return these hulls two times after each other."""
        return Hulls(
            start_mm=np.tile(self.start_mm, (2, 1)),
            run_mm=np.tile(self.run_mm, (2, 1)),
            half_mm=np.tile(self.half_mm, 2),
            growth_mm=np.tile(self.growth_mm, 2),
        )

    @cached_property
    def _axes(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Lengths and unit vectors of the axes; sines and cosines of the lean of the sides."""
        length_mm = np.maximum(np.hypot(*self.run_mm.T), 1e-12)
        lean = np.clip(self.growth_mm / length_mm, -0.99, 0.99)
        return length_mm, self.run_mm / length_mm[:, None], lean, np.sqrt(1.0 - lean**2)

    def gap_mm(self, points_mm: Floats) -> Floats:
        """Return the distance of points from the hulls, one each, negative inside; shape (k,).

        The distance to the disc at place t of the axis, |p - c(t)| - r(t), is least where the line
        to the point stands on the hull's side: the foot of the perpendicular, moved towards the
        larger disc by the lean of the side.
        """
        length_mm, unit, lean, upright = self._axes
        away = points_mm - self.start_mm
        foot = (away * unit).sum(axis=1)
        across = np.abs(away[:, 0] * unit[:, 1] - away[:, 1] * unit[:, 0])
        along = np.clip((foot + across * lean / upright) / length_mm, 0.0, 1.0)
        from_axis_mm = np.hypot(*(points_mm - self.place_mm(along)).T)
        gap: Floats = from_axis_mm - self.half_mm - along * self.growth_mm
        return gap


def hull_gap_mm(one: Hulls, two: Hulls) -> Floats:
    """Return the free distance between pairs of hulls, shape (k,); negative where they overlap."""
    count = len(one.half_mm)
    low, high = np.zeros(count), np.ones(count)
    # Two places of each pair in one go: twice as fast for the few pairs of a usual robot.
    first, second = one.twice(), two.twice()

    def at_mm(one_place: Floats, other: Floats) -> tuple[Floats, Floats]:
        """Return the least distances from discs of the first hulls to the second hulls."""
        along = np.concatenate([one_place, other])
        found = second.gap_mm(first.place_mm(along)) - (first.half_mm + along * first.growth_mm)
        return found[:count], found[count:]

    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_left, at_right = at_mm(left, right)
        lower = at_left <= at_right
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    at_ends = at_mm(np.zeros(count), np.ones(count))
    middle = (low + high) / 2.0
    return np.minimum(at_mm(middle, middle)[0], np.minimum(*at_ends))


_CHUNK, _ROWS = 512, 8192
"""Capsules whose neighbours are looked for at once, and pairs evaluated at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spacing:
    """Pairs of capsules of different branches that are nearer than a reach, k of them."""

    first: Ints  # indices of the first capsules, shape (k,)
    second: Ints  # indices of the second capsules, shape (k,)
    gap_mm: Floats  # free distance between them, negative where they overlap, shape (k,)
    # By how much the nearest end runs past the place where the segments cross, shape (k,); 0 for
    # segments that do not
    crossing_mm: Floats
    first_mm: Floats  # closest points on the first segments, shape (k, 2)
    second_mm: Floats  # closest points on the second segments, shape (k, 2)
    joined: NDArray[np.bool_]  # whether the two branches share a joint, shape (k,)
    pouch: NDArray[np.bool_]  # whether one of the two belongs to a pouch, shape (k,)


def spacing(capsules: Capsules, reach_mm: float) -> Spacing:
    """Return all pairs of capsules that are nearer to each other than ``reach_mm``.

    Capsules of one branch are left out, and so are pairs of branches that share a joint unless a
    pouch is involved: such branches meet by design.
    """
    first, second = _near(capsules, reach_mm)
    branch = capsules.branch
    joined = share_joint(capsules.parent, branch[first], branch[second])
    pouch = capsules.pouch[first] | capsules.pouch[second]
    keep = (branch[first] != branch[second]) & (pouch | ~joined)
    first, second, joined, pouch = (each[keep] for each in (first, second, joined, pouch))
    near = _closest_of_pairs(capsules, first, second)
    # Between even capsules the gap is the distance of their segments less both half widths. Where
    # one is tapered, it is the least distance of two places on the segments less the half widths
    # there: a convex function of the two places, so that a search along one segment finds it when
    # the other place is the best for it.
    gap = near.distance_mm - capsules.half_mm[first] - capsules.half_mm[second]
    even = capsules.half_mm == capsules.end_half_mm
    rows = np.flatnonzero(~(even[first] & even[second]))
    if len(rows):
        gap[rows] = hull_gap_mm(*(capsules.hulls(pair[rows]) for pair in (first, second)))
    run_a = capsules.end_mm[first] - capsules.start_mm[first]
    run_b = capsules.end_mm[second] - capsules.start_mm[second]
    short_a = np.minimum(near.along_a, 1.0 - near.along_a) * np.hypot(*run_a.T)
    short_b = np.minimum(near.along_b, 1.0 - near.along_b) * np.hypot(*run_b.T)
    return Spacing(
        first=first,
        second=second,
        gap_mm=gap,
        crossing_mm=np.where(near.distance_mm < 1e-9, np.minimum(short_a, short_b), 0.0),
        first_mm=capsules.start_mm[first] + near.along_a[:, None] * run_a,
        second_mm=capsules.start_mm[second] + near.along_b[:, None] * run_b,
        joined=joined,
        pouch=pouch,
    )


def _closest_of_pairs(capsules: Capsules, first: Ints, second: Ints) -> Closest:
    """Return where pairs of capsules' segments are closest."""
    # Some thousand at a time stay in the processor's cache: three times as fast.
    parts = [
        closest(
            capsules.start_mm[first[rows]],
            capsules.end_mm[first[rows]],
            capsules.start_mm[second[rows]],
            capsules.end_mm[second[rows]],
        )
        for rows in (slice(begin, begin + _ROWS) for begin in range(0, max(1, len(first)), _ROWS))
    ]
    return Closest(
        distance_mm=np.concatenate([part.distance_mm for part in parts]),
        along_a=np.concatenate([part.along_a for part in parts]),
        along_b=np.concatenate([part.along_b for part in parts]),
    )


def _near(capsules: Capsules, reach_mm: float) -> tuple[Ints, Ints]:
    """Return pairs (first < second) whose boxes come within the reach."""
    grown = capsules.most_half_mm[:, None] + reach_mm / 2
    low = np.minimum(capsules.start_mm, capsules.end_mm) - grown
    high = np.maximum(capsules.start_mm, capsules.end_mm) + grown
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    tree = shapely.STRtree(boxes)
    firsts, seconds, count = [], [], 0
    # Most near pairs evaluated; a tree with more overlaps itself everywhere anyway.
    most_pairs = 2_000_000
    for begin in range(0, len(capsules), _CHUNK):
        first, second = tree.query(boxes[begin : begin + _CHUNK])
        first = first + begin
        keep = first < second
        firsts.append(first[keep])
        seconds.append(second[keep])
        count += len(firsts[-1])
        if count > most_pairs:
            break
    return np.concatenate(firsts), np.concatenate(seconds)


def share_joint(parent: Ints, one: Ints | int, two: Ints | int) -> NDArray[np.bool_]:
    """Return whether branches are siblings, or parent and child."""
    return np.asarray((parent[one] == parent[two]) | (parent[one] == two) | (parent[two] == one))


TURNS = 180
"""Rotations of a flat robot that are tried, over half a turn."""


class RotatedSpan:
    """How far discs reach across a sheet, in every rotation.

    Whole degrees are tried. `place_contours` tries more, so that a finished outline fits no worse
    except for seam, kerf and the overcut at the mouth.
    """

    def __init__(self) -> None:
        turns = np.arange(TURNS) * np.pi / TURNS
        self._across = np.stack([np.cos(turns), np.sin(turns)])
        self._low, self._high = np.full(TURNS, np.inf), np.full(TURNS, -np.inf)

    def add(self, points_mm: Floats, half_mm: Floats) -> None:
        """Add discs, shape (k, 2) and (k,)."""
        at = points_mm @ self._across
        self._low = np.minimum(self._low, (at - half_mm[:, None]).min(axis=0, initial=np.inf))
        self._high = np.maximum(self._high, (at + half_mm[:, None]).max(axis=0, initial=-np.inf))

    def add_mouth(self, capsules: Capsules) -> None:
        """Add the corners at the end of the tail."""
        corners = np.array([[0.0, 1.0], [0.0, -1.0]]) * capsules.half_mm[0]
        self.add(capsules.start_mm[0] + corners, np.zeros(2))

    def excess_mm(self, sheet_mm: tuple[float, float]) -> float:
        """Return by how much they exceed a sheet in the best rotation; 0 or less if they fit."""
        wide = self._high - self._low
        # Turning by a right angle swaps width and height.
        tall = np.roll(wide, -TURNS // 2)
        return float(np.maximum(wide - sheet_mm[0], tall - sheet_mm[1]).min())


def excess_mm(capsules: Capsules, sheet_mm: tuple[float, float]) -> float:
    """Return the excess of a flat robot over a sheet in its best rotation; 0 or less if it fits."""
    span = RotatedSpan()
    span.add_mouth(capsules)
    span.add(capsules.end_mm, capsules.end_half_mm)
    span.add(capsules.start_mm[1:], capsules.half_mm[1:])
    return span.excess_mm(sheet_mm)
