"""Centre lines of a grown robot, traced on the film of a photo.

The design says how many tubes there are, how wide and how long, and how they hang together; the map
says where none can be. So the film is explained by a tree of tubes, level by level: for every
branch some courses are proposed (what the growth model would do from where its parent was seen to
end, and straight runs of film that follow each other), and those courses are chosen together that
cover most film and least floor. The lines are then fitted to the film's edges on both sides, at
fractions of a pixel, all at once, children hanging on their parents' ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise, product

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import LineString

from vinefab.core.limits import deg, rad
from vinefab.core.validation import Floats
from vinefab.growth.batch import grow_on
from vinefab.growth.options import CONTACT_ANGLES_DEG, GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.design import Build, Design, Trunk
from vinefab.model.map import Map, Pose
from vinefab.model.tree import BranchTree
from vinefab.observation.film import SeenFilm
from vinefab.physics.tube import inflated_radius_mm

_TURNS_DEG = (0.0, -1.5, 1.5, -3.0, 3.0, -6.0, 6.0, -10.0, 10.0)
"""Launch headings around the planned one from which a branch's courses are simulated."""


BLUR_MM = 1.2
"""Film so near to a tube may be its blurred edge."""


_GAP_MM = 3.0
"""Shorter stretches without film do not end a branch."""

_KINK_MM, _BEND_MM, _KINK_DEG = 1.5, 0.2, 12.0
"""Each kink of a course counts as so many millimetres of its film less, so that kinks need a
reason; corners of a smooth bend, of fewer degrees, cost hardly anything: real branches bend."""


_UNSEEN, _UNSEEN_LEAF = 0.03, 0.15
"""Area of a course where film cannot be seen counts as this share of it being floor. Children that
are seen farther on speak for a parent that is not, and they come later."""

_COVERED = 0.03
"""Area of a course that others cover counts as this share of it being floor."""


_ROUNDS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TracedBranch:
    """One branch as it was seen."""

    points_mm: Floats  # its centre line from base to tip, shape (k, 2); empty if none was seen
    corners_mm: Floats  # the same with straight stretches between its bends
    length_mm: float  # length of the line
    ends_early: bool  # whether it is shorter than planned
    # median inflated diameter between the edges seen; NaN where no two edges were seen
    width_mm: float
    seen: float  # share of its length where an edge of it was seen
    told_apart: float  # share of its area that no other branch covers

    @property
    def deployed(self) -> bool:
        """Whether any of it was seen."""
        return len(self.points_mm) > 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TracedTree:
    """All branches of a design as they were seen."""

    tree: BranchTree  # the planned branches
    branches: tuple[TracedBranch, ...]  # one for each of them
    film_explained: float  # share of the film that lies in them
    lines_supported: float  # share of their area, where it can be seen, that is film


def trace(film: SeenFilm, design: Design, world: Map, pose: Pose) -> TracedTree:
    """Return the centre lines of a design on the film of a photo.

    Parameters
    ----------
    pose
        Where the trunk was launched, as measured by hand; the line begins where the film says,
        some millimetres from it.
    """
    return _Tracing(film, design, world, pose).traced()


@dataclass(slots=True, eq=False)
class _Course:
    """One way that a branch may have gone."""

    chain_mm: Floats
    cells: NDArray[np.int64]  # of the coarse raster that its tube covers
    around: NDArray[np.int64]  # the same with a rim, which speaks for no other tube
    worth: float  # what it gains or loses besides film, in mm2
    ends_early: bool


