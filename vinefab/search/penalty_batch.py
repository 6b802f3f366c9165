"""Penalties of many designs at once: the tables and limits that the compiled kernel needs.

Everything that depends on a level or a depth alone is computed once, by the readable rules.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vinefab.core.compiling import imported_later
from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.job.passes import reach_mm, taken_mm
from vinefab.fabrication.job.sleeve import STRAIGHT_AFTER_MM, STRAIGHT_BEFORE_MM, sleeve_size
from vinefab.fabrication.outline.ends import pouch_takes_mm
from vinefab.fabrication.outline.layout import level_fillets_mm
from vinefab.fabrication.outline.stroke import LEAST_SEGMENT_MM
from vinefab.fabrication.pieces.bodies import beside_mm
from vinefab.fabrication.pieces.quick_cuts import (
    LEAST_DEPTH,
    MOST_CONFLICTS,
    MOST_PIECE_BRANCHES,
    MOST_STEPS,
)
from vinefab.fabrication.rules.clearance import CLEARANCE, least_gap_mm
from vinefab.fabrication.rules.inflation_rules import BODIES
from vinefab.fabrication.rules.joints import ANGLE, CROTCH
from vinefab.fabrication.rules.penalty import (
    MOST_CHECKED_BRANCHES,
    FilletSizes,
    width_violations,
)
from vinefab.fabrication.rules.piece_rules import LAP_PACKING, widest_cut_mm
from vinefab.fabrication.rules.pressure_limits import WINDOW, GrowthConstantsRange, most_growth_kpa
from vinefab.fabrication.rules.rule import MOST_OF_ONE, LimitChanges, Rule
from vinefab.fabrication.rules.spacing import TURNS, pouch_capsules
from vinefab.fabrication.rules.widths import PACKING
from vinefab.inflation.law import FANS, LEAST_LENGTH, MOST_CHILDREN, MOST_TURN_RAD, level_law
from vinefab.inflation.pattern import stretch_at
from vinefab.model.design import MOST_BRANCHES, MOST_LEVELS, Build
from vinefab.model.laser import LaserProfile, Material
from vinefab.physics.tube import inflated_diameter_mm, lumen_area_mm2
from vinefab.search.design_batch import DesignBatch, batch_branches
from vinefab.search.space import Space

if TYPE_CHECKING:
    from vinefab.search import penalty_kernel
else:
    penalty_kernel = imported_later("vinefab.search.penalty_kernel")


class DesignArrays(NamedTuple):
    """Designs, m of them, with at most n levels below the trunk, and their trees one by one."""

    depth: Ints  # levels of each design, the trunk included, shape (m,)
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
    """What depends on the level or the depth of a design alone, for n + 1 levels and depths."""

    half: Floats  # half the lay-flat width of each level, mm
    fillet: Floats  # radius at the joint below each level, mm
    area: Floats  # cross-section of each level's inflated lumen, mm2
    scale: Floats  # growth constants of each level's tube over those of the fitted tube
    # of designs of each depth
    widths: Floats  # summed violations by the widths themselves
    tip: Floats  # what the pouch takes of a leaf, mm
    tip_cut: Floats  # the same where the cut runs, mm
    pouch_share: Floats  # share of a leaf's lumen that its own pouch fills
    leaf_width: Floats  # lay-flat width of the leaves, pouches included, mm
    pouch_first: Ints  # first of the pouch's capsules; with the total at the end
    # capsules of the pouch in the frame of the tip: both ends and half the width, mm, shape (k, 5)
    pouch: Floats
    # how fans are cut; no rows where they are cut as designed
    # of each level below the trunk and number of children, by deployed fan: `FanLaw.rows`
    law: Floats
    least: Floats  # smallest deployed fan among the simulated ones, rad
    drawn: Floats  # passages of fans cut as designed, by fan; no rows where fans are compensated
    stretch: Floats  # by which each level's tubes grow longer under pressure
    most_turn: float  # by which children are turned so that their tips come near, rad
    least_length: float  # share of a planned length that is always cut


class PenaltyLimits(NamedTuple):
    """Limits of the rules, and constants."""

    angle_deg: float  # least angle between neighbours
    crotch: float  # most of a branch that may lie in the crotch
    fillet_mm: float  # least radius, as `FilletSizes`
    seal_mm: float
    run_mm: float
    end_mm: float
    sibling_share: float  # of the shorter, that inflated siblings may lie on each other
    packing_percent: float  # most of a lumen that folded film may fill
    film_mm: float  # thickness of all plies over the share of solid film when crumpled
    clearance_mm: float  # least distance of lumens
    segment_mm: float  # shortest straight side
    tail_mm: float
    sheet_wide_mm: float  # sheet that the flat robot must fit
    sheet_high_mm: float
    most_kpa: float  # most that growth may take
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
    blend_mm: float
    after_mm: float  # straight branch beyond the sleeve
    rise_mm: float  # how far a socket's lumen lies outside the branch's
    beside_mm: float  # how far outside lumens sockets of one joint need room, cut and all
    on_stub: bool  # whether sockets are on stubs, not on outer pieces
    widest_mm: float  # branch that may be cut
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
    capsule: Floats  # start x, start y, end x, end y, half width, mm, shape (k, 5)
    box: Floats  # low x, low y, high x, high y, mm, shape (k, 4)
    owner: Ints  # branch that each capsule belongs to, shape (k,)
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
    # straight sides on each level, mm
    begin: Floats  # of each child of a fan, shape (levels, children)
    stop: Floats
    # of each set of cuts on the way to the one that is tried
    option: Ints  # branches of which one must be cut, shape (c, o)
    options: Ints  # how many there are, shape (c,)
    tried: Ints  # how many were tried, shape (c,)
    path: Ints  # branches between two
    hit: Ints  # a conflict of a stub or socket, shape (3,); see the kernel
    needed: Ints  # cuts that are needed for certain, shape (1,)
    # film that rides in each branch, mm across, by level; shape (k, levels)
    below: Floats
    laps: Ints  # whether a lap is in it, shape (k,)
    fullest: Floats  # share of a lumen that is filled on each level


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BatchPenalty:
    """The penalty of the designs of one space, many at once; equal to that of single designs."""

    tables: LevelTables
    limits: PenaltyLimits

    @classmethod
    def of(
        cls,
        space: Space,
        profile: LaserProfile,
        changed: LimitChanges,
        sheet_mm: tuple[float, float],
    ) -> "BatchPenalty":
        """Prepare the penalty of a space's designs with a recipe and its changed limits."""
        deepest = int(space.settings.levels.high)
        builds = [space.build_of(depth) for depth in range(1, deepest + 1)]
        window = WINDOW.limits_with(changed.get(WINDOW.id, {}))
        fit = GrowthConstantsRange.of(profile, window)
        packing, laps = (
            rule.limits_with(changed.get(rule.id, {})) for rule in (PACKING, LAP_PACKING)
        )
        material, settings = profile.material, space.build.pieces
        sizes = FilletSizes.of(changed, profile)
        size = sleeve_size(builds[-1], profile)
        limits = PenaltyLimits(
            angle_deg=_error(ANGLE, changed),
            crotch=_error(CROTCH, changed),
            fillet_mm=sizes.error_mm,
            seal_mm=sizes.seal_mm,
            run_mm=sizes.run_mm,
            end_mm=sizes.end_mm,
            sibling_share=BODIES.limits_with(changed.get(BODIES.id, {}))["sibling_share"],
            packing_percent=packing["error"],
            film_mm=material.plies * material.ply_mm.value / packing["packing"],
            clearance_mm=least_gap_mm(CLEARANCE, changed, taken_mm(profile)),
            segment_mm=LEAST_SEGMENT_MM,
            tail_mm=space.build.tail_mm,
            sheet_wide_mm=sheet_mm[0],
            sheet_high_mm=sheet_mm[1],
            most_kpa=most_growth_kpa(builds[-1], profile, window),
            yield_kpa=fit.loose.yield_kpa.value,
            drag_kpa_mm=fit.loose.drag_kpa_m.value / 1000.0,
            storage_kpa=fit.loose.storage_kpa.value,
            friction=fit.loose.friction.value,
            most_branches=MOST_CHECKED_BRANCHES,
            most=MOST_OF_ONE,
            most_cuts=settings.most - 1 if settings else 0,
            most_steps=MOST_STEPS,
            least_depth=LEAST_DEPTH,
            reach_mm=reach_mm(profile),
            before_mm=STRAIGHT_BEFORE_MM,
            lap_mm=size.lap_mm,
            blend_mm=size.blend_mm,
            after_mm=STRAIGHT_AFTER_MM,
            rise_mm=size.rise_mm,
            beside_mm=beside_mm(size, reach_mm(profile)),
            on_stub=size.socket_on_stub,
            widest_mm=widest_cut_mm(builds[-1], profile, changed),
            lap_film_mm=material.film_mm / laps["packing"],
            lap_percent=laps["error"],
        )
        most = _most_children(space)
        tables = _tables(
            builds, fit.diameter_mm, limits, changed, _laws(builds[-1], material, most)
        )
        return cls(tables=tables, limits=limits)

    def __call__(self, designs: DesignBatch) -> Floats:
        """Return the penalties of designs, NaN for those with too many branches; shape (m,)."""
        return self.with_joints(designs)[0]

    def with_joints(self, designs: DesignBatch) -> tuple[Floats, Ints]:
        """Return the penalties of designs, and how many sleeve joints they take; shape (m,) each.

        Joints are 0 for designs with too many branches, which have penalty NaN.
        """
        penalty, joints = np.full(len(designs), np.nan), np.zeros(len(designs), dtype=np.int64)
        rows = np.flatnonzero(designs.sizes <= MOST_BRANCHES)
        if len(rows):
            penalty[rows], joints[rows] = self._of_valid(designs.part(rows))
        return penalty, joints

    def _of_valid(self, designs: DesignBatch) -> tuple[Floats, Ints]:
        """Return the penalties and joints of designs of which none is too large."""
        branches = batch_branches(designs)
        arrays = DesignArrays(
            depth=np.ascontiguousarray(designs.depth),
            trunk=np.ascontiguousarray(designs.trunk_mm),
            branches=np.ascontiguousarray(designs.branches),
            fan=np.ascontiguousarray(designs.fan_rad),
            size=np.ascontiguousarray(designs.length_mm),
            growth=np.ascontiguousarray(designs.growth),
            first=branches.first,
            parent=branches.parent,
            level=branches.level,
            offset=branches.offset_rad,
            length=branches.length_mm,
        )
        flat = np.where(designs.sizes <= MOST_CHECKED_BRANCHES, designs.sizes, 0)
        pouches = np.diff(self.tables.pouch_first)[designs.depth - 1]
        capsules, largest = int((flat * (1 + pouches)).max()), int(designs.sizes.max())
        children = int(designs.branches.max(initial=1))
        penalty, joints = np.empty(len(designs)), np.zeros(len(designs), dtype=np.int64)
        if self.limits.most_cuts == 0:
            scratch = _scratch(largest, capsules, children)
            penalty_kernel.penalize(arrays, self.tables, self.limits, scratch, penalty)
            return penalty, joints
        parts = min(int(flat.max()), MOST_PIECE_BRANCHES)
        scratch = _scratch(largest, capsules + 3 * parts, children)
        cutting = _cut_scratch(parts, capsules, children)
        penalty_kernel.penalize_pieces(
            arrays, self.tables, self.limits, scratch, cutting, penalty, joints
        )
        return penalty, joints


