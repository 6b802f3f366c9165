"""Penalties of many designs at once: the tables and limits that the compiled kernel needs.

Everything that depends on a build and a level alone is computed once, by the rules.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

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
from vinefab.inflation import law
from vinefab.inflation.pattern import (
    FANS,
    LEAST_LENGTH,
    MOST_CHILDREN,
    MOST_TURN_RAD,
    FanLaw,
    joint_law,
    quick_pattern,
    strain_at,
    stretch_at,
)
from vinefab.inflation.table import FILLET
from vinefab.model.design import MOST_BRANCHES, MOST_LEVELS, Build, Design
from vinefab.model.laser import LaserProfile, Material
from vinefab.outline.body_outline import flat_layout
from vinefab.outline.ends import Leaf, level_fillets_mm, pouch_takes_mm
from vinefab.outline.joint import LEAST_SEGMENT_MM, STEEPEST, Point
from vinefab.physics.tube import inflated_diameter_mm, lumen_area_mm2
from vinefab.search.space import BatchBranches, DesignBatch, DesignSpace, batch_branches
from vinefab.search.tree_batch import TreeBatch

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

_Entry = TypeVar("_Entry")

MOST_STEPS = 64
"""Sets of cuts that are looked at for each design."""


class TreeRows(NamedTuple):
    """Trees, m of them, as the kernel takes them: straight parts, one tree after the other."""

    depth: Ints  # levels of each tree, the trunk included, shape (m,)
    build: Ints  # row of each tree's build in the tables, shape (m,)
    first: Ints  # where each tree's rows begin, shape (m + 1,)
    # every row, parents first; places are counted within a tree
    parent: Ints  # row before, -1 for trunks
    level: Ints  # 1 for trunks
    kid: Ints  # first of the rows that begin at its end, which follow each other
    kids: Ints  # how many these are
    bend: Ints  # 1 where it continues its branch behind a bend, else 0
    leaf: Ints  # 1 where its branch has no children, else 0
    offset: Floats  # angle from the heading of the row before, rad
    length: Floats  # mm
    half: Floats  # half the lay-flat width where it begins, mm
    end_half: Floats  # the same where it ends
    fillet: Floats  # radius at the joint where it begins, mm
    stretch: Floats  # by which it grows longer under pressure
    strain: Floats  # hoop strain of its film where it ends

    @classmethod
    def of(
        cls,
        rows: BatchBranches,
        depth: Ints,
        builds: Ints,
        sizes: "Sizes",
        is_bent: NDArray[np.bool_],
    ) -> "TreeRows":
        """Return rows, and which of them begin at the end of which."""
        start = np.repeat(rows.first[:-1], np.diff(rows.first))
        children = np.flatnonzero(rows.parent >= 0)
        above = start[children] + rows.parent[children]
        kids = np.bincount(above, minlength=len(rows.parent))
        kid = np.zeros(len(rows.parent), dtype=np.int64)
        kid[above[::-1]] = (children - start[children])[::-1]  # the first of them is written last
        leaf = (kids == 0).astype(np.int64)
        for row in np.flatnonzero(is_bent)[::-1].tolist():
            leaf[start[row] + rows.parent[row]] = leaf[row]
        return cls(
            depth=np.ascontiguousarray(depth),
            build=np.ascontiguousarray(builds),
            first=rows.first,
            parent=rows.parent,
            level=rows.level,
            kid=kid,
            kids=kids,
            bend=is_bent.astype(np.int64),
            leaf=leaf,
            offset=rows.offset_rad,
            length=rows.length_mm,
            **sizes._asdict(),
        )


class Sizes(NamedTuple):
    """Sizes of branches: of rows, or of each of b builds and n levels, shape (b, n)."""

    half: Floats  # half the lay-flat width where its branches begin, mm
    end_half: Floats  # the same where they end
    fillet: Floats  # radius at the joint below, mm
    stretch: Floats  # by which its tubes grow longer under pressure
    strain: Floats  # hoop strain of its film where its branches end


class BuildTables(NamedTuple):
    """What depends on a build and a level alone, for b builds of at most n levels."""

    # of a leaf of each level, shape (b, n)
    tip: Floats  # what the pouch takes of it, mm
    tip_cut: Floats  # the same where the cut runs, mm
    pouch_share: Floats  # share of its lumen that its own pouch fills
    pouch_width: Floats  # lay-flat width of the pouch, mm; 0 without
    # of each build, shape (b,)
    tail_mm: Floats
    even_mm: Floats  # what of the tail is as wide as the trunk
    most_kpa: Floats  # most that growth may take
    widest_mm: Floats  # branch that may be cut
    # Capsules of the pouch in the frame of the tip, and of the tail in that of the base: where each
    # build's begin, of pouches for each level, how many a pouch has or the total at the end, and
    # both ends and half widths, mm, shape (k, 6).
    pouch_first: Ints
    pouch_count: Ints
    pouch: Floats
    tail_first: Ints
    tail: Floats
    # how even fans are cut; laws by their place, with or without compensation
    law_at: Ints  # of each level below the trunk and number of children, -1 for none, (b, n, c)
    law: Floats  # by deployed fan: `FanLaw.rows`; no rows where they are cut as designed
    least: Floats  # smallest deployed fan among the simulated ones, rad
    drawn: Floats  # passages of fans cut as designed, by fan; no rows where fans are compensated
    most_turn: float  # by which children are turned so that their tips come near, rad
    least_length: float  # share of a planned length that is always cut
    # the law of single joints: flat angles from deployed ones where designs are compensated, else
    # deployed ones from flat ones
    law_first: Floats  # as of `vinefab.inflation.law.Network`
    law_second: Floats
    law_last: Floats
    law_within: Floats  # ranges of width ratio, fillet ratio and strain, shape (3, 2)
    law_least_deg: float  # least gap between siblings that it knows
    law_most_deg: float  # most that a child may turn
    law_children: int  # most children of a joint
    gain: float  # how far joints turn over the simulated, as measured


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
    lumen: float  # cross-section of an inflated lumen over the square of its lay-flat width
    fitted_width_mm: float  # lay-flat width of the tube that the growth constants were fitted to
    width_mm: float  # least lay-flat width of a branch
    width_ratio: float  # least width of a parent over that of its child
    each_place: bool  # whether every place counts, not only the worst of each level


class Scratch(NamedTuple):
    """Memory for one tree: its rows, then its capsules."""

    # as cut, of each row
    angle: Floats  # from the heading of the row before, rad
    run: Floats  # length, mm
    before: Floats  # angle to the next body clockwise, rad
    after: Floats  # and to the next one counter-clockwise
    passage: Floats  # of the joint where it begins
    away: Floats  # mean way from its end to the tips beyond, as planned, mm
    above: Floats  # length of the shortest row that ends in a joint like its own, mm
    begin: Floats  # where its sides begin to be straight, from its base, mm
    twin: Ints  # first row with the same joint at its end
    stop: Floats  # where its sides stop to be straight, before its end, mm
    heading: Floats  # rad
    riding: Floats  # lay-flat area of the film inside, mm2
    factor: Floats  # on the store's tension
    drag: Floats  # of all segments before
    inside: Floats  # film that rides in it, mm across, by level; shape (k, levels)
    worst: Floats  # worst violation of each kind on each level, shape (kinds, levels)
    # start x, start y, end x, end y, half the width at the start and at the end, mm, shape (k, 6)
    capsule: Floats
    box: Floats  # low x, low y, high x, high y, mm, shape (k, 4)
    owner: Ints  # row that each capsule belongs to, shape (k,)
    bare: Ints  # capsules before those of pouches, shape (1,)
    turn: Floats  # cosine and sine of the rotations tried, shape (2, t)
    low: Floats  # lowest place across each rotation, mm, shape (t,)
    high: Floats  # highest place, mm, shape (t,)
    law: Floats  # rows of one joint for the law, see the kernel


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
    # where the cut's straight sides begin from each row's base, and stop before its end, mm
    begin: Floats
    stop: Floats
    # of tapered designs, known from their outlines, of all rows of all trees; else empty
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
    # what the tables have of builds that were asked for before
    known: dict[Build, "_OfBuild"] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        build: Build,
        profile: LaserProfile,
        changed: LimitChanges,
        sheet_mm: tuple[float, float],
        *,
        grows: bool = True,
        each_place: bool = False,
    ) -> "PenaltyRules":
        """Return the rules for a recipe, its changed limits and builds like one.

        Parameters
        ----------
        sheet_mm
            Width and height that the flat robot must fit after a rotation. Subtract a few
            millimetres for seam, kerf and the overcut at the mouth.
        each_place
            Whether every place that violates a rule counts, not only the worst of each level: the
            penalty falls wherever one branch of many gets better, and is 0 for the same designs.
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
            lumen=float(lumen_area_mm2(1.0)),
            fitted_width_mm=fit.diameter_mm / float(inflated_diameter_mm(1.0)),
            width_mm=check_least_width.limits_under(changed)["error"],
            width_ratio=check_width_ratio.limits_under(changed)["error"],
            each_place=each_place,
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
        found = [self._of_build(build) for build in builds]
        return BatchPenalty(
            tables=_tables(self, found, fans),
            levels=Sizes(
                *(_padded(some) for some in zip(*(one.sizes for one in found), strict=True))
            ),
            limits=self.limits,
            builds=tuple(builds),
            material=self.profile.material,
        )

    def _of_build(self, build: Build) -> "_OfBuild":
        """Return what the tables have of a build."""
        most_known = 4096
        if build not in self.known:
            if len(self.known) >= most_known:
                self.known.clear()
            self.known[build] = _of_build(self, build)
        return self.known[build]

    def of_space(self, space: DesignSpace) -> "BatchPenalty":
        """Return the penalty of a space's designs, one build for each depth."""
        deepest, fans = int(space.settings.levels.high), dict[int, range]()
        for place in range(deepest - 1):
            branches = space.settings.bounds(place + 2, "branches")
            fewest = 1 if space.settings.tree == "free" else int(branches.low)
            fans[place] = range(fewest, min(int(branches.high), MOST_CHILDREN) + 1)
        builds = [space.build_of(depth) for depth in range(1, deepest + 1)]
        return self.of_builds(builds, [fans] * deepest)

    def at_once(self, designs: Sequence[Design]) -> tuple["BatchPenalty", TreeBatch]:
        """Return the penalty of designs with a build each, and their trees."""
        trees = TreeBatch.of_designs(designs)
        builds = [design.build for design in designs]
        return self.of_trees(trees, builds, np.arange(len(designs))), trees

    def of_trees(self, trees: TreeBatch, builds: Sequence[Build], rows: Ints) -> "BatchPenalty":
        """Return the penalty of some trees, by the rows of their builds."""
        return self.of_builds(builds, _even_fans(trees, rows, len(builds)))

    def penalties(self, designs: Sequence[Design]) -> Floats:
        """Return the penalties of some designs, shape (m,)."""
        return self.found(designs).penalty

    def found(self, designs: Sequence[Design]) -> "BatchFound":
        """Return the penalties of some designs, and where the last one is cut."""
        at_once, trees = self.at_once(designs)
        return at_once.found(trees, np.arange(len(designs)), self.known_sides(designs))

    def known_sides(self, designs: Sequence[Design]) -> tuple[Floats, Floats] | None:
        """Return where sides of tapered branches are straight, from outlines; None without any.

        Of each row of each design where they begin and how far before the end they stop, mm.
        """
        tapered = any((one.tree.end_width_mm != one.tree.width_mm).any() for one in designs)
        if self.limits.most_cuts == 0 or not tapered:
            return None
        begins, stops = list[Floats](), list[Floats]()
        for design in designs:
            flat = quick_pattern(design, self.profile.material).flat
            layout = flat_layout(flat)
            size = sleeve_size(design.build, self.profile)
            sides = sleeve_sides(flat, layout, size, self.limits.reach_mm)
            begins.append(sides.start_mm)
            stops.append(layout.tree.length_mm - sides.end_mm)
        return np.concatenate(begins), np.concatenate(stops)


