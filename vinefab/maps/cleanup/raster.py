"""Grids of cells, free or solid, made into maps of straight walls with a bounded deviation.

Coordinates are in cells: the cell in column ``i`` and row ``j`` covers ``i .. i + 1`` times
``j .. j + 1``, rows counted upward.

A wall that was straight before it was cut into cells comes out of a trace as stairs. A loop is
split where a straight line no longer follows it (Douglas and Peucker 1973), each section gets the
line that fits it best (least squares over the middles of its cell edges, so a wall lies where the
cells say on average, not where its outermost cell lies), and neighbouring lines meet in corners.

Why not `shapely.simplify` or `coverage_simplify` alone: they keep some of the traced points, which
lie up to half a cell off the wall; they may let a thin wall shrink to a needle; and the second
one bounds areas, not distances.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints, number, positive
from vinefab.maps.cleanup.drawn_shapes import free_apart
from vinefab.maps.generators.generated_map import rounded_points
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.poses import roomiest_start
from vinefab.model.map import Map, Pose, Start

Mask = NDArray[np.bool_]
_PARALLEL_SINE = float(np.sin(np.radians(12.0)))


def _cross_products(first: Floats, second: Floats) -> Floats:
    """Return the cross products of plane vectors, shape (n,)."""
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def unit(vectors: Floats) -> Floats:
    """Return vectors of length 1; zero vectors stay zero."""
    return np.asarray(vectors / np.maximum(np.hypot(*vectors.T), 1e-30)[:, None])


def _distance_to_segments(points: Floats, first: Floats, last: Floats) -> Floats:
    """Return the distance of each point to its segment."""
    step = last - first
    length_2 = np.maximum(np.sum(step * step, axis=1), 1e-30)
    share = np.clip(np.sum((points - first) * step, axis=1) / length_2, 0.0, 1.0)
    return np.asarray(np.hypot(*(first + share[:, None] * step - points).T))


def _feet_on_lines(points: Floats, on_line: Floats, direction: Floats) -> Floats:
    """Return the foot of each point on its line; directions are unit vectors."""
    along = np.sum((points - on_line) * direction, axis=1)
    return np.asarray(on_line + along[:, None] * direction)


_STEPS = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
"""Directions counter-clockwise: right, up, left, down."""


def boundary_loops(region: Mask) -> list[Floats]:
    """Return the closed loops of cell edges around a region, as the edges' midpoints.

    The region lies to the left: outer boundaries run counter-clockwise, holes clockwise. Where
    two cells of the region touch only at a corner the loops keep them apart, so that the region
    is 4-connected and the rest 8-connected: a wall drawn one cell thick along a
    diagonal stays closed. Outside the array is outside the region. (contourpy finds the same
    loops, in 26 bytes for each cell where this takes 4.)

    Returns
    -------
    list of arrays
        Each of shape (n, 2), n at least 4, in cells; one entry per cell edge in walking order.
        Joined up, the midpoints make loops that never touch themselves or each other and stay
        within ``CORNER_CUT`` of the exact boundary.
    """
    padded = np.pad(region, 1)
    rises = padded[1:].astype(np.int8) - padded[:-1]
    widens = padded[:, 1:].astype(np.int8) - padded[:, :-1]
    begins, ways = [], []
    for step, change, sign, (d_row, d_column) in (
        (0, rises, 1, (1, 0)),
        (1, widens, -1, (0, 1)),
        (2, rises, -1, (1, 1)),
        (3, widens, 1, (1, 1)),
    ):
        row, column = np.nonzero(change == sign)
        begins.append(np.column_stack([column + d_column, row + d_row]))
        ways.append(np.full(len(row), step))
    starts, directions = np.concatenate(begins), np.concatenate(ways)
    after = _following(starts, directions, region.shape[1] + 3)
    midpoints = starts + 0.5 * _STEPS[directions] - 1.0
    return [midpoints[order] for order in _cycles(after)]


CORNER_CUT = 0.25 * 2**0.5
"""Distance in cells from a corner of the exact boundary to the line through two midpoints."""


def corners_between(midpoints: Floats, ahead: Floats) -> Floats:
    """Return the boundary's lattice points: one between each midpoint and the one that follows.

    Every corner of the exact boundary is among them.
    """
    lies_flat = (midpoints[:, 0] % 1.0) != 0.0
    turns = lies_flat != ((ahead[:, 0] % 1.0) != 0.0)
    x = np.where(lies_flat, ahead[:, 0], midpoints[:, 0])
    y = np.where(lies_flat, midpoints[:, 1], ahead[:, 1])
    return np.where(turns[:, None], np.column_stack([x, y]), 0.5 * (midpoints + ahead))


def _following(starts: Ints, directions: Ints, width: int) -> Ints:
    """Return for every edge the edge that follows it: the one that turns left most sharply."""
    key = 4 * (starts[:, 1] * width + starts[:, 0]) + directions
    order = np.argsort(key)
    ends = starts + _STEPS[directions]
    base = 4 * (ends[:, 1] * width + ends[:, 0])
    after = np.full(len(key), -1)
    for turn in (-1, 0, 1):
        wanted = base + (directions + turn) % 4
        place = np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)
        found = order[place]
        after = np.where(key[found] == wanted, found, after)
    return after


def _cycles(after: Ints) -> list[Ints]:
    """Split a permutation into its cycles."""
    following = after.tolist()
    seen = bytearray(len(following))
    cycles = []
    for first in range(len(following)):
        if seen[first]:
            continue
        cycle, current = [], first
        while not seen[current]:
            seen[current] = 1
            cycle.append(current)
            current = following[current]
        cycles.append(np.array(cycle))
    return cycles


_HARDLY_RAD = float(np.radians(25.0))
_ON_BREAK = 2
_SIZES = np.array([4, 8])
_REACH = np.array([0.51, 0.8, np.inf])
"""How far, in cells, lines through few midpoints may carry a corner: up to 4 (both sections), up
to 8, more. The corner of a right angle lies 0.5 from the nearest midpoint."""
FEWEST_CORNERS = 4


@dataclass(slots=True, kw_only=True)
class CellWalls:
    """All loops of one region, one after the other; lengths in cells.

    Attributes
    ----------
    midpoints
        Shape (n, 2), the traced loops; the first of each is a break.
    first
        Shape (r,), increasing: where each loop begins in ``midpoints``.
    tolerance
        Shape (r,): how far each loop may be from the result.
    breaks
        Shape (m,), increasing indices of midpoints: where the loops are split into m sections,
        at least four each. Section k runs from break k to the next break of its loop.
    holds
        Shape (m,): how closely a corner is held: 0, where the two lines meet; 1, on the line of
        the longer section, next to its break; 2, on its break.
    corners
        Shape (m, 2), the result; placed by `fit`.
    lines
        A point on, and the direction of, the line through each section, both (m, 2).
    """

    midpoints: Floats
    first: Ints
    tolerance: Floats
    breaks: Ints
    holds: Ints
    corners: Floats = field(init=False)
    lines: tuple[Floats, Floats] = field(init=False)

    def __post_init__(self) -> None:
        self.fit()

    @property
    def sizes(self) -> Ints:
        """Number of midpoints in each section, its first break included, its last not."""
        return np.diff(np.append(self.breaks, len(self.midpoints)))

    @property
    def loop(self) -> Ints:
        """The loop that each section belongs to."""
        return np.searchsorted(self.first, self.breaks, side="right") - 1

    @property
    def opening(self) -> Ints:
        """The first section of each loop."""
        return np.searchsorted(self.breaks, self.first)

    @property
    def after(self) -> Ints:
        """The section that follows each section."""
        opening = self.opening
        following = np.arange(1, len(self.breaks) + 1)
        following[np.append(opening[1:], len(self.breaks)) - 1] = opening
        return following

    @property
    def before(self) -> Ints:
        """The section before each section."""
        return np.argsort(self.after)

    def deviation(self) -> Floats:
        """Return, for every section, the Hausdorff distance to its segment, or a little more.

        It is the largest distance of the section's lattice points to the segment and of its ends
        to the segment's ends; a path that stays within some distance of a straight segment and
        has its ends so near to the segment's cannot leave any part of the segment farther off.
        """
        following = np.arange(1, len(self.midpoints) + 1)
        following[np.append(self.first[1:], len(self.midpoints)) - 1] = self.first
        lattice = corners_between(self.midpoints, self.midpoints[following])
        section, after = np.repeat(np.arange(len(self.breaks)), self.sizes), self.after
        ends = self.corners[after]
        off = _distance_to_segments(lattice, self.corners[section], ends[section])
        at_ends = np.hypot(*(self.corners - self.midpoints[self.breaks]).T)
        between = np.maximum.reduceat(off, self.breaks)
        return np.asarray(np.maximum(between, np.maximum(at_ends, at_ends[after])))

    def turns_rad(self) -> Floats:
        """Return by how much the loop turns at each corner, 0 to pi."""
        ahead = unit(self.corners[self.after] - self.corners)
        behind = ahead[self.before]
        sine, cosine = _cross_products(behind, ahead), np.sum(behind * ahead, axis=1)
        return np.asarray(np.abs(np.arctan2(sine, cosine)))

    def strays(self) -> Mask:
        """Return for every section whether it is farther from its loop than the tolerance."""
        return np.asarray(self.deviation() > self.tolerance[self.loop] + 1e-9)

    def refine(self, sections: Mask) -> bool:
        """Follow the trace more closely in some sections, by one step.

        The steps: hold their ends on the longer line, split them, hold their ends on the breaks.
        """
        after = self.after
        loose = (self.holds == 0) | (self.holds == 0)[after]
        long = self.sizes > 1
        split = np.flatnonzero(sections & ~loose & long)
        extra = np.array([self._farthest(int(k), int(after[k])) for k in split], dtype=np.int64)
        closer = sections & (loose | ~long)
        ends = (closer | closer[self.before]) & (self.holds < _ON_BREAK)
        breaks = np.concatenate([self.breaks, extra])
        holds = np.concatenate([self.holds + ends, np.full(len(extra), _ON_BREAK)])
        order = np.argsort(breaks)
        self.breaks, self.holds = breaks[order], holds[order]
        self.fit()
        return bool(len(extra) or ends.any())

    def fit(self) -> None:
        """Place the corners, as `holds` says, each as near to its break as can be trusted."""
        on_break, before = self.midpoints[self.breaks], self.before
        self.lines = point, direction = self._lines()
        sizes, sizes_before = self.sizes, self.sizes[before]
        longer = np.where(sizes_before > sizes, before, np.arange(len(before)))
        foot = _feet_on_lines(on_break, point[longer], direction[longer])
        behind, arriving = point[before], direction[before]
        sine = _cross_products(arriving, direction)
        parallel = np.abs(sine) < _PARALLEL_SINE
        along = _cross_products(point - behind, direction) / np.where(parallel, 1.0, sine)
        feet = (
            _feet_on_lines(on_break, behind, arriving),
            _feet_on_lines(on_break, point, direction),
        )
        # Where nearly parallel lines meet says nothing.
        meeting = np.where(
            parallel[:, None], 0.5 * (feet[0] + feet[1]), behind + along[:, None] * arriving
        )
        trust = _REACH[np.searchsorted(_SIZES, np.minimum(sizes, sizes_before))]
        reach = np.minimum(self.tolerance[self.loop], trust)
        self.corners = on_break
        for hold, choice in ((1, foot), (0, meeting)):
            near = (np.hypot(*(choice - on_break).T) <= reach) & (self.holds <= hold)
            self.corners = np.where(near[:, None], choice, self.corners)

    def settle(self) -> None:
        """Move each break to the midpoint nearest to its corner and fit again, a few times."""
        window = 3
        shift = np.arange(-window, window + 1)
        settling_rounds = 3
        for _ in range(settling_rounds):
            room = (np.minimum(self.sizes, self.sizes[self.before]) - 1) // 2
            room[self.opening] = 0
            near = self.midpoints[(self.breaks[:, None] + shift) % len(self.midpoints)]
            off = np.hypot(*np.moveaxis(near - self.corners[:, None], 2, 0))
            off[np.abs(shift) > room[:, None]] = np.inf
            self.breaks = self.breaks + shift[np.argmin(off, axis=1)]
            self.fit()

    def divide(self) -> None:
        """Split long sections that stray where they stray most, and settle, until none is left."""
        worth_dividing = 6
        while True:
            split = self.strays() & (self.sizes >= worth_dividing)
            if not split.any():
                return
            after = self.after
            extra = [self._farthest(int(k), int(after[k])) for k in np.flatnonzero(split)]
            breaks = np.append(self.breaks, np.array(extra, dtype=np.int64))
            order = np.argsort(breaks)
            self.breaks = breaks[order]
            self.holds = np.append(self.holds, np.zeros(len(extra), dtype=np.int64))[order]
            self.fit()
            self.settle()

    def merge(self) -> None:
        """Drop breaks at which a loop hardly turns, where one line does as well as two.

        The splitting leaves some inside walls that are straight: it only ever looks at chords
        between traced points, which lie up to half a cell off the wall.
        """
        needed = np.zeros(len(self.breaks), dtype=np.bool_)
        needed[self.opening] = True
        # In square cells: a break must lower the sum of squared distances of the cell edges'
        # middles to their lines by this much. A straight wall's edges scatter by 0.29 about it
        # (evenly within a cell); two more numbers to fit are worth 2 * 0.29**2 * log(n), about 1,
        # by the Bayesian criterion.
        worth_a_break = 1.0
        while True:
            after, before = self.after, self.before
            turn = self.turns_rad()
            turn[needed | (self.holds > 0)] = np.inf
            dropped = (turn <= turn[before]) & (turn < turn[after]) & (turn < _HARDLY_RAD)
            left = np.bincount(self.loop, weights=~dropped, minlength=len(self.first))
            # No two neighbours, and every loop keeps enough.
            dropped = dropped & (left >= FEWEST_CORNERS)[self.loop]
            if not dropped.any():
                return
            kept = ~dropped
            # Breaks that were needed are put back.
            trial = CellWalls(
                midpoints=self.midpoints,
                first=self.first,
                tolerance=self.tolerance,
                breaks=self.breaks[kept],
                holds=self.holds[kept],
            )
            parts = np.add.reduceat(self._misfit(), np.flatnonzero(kept))
            bad = trial.strays() | (trial._misfit() > parts + worth_a_break)
            owner = np.searchsorted(trial.breaks, self.breaks[dropped], side="right") - 1
            back = np.flatnonzero(dropped)[bad[owner]]
            kept[back] = needed[back] = True
            self.breaks, self.holds = self.breaks[kept], self.holds[kept]
            self.fit()
            needed = needed[kept]

    def _misfit(self) -> Floats:
        """Return for every section the sum of squared distances of its midpoints to its line."""
        point, direction = self.lines
        section = np.repeat(np.arange(len(self.breaks)), self.sizes)
        off = _cross_products(self.midpoints - point[section], direction[section])
        off[self.breaks] = 0.0
        return np.asarray(np.add.reduceat(off * off, self.breaks))

    def _lines(self) -> tuple[Floats, Floats]:
        """Return a point on, and the direction of, the line through each section.

        The breaks themselves are left out, they belong to two lines. A short section takes the
        direction of its chord and all of its points, which halves what one odd cell can do.
        """
        on_break, count = self.midpoints[self.breaks], self.sizes - 1
        chord = on_break[self.after] - on_break
        section = np.repeat(np.arange(len(count)), self.sizes)
        inner = np.ones((len(self.midpoints), 1))
        inner[self.breaks] = 0.0
        local = (self.midpoints - on_break[section]) * inner
        total = np.add.reduceat(local, self.breaks)
        enough_to_fit = 4
        short = (count < enough_to_fit)[:, None]
        number = np.where(short[:, 0], count + 2, count)[:, None]
        middle = (total + np.where(short, chord, 0.0)) / number
        x, y = ((local - middle[section]) * inner).T
        xx, yy, xy = (np.add.reduceat(values, self.breaks) for values in (x * x, y * y, x * y))
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        direction = np.column_stack([np.cos(angle), np.sin(angle)])
        direction = np.where(short, unit(chord), direction)
        direction *= np.where(np.sum(direction * chord, axis=1) < 0.0, -1.0, 1.0)[:, None]
        return middle + on_break, direction

    def _farthest(self, section: int, after: int) -> int:
        """Return the index of the midpoint farthest from the chord of a section of 2 or more."""
        low, size = self.breaks[section], self.sizes[section]
        chord = self.midpoints[self.breaks[[section, after]]]
        inner = self.midpoints[low + 1 : low + size]
        return int(low + 1 + np.argmax(_distance_to_segments(inner, chord[:1], chord[1:])))


_SHARP = float(np.cos(np.radians(115.0)))


def _split_loops(loops: list[Floats], tolerance: Floats) -> CellWalls:
    """Return loops as fitted walls without needless breaks."""
    # Each begins at an extreme, where it surely has a corner.
    far = np.array([1.0, 0.618])
    turned = [np.roll(loop, -int(np.argmin(loop @ far)), axis=0) for loop in loops]
    rough = _split(turned, tolerance)
    walls = _split(_from_best_corner(rough), tolerance)
    walls.divide()
    walls.merge()
    walls.settle()
    return walls


def _split(loops: list[Floats], tolerance: Floats) -> CellWalls:
    """Split loops where chords between their midpoints bend, beginning at their first."""
    closed = [np.vstack([loop, loop[:1]]) for loop in loops]
    owner = np.repeat(np.arange(len(loops)), [len(loop) for loop in closed])
    lines = shapely.linestrings(np.concatenate(closed), indices=owner)
    size = np.array([np.ptp(loop, axis=0).max() for loop in loops])
    small_cells = 20.0  # smaller loops are split more finely: a pillar has no straight walls
    # In cells: the middles of a straight wall's cell edges lie up to 0.5 to both of its sides, so a
    # chord between two of them may have others 1 off it and still all belong to one wall.
    straight = 1.05
    coarse = np.where(size > small_cells, straight, 0.0)
    allowed = np.maximum(tolerance - CORNER_CUT, coarse)
    kept = shapely.simplify(lines, allowed, preserve_topology=False)
    first = np.cumsum([0, *(len(loop) for loop in loops[:-1])])
    breaks = [
        start + _breaks(loop, shapely.get_coordinates(line)[:-1])
        for start, loop, line in zip(first, loops, kept, strict=True)
    ]
    walls = CellWalls(
        midpoints=np.concatenate(loops),
        first=first,
        tolerance=tolerance,
        breaks=np.concatenate(breaks),
        holds=np.zeros(sum(len(part) for part in breaks), dtype=np.int64),
    )
    walls.settle()
    return walls


def _from_best_corner(walls: CellWalls) -> list[Floats]:
    """Return loops turned to begin between two long walls that meet at a clear angle.

    Where a loop begins it has a corner for good, so that must be a true one.
    """
    weight = np.minimum(walls.sizes, walls.sizes[walls.before]) * walls.turns_rad()
    openings = np.append(walls.opening, len(weight))
    ends = np.append(walls.first, len(walls.midpoints))
    loops = []
    for low, high, begin, end in zip(openings[:-1], openings[1:], ends[:-1], ends[1:], strict=True):
        best = low + int(np.argmax(weight[low:high]))
        loops.append(np.roll(walls.midpoints[begin:end], begin - walls.breaks[best], axis=0))
    return loops


def _breaks(loop: Floats, kept: Floats) -> Ints:
    """Return the indices of the midpoints kept, and the other necessary breaks."""
    # Twice a midpoint is whole, and no midpoint comes twice: a number names each exactly.
    weights = np.array([2.0, 2.0**27])
    names = loop @ weights
    order = np.argsort(names)
    breaks = np.sort(order[np.searchsorted(names[order], kept @ weights)])
    # The tip of a thin wall is split on both of its sides: it has an end, not a needle's point.
    ahead = unit(np.roll(loop[breaks], -1, axis=0) - loop[breaks])
    turn = np.sum(ahead * np.roll(ahead, 1, axis=0), axis=1)
    sharp = breaks[turn < _SHARP]
    both = np.concatenate([breaks[turn >= _SHARP], sharp - 1, sharp + 1]) % len(loop)
    breaks = np.unique(np.append(both, 0))
    if len(breaks) >= FEWEST_CORNERS:
        return breaks
    evenly = np.arange(FEWEST_CORNERS) * len(loop) // FEWEST_CORNERS
    return np.unique(np.append(breaks, evenly))


_LEAST_TOLERANCE = 0.75
"""In cells. The corners of a straight wall's cells lie up to 0.71 off it, so below this stairs
could not be told from walls."""

LEAST_GAP = 0.3
"""In cells: walls of the result stay this far apart (the trace's keep 0.7), so that a wall one
cell thick neither vanishes nor opens, and a passage one cell wide does not close."""


Lines = NDArray[np.object_]


@dataclass(frozen=True, slots=True)
class Straightened:
    """A polygon and how far it is from the boundary of its cells; in cells.

    Attributes
    ----------
    polygon
        Valid; as many holes as the trace has.
    deviation
        Bound of the Hausdorff distance between the two boundaries.
    """

    polygon: Polygon
    deviation: float


def straighten(loops: list[Floats], tolerance: float) -> Straightened:
    """Return a polygon whose walls follow traced loops within a tolerance.

    Loops that are rectangles are kept as they are. Small and thin loops are followed more
    closely, to 0.1 of their size and half of their thickness, so that a pillar stays a pillar.
    Where straight walls stray, come too near to each other or jump over each other they are taken
    back towards the trace, step by step, and there only; the trace itself has none of these
    faults, so this ends.

    Parameters
    ----------
    loops
        From `boundary_loops` of one 4-connected region: the outer boundary, which runs
        counter-clockwise, and its holes, in any order.
    """
    rectangles = [_rectangle(loop) for loop in loops]
    fixed = [rectangle for rectangle in rectangles if rectangle is not None]
    rough = [loop for loop, rectangle in zip(loops, rectangles, strict=True) if rectangle is None]
    if not rough:
        return Straightened(_polygon(fixed), 0.0)
    own = list[float]()  # small and thin loops have tolerances of their own
    thin_share = 0.5
    small_share = 0.1
    for loop in rough:
        size = float(np.ptp(loop, axis=0).max())
        thickness = 2.0 * float(Polygon(loop).area) / len(loop)
        least = min(tolerance, small_share * size, thin_share * thickness)
        own.append(max(_LEAST_TOLERANCE, least))
    walls = _split_loops(rough, np.array(own))
    while _refine(walls, fixed):
        pass
    return Straightened(_polygon(_rings(walls, fixed)), float(walls.deviation().max()))


def _rectangle(loop: Floats) -> Floats | None:
    """Return the corners of a loop that is a rectangle of cells, else None."""
    low, high = loop.min(axis=0), loop.max(axis=0)
    if len(loop) != 2 * round(float((high - low).sum())):
        return None
    lattice = corners_between(loop, np.roll(loop, -1, axis=0))
    at_corner = ((lattice == low) | (lattice == high)).all(axis=1)
    return lattice[at_corner] if at_corner.sum() == 4 else None


def _rings(walls: CellWalls, fixed: list[Floats]) -> list[Floats]:
    return [*np.split(walls.corners, walls.opening[1:]), *fixed]


def _polygon(rings: list[Floats]) -> Polygon:
    outer = _outer(np.array([Polygon(ring) for ring in rings]))
    return Polygon(rings[outer], [ring for index, ring in enumerate(rings) if index != outer])


def _outer(solids: Lines) -> int:
    return int(np.argmax(shapely.area(solids)))


def _refine(walls: CellWalls, fixed: list[Floats]) -> bool:
    """Take one step at every fault of the kind that comes first; return whether there was one."""
    bad = walls.strays()
    if not bad.any():
        rings = _rings(walls, fixed)
        ends = np.cumsum([len(ring) for ring in rings])
        pairs = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
        lines = np.asarray(shapely.linestrings(np.concatenate(pairs)))
        faults = _too_near(lines, ends)
        if not len(faults):
            faults = _jumping(rings, lines, ends)
        bad[faults[faults < len(bad)]] = True
    return walls.refine(bad)


def _too_near(lines: Lines, ends: Ints) -> Ints:
    """Return the indices of segments that come too near to others."""
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=LEAST_GAP)
    one, two = one[one < two], two[one < two]
    owner = np.searchsorted(ends, np.arange(len(lines)), side="right")
    size = np.diff(ends, prepend=0)[owner[one]]
    steps = np.minimum(two - one, size - (two - one))
    # Next neighbours may be joined by a short wall; that is a fault only if they cross.
    crossing = (steps == 2) & shapely.intersects(lines[one], lines[two])
    clash = (owner[one] != owner[two]) | (steps > 2) | crossing
    return np.concatenate([one[clash], two[clash]])


def _jumping(rings: list[Floats], lines: Lines, ends: Ints) -> Ints:
    """Return the indices of segments that leave another ring on the wrong side, crossing none."""
    solids = np.array([Polygon(ring) for ring in rings])
    outer = _outer(solids)
    spots = shapely.points(np.array([ring[0] for ring in rings]))
    inside, around = shapely.STRtree(solids).query(spots, predicate="within")
    lost = np.setdiff1d(np.arange(len(rings)), np.append(inside[around == outer], outer))
    eaten = around != outer
    pairs = [(int(ring), outer) for ring in lost]
    pairs += zip(inside[eaten].tolist(), around[eaten].tolist(), strict=True)
    starts = ends - np.diff(ends, prepend=0)
    found = [np.empty(0, dtype=np.int64)]
    for ring, jumper in pairs:
        off = shapely.distance(lines[starts[jumper] : ends[jumper]], solids[ring])
        found.append(starts[jumper] + np.flatnonzero(off <= off.min() + _LEAST_TOLERANCE))
    return np.concatenate(found)


MOST_OBSTACLES, MANY_EDGES, MOST_EDGES = 5000, 300_000, 4_000_000
"""Most obstacles of a grid whose walls have many cell edges, and most edges of any: beyond, a grid
is noise, which takes minutes to straighten and which no robot can be planned in."""

LEAST_CELL_MM = 0.01
LARGEST_CELL_MM = 1e6
"""Cells outside this range are not those of a map in millimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridPlacement:
    """Where a grid of cells lies in the map."""

    cell_mm: float  # width of a cell, at least 0.01
    # x_mm, y_mm: map position of the lower left corner of the lowest left cell
    x_mm: float = 0.0
    y_mm: float = 0.0
    turn_rad: float = 0.0  # by how much the grid is turned about that corner, counter-clockwise

    def __post_init__(self) -> None:
        number("cell_mm", self.cell_mm, LEAST_CELL_MM, LARGEST_CELL_MM, "mm")
        number("x_mm", self.x_mm, -1e7, 1e7, "mm")
        number("y_mm", self.y_mm, -1e7, 1e7, "mm")
        number("turn", self.turn_rad, -7.0, 7.0, "rad")

    def to_map(self, polygon: Polygon) -> Polygon:
        """Return a polygon in cells as one in map coordinates, rounded to 1e-4 mm."""
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        rotation = self.cell_mm * np.array([[cosine, sine], [-sine, cosine]])

        def place(points: Floats) -> Floats:
            moved = points @ rotation + np.array([self.x_mm, self.y_mm])
            return rounded_points(moved)

        return shapely.transform(polygon, place)

    def at_cell(self, row: int, column: int) -> tuple[float, float]:
        """Return the position of the middle of a cell, mm."""
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        along, up = self.cell_mm * (column + 0.5), self.cell_mm * (row + 0.5)
        x, y = self.x_mm + cosine * along - sine * up, self.y_mm + sine * along + cosine * up
        return float(x), float(y)

    def cell_at(self, pose: Pose) -> tuple[int, int]:
        """Return row (from the lowest) and column of the cell that holds a position."""
        x, y = pose.x_mm - self.x_mm, pose.y_mm - self.y_mm
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        column = (cosine * x + sine * y) / self.cell_mm
        row = (-sine * x + cosine * y) / self.cell_mm
        return int(np.floor(row)), int(np.floor(column))


def raster_map(
    name: str,
    free: Mask,
    placement: GridPlacement,
    options: ImportOptions,
    facts: Mapping[str, object],
) -> Map:
    """Return the map of one connected free region in a grid of cells.

    The region is the largest one, or the one with the start. Its outer boundary is the map's
    bounds and every solid island in it is an obstacle. Solid cells around it are not drawn as an
    obstacle in a box: a robot cannot tell, and a printed rig needs walls around the free space,
    not a plate as large as the image.

    Parameters
    ----------
    options
        Walls lie within ``simplify_mm`` of the boundary of the cells, by default one cell, at least
        0.75 of a cell; kept but for the rounding to 1e-4 mm.
    """
    tolerance_mm = placement.cell_mm if options.simplify_mm is None else options.simplify_mm
    positive("simplify_mm", tolerance_mm)
    least_mm2 = number("least_obstacle_mm2", options.least_obstacle_mm2 or 0.0, 0.0, 1e14, "mm2")
    least_mm = _LEAST_TOLERANCE * placement.cell_mm
    if tolerance_mm < least_mm * (1.0 - 1e-9):
        raise BadInputError(
            "simplify_mm", tolerance_mm, f"at least {least_mm:.6g} mm, 0.75 of a cell"
        )
    region, corner, left_out = _region(free, placement, options.start)
    islands = _Islands.of(region, least_mm2 / placement.cell_mm**2)
    obstacles = len(islands.loops) - 1
    edges = sum(len(loop) for loop in islands.loops)
    if edges > MOST_EDGES or (edges > MANY_EDGES and obstacles > MOST_OBSTACLES):
        raise BadInputError(
            "image",
            f"{counted(obstacles, 'obstacle')} with {edges} cell edges, as of noise",
            f"at most {MOST_OBSTACLES} obstacles where there are more than {MANY_EDGES} edges, and "
            f"{MOST_EDGES} edges; leave small ones out (--least-obstacle-mm2), or smooth the image "
            "with a median filter",
        )
    result = straighten(islands.loops, max(tolerance_mm / placement.cell_mm, _LEAST_TOLERANCE))
    walls = placement.to_map(shapely.transform(result.polygon, lambda cells: cells + corner))
    rings = 1 + len(result.polygon.interiors)
    if (pose := options.start) is None:
        start = roomiest_start(walls, shapely.maximum_inscribed_circle(walls, tolerance_mm))
    elif shapely.intersects_xy(walls, pose.x_mm, pose.y_mm):
        start = Start(pose=pose)
    else:
        allowed = f"a place farther than {tolerance_mm:g} mm from walls"
        raise BadInputError("start", f"({pose.x_mm:g}, {pose.y_mm:g}) mm", allowed)
    return Map(
        name=name,
        bounds=Polygon(walls.exterior),
        obstacles=tuple(Polygon(ring) for ring in walls.interiors),
        starts=(start,),
        environment="raster",
        facts={
            **facts,
            "simplify_mm": tolerance_mm,
            **left_out,
            **islands.facts(placement.cell_mm),
            "walls": int(shapely.get_num_coordinates(result.polygon)) - rings,
            "deviation_mm": result.deviation * placement.cell_mm,
            "free_area_of_cells_mm2": float(region.sum()) * placement.cell_mm**2,
            "free_area_of_walls_mm2": result.polygon.area * placement.cell_mm**2,
        },
    )


@dataclass(frozen=True, slots=True)
class _Islands:
    """The loops of a region without those of obstacles that are too small."""

    loops: list[Floats]
    dropped_cells2: list[float]

    @classmethod
    def of(cls, region: Mask, least_cells2: float) -> "_Islands":
        loops = boundary_loops(region)
        # The shoelace formula on midpoints misses half a cell: the four corners cut off.
        areas = [float(Polygon(loop).area) + 0.5 for loop in loops]
        outer = int(np.argmax(areas))
        kept = [index == outer or area >= least_cells2 for index, area in enumerate(areas)]
        return cls(
            [loop for loop, keep in zip(loops, kept, strict=True) if keep],
            [area for area, keep in zip(areas, kept, strict=True) if not keep],
        )

    def facts(self, cell_mm: float) -> dict[str, object]:
        return {
            "obstacles_left_out": len(self.dropped_cells2),
            "largest_obstacle_left_out_mm2": cell_mm**2 * max(self.dropped_cells2, default=0.0),
            "traced_cell_edges": sum(len(loop) for loop in self.loops),
        }


def _region(
    free: Mask, placement: GridPlacement, start: Pose | None
) -> tuple[Mask, Floats, dict[str, object]]:
    """Return the selected region, cropped, its lower left corner in cells, and the parts left out.

    The labels of all cells are freed here: they take four times as much as the cells.
    """
    labels, count = scipy.ndimage.label(free)
    if count == 0:
        raise BadInputError("image", "no free cell", "at least one free cell")
    # Row by row: `bincount` copies what it counts as 8-byte integers.
    sizes = np.zeros(count + 1, dtype=np.int64)
    for cells in labels:
        np.add.at(sizes, cells, 1)
    sizes[0] = 0
    wanted = int(sizes.argmax())
    if start is not None:
        row, column = placement.cell_at(start)
        inside = 0 <= row < labels.shape[0] and 0 <= column < labels.shape[1]
        wanted = int(labels[row, column]) if inside else 0
        if wanted == 0:
            place = f"({start.x_mm:g}, {start.y_mm:g}) mm"
            raise BadInputError("start", place, "a free cell")
    rows, columns = scipy.ndimage.find_objects(labels, max_label=wanted)[wanted - 1]
    left_out: dict[str, object] = {
        "free_regions_left_out": count - 1,
        "free_area_left_out_mm2": float(sizes.sum() - sizes[wanted]) * placement.cell_mm**2,
    }
    corner = np.array([columns.start, rows.start], dtype=np.float64)
    region = np.asarray(labels[rows, columns] == wanted, dtype=np.bool_)
    kept, sizes[wanted] = int(sizes[wanted]), 0
    # Less, as behind thin walls and of noise, says nothing about the map.
    least_told_share = 0.1
    if sizes.sum() > least_told_share * kept:
        spot = placement.at_cell(*_inner_cell(labels, int(sizes.argmax())))
        other = "--unknown free, or another --obstacles of a photo, reads its cells another way"
        mm2 = float(sizes.sum()) * placement.cell_mm**2
        left_out |= free_apart(mm2, spot, in_map=False, other=other)
    return region, corner, left_out


def _inner_cell(labels: NDArray[np.signedinteger], wanted: int) -> tuple[int, int]:
    """Return row and column of a cell far from the edge of a labelled region."""
    rows, columns = scipy.ndimage.find_objects(labels, max_label=wanted)[wanted - 1]
    crop = np.pad(labels[rows, columns] == wanted, 1)
    most_cells = 1_000_000
    step = max(1, math.isqrt(crop.size // most_cells))
    depth = scipy.ndimage.distance_transform_cdt(crop[::step, ::step])
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    return rows.start - 1 + int(row) * step, columns.start - 1 + int(column) * step