def _cut_scratch(branches: int, capsules: int, children: int) -> CutScratch:
    """Return memory for the pieces of a design, with at most so many children in a fan."""
    pairs = min(MOST_CONFLICTS, capsules * capsules // 2)
    ways = 2 * MOST_LEVELS

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
        begin=np.zeros((MOST_LEVELS, children)),
        stop=np.zeros(MOST_LEVELS),
        option=whole(branches + 1, ways),
        options=whole(branches + 1),
        tried=whole(branches + 1),
        path=whole(ways),
        hit=whole(3),
        needed=whole(1),
        below=np.zeros((branches, MOST_LEVELS)),
        laps=whole(branches),
        fullest=np.zeros(MOST_LEVELS),
    )


def _scratch(branches: int, capsules: int, children: int) -> Scratch:
    """Return memory for the largest design, with at most so many children in a fan."""
    turns = np.arange(TURNS) * np.pi / TURNS
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
        capsule=np.empty((capsules, 5)),
        box=np.empty((capsules, 4)),
        owner=np.empty(capsules, dtype=np.int64),
        turn=np.stack([np.cos(turns), np.sin(turns)]),
        low=np.empty(TURNS),
        high=np.empty(TURNS),
    )


def _error(rule: Rule, changed: LimitChanges) -> float:
    return rule.limits_with(changed.get(rule.id, {}))["error"]


