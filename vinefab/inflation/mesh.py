"""An inflated sheet: triangles within lines and exact arcs, how they are held, how they start.

Straight stretches of tube get rows of points along the tube, so that edges lie along the lines
about which the sheet bends: triangles across those lines resist the bending of stiff film. All
else, joints and ends, gets a graded lattice. SciPy triangulates (Delaunay); triangles outside the
outline are dropped.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints
from vinefab.inflation.membrane import POISSON, Equilibrium, Membrane, at_rest
from vinefab.model.outline import Contour, Part

LENGTHENED = 1.5
"""Spacing along a straight stretch over that across it."""

FILLET_STEP_RAD = 0.3
"""Largest turn of an arc between two points."""

FINEST = 0.25
"""Smallest spacing at an arc over that asked for."""

GRADE = 0.35
"""How fast spacing may grow with distance."""

LEAST_ANGLE_DEG = 1.0
"""Meshes with a sharper triangle are refused."""

_CORNER_RAD = math.radians(20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightSide:
    """A stretch of tube whose two sides are straight, on the flat sheet."""

    origin: tuple[float, float]  # a point of its axis
    heading_rad: float  # direction of its axis
    begin: float  # where it begins along the axis, from the origin
    end: float
    half_begin: float  # half its width there
    half_end: float

    def points(self, along: Floats, share: Floats) -> Floats:
        """Return points, shape (k, 2), at places along the axis and shares of the half width."""
        slope = (self.half_end - self.half_begin) / (self.end - self.begin)
        across = share * (self.half_begin + slope * (along - self.begin))
        cos, sin = math.cos(self.heading_rad), math.sin(self.heading_rad)
        x, y = self.origin
        return np.column_stack([x + cos * along - sin * across, y + sin * along + cos * across])

    def local(self, points: Floats) -> Floats:
        """Return points along and across the axis, shape (k, 2)."""
        cos, sin = math.cos(self.heading_rad), math.sin(self.heading_rad)
        turned: Floats = (points - np.array(self.origin)) @ np.array([[cos, -sin], [sin, cos]])
        return turned


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetMesh:
    """A flat sheet of triangles."""

    points: Floats  # shape (n, 2)
    triangles: Ints  # counter-clockwise, shape (m, 3)
    seam: Ints  # the corners on the outline in its order, the first once, shape (k,)
    places: Floats  # of those corners: distances along the outline, shape (k,)
    straights: tuple[StraightSide, ...]
    # The corners on the two sides of each straight stretch, from its beginning on: right, left.
    sides: tuple[tuple[Ints, Ints], ...]

    @property
    def least_angle_deg(self) -> float:
        """The sharpest angle of a triangle."""
        one, two, three = self.points[self.triangles].transpose(1, 2, 0)
        a, b, c = (np.hypot(*side) for side in (two - three, three - one, one - two))
        ways = ((a, b, c), (b, c, a), (c, a, b))
        cos = [(b**2 + c**2 - a**2) / (2 * b * c) for a, b, c in ways]
        return float(np.degrees(np.arccos(np.clip(cos, -1.0, 1.0)).min()))

    @property
    def is_unfolded(self) -> bool:
        """Whether every triangle is counter-clockwise."""
        a, b, c = self.points[self.triangles].transpose(1, 2, 0)
        (ux, uy), (vx, vy) = b - a, c - a
        return bool((ux * vy > uy * vx).all())


def mesh_of(
    outline: Contour, straights: tuple[StraightSide, ...], spacing: Floats, *, across: int
) -> SheetMesh:
    """Return triangles within a closed outline.

    Parameters
    ----------
    outline
        Closed, counter-clockwise, not crossing itself.
    straights
        The stretches that get rows of points; their sides are on the outline.
    spacing
        Largest distance of neighbouring points at each segment of the outline, shape (segments,).
        Arcs get shorter ones, as far as `FINEST` of it.
    across
        Triangles across a straight stretch, even.

    Raises
    ------
    BadInputError
        If the outline crosses itself or has parts too narrow for triangles.
    """
    if across < 2 or across % 2:
        raise BadInputError("across", across, "an even number, at least 2")
    curve = _Curve(outline)
    rows = [_rows(straight, across) for straight in straights]
    bounds, marks = _bounds(curve, straights, rows, across)
    sizes = _Sizes(curve, spacing)
    ends = zip(bounds, np.append(bounds[1:], bounds[0] + curve.length), strict=True)
    places = np.concatenate(
        [_places(low, high, marks.get(number), sizes) for number, (low, high) in enumerate(ends)]
    )
    inner = [straight.points(*row.inner) for straight, row in zip(straights, rows, strict=True)]
    fixed = np.concatenate([np.zeros((0, 2)), *inner])
    # A stretch that ends at a mouth has its last points on the outline already.
    if len(fixed):
        fixed = fixed[
            scipy.spatial.cKDTree(curve.at(places)).query(fixed)[0] > 0.25 * sizes.inside(fixed)
        ]
    free = _lattice(curve, places, fixed, straights, sizes, across)
    most_repairs = 6
    for _ in range(most_repairs):
        points, triangles, missing = _triangulated(curve, places, fixed, free)
        if not len(missing) and len(np.unique(triangles)) == len(points):
            break
        after = np.append(places[1:], places[0] + curve.length)
        places = np.sort(
            np.concatenate([places, (places[missing] + after[missing]) / 2.0]) % curve.length
        )
        seam = curve.at(places)
        if len(free):
            free = free[scipy.spatial.cKDTree(seam).query(free)[0] > 0.3 * sizes.inside(free)]
    else:
        raise BadInputError(
            "outline", "crosses itself or is too narrow", "an outline that triangles fill"
        )
    mesh = SheetMesh(
        points=points,
        triangles=triangles,
        seam=np.arange(len(places)),
        places=places,
        straights=straights,
        sides=_sides(points[: len(places)], straights, rows),
    )
    if mesh.least_angle_deg < LEAST_ANGLE_DEG:
        found = f"{mesh.least_angle_deg:.2g} deg in a triangle"
        raise BadInputError("outline", found, f"triangles of at least {LEAST_ANGLE_DEG:g} deg")
    return mesh


def followed(
    mesh: SheetMesh, before: Contour, after: Contour, straights: tuple[StraightSide, ...]
) -> SheetMesh:
    """Return a mesh that follows its outline to a slightly other one: other points, same triangles.

    Points of the outline keep their share of their segment; those within move smoothly with them.

    Parameters
    ----------
    straights
        The straight stretches of the other outline.

    Raises
    ------
    BadInputError
        If the outlines differ in the number of their segments.
    """
    old, new = _Curve(before), _Curve(after)
    if len(old.lengths) != len(new.lengths):
        allowed = counted(len(old.lengths), "segment")
        raise BadInputError("outline", counted(len(new.lengths), "segment"), allowed)
    number = old.segment(mesh.places)
    share = (mesh.places - old.starts[number]) / old.lengths[number]
    places = new.starts[number] + share * new.lengths[number]
    moved = new.at(places) - mesh.points[mesh.seam]
    inner, by_seam, factor = _smoothing(mesh)
    points = mesh.points.copy()
    points[mesh.seam] += moved
    points[inner] += factor.solve(-by_seam @ moved)
    return replace(mesh, points=points, places=places, straights=straights)


@lru_cache(maxsize=4)
def _smoothing(mesh: SheetMesh) -> "tuple[Ints, scipy.sparse.csr_array, Any]":
    """Return the inner points, and the two parts of their Laplacian: by the seam, and factorized.

    Sensitivities follow the outline of one mesh many times.
    """
    count = len(mesh.points)
    sides = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    links = scipy.sparse.coo_array((np.ones(len(sides)), sides.T), shape=(count, count)).tocsr()
    links = links + links.T
    laplacian = scipy.sparse.diags_array(links.sum(axis=1)) - links
    inner = np.setdiff1d(np.arange(count), mesh.seam)
    rows = scipy.sparse.csr_array(laplacian)[inner]
    factor = scipy.sparse.linalg.splu(scipy.sparse.csc_array(rows[:, inner]))
    return inner, rows[:, mesh.seam], factor


# --- The outline as one curve ---------------------------------------------------------------------


class _Curve:
    """A closed contour by the distance along it."""

    def __init__(self, outline: Contour) -> None:
        segments = list(outline.segments)
        self.lengths = np.array([segment.length_mm for segment in segments])
        self.ends = np.cumsum(self.lengths)
        self.starts = self.ends - self.lengths
        self.length = float(self.ends[-1])
        self.turns = np.array([segment.turn_rad for segment in segments])
        self.headings = np.array([segment.direction_rad() for segment in segments])
        self.first = np.array([segment.start_mm for segment in segments])
        after = np.roll(self.headings, -1)
        gone = np.array([segment.direction_rad(at_end=True) for segment in segments])
        corner = np.abs(np.remainder(after - gone + math.pi, math.tau) - math.pi) > _CORNER_RAD
        self.corners = np.remainder(self.ends[corner], self.length)

    def segment(self, place: Floats) -> Ints:
        """Return the number of the segment at each distance."""
        found = np.searchsorted(self.ends, place, side="right")
        return np.minimum(found, len(self.ends) - 1)

    def at(self, place: Floats) -> Floats:
        """Return the points at distances along the curve, shape (k, 2), exact on arcs."""
        place = np.remainder(place, self.length)
        number = self.segment(place)
        gone = place - self.starts[number]
        # The chord from the start: 2 sin(t / 2) / curvature long, turned by t / 2.
        turn = self.turns[number] * gone / self.lengths[number]
        chord = gone * np.sinc(turn / math.tau)
        heading = self.headings[number] + turn / 2.0
        way = np.column_stack([np.cos(heading), np.sin(heading)])
        points: Floats = self.first[number] + chord[:, None] * way
        return points

    def nearest(self, points: Floats) -> Floats:
        """Return the distance along the curve of the line's point nearest to each point."""
        best, found = np.full(len(points), math.inf), np.zeros(len(points))
        for start, length, heading, first, turn in zip(
            self.starts, self.lengths, self.headings, self.first, self.turns, strict=True
        ):
            if turn:
                continue
            away = points - first
            along = np.clip(away @ np.array([math.cos(heading), math.sin(heading)]), 0.0, length)
            off = np.hypot(*(away - along[:, None] * [math.cos(heading), math.sin(heading)]).T)
            better = off < best - 1e-9
            best, found = np.where(better, off, best), np.where(better, start + along, found)
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Row:
    """The rows of points of one straight stretch."""

    steps: int  # along it
    inner: tuple[Floats, Floats]  # place along the axis, share of the half width