@dataclass(slots=True, eq=False)
class _Tracing:
    """What the tracing of one photo works with."""

    film: SeenFilm
    design: Design
    world: Map
    pose: Pose
    tree: BranchTree = field(init=False)
    radius_mm: list[float] = field(init=False)  # of each branch
    chains: list[Floats] = field(init=False)  # of each branch; empty where none
    early: list[bool] = field(init=False)
    patches: list[NDArray[np.int64]] = field(init=False)  # cells that each branch covers
    coarse: "_Coarse" = field(init=False)
    terrain: Terrain = field(init=False)

    def __post_init__(self) -> None:
        self.tree = self.design.tree
        self.radius_mm = [inflated_radius_mm(width) for width in self.tree.width_mm.tolist()]
        nothing = np.zeros((0, 2))
        self.chains = [nothing] * len(self.tree)
        self.early = [False] * len(self.tree)
        self.patches = [np.zeros(0, dtype=np.int64)] * len(self.tree)
        self.coarse = _Coarse.of(self.film, float(np.median(self.radius_mm)))
        self.terrain = Terrain.of(self.world)

    def traced(self) -> TracedTree:
        """Trace level by level, then fit all lines."""
        for level in range(1, int(self.tree.level.max()) + 1):
            self._choose(np.flatnonzero(self.tree.level == level).tolist())
            _fit(self, rounds=2)
        _fit(self, rounds=_ROUNDS)
        cover, lines = self.wide_cover(), list[tuple[Floats, float, float]]()
        for branch, chain in enumerate(self.chains):  # line, median width and share seen
            if len(chain) < 2:
                lines.append((np.zeros((0, 2)), float("nan"), 0.0))
                continue
            edges = _edges(self, branch, cover)
            fine = edges.points + edges.smoothed()[:, None] * edges.side
            points = np.vstack([chain[:1], fine, chain[-1:]])
            known = edges.width[np.isfinite(edges.width)]
            width = float(np.median(known)) if len(known) else float("nan")
            lines.append((points, width, float(np.isfinite(edges.off).mean())))
        for branch, (points, width, _) in enumerate(lines):
            # Seams lie next to a tube: its film is as wide as it is seen.
            if len(points) and width > 2.0 * self.radius_mm[branch]:
                chain = self.chains[branch]
                self.patches[branch] = self.coarse.tube(self.film, chain, 0.5 * width)
        cover, value = self.coarse.cover(self.patches), self.coarse.value
        is_film, used = value > 0.0, cover > 0
        branches = []
        for branch, (points, width, seen) in enumerate(lines):
            patch = self.patches[branch]
            branches.append(
                TracedBranch(
                    points_mm=points,
                    corners_mm=self.chains[branch],
                    length_mm=_length(points),
                    ends_early=self.early[branch],
                    width_mm=width,
                    seen=seen,
                    told_apart=float((cover[patch] == 1).mean()) if len(patch) else 0.0,
                )
            )
        explained = float((used & is_film).sum())
        return TracedTree(
            tree=self.tree,
            branches=tuple(branches),
            film_explained=explained / max(1, int(is_film.sum())),
            lines_supported=explained / max(1, int((used & (value != 0.0)).sum())),
        )

    @property
    def alive(self) -> list[int]:
        """The branches that have a line."""
        return [branch for branch in range(len(self.tree)) if len(self.chains[branch])]

    def wide_cover(self) -> NDArray[np.int64]:
        """Return the number of tubes, each with its rim, that cover each cell."""
        wide = [
            self.coarse.tube(self.film, self.chains[branch], self.radius_mm[branch] + BLUR_MM)
            for branch in self.alive
        ]
        return self.coarse.cover(wide)

    # --- Choosing courses ---

    def _choose(self, branches: list[int]) -> None:
        """Choose the courses of one level's branches together: each the best given the others.

        None may be the best.
        """
        courses = {branch: self._courses(branch) for branch in branches}
        cover = self.wide_cover()
        chosen: dict[int, _Course | None] = dict.fromkeys(branches)
        for _ in range(_ROUNDS):
            before = dict(chosen)
            for branch in branches:
                now, own = chosen[branch], courses[branch]
                if now is not None:
                    cover[now.around] -= 1
                worth = [self.coarse.gain(one.cells, cover) + one.worth for one in own]
                best = int(np.argmax(worth)) if worth else 0
                chosen[branch] = None
                if worth and worth[best] > 0.0:
                    chosen[branch] = own[best]
                    cover[own[best].around] += 1
            self._choose_pairs(branches, courses, chosen, cover)
            if all(chosen[branch] is before[branch] for branch in branches):
                break
        for branch, course in chosen.items():
            if course is not None:
                self.chains[branch], self.early[branch] = course.chain_mm, course.ends_early
                self.patches[branch] = course.cells

    def _choose_pairs(
        self,
        branches: list[int],
        courses: dict[int, list[_Course]],
        chosen: dict[int, _Course | None],
        cover: NDArray[np.int64],
    ) -> None:
        """Choose for two siblings together, which may each have taken the other's film."""
        parent = self.tree.parent
        for one, other in combinations(branches, 2):
            first, second = chosen[one], chosen[other]
            if parent[one] != parent[other] or first is None or second is None:
                continue
            now = (first, second)
            for course in now:
                cover[course.around] -= 1
            best = max(
                product(self._best_few(courses[one]), self._best_few(courses[other])),
                key=lambda pair: self._worth_of(pair, cover),
            )
            if self._worth_of(best, cover) <= self._worth_of(now, cover) + 1e-9:
                best = now
            for branch, course in zip((one, other), best, strict=True):
                cover[course.around] += 1
                chosen[branch] = course

    def _best_few(self, courses: list[_Course]) -> list[_Course]:
        """Return the courses that cover most film if no other branch did."""
        alone = {id(c): float(self.coarse.value[c.cells].sum()) + c.worth for c in courses}
        paired = 12  # so many courses of each of two siblings are tried together
        return sorted(courses, key=lambda course: -alone[id(course)])[:paired]

    def _worth_of(self, pair: tuple[_Course, _Course], cover: NDArray[np.int64]) -> float:
        """Return the joint gain of two courses, given all others."""
        one, other = pair
        total = self.coarse.gain(one.cells, cover) + one.worth + other.worth
        cover[one.around] += 1
        total += self.coarse.gain(other.cells, cover)
        cover[one.around] -= 1
        return total

    def launch(self, branch: int) -> tuple[Floats, float] | None:
        """Return base and planned heading of a branch from the seen part of its parent."""
        parent = int(self.tree.parent[branch])
        if parent < 0:
            return np.array([self.pose.x_mm, self.pose.y_mm]), self.pose.heading_rad
        chain = self.chains[parent]
        if len(chain) < 2 or self.early[parent]:
            return None
        last = chain[-1] - chain[-2]
        if np.hypot(*last) < self.radius_mm[parent]:  # the fit may bend so short an end anywhere
            last = chain[-1] - _cut(chain[::-1], 2.0 * self.radius_mm[parent])[-1]
        heading = float(np.arctan2(last[1], last[0])) + float(self.tree.offset_rad[branch])
        return chain[-1], heading

    def _courses(self, branch: int) -> list[_Course]:
        """Return the ways that a branch may have gone."""
        launched = self.launch(branch)
        if launched is None:
            return []
        base, heading = launched
        radius, length = self.radius_mm[branch], float(self.tree.length_mm[branch])
        found: list[_Course] = []
        # A stop at a wall met outside of the contact range counts as so much film less.
        steep_stop_mm = 15.0
        # Head-on half-angles of these courses: from sliding everywhere to stopping at the first
        # wall.
        stops_deg = (0.0, 5.0, 15.0, 90.0)
        for turn in _TURNS_DEG:
            known: set[bytes] = set()
            for half_angle in stops_deg:
                chain = self._simulated(base, heading + rad(turn), rad(half_angle), branch)
                if chain.tobytes() not in known:
                    # Small turns are the uncertainty of the parent's heading.
                    cost = 0.15 * radius * abs(turn)
                    if half_angle > CONTACT_ANGLES_DEG[-1]:
                        cost += 2.0 * radius * steep_stop_mm
                    self._propose(found, branch, chain, cost)
                known.add(chain.tobytes())
        # A run of film in another direction than planned counts as at most so much film less.
        most_turn_mm = 40.0
        for chain in _runs(self.film, base, heading, radius, length):
            begin = _cut(chain, 4.0 * radius)
            way = begin[-1] - begin[0]
            turn = deg(float(np.arctan2(way[1], way[0]))) - deg(heading)
            turn = abs((turn + 180.0) % 360.0 - 180.0)
            # Joints are some degrees off; more than that is another branch, or a wall's work.
            cost = 2.0 + min(most_turn_mm * 2.0, 0.15 * turn + 0.03 * turn**2)
            self._propose(found, branch, chain, cost * radius)
        return found

    def _propose(self, found: list[_Course], branch: int, chain: Floats, cost: float) -> None:
        """Add a course in full, and as far as film is seen along it."""
        if len(chain) < 2:
            return
        radius, planned = self.radius_mm[branch], float(self.tree.length_mm[branch])
        chain = _simplified(chain, 0.4)
        line = LineString(chain)
        least_length_mm = 2.0  # shorter stumps of branches cannot be told from their parents' ends
        if line.length < least_length_mm:
            return
        is_leaf = not (self.tree.parent == branch).any()
        reached = _film_along(self.film, chain, radius)
        # An end that the model explains, at full length or at a wall, counts as so much film more.
        reason_mm = 3.0
        for length in {line.length, min(line.length, reached)}:
            if length < least_length_mm:
                continue
            part = _cut(chain, length)
            cells = self.coarse.tube(self.film, part, radius)
            # Film under other film is neither for nor against; deploying is the rule.
            turn = _unplanned_turns(part, self.tree.bends_of(branch), max(4.0, radius))
            bends_mm = float(np.where(np.abs(turn) > rad(_KINK_DEG), _KINK_MM, _BEND_MM).sum())
            worth = -cost - 2.0 * radius * bends_mm
            worth += 0.02 * 2.0 * radius * length
            unseen = float((self.coarse.value[cells] == 0.0).sum()) * self.coarse.cell_mm**2
            worth -= (_UNSEEN_LEAF if is_leaf else _UNSEEN) * unseen
            if length == line.length:
                # It ends where the model says why: at its length, or at a wall.
                worth += 2.0 * radius * reason_mm
            early = is_early(length, planned)
            around = self.coarse.tube(self.film, part, radius + BLUR_MM)
            found.append(_Course(part, cells, around, worth, early))

    def _simulated(self, base: Floats, heading: float, half_angle: float, branch: int) -> Floats:
        """Return the course of one branch alone, by the growth model with a head-on half-angle."""
        radius, length = self.radius_mm[branch], float(self.tree.length_mm[branch])
        free = self.terrain.free_space(radius)
        if free.is_empty:
            return np.zeros((0, 2))
        place = shapely.Point(base)
        if not shapely.contains_xy(free, *base):
            nearest = shapely.shortest_line(free, place)
            base = shapely.get_coordinates(nearest)[0]
        width_mm = float(self.tree.width_mm[branch])
        bends = tuple((at_mm, deg(turn)) for at_mm, turn in self.tree.bends_of(branch))
        alone = Design(
            name="alone",
            trunk=Trunk(length_mm=length, bends=bends or None),
            build=Build(widths_mm=(width_mm,), fillet_mm=(), pressure_kpa=0.0),
        )
        launch = Pose(x_mm=float(base[0]), y_mm=float(base[1]), heading_rad=heading)
        options = GrowthOptions(head_on_half_angle_rad=half_angle, pressure_stop=False)
        return grow_on(alone, self.terrain, launch, options).chain_mm(0)