class _Laws(NamedTuple):
    """How the fans of each level are cut, as in `LevelTables`."""

    law: Floats
    least: Floats
    drawn: Floats
    stretch: Floats


def _most_children(space: Space) -> int:
    """Return the most children that a fan of a space's designs has."""
    below = range(2, int(space.settings.levels.high) + 1)
    return max((int(space.settings.bounds(level, "branches").high) for level in below), default=1)


def _laws(build: Build, material: Material, most: int) -> _Laws:
    """Return how fans of a build are cut, of at most so many children; the build is the deepest."""
    levels, children = len(build.widths_mm), min(most, MOST_CHILDREN)
    law = np.zeros((levels - 1, children + 1, FANS, 2 * MOST_CHILDREN + 2))
    drawn = np.ones((levels - 1, children + 1, FANS, 1))
    least = np.zeros((levels - 1, children + 1))
    for place in range(levels - 1):
        for count in range(1, children + 1):
            found = level_law(build, material, place, count)
            law[place, count], least[place, count] = found.rows, found.least_rad
            drawn[place, count] = found.passages_as_drawn
    if build.compensation == "none":
        return _Laws(law[:0], least, drawn, np.ones(levels))
    stretch = [stretch_at(build, material, width_mm) for width_mm in build.widths_mm]
    return _Laws(law, least, drawn[:0], np.array(stretch))