def _rows(straight: StraightSide, across: int) -> _Row:
    wide = (straight.half_begin + straight.half_end) / across
    length = straight.end - straight.begin
    steps = max(1, round(length / (LENGTHENED * wide)))
    along, share = [], []
    for row in range(1, across):
        # Every second row is shifted by half a step.
        shift = 0.5 * (row % 2)
        places = straight.begin + (np.arange(steps + 1 - row % 2) + shift) * length / steps
        along.append(places)
        share.append(np.full(len(places), 2.0 * row / across - 1.0))
    inner = np.concatenate(along), np.concatenate(share)
    return _Row(steps=steps, inner=inner)


def _bounds(
    curve: _Curve, straights: tuple[StraightSide, ...], rows: list[_Row], across: int
) -> tuple[Floats, dict[int, int]]:
    """Return the places that must be points, and the steps of the sides that begin at some."""
    ends, steps = [], []
    for straight, row in zip(straights, rows, strict=True):
        along = np.array([straight.begin, straight.end, straight.end, straight.begin])
        right_left = curve.nearest(straight.points(along, np.array([-1.0, -1.0, 1.0, 1.0])))
        ends.append(right_left)
        steps += [(right_left[0], row.steps), (right_left[2], row.steps)]
    places = np.concatenate([np.zeros(0), *ends])
    kept = np.remainder(places, curve.length)
    near = _around(curve.corners[:, None], kept[None], curve.length).min(axis=1, initial=math.inf)
    bounds = np.unique(np.concatenate([kept, curve.corners[near > 1e-7 * curve.length]]))
    if not len(bounds):
        bounds = np.zeros(1)

    def number(place: float) -> int:
        return int(np.argmin(_around(bounds, place % curve.length, curve.length)))

    marks = {number(place): count for place, count in steps}
    for right_left in ends:
        # Straight across from the left side's beginning to the right one's: a mouth.
        if (number(right_left[3]) + 1) % len(bounds) == number(right_left[0]):
            marks[number(right_left[3])] = across
    return bounds, marks


