"""Penalties of many designs at once: the tables and limits that the compiled kernel needs.

Everything that depends on a build and a level alone is computed once, by the rules.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vinefab.core.front_door import imported_later
from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.job.passes import (
    BLEND_RATIO,
    STRAIGHT_AFTER_MM,
    STRAIGHT_BEFORE_MM,
    reach_mm,
    seal_offset_mm,
    sleeve_size,
    taken_mm,
)
from vinefab.fabrication.pieces.partition import beside_mm, sleeve_sides
from vinefab.fabrication.rules.clearance_rules import (
    check_angle,
    check_clearance,
    check_crotch,
    check_fillet,
    least_gap_mm,
)
from vinefab.fabrication.rules.laser_rules import check_paths
from vinefab.fabrication.rules.pressure_rules import (
    GrowthConstantsRange,
    check_bodies,
    check_window,
    most_growth_kpa,
)
from vinefab.fabrication.rules.rule import MOST_OF_ONE, LimitChanges
from vinefab.fabrication.rules.spacing import TURNS, pouch_capsules, tail_capsules
from vinefab.fabrication.rules.tree_rules import (
    check_lap_packing,
    check_least_width,
    check_packing,
    check_width_ratio,
    widest_cut_mm,
)
from vinefab.inflation.pattern import (
    FANS,
    LEAST_LENGTH,
    MOST_CHILDREN,
    MOST_TURN_RAD,
    FanLaw,
    joint_law,
    quick_pattern,
    stretch_at,
)
from vinefab.model.design import MOST_BRANCHES, MOST_LEVELS, Build, Design
from vinefab.model.laser import LaserProfile
from vinefab.outline.body_outline import flat_layout
from vinefab.outline.ends import level_fillets_mm, pouch_takes_mm, usual_leaf
from vinefab.outline.joint import LEAST_SEGMENT_MM, STEEPEST, Point
from vinefab.physics.tube import inflated_diameter_mm, lumen_area_mm2
from vinefab.search.space import DesignBatch, Space, batch_branches

if TYPE_CHECKING:
    from vinefab.search import penalty_kernel
else:
    penalty_kernel = imported_later("vinefab.search.penalty_kernel")

MOST_CHECKED_BRANCHES = 2000
"""Larger trees are penalized for their size, without checking their branches."""

LEAST_DEPTH = 1e-9
"""Pairs less deep in each other's clearance count as clear of each other."""

MOST_CONFLICTS, MOST_PIECE_BRANCHES = 20_000, 400
"""Designs with more pairs that are too near, or more branches, count as one flat outline."""

MOST_STEPS = 64
"""Sets of cuts that are looked at for each design."""


class DesignArrays(NamedTuple):
    """Designs, m of them, with at most n levels below the trunk, and their trees one by one."""

    depth: Ints  # levels of each design, the trunk included, shape (m,)
    build: Ints  # row of each design's build in the tables, shape (m,)
    trunk: Floats  # length of each trunk, mm, shape (m,)
    # of each design and level below the trunk, as in `vinefab.model.design.Level`, shape (m, n)
    branches: Ints
    fan: Floats  # rad
    size: Floats  # length of the first child, mm
    growth: Floats
    first: Ints  # where each design's branches begin, shape (m + 1,)
    # every branch, parents first
    parent: Ints  # within its tree, -1 for trunks
    level: Ints  # 1 for trunks
    offset: Floats  # angle from the parent's heading, rad
    length: Floats  # mm