def _unplanned_turns(chain: Floats, bends: list[tuple[float, float]], near_mm: float) -> Floats:
    """Return the turns at a chain's corners, without what preformed bends near them account for."""
    way = np.diff(chain, axis=0)
    turn = np.diff(np.unwrap(np.arctan2(way[:, 1], way[:, 0])))
    at_mm = np.cumsum(np.hypot(*way.T))[:-1]
    for bend_mm, bend_rad in bends:
        near = np.flatnonzero(np.abs(at_mm - bend_mm) < near_mm)
        if len(near):
            turn[near[np.argmin(np.abs(turn[near] - bend_rad))]] -= bend_rad
    return np.asarray(turn)


def is_early(length_mm: float, planned_mm: float) -> bool:
    """Tell whether a branch of some length ended before its planned length."""
    # A branch ended early if it is shorter than planned by more than both of these.
    short_share = 0.03
    short_mm = 3.0
    return planned_mm - length_mm > max(short_mm, short_share * planned_mm)


# --- A coarse raster, on which courses are compared -----------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Coarse:
    """The film in cells of about a millimetre, as the plan has it."""

    value: Floats  # of each cell: its area if film, minus its area if floor, 0 where hidden, flat
    columns: int
    cell_mm: float
    left_mm: float
    top_mm: float

    @classmethod
    def of(cls, film: SeenFilm, radius_mm: float) -> "_Coarse":
        times = max(1, round(1.0 / film.view.mm_per_pixel))
        rows, columns = (size // times for size in film.share.shape)
        cut = film.share[: rows * times, : columns * times]
        share = cut.reshape(rows, times, columns, times).mean(axis=(1, 3))
        cell = times * film.view.mm_per_pixel
        x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        places = np.column_stack(
            [film.view.left_mm + x.ravel() * cell, film.view.top_mm - y.ravel() * cell]
        )
        floor = film.moved(places, film.sight.plane_mm, radius_mm)
        unseen = film.hidden(floor, radius_mm) | film.is_solid(places)
        value = np.where(unseen, 0.0, (2.0 * share.ravel() - 1.0) * cell**2)
        return cls(
            value=value,
            columns=columns,
            cell_mm=cell,
            left_mm=film.view.left_mm,
            top_mm=film.view.top_mm,
        )

    def tube(self, film: SeenFilm, chain_mm: Floats, radius_mm: float) -> NDArray[np.int64]:
        """Return the cells that a tube covers."""
        seen = film.moved(chain_mm, radius_mm, film.sight.plane_mm)
        rows = len(self.value) // self.columns
        found = []
        for a, b in pairwise(seen):
            low, high = np.minimum(a, b) - radius_mm, np.maximum(a, b) + radius_mm
            c0 = max(0, int((low[0] - self.left_mm) / self.cell_mm))
            c1 = min(self.columns, int((high[0] - self.left_mm) / self.cell_mm) + 1)
            r0 = max(0, int((self.top_mm - high[1]) / self.cell_mm))
            r1 = min(rows, int((self.top_mm - low[1]) / self.cell_mm) + 1)
            if c0 >= c1 or r0 >= r1:
                continue
            x = self.left_mm + (np.arange(c0, c1) + 0.5) * self.cell_mm
            y = (self.top_mm - (np.arange(r0, r1) + 0.5) * self.cell_mm)[:, None]
            step = b - a
            along = ((x - a[0]) * step[0] + (y - a[1]) * step[1]) / max(float(step @ step), 1e-9)
            along = along.clip(0.0, 1.0)
            d2 = (x - a[0] - along * step[0]) ** 2 + (y - a[1] - along * step[1]) ** 2
            row, column = np.nonzero(d2 <= radius_mm**2)
            found.append((row + r0) * self.columns + column + c0)
        return np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.int64)

    def cover(self, patches: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
        """Return the number of tubes that cover each cell."""
        cover = np.zeros(len(self.value), dtype=np.int64)
        for patch in patches:
            cover[patch] += 1
        return cover

    def gain(self, cells: NDArray[np.int64], cover: NDArray[np.int64]) -> float:
        """Return the film less the floor that a tube covers and no other does."""
        alone = cover[cells] == 0
        covered = len(cells) - int(np.count_nonzero(alone))
        return float(self.value[cells][alone].sum()) - _COVERED * self.cell_mm**2 * covered


# --- Lines --------------------------------------------------------------------------------------


def _length(points: Floats) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) > 1 else 0.0