def _around(one: Floats, two: Floats | float, length: float) -> Floats:
    """Return the distance of places along a closed curve."""
    off = np.abs(one - two)
    nearer: Floats = np.minimum(off, length - off)
    return nearer


class _Sizes:
    """How far apart points should be."""

    def __init__(self, curve: _Curve, spacing: Floats) -> None:
        radius = curve.lengths / np.maximum(np.abs(curve.turns), 1e-12)
        wanted = np.clip(FILLET_STEP_RAD * radius, FINEST * spacing, spacing)
        step = float(wanted.min()) / 2.0
        count = max(16, math.ceil(curve.length / step))
        self.curve = curve
        self.place = (np.arange(count) + 0.5) * curve.length / count
        size = wanted[curve.segment(self.place)]
        # No spacing grows faster than it may: both ways around, twice for the wrap.
        away = GRADE * curve.length / count
        ramp = away * np.arange(3 * count)
        tiled = np.tile(size, 3)
        forward = np.minimum.accumulate(tiled - ramp) + ramp
        backward = (np.minimum.accumulate((tiled + ramp - ramp[-1])[::-1]))[::-1] - ramp + ramp[-1]
        self.size = np.minimum(forward, backward)[count : 2 * count]
        points = curve.at(self.place)
        self.tree = scipy.spatial.cKDTree(points)
        self.coarsest = float(wanted.max())

    def finer(self, boxes: list[Floats], size: float) -> list[Floats]:
        """Return parts of boxes that hold all their points with a spacing below a size.

        Without it, a child of a hundredth of the trunk's width takes 10 s.
        """
        reach = size / GRADE
        near = np.floor(self.tree.data[self.size < size] / reach).astype(np.int64)
        steps = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
        cells = np.unique((near[:, None] + steps).reshape(-1, 2), axis=0) * reach
        parts = []
        for low, high in boxes:
            lows, highs = np.maximum(cells, low), np.minimum(cells + reach, high)
            kept = (lows <= highs).all(axis=1)
            parts += list(np.stack([lows[kept], highs[kept]], axis=1))
        return parts

    def along(self, place: Floats) -> Floats:
        """Return the spacing at distances along the curve."""
        size: Floats = np.interp(place, self.place, self.size, period=self.curve.length)
        return size

    def inside(self, points: Floats) -> Floats:
        """Return the spacing at points within the outline."""
        away, near = self.tree.query(points, k=4)
        sizes: Floats = (self.size[near] + GRADE * away).min(axis=1)
        return np.minimum(sizes, self.coarsest)