def _even_fans(trees: TreeBatch, rows: Ints, count: int) -> list[dict[int, set[int]]]:
    """Return the numbers of children of even fans, by the level of their joints from 0.

    Of the trees with each build, by the rows of these. All other joints go by the law of single
    ones, and tables of fans take some milliseconds each.
    """
    close = 1e-8  # ten times as close as the kernel takes for even
    found = [dict[int, set[int]]() for _ in range(count)]
    children = np.flatnonzero((trees.parent >= 0) & ~trees.is_bent)
    if not len(children):
        return found
    above, offset = trees.row_before[children], trees.offset_rad[children]
    first = np.flatnonzero(np.concatenate([[True], above[1:] != above[:-1]]))
    sizes = np.diff(first, append=len(children))
    fan = np.repeat(offset[first + sizes - 1] - offset[first], sizes)
    place = np.arange(len(children)) - np.repeat(first, sizes)
    most = np.repeat(np.maximum(1, sizes - 1), sizes)
    even = np.where(np.repeat(sizes, sizes) > 1, fan * (place / most - 0.5), 0.0)
    is_even = np.logical_and.reduceat(np.abs(offset - even) <= close, first)
    build = rows[np.repeat(np.arange(len(trees)), np.diff(trees.first))[children[first]]]
    level = trees.level[children[first]] - 2
    kinds = np.stack([build, level, sizes])[:, is_even]
    for row, joint, size in np.unique(kinds, axis=1).T.tolist():
        found[row].setdefault(joint, set()).add(size)
    return found