def _simplified(chain: Floats, tolerance_mm: float) -> Floats:
    if len(chain) < 3:
        return chain
    return shapely.get_coordinates(shapely.simplify(LineString(chain), tolerance_mm))


def _cut(chain: Floats, length: float) -> Floats:
    """Return the beginning of a line."""
    steps = np.hypot(*np.diff(chain, axis=0).T)
    ends = np.concatenate([[0.0], np.cumsum(steps)])
    if length >= ends[-1]:
        return chain
    last = int(np.searchsorted(ends, length, side="left"))
    share = (length - ends[last - 1]) / max(steps[last - 1], 1e-9)
    tip = chain[last - 1] + share * (chain[last] - chain[last - 1])
    return np.vstack([chain[:last], tip])


def _stations(chain: Floats, step: float) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
    """Return points along a line: their stretch, share of it, place and the stretch's direction."""
    strides = np.diff(chain, axis=0)
    lengths = np.maximum(np.hypot(*strides.T), 1e-9)
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    count = max(2, int(ends[-1] / step) + 1)
    s = (np.arange(count) + 0.5) * ends[-1] / count
    stretch = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(lengths) - 1)
    share = (s - ends[stretch]) / lengths[stretch]
    way = strides[stretch] / lengths[stretch, None]
    return stretch, share, chain[stretch] + share[:, None] * strides[stretch], way