def _places(low: float, high: float, steps: int | None, sizes: _Sizes) -> Floats:
    """Return the points from one bound up to the next, without it, as places on the curve."""
    if steps is not None:
        return low + (high - low) * np.arange(steps) / steps
    fine = np.linspace(low, high, max(9, math.ceil((high - low) / sizes.size.min() * 2)))
    middle = (fine[1:] + fine[:-1]) / 2.0
    gone = np.concatenate([[0.0], np.cumsum(np.diff(fine) / sizes.along(middle))])
    count = max(1, math.ceil(gone[-1] - 0.2))
    places: Floats = np.interp(gone[-1] * np.arange(count) / count, gone, fine)
    return places


# --- Points within --------------------------------------------------------------------------------


def _lattice(
    curve: _Curve,
    places: Floats,
    fixed: Floats,
    straights: tuple[StraightSide, ...],
    sizes: _Sizes,
    across: int,
) -> Floats:
    """Return the points of the graded lattice: within the outline, outside straight stretches."""
    seam = curve.at(places)
    is_open = ~np.isin(np.arange(len(seam)), _covered(seam, straights))
    smallest, largest = float(sizes.size.min()), sizes.coarsest
    levels = max(0, round(math.log2(largest / smallest)))
    boxes = _boxes(seam, is_open, across * sizes.along(places))
    chosen, known = np.zeros((0, 2)), np.concatenate([seam, fixed])
    for level in range(levels, -1, -1):
        size = largest / 2.0**level
        low = 0.0 if level == levels else size / math.sqrt(2.0)
        high = math.inf if level == 0 else size * math.sqrt(2.0)
        grid = _hexagonal(boxes if level == 0 else sizes.finer(boxes, high), size)
        grid = np.delete(grid, _covered(grid, straights), axis=0)
        if not len(grid):
            continue
        wanted = sizes.inside(grid)
        grid = grid[(wanted >= low) & (wanted < high)]
        if not len(grid):
            continue
        grid = grid[scipy.spatial.cKDTree(known).query(grid)[0] > 0.65 * size]
        grid = grid[_within(grid, seam)]
        known, chosen = np.concatenate([known, grid]), np.concatenate([chosen, grid])
    return chosen


