"""Boundaries of regions of cells as rings of straight walls, with a bounded deviation.

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

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints

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
    is 4-connected and what is not in it 8-connected: a wall drawn one cell thick along a
    diagonal stays closed. Outside the array is outside the region.

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
_WORTH_A_BREAK = 1.0
"""In square cells: a break must lower the sum of squared distances of the cell edges' middles to
their lines by this much. A straight wall's edges scatter by 0.29 about it (evenly within a cell);
two more numbers to fit are worth 2 * 0.29**2 * log(n), about 1, by the Bayesian criterion."""
_ENOUGH_TO_FIT = 4
_ON_BREAK = 2
_SIZES = np.array([4, 8])
_REACH = np.array([0.51, 0.8, np.inf])
"""How far, in cells, lines through few midpoints may carry a corner: up to 4 (both sections), up
to 8, more. The corner of a right angle lies 0.5 from the nearest midpoint."""
_WORTH_DIVIDING = 6
_SETTLING_ROUNDS = 3
_WINDOW = 3
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
        the longer section, beside its break; 2, on its break.
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
        shift = np.arange(-_WINDOW, _WINDOW + 1)
        for _ in range(_SETTLING_ROUNDS):
            room = (np.minimum(self.sizes, self.sizes[self.before]) - 1) // 2
            room[self.opening] = 0
            near = self.midpoints[(self.breaks[:, None] + shift) % len(self.midpoints)]
            off = np.hypot(*np.moveaxis(near - self.corners[:, None], 2, 0))
            off[np.abs(shift) > room[:, None]] = np.inf
            self.breaks = self.breaks + shift[np.argmin(off, axis=1)]
            self.fit()

    def divide(self) -> None:
        """Split long sections that stray where they stray most, and settle, until none is left."""
        while True:
            split = self.strays() & (self.sizes >= _WORTH_DIVIDING)
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
        between traced points, which lie up to half a cell beside the wall.
        """
        needed = np.zeros(len(self.breaks), dtype=np.bool_)
        needed[self.opening] = True
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
            bad = trial.strays() | (trial._misfit() > parts + _WORTH_A_BREAK)
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
        short = (count < _ENOUGH_TO_FIT)[:, None]
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