def _film_along(film: SeenFilm, chain: Floats, radius: float) -> float:
    """Return the length of film seen along a line, without longer gaps and the tip's cap."""
    _, _, points, way = _stations(chain, 1.0)
    step = _length(chain) / len(points)
    side = np.column_stack([-way[:, 1], way[:, 0]])
    seen = np.mean([film.at(points + o * radius * side, radius) for o in (-0.6, 0.0, 0.6)], axis=0)
    there = (seen > 0.6) | film.hidden(points, radius)
    missing = np.flatnonzero(~there)
    gap = max(1, round(_GAP_MM / step))
    for first in missing.tolist():
        if not there[first : first + gap].any():
            # What ends in the hidden may have gone on there.
            return max(0.0, first * step - radius)
    return _length(chain)


def _runs(
    film: SeenFilm, base: Floats, heading: float, radius: float, length: float
) -> list[Floats]:
    """Return chains of runs of film from a base on, the longest first; kinks lie between runs."""
    open_chains: list[tuple[Floats, float]] = [(base[None, :], heading)]
    done: list[Floats] = []
    for depth in range(5):
        grown: list[tuple[Floats, float, float]] = []
        begun: list[tuple[Floats, float]] = []
        for chain, way in open_chains:
            left = length - _length(chain)
            spread = np.arange(-100.0, 100.5, 2.0)
            straight = _straight(film, chain[-1], way, spread, radius, left)
            begun += [(chain, angle) for angle, _ in straight]
        for (chain, _), run in zip(begun, _followed(film, begun, radius, length), strict=True):
            whole = np.vstack([chain, run[1:]])
            done.append(whole)
            if _length(whole) >= length - 1.0 or len(run) < 3:
                continue
            for back in (0.3, 1.2):
                at = _length(run) - back * radius
                if at > max(4.0, radius):
                    corner = np.vstack([chain, _cut(run, at)[1:]])
                    last = corner[-1] - corner[-2]
                    angle = float(np.arctan2(last[1], last[0]))
                    grown.append((corner, angle, _length(corner)))
        grown.sort(key=lambda item: -item[2])
        open_chains = [(chain, angle) for chain, angle, _ in grown[:4]]
        if not open_chains or depth == 4:
            break
    done.sort(key=lambda chain: -_length(chain))
    return done[:24]


_TURN_BY_OFF, _MOST_TURN = 0.06, 0.06
"""In radians for each millimetre off the film's middle, and at most, in each stride."""