def _covered(points: Floats, straights: tuple[StraightSide, ...]) -> Ints:
    """Return the numbers of the points on straight stretches, their sides included."""
    found = [np.zeros(0, dtype=np.int64)]
    if not len(points):
        return found[0]
    tree = scipy.spatial.cKDTree(points)
    for straight in straights:
        half = max(straight.half_begin, straight.half_end) * (1.0 + 1e-6)
        middle = straight.points(np.array([(straight.begin + straight.end) / 2.0]), np.zeros(1))[0]
        reach = math.hypot(half, (straight.end - straight.begin) / 2.0)
        near = np.array(tree.query_ball_point(middle, reach), dtype=np.int64)
        along, off = straight.local(points[near]).T
        slack = 1e-9 * (1.0 + abs(straight.end))
        on = (along > straight.begin - slack) & (along < straight.end + slack)
        found.append(near[on & (np.abs(off) < half)])
    return np.concatenate(found)


def _boxes(seam: Floats, is_open: NDArray[np.bool_], widths: Floats) -> list[Floats]:
    """Return boxes, shape (2, 2), that hold all within the outline but the straight stretches."""
    if not is_open.any():
        return []
    # Around each run of the seam between straight stretches, and half a tube farther.
    turn = 0 if is_open.all() else int(np.flatnonzero(~is_open)[0])
    order = np.roll(np.arange(len(seam)), -turn)
    breaks = np.flatnonzero(np.diff(is_open[order].astype(int))) + 1
    boxes = []
    for run in np.split(order, breaks):
        if is_open[run[0]]:
            margin = 0.6 * float(widths[run].max())
            boxes.append(np.array([seam[run].min(axis=0) - margin, seam[run].max(axis=0) + margin]))
    return boxes


def _hexagonal(boxes: list[Floats], size: float) -> Floats:
    """Return the points of one lattice within boxes."""
    row, found = size * math.sqrt(0.75), [np.zeros((0, 2), dtype=np.int64)]
    for (x0, y0), (x1, y1) in boxes:
        j = np.arange(math.floor(y0 / row), math.ceil(y1 / row) + 1)
        i = np.arange(math.floor(x0 / size) - 1, math.ceil(x1 / size) + 1)
        found.append(np.stack(np.meshgrid(i, j), axis=-1).reshape(-1, 2))
    i, j = np.unique(np.concatenate(found), axis=0).T
    return np.column_stack([i * size + 0.5 * size * (j % 2), j * row])


def _within(points: Floats, polygon: Floats) -> NDArray[np.bool_]:
    """Return whether points lie within a polygon."""
    area = shapely.Polygon(polygon)
    shapely.prepare(area)
    return np.asarray(shapely.contains_xy(area, points))


# --- Triangles ------------------------------------------------------------------------------------


def _triangulated(
    curve: _Curve, places: Floats, fixed: Floats, free: Floats
) -> tuple[Floats, Ints, Ints]:
    """Return points, triangles, and the pieces of the seam that are no edge."""
    seam = curve.at(places)
    kept = len(seam) + len(fixed)
    points = np.concatenate([seam, fixed, free])
    smoothings = 4
    for turn in range(smoothings + 1):
        triangles = _inside_triangles(points, len(seam))
        if turn == smoothings or not len(free):
            break
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        count = np.bincount(edges.ravel(), minlength=len(points))
        mean = (
            np.column_stack(
                [
                    np.bincount(edges[:, 0], points[edges[:, 1], axis], len(points))
                    + np.bincount(edges[:, 1], points[edges[:, 0], axis], len(points))
                    for axis in range(2)
                ]
            )
            / np.maximum(count, 1)[:, None]
        )
        points[kept:] = mean[kept:]
    size = len(points)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    here = np.arange(len(seam))
    wanted = here * size + np.roll(here, -1)
    missing = np.flatnonzero(~np.isin(wanted, edges[:, 0] * size + edges[:, 1]))
    return points, triangles, missing