class LevelTables(NamedTuple):
    """What depends on a build and a level alone, for b builds of at most n + 1 levels."""

    # of each level, shape (b, n + 1)
    half: Floats  # half the lay-flat width where its branches begin, mm
    end_half: Floats  # the same where they end
    fillet: Floats  # radius at the joint below, mm
    area: Floats  # cross-section of the inflated lumen where its branches end, mm2
    scale: Floats  # growth constants of its tube over those of the fitted tube
    stretch: Floats  # by which its tubes grow longer under pressure
    # of each build, shape (b,)
    widths: Floats  # summed violations by the widths themselves
    tip: Floats  # what the pouch takes of a leaf, mm
    tip_cut: Floats  # the same where the cut runs, mm
    pouch_share: Floats  # share of a leaf's lumen that its own pouch fills
    leaf_width: Floats  # lay-flat width of the leaves, pouches included, mm
    tail_mm: Floats
    even_mm: Floats  # what of the tail is as wide as the trunk
    most_kpa: Floats  # most that growth may take
    widest_mm: Floats  # branch that may be cut
    # Capsules of the pouch in the frame of the tip, and of the tail in that of the base: where each
    # build's begin, with the total at the end, and both ends and half widths, mm, shape (k, 6).
    pouch_first: Ints
    pouch: Floats
    tail_first: Ints
    tail: Floats
    # how fans are cut; laws by their place, with or without compensation
    law_at: Ints  # of each level below the trunk and number of children, -1 for none, (b, n, c)
    law: Floats  # by deployed fan: `FanLaw.rows`; no rows where they are cut as designed
    least: Floats  # smallest deployed fan among the simulated ones, rad
    drawn: Floats  # passages of fans cut as designed, by fan; no rows where fans are compensated
    most_turn: float  # by which children are turned so that their tips come near, rad
    least_length: float  # share of a planned length that is always cut


class PenaltyLimits(NamedTuple):
    """Limits of the rules, and constants."""

    angle_deg: float  # least angle between neighbours
    crotch: float  # most of a branch that may lie in the crotch
    fillet_mm: float  # least radius that VF-C04 allows
    seal_mm: float  # how far outside the lumen's edge the seam runs: smaller fillets are corners
    run_mm: float  # least radius whose arc on the seam's path is large enough to be run (VF-L02)
    end_mm: float  # least length of a parent's end on that path, with a tenth for the law's error
    sibling_share: float  # of the shorter, that inflated siblings may lie on each other
    packing_percent: float  # most of a lumen that folded film may fill
    film_mm: float  # thickness of all plies over the share of solid film when crumpled
    clearance_mm: float  # least distance of lumens
    segment_mm: float  # shortest straight side
    side_mm: float  # shortest straight side that the laser can run
    drawn_mm: float  # least fillet that rules allow and the laser can run
    steepest: float  # sine of the most that a side may lean
    compensated: bool  # whether fans are cut narrower than they deploy
    sheet_wide_mm: float  # sheet that the flat robot must fit
    sheet_high_mm: float
    yield_kpa: float
    drag_kpa_mm: float
    storage_kpa: float
    friction: float
    most_branches: int  # larger trees are penalized for their size alone
    most: float  # most that a single broken limit adds
    most_cuts: int  # sleeve joints that a robot may have; 0 for one flat outline
    most_steps: int  # of the search for the fewest cuts
    least_depth: float  # smaller depths of a pair are none
    reach_mm: float  # how far cuts lie outside the lumen
    before_mm: float  # straight stub before the sleeve
    lap_mm: float
    blend_ratio: float  # length of the blend from the socket to the branch, over the rise
    after_mm: float  # straight branch beyond the sleeve
    rise_mm: float  # how far a socket's lumen lies outside the branch's
    beside_mm: float  # how far outside lumens sockets of one joint need room, cut and all
    on_stub: bool  # whether sockets are on stubs, not on outer pieces
    lap_film_mm: float  # as `film_mm`, where laps ride in it
    lap_percent: float  # most of a lumen that film with laps in it may fill


class Scratch(NamedTuple):
    """Memory for one design: its branches, then its capsules."""

    # as cut, of each level and child, the trunk first
    angle: Floats  # from the parent's heading, rad, shape (levels, children)
    run: Floats  # length, mm, shape (levels, children)
    gap: Floats  # before each child and after the last, rad, shape (levels, children + 1)
    short: Floats  # of each level the length of the shortest child, mm
    passage: Floats  # of the joint that each level sprouts from
    heading: Floats  # of each branch, rad
    riding: Floats  # film inside each branch, mm
    factor: Floats  # on the store's tension, of each branch
    drag: Floats  # of all segments before, of each branch
    # start x, start y, end x, end y, half the width at the start and at the end, mm, shape (k, 6)
    capsule: Floats
    box: Floats  # low x, low y, high x, high y, mm, shape (k, 4)
    owner: Ints  # branch that each capsule belongs to, shape (k,)
    bare: Ints  # capsules before those of pouches, shape (1,)
    turn: Floats  # cosine and sine of the rotations tried, shape (2, t)
    low: Floats  # lowest place across each rotation, mm, shape (t,)
    high: Floats  # highest place, mm, shape (t,)