def _followed(
    film: SeenFilm, begun: Sequence[tuple[Floats, float]], radius: float, length: float
) -> list[Floats]:
    """Return runs of film that bend, each from the end of a chain and a direction on.

    A run keeps to the middle between both edges; next to other film, it goes straight.
    """
    if not begun:
        return []
    place = np.array([chain[-1] for chain, _ in begun])
    angle = np.array([way for _, way in begun])
    left = np.array([length - _length(chain) for chain, _ in begun])
    runs = [[point] for point in place]
    stride_mm = 2.0
    gap, alive = np.zeros(len(begun)), left > stride_mm
    out = np.arange(-1.9 * radius, 1.9 * radius + 0.25, 0.5)
    middle = len(out) // 2
    for stride in range(int(left.max() / stride_mm) + 1):
        if not alive.any():
            break
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        side = np.column_stack([-way[:, 1], way[:, 0]])
        step = np.minimum(stride_mm, left - stride * stride_mm).clip(0.0)
        ahead = place + step[:, None] * way
        across = (ahead[:, None, :] + out[None, :, None] * side[:, None, :]).reshape(-1, 2)
        seen = film.at(across, radius).reshape(len(begun), -1) > 0.5
        gone = ~(seen[:, middle] | film.hidden(ahead, radius))
        high = np.where(seen[:, middle:].all(axis=1), 99, (~seen[:, middle:]).argmax(axis=1))
        low = np.where(seen[:, middle::-1].all(axis=1), 99, (~seen[:, middle::-1]).argmax(axis=1))
        width = 0.5 * (high + low)
        is_tube = (width > 1.1 * radius) & (width < 2.7 * radius) & seen[:, middle]
        off = np.where(is_tube, 0.25 * (high - low), 0.0)
        first = stride * stride_mm < radius  # the base lies within the parent's film
        off = np.where(first, 0.0, off)
        place = ahead + np.clip(0.5 * off, -1.0, 1.0)[:, None] * side
        angle = angle + np.clip(_TURN_BY_OFF * off, -_MOST_TURN, _MOST_TURN)
        gap = np.where(gone & ~first, gap + stride_mm, 0.0)
        alive &= (step > 0.0) & (gap <= _GAP_MM)
        for run, point, going in zip(runs, place, alive.tolist(), strict=True):
            if going:
                run.append(point)
    return [np.array(run) for run in runs]


def _straight(
    film: SeenFilm, base: Floats, heading: float, spread: Floats, radius: float, most: float
) -> list[tuple[float, float]]:
    """Return directions in which film runs straight from a point, and how far; the best few."""
    if most < 4.0:
        return []
    angles = heading + np.radians(spread)
    way = np.column_stack([np.cos(angles), np.sin(angles)])
    side = np.column_stack([-way[:, 1], way[:, 0]])
    t = np.arange(0.0, most, 1.5)
    middle = base + way[:, None, :] * t[None, :, None]
    there = np.ones(middle.shape[:2], dtype=np.bool_)
    for offset in (-0.6, 0.0, 0.6):
        points = (middle + offset * radius * side[:, None, :]).reshape(-1, 2)
        seen = film.at(points, radius).reshape(there.shape) > 0.5
        there &= seen
    flat = middle.reshape(-1, 2)
    hidden = (film.hidden(flat, radius) & ~film.is_solid(flat)).reshape(there.shape)
    there |= hidden
    there[:, : int(radius / 1.5) + 1] = True
    gone = ~there[:, :-1] & ~there[:, 1:]
    first = np.where(gone.any(axis=1), gone.argmax(axis=1), there.shape[1])
    run = np.minimum(first * 1.5, most)
    peaks = scipy.ndimage.maximum_filter1d(run, 7)
    best = np.flatnonzero((run >= peaks - 1e-9) & (run > max(6.0, 2.0 * radius)))
    groups = np.split(best, np.flatnonzero(np.diff(best) > 1) + 1) if len(best) else []
    picked = [(float(angles[int(np.median(g))]), float(run[int(np.median(g))])) for g in groups]
    return sorted(picked, key=lambda item: -item[1])[:4]


# --- Fitting all lines to the edges of the film ---------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Edges:
    """The edges of film at stations of a line."""

    stretch: NDArray[np.int64]
    share: Floats
    points: Floats
    way: Floats
    off: Floats  # how far to the left of the line the film's middle is; NaN where unknown
    width: Floats  # between both edges; NaN where one was not seen
    weight: Floats

    @property
    def side(self) -> Floats:
        """The way to the left."""
        return np.column_stack([-self.way[:, 1], self.way[:, 0]])

    def smoothed(self, sigma_mm: float = 4.0) -> Floats:
        """Return the distances from the line to the film's middle, smoothed; 0 where unseen."""
        step = max(1e-6, float(np.hypot(*(self.points[1] - self.points[0]))))
        off = np.nan_to_num(self.off)
        weight = np.where(np.isfinite(self.off), self.weight, 0.0)
        weight = weight / np.maximum(1.0, np.abs(off - np.median(off)) / 1.0)
        sigma = sigma_mm / step
        over = scipy.ndimage.gaussian_filter1d(weight * off, sigma, mode="nearest")
        under = scipy.ndimage.gaussian_filter1d(weight, sigma, mode="nearest")
        return np.asarray(over / (under + 0.05))


