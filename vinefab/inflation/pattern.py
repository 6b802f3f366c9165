"""The pattern of a design: the flat tree that deploys as designed, with its tables on pages.

A search asks for the patterns of thousands of designs a second. The joints of a level differ only
in their fan and number of children, so that one short table for each of these numbers tells all:
`quick_pattern` takes microseconds and simulates nothing. What is cut is simulated (`pattern_of`).
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np

from vinefab.core.plain_text import some_of
from vinefab.core.validation import Floats
from vinefab.core.verbs import note
from vinefab.core.view import Notes, Number, Rows, Value
from vinefab.inflation import law
from vinefab.inflation.compensation import (
    FlatJoint,
    UnknownJointError,
)
from vinefab.inflation.mesh import tube_stretch
from vinefab.inflation.solving import JointTask, solved_joints
from vinefab.inflation.table import CHILDREN, FILLET, RATIO, STRAIN, fan_table, flat_fan, scaled
from vinefab.model.design import Build, Design
from vinefab.model.files.run_context import ChosenRecipe
from vinefab.model.laser import LaserProfile, Material
from vinefab.model.quantity import Standing
from vinefab.outline.body_outline import DrawnTree
from vinefab.outline.joint import JointPlan
from vinefab.physics.tube import hoop_strain

LEAST_STRAIN = 0.002
"""Flat angles of stiffer film, and without pressure, are those at this hoop strain: they differ by
less than a degree down to it."""

MOST_STRAIN = 0.5

ASSUMED_PRESSURE_KPA = 20.0
"""Where a design's working pressure is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PatternJoint:
    """A kind of joint, or of preformed bend, and where it is."""

    level: int  # of the children, 2 for those of the trunk; of a bend, that of its branch
    width_mm: float  # lay-flat width of the parent at the joint
    child_widths_mm: tuple[float, ...]  # lay-flat width of each child at the joint
    rows: tuple[int, ...]  # straight parts at whose ends it is, see `BranchTree.straight`
    name: str  # for people: ``level 2``, or the branches at whose ends it is
    is_bend: bool  # whether it is a preformed bend
    wanted_deg: tuple[float, ...]  # designed angle of each child
    # Angles that the joint is solved for: the designed ones, turned so that tips come near.
    aimed_deg: tuple[float, ...]
    found: FlatJoint | None  # as cut and as deployed (simulated); None where there is none
    problem: str = ""  # why it does not deploy as designed; empty where it does
    is_known: bool = True  # False: nothing but a simulation would tell, and none was asked for

    @property
    def count(self) -> int:
        """Joints of this kind in the robot."""
        return len(self.rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """A design, the flat tree that is cut for it, and that tree as deployed (simulated).

    Without compensation the flat tree is the design itself.
    """

    design: Design
    flat: Design
    deployed: Design
    joints: tuple[PatternJoint, ...]  # each kind, in the order of the first part that ends there
    standing: str = "simulated, unverified"

    @property
    def is_by_levels(self) -> bool:
        """Whether all joints of a level are alike."""
        return all(joint.name == f"level {joint.level}" for joint in self.joints)

    @property
    def problems(self) -> tuple[str, ...]:
        """Why joints do not deploy as designed, a sentence each."""
        return tuple(joint.problem for joint in self.joints if joint.problem)


def cut_design(design: Design, profile: LaserProfile) -> Design:
    """Return the flat tree that a design is cut as; the design itself without compensation."""
    return design if design.build.compensation == "none" else pattern_of(design, profile).flat


def strain_at(build: Build, material: Material, width_mm: float) -> float:
    """Return the hoop strain of film at a design's working pressure on a tube of some width.

    Two digits, so that joints that differ by no more are one.
    """
    pressure_kpa = build.pressure_kpa or ASSUMED_PRESSURE_KPA
    strain = hoop_strain(pressure_kpa, width_mm, material.ply_mm.value, material.modulus_mpa.value)
    return float(f"{min(max(strain, LEAST_STRAIN), MOST_STRAIN):.2g}")


def strain_of(design: Design, material: Material, width_mm: float) -> float:
    """Return the hoop strain of a design's film, as `strain_at`."""
    return strain_at(design.build, material, width_mm)


def stretch_at(build: Build, material: Material, width_mm: float) -> float:
    """Return by how much a straight tube of some width grows longer under pressure, as a ratio."""
    return tube_stretch(strain_at(build, material, width_mm))[1]


def stretch_of(design: Design, material: Material, width_mm: float) -> float:
    """Return by how much a design's tubes of some width grow longer, as `stretch_at`."""
    return stretch_at(design.build, material, width_mm)


def _stretches(build: Build, material: Material, width_mm: Floats) -> Floats:
    """Return by how much tubes grow longer, shape (n,); equal widths are worked out once."""
    widths_mm, place = np.unique(width_mm, return_inverse=True)
    return np.array([stretch_at(build, material, width) for width in widths_mm.tolist()])[place]


def pattern_of(design: Design, profile: LaserProfile, *, known_only: bool = False) -> Pattern:
    """Return the flat tree that a design is cut as.

    Joints that are alike are solved once, whatever their number. Angles become those that deploy as
    designed, and lengths grow by the pull-back of the joint. A joint that cannot be solved keeps
    its designed angles and has a problem.

    Parameters
    ----------
    profile
        Its film stretches; the strain at the working pressure decides. A measured closing gain says
        how far joints turn over the simulated.
    known_only
        Simulate nothing: look joints up in milliseconds, for views that follow a pointer. What
        table and law say is good for a degree or two; nothing may be cut by it.
    """
    material, build = profile.material, design.build
    compensated = build.compensation == "inflation"
    drawn = DrawnTree.of(design)
    parts = drawn.tree
    flat_rad, deployed_rad = parts.offset_rad.copy(), parts.offset_rad.copy()
    stretch = _stretches(build, material, parts.width_mm)
    cut_mm, grown_mm = parts.length_mm.copy(), parts.length_mm.copy()
    if compensated:
        cut_mm[0] /= stretch[0]
    else:
        grown_mm[0] *= stretch[0]
    gain = 1.0 if material.closing_gain is None else material.closing_gain.value
    families = joint_families(drawn, design.called(parts.ids))
    tasks = [
        JointTask(
            plan=family.plan,
            away_mm=family.away_mm,
            strain=strain_at(build, material, 2.0 * family.plan.parent.half_mm),
            gain=gain,
            compensated=compensated,
        )
        for family in families
    ]
    joints = []
    solved = solved_joints(tasks, known_only=known_only)
    for family, solution in zip(families, solved, strict=True):
        children = np.array([drawn.children[row] for row in family.rows])
        found = solution.found
        if found and any(one >= two for one, two in pairwise(found.deployed_deg)):
            # Siblings would pass through each other: nothing that could be drawn.
            found = None
        joints.append(
            PatternJoint(
                level=family.level,
                width_mm=2.0 * family.plan.parent.half_mm,
                child_widths_mm=tuple(2.0 * one.half_mm for one in family.plan.children),
                rows=family.rows,
                name=family.name,
                is_bend=family.plan.is_bend,
                wanted_deg=tuple(math.degrees(one.angle_rad) for one in family.plan.children),
                aimed_deg=solution.aimed_deg,
                found=found,
                problem=f"{family.name}: {solution.error}" if solution.error else "",
                is_known=not isinstance(solution.error, UnknownJointError),
            )
        )
        if found is not None:
            backs_mm = 2.0 * family.plan.parent.half_mm * np.array(found.pull_backs)
            planned_mm, longer = parts.length_mm[children], stretch[children]
            deployed_rad[children] = np.radians(found.deployed_deg)
            if compensated:
                flat_rad[children] = np.radians(found.flat.angles_deg)
                cut_mm[children] = (planned_mm + backs_mm) / longer
            else:
                grown_mm[children] = planned_mm * longer - backs_mm
    tree = design.tree
    return Pattern(
        design=design,
        flat=design.shaped(
            tree.of_parts(parts, flat_rad, cut_mm), build.changed(compensation="none")
        ),
        deployed=design.shaped(
            tree.of_parts(parts, deployed_rad, grown_mm), build.changed(compensation="inflation")
        ),
        joints=tuple(joints),
        standing=standing_of(material),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFamily:
    """Joints that are alike, and so cut and deployed alike."""

    plan: JointPlan  # of the first of them
    rows: tuple[int, ...]  # straight parts at whose ends they are, rising
    level: int  # of the children; of a bend, that of its branch
    away_mm: tuple[float, ...]  # mean way from the joint to the tips behind it, through each child
    name: str  # ``level 2`` where all joints of the level are alike, else branches


def joint_families(drawn: DrawnTree, called: Sequence[str] = ()) -> list[JointFamily]:
    """Return the joints and bends of a tree by their kinds, in the order of the first of each.

    Tapers of the parents' own sides make no difference.

    Parameters
    ----------
    called
        What people call the straight parts; their ids if left out.
    """
    tree = drawn.tree
    away_mm = [0.0] * len(tree)
    length_mm, level = tree.length_mm.tolist(), tree.level.tolist()
    for row in range(len(tree) - 1, -1, -1):
        if below := drawn.children[row]:
            away_mm[row] = math.fsum(length_mm[one] + away_mm[one] for one in below) / len(below)

    def ways_mm(row: int) -> tuple[float, ...]:
        return tuple(length_mm[one] + away_mm[one] for one in drawn.children[row])

    alike = list[tuple[JointPlan, list[int]]]()
    for family in drawn.joints():
        by_way: dict[tuple[float, ...], tuple[JointPlan, list[int]]] = {}
        for plan, row in ((plan, row) for plan, rows in family for row in rows):
            by_way.setdefault(ways_mm(row), (plan, []))[1].append(row)
        alike += by_way.values()
    names, found = called or tree.ids, []
    forks = {row for row, below in enumerate(drawn.children) if below}
    forks -= {row for plan, rows in alike if plan.is_bend for row in rows}
    for plan, rows in sorted(alike, key=lambda one: min(one[1])):
        rows.sort()
        own = level[rows[0]]
        if plan.is_bend:
            words = "bend at the end of" if len(rows) == 1 else "bends at the ends of"
            name = f"{words} {some_of([names[row] for row in rows], 3)}"
        elif len(rows) == sum(level[row] == own for row in forks):
            name = f"level {own + 1}"
        else:
            some = some_of([names[row] for row in rows], 3)
            name = f"joint{'' if len(rows) == 1 else 's'} at the end of {some}"
        found.append(
            JointFamily(
                plan=plan,
                rows=tuple(rows),
                level=own if plan.is_bend else own + 1,
                away_mm=ways_mm(rows[0]),
                name=name,
            )
        )
    return found


def as_grown(
    design: Design, profile: LaserProfile | None = None, *, known_only: bool = False
) -> Design:
    """Return a design as it deploys: itself, or without compensation what its flat angles become.

    Parameters
    ----------
    profile
        Of its film; that of the design's run, or the default, if None.
    known_only
        Simulate nothing, as `pattern_of`: joints that are not known keep their designed angles.
    """
    if design.build.compensation != "none":
        return design
    profile = profile or ChosenRecipe.of(design).profile
    found = pattern_of(design, profile, known_only=known_only)
    for joint in found.joints:
        if not known_only and joint.found is None:
            why = joint.problem or f"{joint.name}: siblings deploy through each other"
            note(f"{why}: grown at its designed angles (compensation none)")
    return found.deployed


def standing_of(material: Material) -> str:
    """Return the standing of a simulated pattern of some film.

    It is simulated in any case; joint coupons measure what the simulation takes from the film.
    """
    known = [f"modulus {material.modulus_mpa.standing}"]
    if material.closing_gain is not None:
        known.append(f"closing gain {material.closing_gain.standing}")
    if not any(words.endswith(Standing.MEASURED) for words in known):
        return "simulated, unverified"
    return f"simulated; {', '.join(known)}"


_SHOWN = partial(Number, form="z.1f", decimals=3)
_PLAIN = partial(Number, form=".2f", decimals=4)
_NOTHING = Number(None)


def pattern_blocks(
    pattern: Pattern, in_robot_deg: dict[int, Floats] | None = None
) -> Iterator[Rows | Notes]:
    """Yield the cut shape of the design, each joint as deployed, and the problems.

    Parameters
    ----------
    in_robot_deg
        Mean angle of each child within the whole robot, by the joint's place among those of the
        pattern, if that was simulated.
    """
    yield pattern_table(pattern, in_robot_deg)
    yield joint_table(pattern)
    yield Notes(tuple(f"{one}." for one in pattern.problems), "problems")


def pattern_table(pattern: Pattern, in_robot_deg: dict[int, Floats] | None = None) -> Rows:
    """Return angles and lengths of each kind of child as designed, as cut and as expected.

    Parameters
    ----------
    in_robot_deg
        As of `pattern_blocks`.
    """
    trees = [one.tree.straight for one in (pattern.design, pattern.flat, pattern.deployed)]
    whole, means_deg = in_robot_deg is not None, in_robot_deg or {}
    by_level = pattern.is_by_levels
    ids = trees[0].ids
    rows = list[tuple[Value, ...]]()

    def row(branch: int, level: int, child: int, values: Iterable[Value]) -> None:
        rows.append((*(() if by_level else (ids[branch],)), level, child, *values))

    trunks = [_SHOWN(float(tree.length_mm[0])) for tree in trees]
    row(0, 1, 1, (*(_NOTHING,) * 3, *((_NOTHING,) if whole else ()), *trunks, _NOTHING))
    for place, joint in enumerate(pattern.joints):
        if (found := joint.found) is None:
            continue
        angles = zip(joint.wanted_deg, found.flat.angles_deg, found.deployed_deg, strict=True)
        children = np.flatnonzero(trees[0].parent == joint.rows[0])
        for child, (degrees, branch) in enumerate(zip(angles, children.tolist(), strict=True)):
            here = (_SHOWN(float(means_deg[place][child])),) if whole else ()
            aside = _SHOWN(joint.width_mm * found.side_offsets[child])
            sizes = (_SHOWN(float(tree.length_mm[branch])) for tree in trees)
            row(branch, joint.level, child + 1, (*map(_SHOWN, degrees), *here, *sizes, aside))
    within = "of the joint alone, and the mean within the whole robot" if whole else "of the joint"
    of = "Branches of each level" if by_level else "Branches, the first of each kind"
    return Rows(
        caption=f"{of}: angles to the parent in deg (positive: left), lengths in "
        f"mm; as designed, as cut, as expected {within} ({pattern.standing}; triangles are good "
        "for 0.6 deg)",
        headings=(*(() if by_level else ("branch",)), "level", "child", "angle designed", "cut",
                  "expected", *(("in the robot",) if whole else ()),
                  "length designed", "cut", "expected", "aside"),
        rows=tuple(rows),
        key="branches",
        keys=(*(() if by_level else ("branch",)), "level", "child", "designed_deg", "cut_deg",
              "expected_deg", *(("in_robot_deg",) if whole else ()),
              "designed_mm", "cut_mm", "expected_mm", "aside_mm"),
    )  # fmt: skip


def joint_table(pattern: Pattern) -> Rows:
    """Return sensitivity, load and passage of each kind of joint."""
    by_level = pattern.is_by_levels
    return Rows(
        caption="Joints: change of the deployed angle over that of the flat one, load that "
        "opens the weld in a crotch over that of the trunk's straight seam, largest ball that "
        "passes into a child over the child's tube (simulated)",
        headings=(*(() if by_level else ("joint",)), "children on level", "joints", "parent mm",
                  "sensitivity", "crotch load", "passage"),
        rows=tuple(
            (*(() if by_level else (joint.name,)), joint.level, joint.count,
             Number(joint.width_mm, form=".1f"),
             _PLAIN(joint.found.sensitivity), _PLAIN(joint.found.crotch_load),
             _PLAIN(joint.found.passage))
            for joint in pattern.joints
            if joint.found is not None
        ),
        key="joints",
        keys=(*(() if by_level else ("joint",)), "level", "count", "parent_mm", "sensitivity",
              "crotch_load", "passage"),
    )  # fmt: skip


FANS = 361
"""Deployed fans that a law has rows for, a degree apart from 0 on."""

MOST_CHILDREN = 8
"""Fans of more children are taken as designed: joints of five say nothing about theirs."""

LEAST_LENGTH = 0.1
"""Share of its planned length that a child is always cut with, however far the law says it grows
longer: such a child lies within its joint."""

MOST_TURN_RAD = math.radians(0.8)
"""Most by which a fan's outer children are turned so that their tips come near, as in patterns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FanLaw:
    """Flat fans of so many children at the joints of one level, by their deployed fans.

    Lengths are in widths of the parent.
    """

    angles_rad: Floats  # of each child, shape (FANS, n)
    pull_backs: Floats  # of each child, shape (FANS, n)
    side_offsets: Floats  # of the last child to its left, shape (FANS,)
    passages: Floats  # shape (FANS,)
    least_rad: float  # smallest deployed fan among the simulated ones

    @property
    def rows(self) -> Floats:
        """Everything, of at most `MOST_CHILDREN` children: angles, pull-backs, offset, passage."""
        rows = np.zeros((FANS, 2 * MOST_CHILDREN + 2))
        children = self.angles_rad.shape[1]
        rows[:, :children] = self.angles_rad
        rows[:, MOST_CHILDREN : MOST_CHILDREN + children] = self.pull_backs
        rows[:, -2], rows[:, -1] = self.side_offsets, self.passages
        return rows

    @property
    def passages_as_drawn(self) -> Floats:
        """Passages of joints that are cut as designed, by their flat fans, shape (FANS, 1)."""
        if self.angles_rad.shape[1] == 1:
            return np.full((FANS, 1), self.passages[0])
        # Nothing says that the flat fans of a law rise where they are narrow.
        drawn_rad = np.maximum.accumulate(self.angles_rad[:, -1] - self.angles_rad[:, 0])
        return np.interp(np.radians(np.arange(FANS)), drawn_rad, self.passages)[:, None]


@lru_cache(maxsize=512)
def fan_law(children: int, ratio: float, fillet: float, strain: float, gain: float) -> FanLaw:
    """Return the law of one kind of joint.

    Parameters
    ----------
    children
        From 1 to `MOST_CHILDREN`. More than five turn as five that are as far apart.
    ratio, fillet, strain
        As of `vinefab.inflation.table.flat_fan`.
    gain
        How far joints turn over the simulated, as measured; 1 without a measurement.
    """
    known = min(children, max(CHILDREN))
    whole = np.radians(np.arange(FANS, dtype=np.float64))
    # Of more children than the table has, as many as it has that are as far apart.
    fan = whole * ((known - 1) / (children - 1) if children > 1 else 0.0)
    found = flat_fan(np.array(known), fan, *map(np.array, (ratio, fillet, strain)))
    even, shares = np.linspace(-0.5, 0.5, known), np.linspace(0.0, 1.0, known)
    turned = found.angles_rad[:, :known] - fan[:, None] * even if known > 1 else np.zeros((FANS, 1))
    if gain != 1.0:
        # Film turns by so many times the simulated turn: outer children decide which fan deploys.
        deployed = fan + 2.0 * turned[:, -1] * (1.0 - gain)
        turned = np.column_stack([np.interp(fan, deployed, gain * one) for one in turned.T])
    backs = found.pull_backs[:, :known]
    if children > known:
        places = np.linspace(0.0, 1.0, children)
        turned, backs = (
            np.stack([np.interp(places, shares, row) for row in rows]) for rows in (turned, backs)
        )
    table = fan_table(known)
    place = np.clip(np.array([ratio, fillet, strain]), *np.array([RATIO, FILLET, STRAIN]).T)
    passages, least = np.ones(FANS), 0.0
    if table is not None:
        simulated = table.rows.deployed_fan_deg[table.rows.is_open]
        near = np.clip(np.degrees(fan), simulated.min(), simulated.max())
        passages = np.clip(table.figures[3](scaled(near, np.tile(place, (FANS, 1))))[:, 0], 0.1, 1)
        least = math.radians(float(simulated.min())) if known > 1 else 0.0
        least *= (children - 1) / (known - 1) if known > 1 else 0.0
    outer = np.linspace(-0.5, 0.5, children) if children > 1 else np.zeros(1)
    found_law = FanLaw(
        angles_rad=whole[:, None] * outer + turned,
        pull_backs=np.ascontiguousarray(backs),
        side_offsets=found.side_offsets,
        passages=passages,
        least_rad=least,
    )
    for array in (
        found_law.angles_rad,
        found_law.pull_backs,
        found_law.side_offsets,
        found_law.passages,
    ):
        array.setflags(write=False)
    return found_law


def joint_law(
    build: Build,
    material: Material,
    widths_mm: tuple[float, float],
    fillet_mm: float,
    children: int,
) -> FanLaw:
    """Return the law of joints with an even fan of equal children.

    Joints that differ by a hundredth of the parent's width at most are one: angles change by a
    tenth of a degree.

    Parameters
    ----------
    widths_mm
        Lay-flat width of the parent where it ends, and of a child where it begins.
    """
    width_mm, child_mm = widths_mm
    return fan_law(
        children,
        round(child_mm / width_mm, 2),
        round(fillet_mm / width_mm, 2),
        strain_at(build, material, width_mm),
        1.0 if material.closing_gain is None else material.closing_gain.value,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class QuickPattern:
    """The flat tree of a design by the law alone."""

    flat: Design
    passages: tuple[float, ...]  # of the joints of each kind, in the order of their first parts
    # By how much joints lie beyond the simulated ones: narrower fans, fewer degrees between
    # siblings, wider turns, more children; relative to the nearest simulated one; summed.
    beyond: float


def quick_pattern(design: Design, material: Material) -> QuickPattern:
    """Return about the flat tree that a design is cut as; the design itself without compensation.

    Angles are within a few degrees of those of `vinefab.inflation.pattern.pattern_of`. Even fans of
    at most `MOST_CHILDREN` equally wide children are the table's, others and bends those of the
    law, beyond its range those of its end; with more children they keep their designed angles.
    """
    build, drawn = design.build, DrawnTree.of(design)
    parts, beyond, families = drawn.tree, 0.0, joint_families(drawn)
    stretch = _stretches(build, material, parts.width_mm)
    offset_rad, length_mm = parts.offset_rad.copy(), parts.length_mm.copy()
    length_mm[0] /= stretch[0]
    passages = np.ones(len(families))
    uneven = list[int]()
    for place, family in enumerate(families):
        plan, children = family.plan, np.array([drawn.children[row] for row in family.rows])
        fan_rad = _even_fan_rad(plan)
        if fan_rad is None or len(plan.children) > MOST_CHILDREN:
            if fan_rad is None:
                uneven.append(place)
            continue
        width_mm, child = 2.0 * plan.parent.half_mm, plan.children[0]
        widths_mm = width_mm, 2.0 * child.half_mm
        fans = joint_law(build, material, widths_mm, child.fillet_mm, len(plan.children))
        if build.compensation == "none":
            passages[place] = float(_at(fans.passages_as_drawn, fan_rad)[0])
            continue
        if fan_rad < fans.least_rad:
            beyond += (fans.least_rad - fan_rad) / fans.least_rad
        # Children stand off their designed axes: turned a little, their tips come nearer.
        offset_mm = width_mm * float(_at(fans.side_offsets, fan_rad))
        most_rad = min(MOST_TURN_RAD, fan_rad / 10.0)
        away_mm = math.fsum(family.away_mm) / len(family.away_mm)
        turn_rad = min(max(offset_mm / away_mm, -most_rad), most_rad)
        fan_rad -= 2.0 * turn_rad
        backs_mm = width_mm * _at(fans.pull_backs, fan_rad)
        length_mm[children] = _cut_mm(parts.length_mm[children], backs_mm, stretch[children])
        offset_rad[children] = _at(fans.angles_rad, fan_rad)
        passages[place] = float(_at(fans.passages, fan_rad))
    by_law = _by_law([families[place] for place in uneven], build, material)
    for place, flat in zip(uneven, by_law, strict=True):
        passages[place] = flat.passage
        beyond += flat.beyond
        if flat.angles_rad is not None:
            family = families[place]
            children = np.array([drawn.children[row] for row in family.rows])
            planned_mm = parts.length_mm[children]
            length_mm[children] = _cut_mm(planned_mm, flat.backs_mm, stretch[children])
            offset_rad[children] = flat.angles_rad
    told = tuple(passages.tolist())
    if build.compensation == "none":
        return QuickPattern(flat=design, passages=told, beyond=beyond)
    tree = design.tree.of_parts(parts, offset_rad, length_mm)
    flat_design = design.shaped(tree, build.changed(compensation="none"))
    return QuickPattern(flat=flat_design, passages=told, beyond=beyond)


def _cut_mm(planned_mm: Floats, backs_mm: Floats, stretch: Floats) -> Floats:
    """Return the flat lengths of children that are pulled back, and stretched under pressure."""
    cut_mm: Floats = np.maximum(planned_mm + backs_mm, LEAST_LENGTH * planned_mm) / stretch
    return cut_mm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ByLaw:
    """The children of an uneven fan, or of a bend, by the law."""

    angles_rad: Floats | None  # flat ones, shape (n,); None where they are cut as designed
    backs_mm: Floats  # shape (n,)
    passage: float  # as compensated, or as cut where nothing is
    beyond: float  # as of `QuickPattern`


def _by_law(families: list[JointFamily], build: Build, material: Material) -> list[_ByLaw]:
    """Return joints by the law; those with too many children are cut as designed."""
    most, is_drawn = law.MOST_CHILDREN, build.compensation == "none"
    few = [place for place, one in enumerate(families) if len(one.plan.children) <= most]
    told = [
        _ByLaw(angles_rad=None, backs_mm=np.empty(0), passage=1.0, beyond=beyond)
        for beyond in (float(len(one.plan.children) - most) for one in families)
    ]
    if not few:
        return told
    joints = _law_joints([families[place].plan for place in few], build, material)
    gain = 1.0 if material.closing_gain is None else material.closing_gain.value
    found = law.law_of("deployed", joints) if is_drawn else law.flat_by_law(joints, gain)
    if found is None:
        return [replace(one, beyond=one.beyond + most) for one in told]
    for row, place in enumerate(few):
        own, family = slice(0, int(joints.count[row])), families[place]
        width_mm, beyond = 2.0 * family.plan.parent.half_mm, float(found.beyond[row])
        angles_rad = np.radians(found.angles_deg[row, own])
        if is_drawn:
            # As cut siblings deploy through each other.
            gaps = np.degrees(np.diff(angles_rad)) / law.LEAST_GAP_DEG
            told[place] = _ByLaw(
                angles_rad=None,
                backs_mm=np.empty(0),
                passage=float(found.passages[row]),
                beyond=max(beyond, *(1.0 - gap for gap in gaps.tolist() if gap <= 0.0), 0.0),
            )
            continue
        # Turned a little, as even fans are.
        turn_rad = found.side_offsets[row, own] * width_mm / np.array(family.away_mm)
        most_rad = np.minimum(MOST_TURN_RAD, np.radians(np.abs(joints.angles_deg[row, own])) / 5.0)
        told[place] = _ByLaw(
            angles_rad=angles_rad - np.clip(turn_rad, -most_rad, most_rad),
            backs_mm=width_mm * found.pull_backs[row, own],
            passage=float(found.passages[row]),
            beyond=beyond,
        )
    return told


def _law_joints(plans: list[JointPlan], build: Build, material: Material) -> law.Joints:
    """Return joints as the law takes them, as designed."""
    count = np.array([len(plan.children) for plan in plans])
    width_mm = np.array([2.0 * plan.parent.half_mm for plan in plans])
    children = np.zeros((3, len(plans), law.MOST_CHILDREN))
    for row, plan in enumerate(plans):
        for place, one in enumerate(plan.children):
            children[:, row, place] = math.degrees(one.angle_rad), one.half_mm, one.fillet_mm
    own = children[2] / width_mm[:, None]
    return law.Joints(
        angles_deg=children[0],
        count=count,
        ratios=2.0 * children[1] / width_mm[:, None],
        fillets=law.gap_fillets(own, count),
        strain=np.array([strain_at(build, material, width) for width in width_mm.tolist()]),
        is_bend=np.array([plan.is_bend for plan in plans]),
    )


def _even_fan_rad(plan: JointPlan) -> float | None:
    """Return the fan of a joint whose children are alike and evenly apart; None of any other."""
    angles = np.array([one.angle_rad for one in plan.children])
    even = np.linspace(-0.5, 0.5, len(angles)) if len(angles) > 1 else np.zeros(1)
    fan_rad = float(angles[-1] - angles[0])
    alike = len({(one.half_mm, one.fillet_mm) for one in plan.children}) == 1
    is_even = alike and not plan.is_bend and bool(np.abs(angles - fan_rad * even).max() < 1e-9)
    return fan_rad if is_even else None


def _at(rows: Floats, fan_rad: float) -> Floats:
    """Return the row of a deployed fan, between those of whole degrees."""
    place = min(math.degrees(fan_rad), FANS - 1.0)
    row = min(int(place), FANS - 2)
    return np.asarray(rows[row] + (place - row) * (rows[row + 1] - rows[row]))