def _tables(
    builds: list[Build],
    diameter_mm: float,
    limits: PenaltyLimits,
    changed: LimitChanges,
    laws: _Laws,
) -> LevelTables:
    """Return what depends on a level or a depth alone; the last build is the deepest."""
    deepest = builds[-1]
    widths_mm = np.array(deepest.widths_mm)
    pouch_mm = deepest.pouch.flat_width_mm if deepest.pouch else 0.0
    leaves_mm = np.array([build.widths_mm[-1] for build in builds])
    leaf_areas_mm2 = lumen_area_mm2(1.0) * leaves_mm**2
    pouches = [pouch_capsules(build) for build in builds]
    rows = [[*start, *end, half] for found in pouches for start, end, half in found]
    return LevelTables(
        half=widths_mm / 2.0,
        fillet=np.array(level_fillets_mm(deepest)),
        area=np.array([lumen_area_mm2(width_mm) for width_mm in deepest.widths_mm]),
        scale=diameter_mm / (inflated_diameter_mm(1.0) * widths_mm),
        widths=np.array([width_violations(build, changed) for build in builds]),
        tip=np.array([pouch_takes_mm(build) for build in builds]),
        tip_cut=np.array([pouch_takes_mm(build, limits.reach_mm) for build in builds]),
        pouch_share=np.where(pouch_mm > leaves_mm, pouch_mm * limits.film_mm / leaf_areas_mm2, 0.0),
        leaf_width=np.maximum(leaves_mm, pouch_mm),
        pouch_first=np.cumsum([0, *map(len, pouches)]),
        pouch=np.array(rows).reshape(-1, 5),
        law=laws.law,
        least=laws.least,
        drawn=laws.drawn,
        stretch=laws.stretch,
        most_turn=MOST_TURN_RAD,
        least_length=LEAST_LENGTH,
    )