class CutScratch(NamedTuple):
    """Memory for the pieces of one design; empty where robots are cut in one."""

    # pairs of capsules that are too near
    one: Ints  # the capsules, shape (p,)
    two: Ints
    depth: Floats
    also: Ints  # the branch where they meet, if a cut there parts them too, else -1
    top: Ints  # level of that branch, or of the one before
    between: Ints  # branches whose cut parts it, shape (p, o)
    ways: Ints  # how many
    order: Ints  # pairs from the ones that meet farthest from the base
    # each branch, shape (k,)
    can: Ints  # whether it may be cut
    cut: Ints  # whether it is
    best: Ints  # whether it is in the best cuts so far
    banned: Ints  # whether all sets of cuts with it were tried
    used: Ints  # last step in which a pair claimed it
    weight: Ints  # how many pairs its cut parts
    share: Floats  # summed depths of those
    piece: Ints  # branch that its piece begins with
    wide: Floats  # lay-flat width at its sleeve, mm
    rise: Floats  # how far the socket's lumen lies outside the branch's, mm
    # straight sides on each level, mm
    begin: Floats  # of each child of a fan, shape (levels, children)
    stop: Floats
    # of tapered designs, known from their outlines, shape (m, levels, children); else no rows
    begins: Floats
    stops: Floats
    # of each set of cuts on the way to the one that is tried
    option: Ints  # branches of which one must be cut, shape (c, o)
    options: Ints  # how many there are, shape (c,)
    tried: Ints  # how many were tried, shape (c,)
    path: Ints  # branches between two
    hit: Ints  # a conflict of a stub or socket, shape (3,); see the kernel
    needed: Ints  # cuts that are needed for certain, shape (1,)
    left: Floats  # what the cuts leave; infinite for designs that are not cut, shape (1,)
    # film that rides in each branch, mm across, by level; shape (k, levels)
    below: Floats
    laps: Ints  # whether a lap is in it, shape (k,)
    fullest: Floats  # share of a lumen that is filled on each level


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PenaltyRules:
    """The rules of the penalty for designs that differ in widths and lengths, not in how they join.

    These are the error limits of VF-W01 to VF-W03, VF-C01 to VF-C04, VF-C07, VF-I04, VF-L02, VF-S01
    and, as negative clearance, VF-T03; with pieces VF-J01 to VF-J04 and VF-J06, and for growth
    VF-P03 (also where its limit is only assumed). Each kind of rule adds ``log(1 + depth)`` with
    the summed depths of its violations, each relative to its limit and at most 10: the penalty
    falls steadily as branches part, also while they still cross, and a hopeless tree stays below
    about 100. A design without penalty has no error from these rules. Fillets count with their
    designed radius, so that a few designs whose fillets the outline reduces are penalized
    needlessly. Fans count as their pattern by `vinefab.inflation.pattern.quick_pattern`.
    """

    profile: LaserProfile
    changed: LimitChanges
    limits: PenaltyLimits
    grows: bool  # whether the pressure for growth counts

    @classmethod
    def of(
        cls,
        build: Build,
        profile: LaserProfile,
        changed: LimitChanges,
        sheet_mm: tuple[float, float],
        *,
        grows: bool = True,
    ) -> "PenaltyRules":
        """Return the rules for a recipe, its changed limits and builds like one.

        Parameters
        ----------
        sheet_mm
            Width and height that the flat robot must fit after a rotation. Subtract a few
            millimetres for seam, kerf and the overcut at the mouth.
        """
        fit = GrowthConstantsRange.of(profile, check_window.limits_under(changed))
        packing, laps = (rule.limits_under(changed) for rule in (check_packing, check_lap_packing))
        material, seal_mm = profile.material, seal_offset_mm(profile)
        paths = check_paths.limits_under(changed)
        fillet_mm = check_fillet.limits_under(changed)["error"]
        run_mm = 1.001 * (paths["radius_error"] + seal_mm)
        size = sleeve_size(build, profile)
        limits = PenaltyLimits(
            angle_deg=check_angle.limits_under(changed)["error"],
            crotch=check_crotch.limits_under(changed)["error"],
            fillet_mm=fillet_mm,
            seal_mm=seal_mm,
            run_mm=run_mm,
            end_mm=1.1 * paths["segment_error"],
            sibling_share=check_bodies.limits_under(changed)["sibling_share"],
            packing_percent=packing["error"],
            film_mm=material.plies * material.ply_mm.value / packing["packing"],
            clearance_mm=least_gap_mm(check_clearance, changed, taken_mm(profile)),
            segment_mm=LEAST_SEGMENT_MM,
            side_mm=1.001 * paths["segment_error"],
            drawn_mm=max(fillet_mm, run_mm),
            steepest=STEEPEST,
            compensated=build.compensation != "none",
            sheet_wide_mm=sheet_mm[0],
            sheet_high_mm=sheet_mm[1],
            yield_kpa=fit.loose.yield_kpa.value,
            drag_kpa_mm=fit.loose.drag_kpa_m.value / 1000.0,
            storage_kpa=fit.loose.storage_kpa.value,
            friction=fit.loose.friction.value,
            most_branches=MOST_CHECKED_BRANCHES,
            most=MOST_OF_ONE,
            most_cuts=build.pieces.most - 1 if build.pieces else 0,
            most_steps=MOST_STEPS,
            least_depth=LEAST_DEPTH,
            reach_mm=reach_mm(profile),
            before_mm=STRAIGHT_BEFORE_MM,
            lap_mm=size.lap_mm,
            blend_ratio=BLEND_RATIO,
            after_mm=STRAIGHT_AFTER_MM,
            rise_mm=size.rise_mm,
            beside_mm=beside_mm(size, reach_mm(profile)),
            on_stub=size.socket_on_stub,
            lap_film_mm=material.film_mm / laps["packing"],
            lap_percent=laps["error"],
        )
        return cls(profile=profile, changed=changed, limits=limits, grows=grows)

    def of_builds(
        self, builds: Sequence[Build], fans: Sequence[Mapping[int, Collection[int]]]
    ) -> "BatchPenalty":
        """Return the penalty of designs with some builds.

        Parameters
        ----------
        fans
            Of each build, the numbers of children that the joints below each level may have, the
            trunk's at 0.
        """
        tables = _tables(self, builds, fans)
        return BatchPenalty(tables=tables, limits=self.limits)

    def of_space(self, space: Space) -> "BatchPenalty":
        """Return the penalty of a space's designs, one build for each depth."""
        deepest, fans = int(space.settings.levels.high), dict[int, range]()
        for place in range(deepest - 1):
            branches = space.settings.bounds(place + 2, "branches")
            fans[place] = range(int(branches.low), min(int(branches.high), MOST_CHILDREN) + 1)
        builds = [space.build_of(depth) for depth in range(1, deepest + 1)]
        return self.of_builds(builds, [fans] * deepest)

    def _at_once(self, designs: Sequence[Design]) -> "BatchPenalty":
        """Return the penalty of designs with a build each."""
        fans = [
            {place: (level.branches,) for place, level in enumerate(design.levels)}
            for design in designs
        ]
        return self.of_builds([design.build for design in designs], fans)

    def penalties(self, designs: Sequence[Design]) -> Floats:
        """Return the penalties of some designs with even fans, shape (m,)."""
        return self.found(designs).penalty

    def found(self, designs: Sequence[Design]) -> "BatchFound":
        """Return the penalties of some designs with even fans, and where the last one is cut."""
        return self._at_once(designs).found(*_rows(designs), self._known_sides(designs))

    def with_path_excess(self, designs: Sequence[Design]) -> tuple[Floats, Floats]:
        """Return the penalties of some designs, and their distances from paths fit for the laser.

        That is the summed excess of straight sides and drawn fillets that are too small; (m,) each.
        """
        at_once, rows = self._at_once(designs), _rows(designs)
        found = at_once.found(*rows, self._known_sides(designs))
        return found.penalty, at_once.path_excess(*rows)

    def _known_sides(self, designs: Sequence[Design]) -> tuple[Floats, Floats] | None:
        """Return where sides of tapered branches are straight, from outlines; None without any.

        Of each design, level and child where they begin and how far before the end they stop, mm.
        """
        if self.limits.most_cuts == 0 or not any(design.build.taper for design in designs):
            return None
        children = max((level.branches for design in designs for level in design.levels), default=1)
        begins, stops = np.zeros((2, len(designs), MOST_LEVELS, children))
        for number, design in enumerate(designs):
            flat = quick_pattern(design, self.profile.material).flat
            layout = flat_layout(flat)
            size = sleeve_size(design.build, self.profile)
            sides, tree = sleeve_sides(flat, layout, size, self.limits.reach_mm), layout.tree
            counts = np.array([1, *(level.branches for level in design.levels)])
            first = np.searchsorted(tree.level, tree.level)
            child = (np.arange(len(tree)) - first) % counts[tree.level - 1]
            begins[number, tree.level - 1, child] = sides.start_mm
            stops[number, tree.level - 1, child] = tree.length_mm - sides.end_mm
        return begins, stops