class BatchFound(NamedTuple):
    """The penalties of some designs."""

    penalty: Floats  # NaN for those with too many branches, shape (m,)
    joints: Ints  # how many sleeve joints each takes, 0 for those, shape (m,)
    cut: Ints  # branches of the last design that are cut
    left: float  # what is left of its conflicts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BatchPenalty:
    """The penalty of designs with the same few builds, many at once."""

    tables: BuildTables
    levels: Sizes  # of each build and level
    limits: PenaltyLimits
    builds: tuple[Build, ...]
    material: Material

    def __call__(self, designs: DesignBatch | TreeBatch) -> Floats:
        """Return the penalties of a space's designs, NaN for those with too many branches; (m,)."""
        return self.with_joints(designs)[0]

    def with_joints(self, designs: DesignBatch | TreeBatch) -> tuple[Floats, Ints]:
        """Return the penalties of a space's designs, and how many sleeve joints they take.

        Joints are 0 for designs with too many branches, which have penalty NaN; shape (m,) each.
        """
        found = self.found(designs, designs.depth - 1)
        return found.penalty, found.joints

    def found(
        self,
        designs: DesignBatch | TreeBatch,
        builds: Ints,
        sides: tuple[Floats, Floats] | None = None,
    ) -> BatchFound:
        """Return the penalties of designs with some builds, by their rows in the tables.

        ``sides``: where the sides of tapered designs are straight.
        """
        rows = np.flatnonzero(designs.sizes <= MOST_BRANCHES)
        if len(rows) == len(designs):
            return self._of_valid(self._rows(designs, builds), sides)
        penalty, joints = np.full(len(designs), np.nan), np.zeros(len(designs), dtype=np.int64)
        if not len(rows):
            return BatchFound(penalty, joints, np.empty(0, dtype=np.int64), math.inf)
        some = self._of_valid(self._rows(designs.part(rows), builds[rows]), sides)
        penalty[rows], joints[rows] = some.penalty, some.joints
        return some._replace(penalty=penalty, joints=joints)

    def with_path_excess(
        self, designs: TreeBatch, builds: Ints, sides: tuple[Floats, Floats] | None = None
    ) -> tuple[Floats, Floats]:
        """Return the penalties of some trees, none too large, and their distances from paths.

        That is by how much sides and drawn fillets are too small to run, summed; (m,) each. Other
        parameters are as of `found`.
        """
        rows, excess = self._rows(designs, builds), np.zeros(len(designs))
        scratch = _scratch(int(np.diff(rows.first).max()), 1)
        penalty_kernel.add_path_excess(rows, self.tables, self.limits, scratch, excess)
        return self._of_valid(rows, sides).penalty, excess

    def _rows(self, designs: DesignBatch | TreeBatch, builds: Ints) -> TreeRows:
        """Return designs for the kernel."""
        if isinstance(designs, DesignBatch):
            rows = batch_branches(designs)
            at = np.repeat(builds, np.diff(rows.first)), rows.level - 1
            sizes = Sizes(*(one[at] for one in self.levels))
            is_bent = np.zeros(len(rows.parent), dtype=np.bool_)
            return TreeRows.of(rows, designs.depth, builds, sizes, is_bent)
        sizes = Sizes(
            half=designs.width_mm / 2.0,
            end_half=designs.end_width_mm / 2.0,
            fillet=designs.fillet_mm,
            stretch=self._stretches(designs, builds),
            strain=self._of_widths(strain_at, builds, designs, designs.end_width_mm),
        )
        rows = BatchBranches(
            first=designs.first,
            parent=designs.parent,
            level=designs.level,
            offset_rad=designs.offset_rad,
            length_mm=designs.length_mm,
        )
        return TreeRows.of(rows, designs.depth, builds, sizes, designs.is_bent)

    def _stretches(self, designs: TreeBatch, builds: Ints) -> Floats:
        """Return by how much the tube of each row grows longer."""
        if not self.limits.compensated:
            return np.ones(len(designs.parent))
        return self._of_widths(stretch_at, builds, designs, designs.width_mm)

    def _of_widths(
        self,
        value: Callable[[Build, Material, float], float],
        builds: Ints,
        designs: TreeBatch,
        width_mm: Floats,
    ) -> Floats:
        """Return a value of the tube of each row; those of equal widths are worked out once."""
        pairs = width_mm + 1j * np.repeat(builds, np.diff(designs.first))  # which sort fast
        known, place = np.unique(pairs, return_inverse=True)
        values = [
            value(self.builds[int(one.imag)], self.material, one.real) for one in known.tolist()
        ]
        return np.array(values)[place]

    def _of_valid(self, rows: TreeRows, sides: tuple[Floats, Floats] | None) -> BatchFound:
        """Return the penalties and joints of trees of which none is too large."""
        sizes = np.diff(rows.first)
        flat = np.where(sizes <= MOST_CHECKED_BRANCHES, sizes, 0)
        pouches = self.tables.pouch_count[rows.build]
        tails = np.diff(self.tables.tail_first)[rows.build]
        capsules, largest = int((flat * (1 + pouches) + tails).max()), int(sizes.max())
        count = len(rows.depth)
        penalty, joints = np.empty(count), np.zeros(count, dtype=np.int64)
        if self.limits.most_cuts == 0:
            scratch = _scratch(largest, capsules)
            penalty_kernel.penalize(rows, self.tables, self.limits, scratch, penalty)
            return BatchFound(penalty, joints, joints[:0], math.inf)
        parts = min(int(flat.max()), MOST_PIECE_BRANCHES)
        scratch = _scratch(largest, capsules + 3 * parts)
        cutting = _cut_scratch(parts, capsules, sides)
        penalty_kernel.penalize_pieces(
            rows, self.tables, self.limits, scratch, cutting, penalty, joints
        )
        return BatchFound(penalty, joints, np.flatnonzero(cutting.cut), float(cutting.left[0]))


