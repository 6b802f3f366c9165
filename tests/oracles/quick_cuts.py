"""Cuts that leave flat pieces, found quickly and readably: what a search takes for the fewest.

The compiled `vinefab.search.penalty_kernel` must give the same. The exact answer, from the outlines
as they will be cut, is `vinefab.fabrication.pieces.partition`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tests.oracles.fans import fans_of, level_lengths_mm
from vinefab.core.validation import Floats
from vinefab.fabrication.job.passes import (
    STRAIGHT_BEFORE_MM,
    SleeveSize,
    reach_mm,
    sleeve_size,
    taken_mm,
)
from vinefab.fabrication.pieces.partition import (
    BodyKind,
    StraightSides,
    beside_mm,
    bodies_of,
    sleeve_sides,
    sleeves_of,
)
from vinefab.fabrication.rules.clearance_rules import check_clearance, least_gap_mm
from vinefab.fabrication.rules.rule import LimitChanges, relative_excess
from vinefab.fabrication.rules.spacing import Capsules, RotatedSpan, Spacing, spacing
from vinefab.fabrication.rules.tree_rules import check_lap_packing, fullest_laps, widest_cut_mm
from vinefab.model.design import Build, Design, PieceSettings
from vinefab.model.laser import LaserProfile
from vinefab.outline.body_outline import FlatLayout, flat_layout
from vinefab.outline.ends import pouch_takes_mm, usual_leaf
from vinefab.outline.joint import (
    Point,
    largest_fillet_mm,
    neck_length_mm,
)
from vinefab.search.penalty_batch import (
    LEAST_DEPTH,
    MOST_CONFLICTS,
    MOST_PIECE_BRANCHES,
    MOST_STEPS,
)

_PARTED = 1.0 - 1e-9
"""A further cut must leave at most this share of what is left without it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PieceLimits:
    """What the pieces of a robot must keep."""

    most_cuts: int  # sleeve joints that it may have
    size: SleeveSize
    reach_mm: float  # how far outside the lumen's edge its cuts run
    clearance_mm: float  # least distance of lumens
    sheet_mm: tuple[float, float] | None  # width and height that each piece must fit, if any
    widest_mm: float  # branch that may be cut: its lap bears the pressure
    film_mm: float  # thickness of all plies
    packing: float  # share of solid film when crumpled
    packing_percent: float  # most of a lumen that film with laps in it may fill

    @classmethod
    def of(
        cls,
        build: Build,
        profile: LaserProfile,
        changed: LimitChanges,
        sheet_mm: tuple[float, float] | None = None,
    ) -> "PieceLimits":
        """Return the limits for a recipe and the limits that it changes."""
        packed = check_lap_packing.limits_under(changed)
        return cls(
            most_cuts=(build.pieces or PieceSettings()).most - 1,
            size=sleeve_size(build, profile),
            reach_mm=reach_mm(profile),
            clearance_mm=least_gap_mm(check_clearance, changed, taken_mm(profile)),
            sheet_mm=sheet_mm,
            widest_mm=widest_cut_mm(build, profile, changed),
            film_mm=profile.material.film_mm,
            packing=packed["packing"],
            packing_percent=packed["error"],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class QuickCuts:
    """Where a robot is cut."""

    branches: tuple[int, ...]  # that are cut
    # Summed depths of conflicts within a piece, excess of pieces over the sheet relative to its
    # shorter side, and of film with laps over the lumens; 0 where all pieces can be made.
    left: float


def quick_cuts(
    design: Design, limits: PieceLimits, passages: Sequence[float] = ()
) -> QuickCuts | None:
    """Return cuts that leave as few pieces as were found; None for designs that are too large.

    Where the pieces that are allowed do not suffice, these are the cuts that part the deepest
    conflicts, so that a search can follow what is left.

    Parameters
    ----------
    passages
        Of the joints below each level, the trunk's first; without them, as wide as the tubes.

    Notes
    -----
    Pairs of branches that are too near must be parted by a cut between them on the tree: a minimum
    multicut. It is searched depth first: the pair that meets farthest from the base is parted by
    one branch after another, those that part most pairs first. Pairs that share no branch need a
    cut each, which bounds the number from below (the dual of Garg, Vazirani and Yannakakis 1997)
    and ends most searches at once; the rest end after `MOST_STEPS` steps. Stubs and sockets are
    looked at where all pairs are parted.
    """
    if design.branch_count > MOST_PIECE_BRANCHES:
        return None
    tree = _TreeCuts(design, limits, passages)
    return tree.found() if len(tree.pairs) <= MOST_CONFLICTS else None


def planned_sides(
    design: Design, layout: FlatLayout, size: SleeveSize, reach: float
) -> StraightSides:
    """Return where a sleeve may lie on each branch, from its joints alone.

    As `sleeve_sides`, where sides of a robot without tapers are never straight for longer.
    """
    tree, start, stop = layout.tree, {(1, 0): 0.0}, {design.depth: 0.0}
    for level in range(1, design.depth):
        for place, used in _joint_takes(design, level, size, reach).items():
            if place is None:
                stop[level] = used
            else:
                start[level + 1, place] = used
    stop[design.depth] = pouch_takes_mm(usual_leaf(design.build), design.build.pouch, reach)
    children = [1, *(fan.branches for fan in fans_of(design))]
    first = np.searchsorted(tree.level, tree.level)
    places = [
        (level, row % children[level - 1])
        for level, row in zip(
            tree.level.tolist(), (np.arange(len(tree)) - first).tolist(), strict=True
        )
    ]
    ends = [stop[level] for level, _ in places]
    return StraightSides(
        start_mm=np.array([start[place] for place in places]),
        end_mm=tree.length_mm - np.array(ends),
    )


def _joint_takes(
    design: Design, level: int, size: SleeveSize, reach: float
) -> dict[int | None, float]:
    """Return what the joint below a level takes of each child, and under None of the parent."""
    below, build = fans_of(design)[level - 1], design.build
    wide, narrow = build.widths_mm[level - 1] / 2.0, build.widths_mm[level] / 2.0
    lengths, disc = level_lengths_mm(design, level + 1), max(wide, narrow)
    around = [None, *range(below.branches), None]
    headings = [-math.pi, *below.angles_rad.tolist(), math.pi]
    takes: dict[int | None, float] = dict.fromkeys(around, 0.0)
    for pair, (before, after) in zip(pairwise(around), pairwise(headings), strict=True):
        angle = after - before
        halves = tuple(wide if one is None else narrow for one in pair)
        parent = min(level_lengths_mm(design, level))
        shorter = min(parent if one is None else lengths[one] for one in pair)
        most = largest_fillet_mm(angle, (halves[0], halves[1]), max(0.5 * shorter, disc))
        radius = max(0.0, min(build.fillet_mm[level - 1], most))
        beside = beside_mm(size, reach), STRAIGHT_BEFORE_MM + size.blend_mm
        for out, beyond in ((0.0, 0.0), (reach, 0.0), beside):
            # Corners in place of small fillets lie farther from the joint where the cut runs.
            used = straight_begins_mm(
                angle, (halves[0] + out, halves[1] + out), max(0.0, radius - out), disc + out
            )
            for one, mm in zip(pair, used, strict=True):
                if one is not None or not beyond:
                    takes[one] = max(takes[one], mm - beyond)
    return takes


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two whole bodies that are too near."""

    one: int  # capsules
    two: int
    a: int  # their branches
    b: int
    depth: float
    also: int | None  # the branch where they meet, if a cut there parts them too


Conflict = tuple[float, int, int, int | None]
"""Depth; the branches whose pieces two bodies lie on; a branch whose own cut may part them too."""


class _TreeCuts:
    """The search for the cuts of one design."""

    def __init__(self, design: Design, limits: PieceLimits, passages: Sequence[float] = ()) -> None:
        self.limits, layout = limits, flat_layout(design)
        self.on_stub = limits.size.socket_on_stub
        self.parent: list[int] = layout.tree.parent.tolist()
        self.level: list[int] = layout.tree.level.tolist()
        if design.build.taper:
            sides = sleeve_sides(design, layout, limits.size, limits.reach_mm)
        else:
            sides = planned_sides(design, layout, limits.size, limits.reach_mm)
        sides = StraightSides(start_mm=sides.start_mm, end_mm=sides.end_mm + LEAST_DEPTH)
        known = (1.0, *passages) if passages else (1.0,) * design.depth
        self.design, self.passages = design, np.array(known)[layout.tree.level - 1]
        self.sleeves = {
            row: sleeve
            for row, sleeve in sleeves_of(layout, sides, limits.size).items()
            if sleeve.width_mm <= limits.widest_mm
        }
        sleeves = self.sleeves
        bodies = bodies_of(layout, design.build, sleeves)
        self.capsules: Capsules = bodies.capsules
        self.whole = np.flatnonzero(bodies.kind == BodyKind.WHOLE)
        self.rows: list[int] = self.capsules.branch.tolist()
        self.own: NDArray[np.bool_] = ~self.capsules.pouch
        # Stubs, outer parts and sockets follow each other, each in the order of their branches.
        self.stub = {row: len(self.whole) + place for place, row in enumerate(sorted(sleeves))}
        self.outer = {row: at + len(sleeves) for row, at in self.stub.items()}
        self.socket = {row: at + 2 * len(sleeves) for row, at in self.stub.items()}
        found = spacing(self.capsules, limits.clearance_mm)
        depths = pair_depths(self.capsules, found, limits.clearance_mm)
        near = zip(found.first.tolist(), found.second.tolist(), depths.tolist(), strict=True)
        self.depths: dict[tuple[int, int], float] = {
            (one, two): depth for one, two, depth in near if depth > LEAST_DEPTH
        }
        # Those that meet the farthest from the trunk first.
        self.pairs = sorted(
            self._pairs(),
            key=lambda one: (one.also is not None) - self.level[self._meet(one.a, one.b)],
        )
        self.weight = dict.fromkeys(self.stub, 0)
        for pair in self.pairs:
            for row in self.between(pair.a, pair.b, pair.also):
                self.weight[row] += 1

    def found(self) -> QuickCuts:
        """Return the cuts, and what is left."""
        cut = _FewestCuts(self, self.limits.most_cuts).best
        if cut is not None:
            # More cuts as long as they help.
            left = self.left(cut)
            while left > 0.0 and len(cut) < self.limits.most_cuts:
                chosen, least = -1, math.inf
                for row in sorted(self.stub.keys() - cut):
                    trial = self.left(cut | {row})
                    if trial < least * _PARTED:
                        chosen, least = row, trial
                if least >= left * _PARTED:
                    break
                cut, left = cut | {chosen}, least
            return QuickCuts(branches=tuple(sorted(cut)), left=left)
        cut = self._deepest()
        return QuickCuts(branches=tuple(sorted(cut)), left=self.left(cut))

    # --- pairs -----------------------------------------------------------------------------------

    def _pairs(self) -> Iterator[_Pair]:
        """Yield the pairs of whole bodies that are too near."""
        last = int(self.whole[-1])
        for (one, two), depth in sorted(self.depths.items()):
            if two <= last:
                a, b = self.rows[one], self.rows[two]
                meet, also = self._meet(a, b), None
                if meet == a and self._outer_clears(a, two):
                    also = a
                if meet == b and self._outer_clears(b, one):
                    also = b
                yield _Pair(one, two, a, b, depth, also)

    def _meet(self, a: int, b: int) -> int:
        """Return the last branch that both of two are, or lie beyond."""
        while a != b:
            if self.level[a] >= self.level[b]:
                a = self.parent[a]
            else:
                b = self.parent[b]
        return a

    def _outer_clears(self, row: int, other: int) -> bool:
        """Return whether a branch may be cut, and its outer part is clear of a capsule."""
        if row not in self.stub:
            return False
        parts = (self.outer,) if self.on_stub else (self.outer, self.socket)
        return not any(self._depth(one[row], other) for one in parts)

    def _depth(self, one: int, two: int) -> float:
        return self.depths.get((min(one, two), max(one, two)), 0.0)

    def between(self, a: int, b: int, also: int | None) -> list[int]:
        """Return the branches whose cut may part two; ``also`` counts if they meet there."""
        found = []
        while a != b:
            if self.level[a] >= self.level[b]:
                found.append(a)
                a = self.parent[a]
            else:
                found.append(b)
                b = self.parent[b]
        if also == a:
            found.append(a)
        return [row for row in found if row in self.stub]

    # --- what is left ----------------------------------------------------------------------------

    def pieces(self, cut: set[int]) -> list[int]:
        """Return the piece that each branch ends on, named by its first branch."""
        home = [0] * len(self.parent)
        for row in range(1, len(home)):
            home[row] = row if row in cut else home[self.parent[row]]
        return home

    def together(self, cut: set[int], home: list[int]) -> list[_Pair]:
        """Return the pairs of whole bodies that are still on one piece."""
        return [one for one in self.pairs if home[one.a] == home[one.b] and one.also not in cut]

    def left(self, cut: set[int]) -> float:
        """Return what is left of conflicts and excess."""
        home = self.pieces(cut)
        whole = sum(pair.depth for pair in self.together(cut, home))
        parts = sum(depth for depth, *_ in self.of_parts(cut, home))
        return whole + parts + self._excess(cut, home) + self.overfull(cut)

    def overfull(self, cut: set[int]) -> float:
        """Return by how much film with the laps of some cuts overfills lumens, as VF-J04."""
        limits, sleeves = self.limits, [self.sleeves[row] for row in cut]
        fullest = fullest_laps(self.design, sleeves, limits.film_mm, limits.packing, self.passages)
        return math.fsum(
            relative_excess(100.0 * share, limits.packing_percent) for _, share in fullest.values()
        )

    def of_parts(self, cut: set[int], home: list[int]) -> Iterator[Conflict]:
        """Yield the conflicts of stubs and sockets with something on their piece."""
        for pair in self.pairs:
            if home[pair.a] != home[pair.b] or pair.also in cut:
                yield from self._on_one_piece(self._of_stubs(pair, cut), home)
        for row in sorted(cut):
            yield from self._on_one_piece(self._of_socket(row, cut), home)

    def _on_one_piece(
        self, found: Iterator[tuple[int, int, int, int, int | None]], home: list[int]
    ) -> Iterator[Conflict]:
        """Yield conflicts of bodies, each given with the branch on whose piece it lies."""
        for a, one, b, two, also in found:
            depth = self._depth(one, two) if home[a] == home[b] else 0.0
            if depth > 0.0:
                yield depth, a, b, also

    def _of_stubs(
        self, pair: _Pair, cut: set[int]
    ) -> Iterator[tuple[int, int, int, int, int | None]]:
        """Yield each stub of a pair beside what there is of the other."""
        sides = ((pair.a, pair.one), (pair.b, pair.two))
        for (a, one), (b, two) in (sides, sides[::-1]):
            if not self.own[one] or a not in cut:
                continue
            stub, up, also = self.stub[a], self.parent[a], None
            if self.own[two] and b in cut:
                yield up, stub, b, self.outer[b], None
                if one == pair.one:
                    yield up, stub, self.parent[b], self.stub[b], None
                continue
            if self.own[two] and self._outer_clears(b, stub):
                also = b
            yield up, stub, b, two, also

    def _of_socket(
        self, row: int, cut: set[int]
    ) -> Iterator[tuple[int, int, int, int, int | None]]:
        """Yield a socket beside everything that is not joined to it."""
        socket, home = self.socket[row], self.parent[row] if self.on_stub else row
        for two in self.whole.tolist():
            yield home, socket, self.rows[two], two, None
        for other in sorted(cut):
            if self.on_stub or other > row:
                yield home, socket, self.parent[other], self.stub[other], None
            if self.on_stub and other > row:
                yield home, socket, self.parent[other], self.socket[other], None

    def _excess(self, cut: set[int], home: list[int]) -> float:
        """Return the summed excesses of all pieces over the sheet, relative to its shorter side."""
        sheet = self.limits.sheet_mm
        if sheet is None:
            return 0.0
        found = 0.0
        for root in (0, *sorted(cut)):
            whole = [one for one in self.whole.tolist() if home[self.rows[one]] == root]
            begin = [one for one in whole if one != root]
            stubs = [row for row in sorted(cut) if home[self.parent[row]] == root]
            span, first = RotatedSpan(), self.outer if self.on_stub else self.socket
            base = [first[root]] if root else []
            if root == 0:
                span.add_mouth(self.capsules)
            begin += base + [self.socket[row] for row in stubs if self.on_stub]
            end = whole + base + [self.stub[row] for row in stubs if not self.on_stub]
            for at_mm, half_mm, rows in (
                (self.capsules.start_mm, self.capsules.half_mm, begin),
                (self.capsules.end_mm, self.capsules.end_half_mm, end),
            ):
                span.add(at_mm[rows], half_mm[rows])
            found += max(0.0, span.excess_mm(sheet) / min(sheet))
        return found

    # --- further cuts ----------------------------------------------------------------------------

    def _deepest(self) -> set[int]:
        """Return cuts that part the deepest conflicts, one after the other."""
        cut = set[int]()
        while len(cut) < self.limits.most_cuts:
            share = dict.fromkeys(range(len(self.parent)), 0.0)
            for pair in self.together(cut, self.pieces(cut)):
                for row in self.between(pair.a, pair.b, pair.also):
                    share[row] += pair.depth
            chosen = 0
            for row, depth in share.items():
                if depth > share[chosen] + LEAST_DEPTH:
                    chosen = row
            if share[chosen] <= 0.0:
                break
            cut.add(chosen)
        return cut


class _FewestCuts:
    """A depth-first search for the fewest cuts that leave no conflict."""

    def __init__(self, tree: _TreeCuts, most: int) -> None:
        self.tree, self.most = tree, most
        self.best: set[int] | None = None
        self._overfull = math.inf
        self._steps = self._bound = 0
        self._visit(set(), set())

    def _visit(self, cut: set[int], banned: set[int]) -> None:
        """Part the first conflict that some cuts leave by each branch that is not banned."""
        if self._steps == MOST_STEPS or (self._overfull <= 0.0 and self.most < self._bound):
            return
        self._steps += 1
        ways = self._ways(cut, banned)
        if ways is None:
            # Further cuts only add laps: those that overfill a lumen are kept for want of better.
            overfull = self.tree.overfull(cut)
            if overfull < self._overfull or overfull <= 0.0:
                self.best, self._overfull = cut, overfull
            if overfull <= 0.0:
                self.most = len(cut) - 1
            return
        for way in ways:
            if len(cut) >= self.most:
                return
            self._visit(cut | {way}, banned)
            banned = banned | {way}  # all sets of cuts with it were tried

    def _ways(self, cut: set[int], banned: set[int]) -> list[int] | None:
        """Return the branches that may part the first conflict, None if there is no conflict.

        There are none if more cuts than may be made are needed for certain.
        """
        tree, home = self.tree, self.tree.pieces(cut)
        together, needed, used = tree.together(cut, home), 0, set[int]()
        for pair in together:
            between = set(tree.between(pair.a, pair.b, pair.also)) - banned
            if between.isdisjoint(used):
                needed += 1
                used |= between
            if not between or len(cut) + needed > self.most:
                return []
        if not cut:
            self._bound = needed
        if together:
            ends = together[0].a, together[0].b, together[0].also
        else:
            conflict = next(tree.of_parts(cut, home), None)
            if conflict is None:
                return None
            ends = conflict[1:]
        ways = set(tree.between(*ends)) - banned
        return sorted(ways, key=lambda row: (tree.weight[row], row), reverse=True)


def straight_begins_mm(
    angle_rad: float, halves_mm: Point, radius_mm: float, disc_mm: float = 0.0
) -> Point:
    """Return how far from the joint the straight sides of two neighbours begin."""
    disc = max(disc_mm, *halves_mm)
    one, two = (half + radius_mm for half in halves_mm)
    hidden = sum(math.asin(reach / (disc + radius_mm)) for reach in (one, two))
    if hidden <= angle_rad:
        first, second = (neck_length_mm(half, disc, radius_mm) for half in halves_mm)
        return first, second
    sin, cos = math.sin(angle_rad), math.cos(angle_rad)
    if sin < 1e-9:
        return math.inf, math.inf
    return max(0.0, (two + one * cos) / sin), max(0.0, (one + two * cos) / sin)


def pair_depths(capsules: Capsules, found: Spacing, clearance_mm: float) -> Floats:
    """Return how deep pairs are in each other's clearance, shape (k,).

    From 0 (just clear) to 1 (centre lines touch), and where centre lines cross from 1 to 2, by how
    far the nearer end would have to be drawn back.
    """
    wide_mm = capsules.most_half_mm[found.first] + capsules.most_half_mm[found.second]
    room_mm = clearance_mm + wide_mm
    near = np.maximum(0.0, (clearance_mm - found.gap_mm) / room_mm)
    crossing: Floats = found.crossing_mm / (found.crossing_mm + room_mm)
    return near + crossing