def _inside_triangles(points: Floats, seam: int) -> Ints:
    triangles = scipy.spatial.Delaunay(points).simplices.astype(np.int64)
    corners = points[triangles]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    double = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    longest = np.maximum((a**2).sum(1), (b**2).sum(1))
    triangles = np.where((double < 0.0)[:, None], triangles[:, ::-1], triangles)
    kept = np.abs(double) > 1e-6 * longest
    # A triangle with a corner within lies within.
    doubtful = np.flatnonzero(kept & (triangles < seam).all(axis=1))
    kept[doubtful] = _within(corners[doubtful].mean(axis=1), points[:seam])
    within: Ints = triangles[kept]
    return within


def _sides(
    seam: Floats, straights: tuple[StraightSide, ...], rows: list[_Row]
) -> tuple[tuple[Ints, Ints], ...]:
    tree = scipy.spatial.cKDTree(seam)

    def side(straight: StraightSide, steps: int, share: float) -> Ints:
        along = np.linspace(straight.begin, straight.end, steps + 1)
        nearest = tree.query(straight.points(along, np.full(len(along), share)))[1]
        return np.asarray(nearest, dtype=np.int64)

    return tuple(
        (side(straight, row.steps, -1.0), side(straight, row.steps, 1.0))
        for straight, row in zip(straights, rows, strict=True)
    )


LOAD_LENGTH = 0.1
"""Length of seam, in widths of the trunk, over which a load is a mean: about that of a weld band.

The load at a single point of a tight crotch grows with the fineness of the triangles.
"""