def _edges(work: _Tracing, branch: int, cover: NDArray[np.int64]) -> _Edges:
    """Return the edges of the film on both sides of a branch's line."""
    film, radius = work.film, work.radius_mm[branch]
    stretch, share, points, way = _stations(work.chains[branch], 1.5)
    side = np.column_stack([-way[:, 1], way[:, 0]])
    left, left_sure = _edge(work, points, side, radius, cover)
    right, right_sure = _edge(work, points, -side, radius, cover)
    both = np.isfinite(left) & np.isfinite(right)
    width = np.where(both, left + right, np.nan)
    fits = both & (np.abs(width / (2.0 * radius) - 1.0) < 0.35)
    known = width[fits & left_sure & right_sure]
    half = float(np.median(known)) / 2.0 if len(known) >= 5 else radius
    off = np.where(fits, (left - right) / 2.0, np.nan)
    only_left = np.isfinite(left) & left_sure & ~fits & (~np.isfinite(right) | ~right_sure)
    only_right = np.isfinite(right) & right_sure & ~fits & (~np.isfinite(left) | ~left_sure)
    off = np.where(only_left & ~only_right, left - half, off)
    off = np.where(only_right & ~only_left, half - right, off)
    weight = np.where(fits, 1.0, np.where(np.isfinite(off), 0.35, 0.0))
    weight[film.hidden(points, radius)] *= 0.3
    return _Edges(
        stretch=stretch,
        share=share,
        points=points,
        way=way,
        off=np.where(weight > 0.0, off, np.nan),
        width=np.where(fits, width, np.nan),
        weight=weight,
    )