def _cut_scratch(branches: int, capsules: int, sides: tuple[Floats, Floats] | None) -> CutScratch:
    """Return memory for the pieces of a tree with so many rows."""
    pairs = min(MOST_CONFLICTS, capsules * capsules // 2)
    ways, unknown = 2 * MOST_LEVELS, np.empty(0)
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
        begin=np.zeros(branches),
        stop=np.zeros(branches),
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


LAW_ROOM = 64
"""Units, or inputs, that a layer of the law may have."""


def _scratch(rows: int, capsules: int) -> Scratch:
    """Return memory for the largest tree."""
    return Scratch(
        angle=np.zeros(rows),
        run=np.zeros(rows),
        before=np.zeros(rows),
        after=np.zeros(rows),
        passage=np.ones(rows),
        away=np.zeros(rows),
        above=np.zeros(rows),
        begin=np.zeros(rows),
        twin=np.zeros(rows, dtype=np.int64),
        stop=np.zeros(rows),
        heading=np.empty(rows),
        riding=np.empty(rows),
        factor=np.empty(rows),
        drag=np.empty(rows),
        inside=np.zeros((rows, MOST_LEVELS)),
        worst=np.zeros((5, MOST_LEVELS)),
        capsule=np.empty((capsules, 6)),
        box=np.empty((capsules, 4)),
        owner=np.empty(capsules, dtype=np.int64),
        bare=np.zeros(1, dtype=np.int64),
        turn=_TURN,
        low=np.empty(TURNS),
        high=np.empty(TURNS),
        law=np.empty((penalty_kernel.LAW_ROWS, LAW_ROOM)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _OfBuild:
    """What the tables have of one build."""

    build: Build
    sizes: tuple[Sequence[float], ...]  # as of `Sizes`, by level
    # of a leaf of each level
    tip_mm: Sequence[float]
    tip_cut_mm: Sequence[float]
    pouch_share: Sequence[float]
    pouch: Sequence[Sequence[tuple[Point, Point, float]]]
    # of the build
    pouch_mm: float
    tail: Sequence[tuple[Point, Point, float]]
    most_kpa: float
    widest_mm: float
    # of even fans, by their parent's level from 0 and number of children, once asked for
    laws: dict[tuple[int, int], FanLaw] = field(default_factory=dict)

    def law(self, place: int, children: int, material: Material) -> FanLaw:
        """Return the law of joints with so many children."""
        key, build = (place, children), self.build
        if key not in self.laws:
            pair_mm = build.end_widths_mm[place], build.widths_mm[place + 1]
            fillet_mm = build.fillet_mm[place]
            self.laws[key] = joint_law(build, material, pair_mm, fillet_mm, children)
        return self.laws[key]


def _of_build(rules: PenaltyRules, build: Build) -> _OfBuild:
    """Return what the tables have of one build."""
    profile, changed, limits = rules.profile, rules.changed, rules.limits
    material, window = profile.material, check_window.limits_under(changed)
    widths_mm, ends_mm, fillets_mm = build.widths_mm, build.end_widths_mm, level_fillets_mm(build)
    leaves = [
        Leaf(half_mm=end_mm / 2.0, lean_rad=0.0, fillet_mm=fillet_mm)
        for end_mm, fillet_mm in zip(ends_mm, fillets_mm, strict=True)
    ]
    pouch_mm = build.pouch.flat_width_mm if build.pouch else 0.0
    is_stretched = limits.compensated
    return _OfBuild(
        build=build,
        sizes=(
            [mm / 2.0 for mm in widths_mm],
            [mm / 2.0 for mm in ends_mm],
            fillets_mm,
            [stretch_at(build, material, mm) if is_stretched else 1.0 for mm in widths_mm],
            [strain_at(build, material, mm) for mm in ends_mm],
        ),
        tip_mm=[pouch_takes_mm(leaf, build.pouch, 0.0) for leaf in leaves],
        tip_cut_mm=[pouch_takes_mm(leaf, build.pouch, limits.reach_mm) for leaf in leaves],
        pouch_share=[
            pouch_mm * limits.film_mm / (limits.lumen * mm**2) if pouch_mm > mm else 0.0
            for mm in ends_mm
        ],
        pouch=[pouch_capsules(build.pouch, leaf) for leaf in leaves],
        pouch_mm=pouch_mm,
        tail=tail_capsules(build),
        most_kpa=most_growth_kpa(build, profile, window) if rules.grows else math.inf,
        widest_mm=widest_cut_mm(build, profile, changed),
    )


def _tables(
    rules: PenaltyRules, found: Sequence[_OfBuild], fans: Sequence[Mapping[int, Collection[int]]]
) -> BuildTables:
    """Return the tables that depend on a build and a level alone."""
    limits, material = rules.limits, rules.profile.material
    builds = [one.build for one in found]
    single = law.network("flat" if limits.compensated else "deployed")
    # How the fans that some builds may have are cut: each law once, and where it stands.
    counts = {count for by_place in fans for some in by_place.values() for count in some}
    children = min(MOST_CHILDREN, max(counts, default=1))
    law_at = np.full((len(builds), max(len(one.widths_mm) for one in builds), children + 1), -1)
    fan_laws: dict[FanLaw, int] = {}
    for row, (one, by_place) in enumerate(zip(found, fans, strict=True)):
        for place in range(len(one.build.widths_mm) - 1):
            for count in (count for count in by_place.get(place, ()) if count <= children):
                by_fan = one.law(place, count, material)
                law_at[row, place, count] = fan_laws.setdefault(by_fan, len(fan_laws))
    law_rows = [one.rows for one in fan_laws if limits.compensated]
    drawn = [one.passages_as_drawn for one in fan_laws if not limits.compensated]
    pouches = _filled([one.pouch for one in found])
    pouch_first, pouch = _capsule_rows([one for row in pouches for one in row])
    tail_first, tail = _capsule_rows([one.tail for one in found])
    pouch_share = _padded([one.pouch_share for one in found], 0.0)
    tails_mm = np.array([build.tail_mm for build in builds])
    collars_mm = np.array([build.collar.reach_mm if build.collar else 0.0 for build in builds])
    return BuildTables(
        tip=_padded([one.tip_mm for one in found]),
        tip_cut=_padded([one.tip_cut_mm for one in found]),
        pouch_share=pouch_share,
        pouch_width=np.repeat([[one.pouch_mm] for one in found], pouch_share.shape[1], axis=1),
        tail_mm=tails_mm,
        even_mm=tails_mm - collars_mm,
        most_kpa=np.array([one.most_kpa for one in found]),
        widest_mm=np.array([one.widest_mm for one in found]),
        pouch_first=pouch_first[:-1].reshape(len(builds), -1),
        pouch_count=np.array([len(row[0]) for row in pouches]),
        pouch=pouch,
        tail_first=tail_first,
        tail=tail,
        law_at=law_at,
        law=np.array(law_rows).reshape(-1, FANS, 2 * MOST_CHILDREN + 2),
        least=np.array([one.least_rad for one in fan_laws]),
        drawn=np.array(drawn).reshape(-1, FANS, 1),
        most_turn=MOST_TURN_RAD,
        least_length=LEAST_LENGTH,
        law_first=single.first if single else np.zeros((1, 1)),
        law_second=single.second if single else np.zeros((1, 1)),
        law_last=single.last if single else np.zeros((1, 1)),
        law_within=np.array([law.RATIO, FILLET, law.STRAIN]),
        law_least_deg=law.LEAST_GAP_DEG,
        law_most_deg=law.MOST_ANGLE_DEG,
        law_children=law.MOST_CHILDREN if single else 0,
        gain=1.0 if material.closing_gain is None else material.closing_gain.value,
    )


def _filled(rows: Sequence[Sequence[_Entry]]) -> list[list[_Entry]]:
    """Return rows of different lengths as long as the longest, their last entry repeated."""
    longest = max(map(len, rows))
    return [[*row, *[row[-1]] * (longest - len(row))] for row in rows]


def _padded(rows: Sequence[Sequence[float]], empty: float = 1.0) -> Floats:
    """Return rows of different lengths as one table, with a value behind where they end."""
    longest = max(map(len, rows))
    return np.array([[*row, *[empty] * (longest - len(row))] for row in rows])


def _capsule_rows(found: Sequence[Sequence[tuple[Point, Point, float]]]) -> tuple[Ints, Floats]:
    """Return where the capsules of each build begin, and all of them, as in `BuildTables`."""
    rows = [[*start, *end, half, half] for some in found for start, end, half in some]
    return np.cumsum([0, *map(len, found)]), np.array(rows).reshape(-1, 6)