FINER = 0.65
"""Spacing in joints and ends over that across straight tubes.

There, edges do not lie along the lines about which the sheet bends, which makes coarse triangles
too stiff.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sheet:
    """The upper sheet of a pattern, in widths of its trunk.

    The seam stays in the plane z = 0. A mouth is the cut end of a long tube: its points stay in the
    upright plane x = const and are free in it, which is what an endless tube does there. A pattern
    without a mouth is held at two points against moving as a whole.
    """

    mesh: SheetMesh
    membrane: Membrane
    is_seam: "Ints"  # corners that keep z = 0, in the outline's order

    def inflated(self, *, start: Floats | None = None) -> Equilibrium:
        """Return the sheet under pressure.

        Parameters
        ----------
        start
            Corners in space, shape (n, 3), near the result; None: a low roof over the flat sheet.

        Raises
        ------
        NotConvergedError
            If no equilibrium is found.
        """
        return at_rest(self.membrane, self.roof() if start is None else start)

    def roof(self) -> Floats:
        """Return a start: the flat sheet raised with the distance from the seam, shape (n, 3)."""
        points = self.mesh.points
        held = ~self.membrane.free[:, 2]
        away = scipy.spatial.cKDTree(points[held]).query(points)[0]
        start_slope = 0.45  # height of the start over the distance from the seam
        return np.column_stack([points, np.where(held, 0.0, start_slope * away)])

    def seam_loads(self, found: Equilibrium) -> Floats:
        """Return the load that opens the weld at each corner of `SheetMesh.seam`, over p W.

        Force per length of flat seam, the mean over `LOAD_LENGTH` of it; 1 / pi on a straight tube
        of width 1, NaN at a mouth.
        """
        seam = self.mesh.seam
        force = np.abs(self.membrane.forces(found.positions)[seam, 2])
        loop = self.mesh.points[seam]
        ahead = np.hypot(*(np.roll(loop, -1, axis=0) - loop).T)
        # Each corner bears the half of both edges: the force up to the middle of every edge.
        bounds = np.concatenate([[-ahead[-1] / 2.0], np.cumsum(ahead) - ahead / 2.0])
        total = np.concatenate([[0.0], np.cumsum(force)])
        length = float(ahead.sum())
        bounds = np.concatenate([bounds[:-1] - length, bounds, bounds[1:] + length])
        total = np.concatenate([total[:-1] - total[-1], total, total[1:] + total[-1]])
        here = np.concatenate([[0.0], np.cumsum(ahead)[:-1]])
        half = LOAD_LENGTH / 2.0
        loads = np.interp(here + half, bounds, total) - np.interp(here - half, bounds, total)
        loads[~np.isin(seam, self.is_seam)] = np.nan
        mean: Floats = loads / LOAD_LENGTH
        return mean


def sheet_of(
    outline: Contour,
    straights: tuple[StraightSide, ...],
    widths: Mapping[str, float],
    *,
    across: int,
    hoop_strain: float,
) -> Sheet:
    """Return the upper sheet of a pattern.

    Parameters
    ----------
    outline
        Closed, counter-clockwise, in widths of the trunk; segments of `Part.MOUTH` lie across +x.
    straights
        Its straight stretches.
    widths
        Width of each branch of the outline, by its id.
    across
        Triangles across a tube, even.
    hoop_strain
        p W / (pi E t) of the trunk.

    Raises
    ------
    BadInputError
        If the outline cannot be filled with triangles.
    """
    spacing = FINER * np.array([widths[branch] for branch in outline.branches]) / across
    mesh = mesh_of(outline, straights, spacing, across=across)
    points = mesh.points
    free = np.ones((len(points), 3), dtype=np.bool_)
    is_seam = np.zeros(len(points), dtype=np.bool_)
    is_seam[mesh.seam] = True
    mouth = [segment for segment in outline.segments if segment.part is Part.MOUTH]
    for segment in mouth:
        (x, y0), (_, y1) = segment.start_mm, segment.end_mm
        size = abs(y1 - y0)
        on = is_seam & (np.abs(points[:, 0] - x) < 1e-6 * size)
        on &= np.abs(points[:, 1] - (y0 + y1) / 2.0) < size / 2.0 * (1.0 + 1e-6)
        free[on, 0] = False
        corner = on & (np.abs(np.abs(points[:, 1] - (y0 + y1) / 2.0) - size / 2.0) < 1e-6 * size)
        is_seam[on & ~corner] = False
        # Sideways nothing pulls: any one point may hold it.
        free[np.flatnonzero(corner)[0], 1] = False
    free[is_seam, 2] = False
    if not mouth:
        one = int(mesh.seam[0])
        other = int(mesh.seam[np.argmax(np.abs(points[mesh.seam, 0] - points[one, 0]))])
        free[one, :2] = free[other, 1] = False
    membrane = Membrane(points, mesh.triangles, free, hoop_strain=hoop_strain)
    loop = mesh.seam[is_seam[mesh.seam]]
    return Sheet(mesh=mesh, membrane=membrane, is_seam=loop)


def turned_deg(one: Floats, other: Floats) -> float:
    """Return the angle from one direction in the plane to another, -180 to 180."""
    cross, dot = one[0] * other[1] - one[1] * other[0], one[0] * other[0] + one[1] * other[1]
    return math.degrees(math.atan2(cross, dot))


def tube_stretch(hoop_strain: float, poisson: float = POISSON) -> tuple[float, float]:
    """Return by how much the film of a closed tube is stretched around and along, as ratios.

    Parameters
    ----------
    hoop_strain
        p W / (pi E t) of the flat tube.

    Notes
    -----
    St. Venant and Kirchhoff film in plane stress. With the radius R = h W / pi, h and a the
    stretches around and along, equilibrium per flat length is ``h S_h = p a R`` around and
    ``2 W a S_a = p pi R^2`` along.

    Examples
    --------
    >>> [round(stretch, 4) for stretch in tube_stretch(0.01)]
    [1.0077, 1.0006]
    """
    along = 1.0
    for _ in range(200):
        # Around in closed form for a length: both in turn diverge above a strain of 0.55.
        square = (1.0 + 2.0 * hoop_strain * along) / (1.0 + poisson * hoop_strain / along)
        axial = hoop_strain * (square / (2.0 * along) - poisson * along)
        new = math.sqrt(max(0.01, 1.0 + 2.0 * axial))
        if abs(new - along) < 1e-14:
            break
        along = new
    return math.sqrt(square), new