def _edge(
    work: _Tracing, points: Floats, side: Floats, radius: float, cover: NDArray[np.int64]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the distance of the film's edge on one side, NaN where unknown; and if it is sure."""
    film, coarse = work.film, work.coarse
    slack = min(3.5, 0.6 * radius + 1.2)
    out = np.arange(max(0.0, radius - slack), radius + slack, 0.2)
    places = points[:, None, :] + out[None, :, None] * side[:, None, :]
    seen = film.at(places.reshape(-1, 2), radius).reshape(places.shape[:2])
    falls = (seen[:, :-1] >= 0.5) & (seen[:, 1:] < 0.5)
    drop = np.maximum(seen[:, :-1] - seen[:, 1:], 1e-9)
    at = out[:-1] + 0.2 * (seen[:, :-1] - 0.5) / drop
    apart = np.where(falls, np.abs(at - radius), np.inf)
    nearest = apart.argmin(axis=1)
    rows = np.arange(len(points))
    edge = np.where(np.isfinite(apart[rows, nearest]), at[rows, nearest], np.nan)
    where = points + np.nan_to_num(edge, nan=radius)[:, None] * side
    hidden = film.hidden(where + 0.5 * side, radius)
    edge[hidden] = np.nan
    seen_at = film.moved(where - 0.7 * side, radius, film.sight.plane_mm)
    column = ((seen_at[:, 0] - coarse.left_mm) / coarse.cell_mm).astype(np.int64)
    row = ((coarse.top_mm - seen_at[:, 1]) / coarse.cell_mm).astype(np.int64)
    cell = (row * coarse.columns + column).clip(0, len(cover) - 1)
    # Where another tube lies too, the edge may be its.
    return edge, np.isfinite(edge) & (cover[cell] <= 1)


def _fit(work: _Tracing, rounds: int) -> None:
    """Fit all corners to the edges, children hanging on their parents' ends."""
    for round_number in range(rounds):
        alive = work.alive
        if not alive:
            return
        cover, count = work.wide_cover(), 0
        nodes: dict[int, NDArray[np.int64]] = {}
        for branch in alive:
            own = len(work.chains[branch]) - 1
            parent = int(work.tree.parent[branch])
            base = count if parent < 0 else int(nodes[parent][-1])
            count += parent < 0
            nodes[branch] = np.concatenate([[base], np.arange(count, count + own)])
            count += own
        system = _System(count)
        for branch in alive:
            ids, edges = nodes[branch], _edges(work, branch, cover)
            ok = np.isfinite(edges.off)
            robust = edges.weight[ok] / np.maximum(1.0, np.abs(edges.off[ok]) / 1.0)
            a, b = ids[edges.stretch[ok]], ids[edges.stretch[ok] + 1]
            system.across(a, b, edges.share[ok], edges.side[ok], edges.off[ok], robust)
            _hold_length(work, system, branch, ids)
            system.stay(ids, 0.05)
            if work.tree.parent[branch] < 0:
                system.stay(ids[:1], 0.5)
        moved = system.solved()
        for branch in alive:
            work.chains[branch] = work.chains[branch] + moved[nodes[branch]]
        for branch in alive:
            chain = _simplified(work.chains[branch], 0.25)
            if round_number >= 1:
                chain = _bent_more(work, branch, chain)
            work.chains[branch] = chain
            work.patches[branch] = work.coarse.tube(work.film, chain, work.radius_mm[branch])


def _hold_length(work: _Tracing, system: "_System", branch: int, ids: NDArray[np.int64]) -> None:
    """Hold a parent's length, whose end is hidden; move the end of others to the film's end."""
    film, chain, radius = work.film, work.chains[branch], work.radius_mm[branch]
    planned = float(work.tree.length_mm[branch])
    strides = np.diff(chain, axis=0)
    way = strides / np.maximum(np.hypot(*strides.T), 1e-9)[:, None]
    has_children = bool((work.tree.parent == branch).any()) and not work.early[branch]
    if has_children:
        system.lengthen(ids, way, planned - _length(chain), 2.0)
        return
    out = np.arange(-6.0, radius + 7.0, 0.2)
    tip, ahead, side = chain[-1], way[-1], np.array([-way[-1, 1], way[-1, 0]])
    line = tip + out[:, None] * ahead
    seen = np.mean([film.at(line + o * radius * side, radius) for o in (-0.25, 0.0, 0.25)], axis=0)
    falls = np.flatnonzero((seen[:-1] >= 0.5) & (seen[1:] < 0.5))
    if len(falls):
        last = falls[np.argmin(np.abs(out[falls] - radius))]
        end = out[last] + 0.2 * (seen[last] - 0.5) / max(seen[last] - seen[last + 1], 1e-9)
        if not film.hidden((tip + (end + 1.0) * ahead)[None, :], radius)[0]:
            # The middle of the cap's edge, as seen over a quarter of its width.
            further_mm = float(end - 0.98 * radius)
            system.along(int(ids[-1]), ahead, further_mm, 2.0)
            work.early[branch] = is_early(_length(chain) + further_mm, planned)
            return
    goal = _length(chain) if work.early[branch] else planned
    system.lengthen(ids, way, goal - _length(chain), 1.0)


def _bent_more(work: _Tracing, branch: int, chain: Floats) -> Floats:
    """Return a line with one more corner where the film bends away from it."""
    if len(chain) < 2:
        return chain
    cover = work.coarse.cover(work.patches)
    edges = _edges(work, branch, cover)
    ok = np.isfinite(edges.off)
    if ok.sum() < 8:
        return chain
    smooth = edges.smoothed()
    worst = int(np.argmax(np.abs(smooth)))
    if abs(smooth[worst]) < 0.7:
        return chain
    corner = edges.points[worst]
    if np.hypot(*(chain - corner).T).min() < 6.0:
        return chain
    place = int(edges.stretch[worst]) + 1
    return np.insert(chain, place, corner, axis=0)


class _System:
    """Linear least squares for small moves of corners."""

    def __init__(self, corners: int) -> None:
        self.matrix = np.zeros((2 * corners, 2 * corners))
        self.right = np.zeros(2 * corners)

    def _add(self, rows: Floats, values: Floats, weights: Floats) -> None:
        self.matrix += rows.T @ (rows * weights[:, None])
        self.right += rows.T @ (weights * values)

    def across(
        self,
        a: NDArray[np.int64],
        b: NDArray[np.int64],
        share: Floats,
        side: Floats,
        off: Floats,
        weights: Floats,
    ) -> None:
        """Ask points between two corners to move sideways."""
        rows = np.zeros((len(a), len(self.right)))
        index = np.arange(len(a))
        for axis in (0, 1):
            rows[index, 2 * a + axis] += (1.0 - share) * side[:, axis]
            rows[index, 2 * b + axis] += share * side[:, axis]
        self._add(rows, off, weights)

    def lengthen(self, ids: NDArray[np.int64], way: Floats, by: float, weight: float) -> None:
        """Ask a line to become longer."""
        row = np.zeros((1, len(self.right)))
        for stretch in range(len(way)):
            for axis in (0, 1):
                row[0, 2 * ids[stretch] + axis] -= way[stretch, axis]
                row[0, 2 * ids[stretch + 1] + axis] += way[stretch, axis]
        self._add(row, np.array([by]), np.array([weight]))

    def along(self, corner: int, way: Floats, by: float, weight: float) -> None:
        """Ask a corner to move in a direction."""
        row = np.zeros((1, len(self.right)))
        row[0, 2 * corner], row[0, 2 * corner + 1] = way
        self._add(row, np.array([np.clip(by, -4.0, 4.0)]), np.array([weight]))

    def stay(self, ids: NDArray[np.int64], weight: float) -> None:
        """Ask corners to stay where they are."""
        for axis in (0, 1):
            self.matrix[2 * ids + axis, 2 * ids + axis] += weight

    def solved(self) -> Floats:
        """Return the moves, at most 4 mm each, shape (corners, 2)."""
        moves = np.linalg.solve(self.matrix + 1e-6 * np.eye(len(self.right)), self.right)
        moves = moves.reshape(-1, 2)
        far = np.maximum(1.0, np.hypot(*moves.T) / 4.0)
        return np.asarray(moves / far[:, None])