class BatchFound(NamedTuple):
    """The penalties of some designs."""

    penalty: Floats  # NaN for those with too many branches, shape (m,)
    joints: Ints  # how many sleeve joints each takes, 0 for those, shape (m,)
    cut: Ints  # branches of the last design that are cut
    left: float  # what is left of its conflicts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BatchPenalty:
    """The penalty of designs with the same few builds, many at once."""

    tables: LevelTables
    limits: PenaltyLimits

    def __call__(self, designs: DesignBatch) -> Floats:
        """Return the penalties of a space's designs, NaN for those with too many branches; (m,)."""
        return self.with_joints(designs)[0]

    def with_joints(self, designs: DesignBatch) -> tuple[Floats, Ints]:
        """Return the penalties of a space's designs, and how many sleeve joints they take.

        Joints are 0 for designs with too many branches, which have penalty NaN; shape (m,) each.
        """
        found = self.found(designs, designs.depth - 1)
        return found.penalty, found.joints

    def found(
        self, designs: DesignBatch, builds: Ints, sides: tuple[Floats, Floats] | None = None
    ) -> BatchFound:
        """Return the penalties of designs with some builds, by their rows in the tables.

        ``sides``: where the sides of tapered designs are straight.
        """
        rows = np.flatnonzero(designs.sizes <= MOST_BRANCHES)
        if len(rows) == len(designs):
            return self._of_valid(designs, builds, sides)
        penalty, joints = np.full(len(designs), np.nan), np.zeros(len(designs), dtype=np.int64)
        if not len(rows):
            return BatchFound(penalty, joints, np.empty(0, dtype=np.int64), math.inf)
        known = None if sides is None else (sides[0][rows], sides[1][rows])
        some = self._of_valid(designs.part(rows), builds[rows], known)
        penalty[rows], joints[rows] = some.penalty, some.joints
        return some._replace(penalty=penalty, joints=joints)

    def path_excess(self, designs: DesignBatch, builds: Ints) -> Floats:
        """Return by how much sides and drawn fillets are too small to run, summed; shape (m,)."""
        arrays, excess = _arrays(designs, builds), np.zeros(len(designs))
        scratch = _scratch(1, 1, int(designs.branches.max(initial=1)))
        penalty_kernel.add_path_excess(arrays, self.tables, self.limits, scratch, excess)
        return excess

    def _of_valid(
        self, designs: DesignBatch, builds: Ints, sides: tuple[Floats, Floats] | None
    ) -> BatchFound:
        """Return the penalties and joints of designs of which none is too large."""
        arrays, sizes = _arrays(designs, builds), designs.sizes
        flat = np.where(sizes <= MOST_CHECKED_BRANCHES, sizes, 0)
        pouches, tails = (
            np.diff(first)[builds] for first in (self.tables.pouch_first, self.tables.tail_first)
        )
        capsules, largest = int((flat * (1 + pouches) + tails).max()), int(sizes.max())
        children = int(designs.branches.max(initial=1))
        penalty, joints = np.empty(len(designs)), np.zeros(len(designs), dtype=np.int64)
        if self.limits.most_cuts == 0:
            scratch = _scratch(largest, capsules, children)
            penalty_kernel.penalize(arrays, self.tables, self.limits, scratch, penalty)
            return BatchFound(penalty, joints, joints[:0], math.inf)
        parts = min(int(flat.max()), MOST_PIECE_BRANCHES)
        scratch = _scratch(largest, capsules + 3 * parts, children)
        cutting = _cut_scratch(parts, capsules, children, sides)
        penalty_kernel.penalize_pieces(
            arrays, self.tables, self.limits, scratch, cutting, penalty, joints
        )
        return BatchFound(penalty, joints, np.flatnonzero(cutting.cut), float(cutting.left[0]))


def _rows(designs: Sequence[Design]) -> tuple[DesignBatch, Ints]:
    """Return designs with a build each as arrays, and the rows of their builds."""
    return DesignBatch.of(*designs), np.arange(len(designs))


def _arrays(designs: DesignBatch, builds: Ints) -> DesignArrays:
    """Return designs and their trees for the kernel."""
    tree = batch_branches(designs)
    return DesignArrays(
        depth=np.ascontiguousarray(designs.depth),
        build=np.ascontiguousarray(builds),
        trunk=np.ascontiguousarray(designs.trunk_mm),
        branches=np.ascontiguousarray(designs.branches),
        fan=np.ascontiguousarray(designs.fan_rad),
        size=np.ascontiguousarray(designs.length_mm),
        growth=np.ascontiguousarray(designs.growth),
        first=tree.first,
        parent=tree.parent,
        level=tree.level,
        offset=tree.offset_rad,
        length=tree.length_mm,
    )


def _cut_scratch(
    branches: int, capsules: int, children: int, sides: tuple[Floats, Floats] | None
) -> CutScratch:
    """Return memory for the pieces of a design, with at most so many children in a fan."""
    pairs = min(MOST_CONFLICTS, capsules * capsules // 2)
    ways, unknown = 2 * MOST_LEVELS, np.zeros((0, MOST_LEVELS, children))
    begins, stops = (unknown, unknown) if sides is None else sides

    def whole(*shape: int) -> Ints:
        return np.zeros(shape, dtype=np.int64)

    return CutScratch(
        one=whole(pairs),
        two=whole(pairs),
        depth=np.empty(pairs),
        also=whole(pairs),
        top=whole(pairs),
        between=np.empty((pairs, ways), dtype=np.int64),
        ways=whole(pairs),
        order=whole(pairs),
        can=whole(branches),
        cut=whole(branches),
        best=whole(branches),
        banned=whole(branches),
        used=whole(branches),
        weight=whole(branches),
        share=np.empty(branches),
        piece=whole(branches),
        wide=np.empty(branches),
        rise=np.empty(branches),
        begin=np.zeros((MOST_LEVELS, children)),
        stop=np.zeros(MOST_LEVELS),
        begins=begins,
        stops=stops,
        option=whole(branches + 1, ways),
        options=whole(branches + 1),
        tried=whole(branches + 1),
        path=whole(ways),
        hit=whole(3),
        needed=whole(1),
        left=np.full(1, math.inf),
        below=np.zeros((branches, MOST_LEVELS)),
        laps=whole(branches),
        fullest=np.zeros(MOST_LEVELS),
    )


_TURN = np.stack(
    [np.cos(np.arange(TURNS) * np.pi / TURNS), np.sin(np.arange(TURNS) * np.pi / TURNS)]
)
"""Cosine and sine of the rotations on the sheet that are tried."""


def _scratch(branches: int, capsules: int, children: int) -> Scratch:
    """Return memory for the largest design, with at most so many children in a fan."""
    return Scratch(
        angle=np.zeros((MOST_LEVELS, children)),
        run=np.zeros((MOST_LEVELS, children)),
        gap=np.zeros((MOST_LEVELS, children + 1)),
        short=np.zeros(MOST_LEVELS),
        passage=np.ones(MOST_LEVELS),
        heading=np.empty(branches),
        riding=np.empty(branches),
        factor=np.empty(branches),
        drag=np.empty(branches),
        capsule=np.empty((capsules, 6)),
        box=np.empty((capsules, 4)),
        owner=np.empty(capsules, dtype=np.int64),
        bare=np.zeros(1, dtype=np.int64),
        turn=_TURN,
        low=np.empty(TURNS),
        high=np.empty(TURNS),
    )


def width_violations(build: Build, changed: LimitChanges) -> float:
    """Return the summed depths of violations by the widths of the levels, whatever they hold."""
    widths_mm, ends_mm = build.widths_mm, build.end_widths_mm
    least_mm, least = (
        rule.limits_under(changed)["error"] for rule in (check_least_width, check_width_ratio)
    )
    ratios = (wide / narrow for wide, narrow in zip(ends_mm, widths_mm[1:], strict=False))
    narrow = math.fsum((least_mm - mm) / least_mm for mm in ends_mm if mm < least_mm)
    return narrow + math.fsum((least - ratio) / least for ratio in ratios if ratio < least)


def _tables(
    rules: PenaltyRules, builds: Sequence[Build], fans: Sequence[Mapping[int, Collection[int]]]
) -> LevelTables:
    """Return the tables that depend on a build and a level alone."""
    profile, changed, limits = rules.profile, rules.changed, rules.limits
    material, window = profile.material, check_window.limits_under(changed)
    # How the fans that some builds may have are cut: each law once, and where it stands.
    counts = {count for by_place in fans for some in by_place.values() for count in some}
    children = min(MOST_CHILDREN, max(counts, default=1))
    law_at = np.full((len(builds), max(len(one.widths_mm) for one in builds), children + 1), -1)
    laws: dict[FanLaw, int] = {}
    for row, (build, by_place) in enumerate(zip(builds, fans, strict=True)):
        for place in range(len(build.widths_mm) - 1):
            for count in (count for count in by_place[place] if count <= children):
                pair_mm = build.end_widths_mm[place], build.widths_mm[place + 1]
                law = joint_law(build, material, pair_mm, build.fillet_mm[place], count)
                law_at[row, place, count] = laws.setdefault(law, len(laws))
    law_rows = [law.rows for law in laws if limits.compensated]
    drawn = [law.passages_as_drawn for law in laws if not limits.compensated]
    fitted_mm = GrowthConstantsRange.of(profile, window).diameter_mm
    widths_mm = _padded([build.widths_mm for build in builds])
    ends_mm = _padded([build.end_widths_mm for build in builds])
    leaves_mm = np.array([(build.widths_mm[-1], build.end_widths_mm[-1]) for build in builds]).T
    pouch_mm = np.array([build.pouch.flat_width_mm if build.pouch else 0.0 for build in builds])
    pouch_shares = pouch_mm * limits.film_mm / (lumen_area_mm2(1.0) * leaves_mm[1] ** 2)
    pouches = [pouch_capsules(build.pouch, usual_leaf(build)) for build in builds]
    tails = map(tail_capsules, builds)
    pouch_first, pouch = _capsule_rows(pouches)
    tail_first, tail = _capsule_rows(list(tails))
    tails_mm = np.array([build.tail_mm for build in builds])
    collars_mm = np.array([build.collar.reach_mm if build.collar else 0.0 for build in builds])
    return LevelTables(
        half=widths_mm / 2.0,
        end_half=ends_mm / 2.0,
        fillet=_padded([level_fillets_mm(build) for build in builds]),
        area=lumen_area_mm2(1.0) * ends_mm**2,
        scale=fitted_mm / (inflated_diameter_mm(1.0) * widths_mm),
        stretch=_padded(
            [[stretch_at(build, material, mm) for mm in build.widths_mm] for build in builds]
        )
        if limits.compensated
        else np.ones_like(widths_mm),
        widths=np.array([width_violations(build, changed) for build in builds]),
        tip=np.array([pouch_takes_mm(usual_leaf(build), build.pouch) for build in builds]),
        tip_cut=np.array(
            [pouch_takes_mm(usual_leaf(build), build.pouch, limits.reach_mm) for build in builds]
        ),
        pouch_share=np.where(pouch_mm > leaves_mm[1], pouch_shares, 0.0),
        leaf_width=np.maximum(leaves_mm[0], pouch_mm),
        tail_mm=tails_mm,
        even_mm=tails_mm - collars_mm,
        most_kpa=np.array(
            [most_growth_kpa(one, profile, window) if rules.grows else math.inf for one in builds]
        ),
        widest_mm=np.array([widest_cut_mm(build, profile, changed) for build in builds]),
        pouch_first=pouch_first,
        pouch=pouch,
        tail_first=tail_first,
        tail=tail,
        law_at=law_at,
        law=np.array(law_rows).reshape(-1, FANS, 2 * MOST_CHILDREN + 2),
        least=np.array([law.least_rad for law in laws]),
        drawn=np.array(drawn).reshape(-1, FANS, 1),
        most_turn=MOST_TURN_RAD,
        least_length=LEAST_LENGTH,
    )


def _padded(rows: Sequence[Sequence[float]]) -> Floats:
    """Return rows of different lengths as one table, with ones where they end."""
    longest = max(map(len, rows))
    return np.array([[*row, *[1.0] * (longest - len(row))] for row in rows])


def _capsule_rows(found: Sequence[Sequence[tuple[Point, Point, float]]]) -> tuple[Ints, Floats]:
    """Return where the capsules of each build begin, and all of them, as in `LevelTables`."""
    rows = [[*start, *end, half, half] for some in found for start, end, half in some]
    return np.cumsum([0, *map(len, found)]), np.array(rows).reshape(-1, 6)
