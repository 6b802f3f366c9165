"""Rules about joints: angles, crotches, fillets and turns."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vinefab.core.validation import Floats
from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.outline.gap import Gap, crotch_reach_mm
from vinefab.fabrication.outline.joint import joint_of, level_tapers_rad
from vinefab.fabrication.rules.rule import (
    BrokenLimit,
    Limits,
    Rule,
    RuleApplied,
    Violation,
    branch_start_mm,
    branch_violation,
    outline_violations,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.design import Design, UnevenLevel
from vinefab.model.finding import Severity
from vinefab.model.tree import (
    BranchTree,
    child_lengths_mm,
    fan_offsets_rad,
    least_gap_rad,
    widest_turn_rad,
)
from vinefab.physics.growth_pressure import FITTED, capstan_factor

PARALLEL_RAD = 1e-6
"""Neighbours at a smaller angle never part."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelJoint:
    """The joint where one level's children sprout from their parent's tip."""

    level: int  # level of the children, 2 or more
    joints: int  # how many such joints the design has
    parent: int  # tree index of the parent at the first of these joints
    first_child: int  # tree index of that parent's clockwise-most child
    # Gaps around the joint on the lumen's edge, counter-clockwise, the parent's body first and
    # last. Owner 0 is the parent, 1 the first child, and so on.
    gaps: tuple[Gap, ...]
    # Smallest fillet radius drawn: the designed one, or less where the angle allows no more;
    # infinite if no gap has room for a fillet.
    fillet_mm: float

    def branch(self, owner: int) -> int:
        """Return the tree's index of a gap's owner."""
        return self.parent if owner == 0 else self.first_child + owner - 1


def level_joints(design: Design) -> tuple[LevelJoint, ...]:
    """Return the joint of every level after the trunk."""
    found = []
    parent, count = 0, 1
    for number, level in enumerate(design.levels, start=2):
        drawn = joint_of(design, number - 1, 0.0)
        radii_mm = (min(drawn.fillet_mm, most) for most in drawn.allowed_mm if most >= 0.0)
        found.append(
            LevelJoint(
                level=number,
                joints=count,
                parent=parent,
                first_child=parent + count,
                gaps=drawn.gaps,
                fillet_mm=min(radii_mm, default=math.inf),
            )
        )
        parent, count = parent + count, count * level.branches
    return tuple(found)


def shorter_mm(gap: Gap) -> float:
    """Return the length of the shorter neighbour that a gap's crotch webs.

    Where the outline passes the joint's disc the parent is as it should be, and only the
    children count.
    """
    lengths = [strip.length_mm for strip in (gap.first, gap.second) if strip.owner]
    disc_mm = max(gap.first.half_mm, gap.second.half_mm)
    if gap.reach_mm > disc_mm * (1.0 + 1e-9):
        lengths = [gap.first.length_mm, gap.second.length_mm]
    return min(lengths)


def share_in_crotch(gap: Gap) -> float:
    """Return the reach of a gap's crotch over the length of its shorter neighbour.

    Neighbours that never part give infinity.
    """
    return gap.reach_mm / shorter_mm(gap) if gap.angle_rad > PARALLEL_RAD else math.inf


def gap_angles_rad(design: Design, number: int) -> tuple[float, ...]:
    """Return the least angles beside the parent and between children at the end of a level.

    Tapered parents count with the side that leans most, tapered children with the one that leans
    least. A single child has a gap beside its parent only.
    """
    beside, *between = _gaps_rad(design, number)
    return (beside, min(between)) if between else (beside,)


def _gaps_rad(design: Design, number: int) -> list[float]:
    """Return the least angle beside the parent, and that of each gap between children."""
    level, lean = design.levels[number - 1], least_lean_rad(design, number + 1)
    beside = math.pi - widest_turn_rad(level) - max(level_tapers_rad(design, number)) + lean
    if isinstance(level, UnevenLevel):
        between = np.diff(fan_offsets_rad(level)).tolist()
    else:  # all alike, and equal to the last digit
        between = [least_gap_rad(level)] * (level.branches - 1) if level.branches > 1 else []
    return [beside, *(angle + 2.0 * lean for angle in between)]


def bare_gaps(design: Design) -> list[tuple[float, float]]:
    """Return angle and share in the crotch of every kind of gap, in closed form, without fillets.

    For each level that is the gap beside the parent and, between children, the least angle and the
    largest share. Fillets are drawn no larger than the crotch allows, so these shares exceed one
    half exactly when those of `share_in_crotch` do.
    """
    found = []
    widths_mm, ends_mm = design.build.widths_mm, design.build.end_widths_mm
    above_mm = design.trunk_length_mm
    for number, level in enumerate(design.levels, start=1):
        wide, narrow = ends_mm[number - 1] / 2.0, widths_mm[number] / 2.0
        lengths_mm = child_lengths_mm(level).tolist()
        shortest_mm = min(lengths_mm)
        disc = max(wide, narrow)
        beside, *between = _gaps_rad(design, number)
        reach = _bare_reach_mm(beside, (wide, narrow), disc)
        length_mm = shortest_mm if reach <= disc else min(shortest_mm, above_mm)
        found.append((beside, reach / length_mm))
        shares = [
            _bare_reach_mm(angle, (narrow, narrow), disc) / min(pair)
            for angle, pair in zip(between, pairwise(lengths_mm), strict=True)
        ]
        if shares:
            found.append((min(between), max(shares)))
        above_mm = shortest_mm
    return found


def least_lean_rad(design: Design, level: int) -> float:
    """Return by how much the sides of every branch of a level lean towards its axis at least."""
    return min(level_tapers_rad(design, level)) if design.build.taper else 0.0


def _bare_reach_mm(angle_rad: float, halves_mm: tuple[float, float], disc_mm: float) -> float:
    """Return how far from the joint two sides part: where they cross, or at the joint's disc."""
    hidden = sum(math.asin(half / disc_mm) for half in halves_mm)
    return disc_mm if hidden <= angle_rad else crotch_reach_mm(angle_rad, *halves_mm)


def check_angle(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C02: neighbours round a joint, the parent's body among them, part at an angle."""
    joints = level_joints(subject.design)
    violations = []
    for joint in joints:
        # Gaps of one angle are alike: the first of them stands for all.
        for gap in {round(gap.angle_rad, 9): gap for gap in reversed(joint.gaps)}.values():
            if broken := limits.least(math.degrees(gap.angle_rad)):
                predicate = "almost parallel: widen the fan or have fewer children"
                if 0 in (gap.first.owner, gap.second.owner):
                    predicate = "almost folded onto its parent: narrow the fan"
                violations.append(_violation(subject, joint, gap, predicate, broken))
    alone = [
        f"level {number} has one child per branch, which grows straight on: its angle_deg of "
        f"{math.degrees(level.fan_rad):g} changes nothing"
        for number, level in enumerate(subject.design.levels, start=2)
        if level.branches == 1 and level.fan_rad > 0.0
    ]
    return RuleApplied(
        checked=sum(len(joint.gaps) for joint in joints),
        violations=tuple(violations),
        note="; ".join(alone),
    )


def check_crotch(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C03: the filleted crotch ends within a share of the shorter neighbour."""
    joints = level_joints(subject.design)
    violations = []
    for joint in joints:
        gap = max(joint.gaps, key=share_in_crotch)
        if broken := limits.most(share_in_crotch(gap)):
            predicate = (
                f"webbed together for {gap.reach_mm:.1f} mm from the joint: lengthen the child, "
                "widen the angle or narrow the branches"
            )
            limit_mm = broken.limit * shorter_mm(gap)
            in_mm = replace(broken, limit=limit_mm, measured=gap.reach_mm)
            violations.append(_violation(subject, joint, gap, predicate, in_mm))
    # The worst gap stands for its joint: the outline's problems in its other gaps add nothing.
    reported = {violation.at_mm for violation in violations}
    crotches = outline_violations(subject, ProblemKind.NARROW_CROTCH)
    violations += [violation for violation in crotches if violation.at_mm not in reported]
    violations += outline_violations(subject, ProblemKind.NO_ROOM)
    return RuleApplied(
        checked=sum(len(joint.gaps) for joint in joints), violations=tuple(violations)
    )


def check_fillet(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C04: fillets are large enough, for the laser and for their child."""
    joints = level_joints(subject.design)
    violations = []
    for joint in joints:
        width_mm = subject.design.build.widths_mm[joint.level - 1]
        designed_mm = subject.design.build.fillet_mm[joint.level - 2]
        least_mm = max(limits["warning"], limits["share_of_width"] * width_mm)
        small = Limits({"error": limits["error"], "warning": least_mm}).least(joint.fillet_mm)
        if small:
            predicate = (
                f"joined with too small a fillet: design {least_mm:.1f} mm or more, and widen the "
                "angle if it is drawn smaller than designed"
            )
            violations.append(_violation(subject, joint, joint.gaps[0], predicate, small))
        shares = {name: limits[f"most_{name}_share"] * width_mm for name in ("error", "warning")}
        if large := Limits(shares).most(designed_mm):
            predicate = (
                f"joined with so large a fillet that the child is wider than designed far from the "
                f"joint: design {large.limit:.1f} mm or less"
            )
            violations.append(_violation(subject, joint, joint.gaps[0], predicate, large))
        elif joint.fillet_mm < designed_mm * (1.0 - 1e-9):
            less = BrokenLimit(severity=Severity.INFO, limit=designed_mm, measured=joint.fillet_mm)
            predicate = (
                f"joined with a fillet of {joint.fillet_mm:.2f} mm: the angle has no room for more"
            )
            violations.append(_violation(subject, joint, joint.gaps[0], predicate, less))
    return RuleApplied(checked=len(joints), violations=tuple(violations))


def _violation(
    subject: Subject, joint: LevelJoint, gap: Gap, predicate: str, broken: BrokenLimit
) -> Violation:
    """Return a violation by all joints of a level, placed at the first of them."""
    rows = sorted(joint.branch(strip.owner) for strip in (gap.first, gap.second))
    all_joints = f" (and at {joint.joints - 1} more joints)" if joint.joints > 1 else ""
    names = " and ".join(subject.ids(*rows))
    message = f"branches {names}{all_joints} are {predicate}"
    at_mm = branch_start_mm(subject.layout, joint.first_child)
    return branch_violation(subject, rows, message, broken, at_mm=at_mm)


ANGLE = Rule(
    id="VF-C02",
    title="neighbours at every joint part widely enough",
    broken="the angle at a joint is too small",
    unit="deg",
    limits={"error": 15.0, "warning": 20.0},
    reason="narrower crotches leave a sliver of film that the laser melts shut",
    remedy="widen the fan, or use fewer branches in it",
    check=check_angle,
)
CROTCH = Rule(
    id="VF-C03",
    title="crotches end within half of the shorter neighbour",
    broken="a crotch webs its branches together too far",
    unit="mm",
    limits_in="times the length of the shorter neighbour",
    limits={"error": 0.5},
    reason="a longer web ties branches together that should bend apart",
    remedy="a smaller fillet, a wider angle, or a longer child",
    check=check_crotch,
)
FILLET = Rule(
    id="VF-C04",
    title="fillets are of the right size",
    broken="a fillet is too small or too large",
    unit="mm",
    limits={
        "error": 1.0,
        "warning": 2.0,
        "share_of_width": 0.25,
        "most_warning_share": 1.0,
        "most_error_share": 2.0,
    },
    reason="a sharp crotch is where seams begin to peel; the radius should grow with the child, "
    "but a fillet much larger than the child makes it wide where it should be narrow",
    remedy="a larger fillet on a sharp crotch, a smaller one next to a narrow child",
    check=check_fillet,
)


def check_turn(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C06: joints turn little, and so does the whole path to every tip.

    Without deployments a path's turn is that of its joints; with them, the largest turn at
    contacts and base hinges on the way is added.
    """
    tree = subject.grown_tree
    turns_rad = np.abs(tree.offset_rad)
    violations = []
    for level in range(2, subject.design.depth + 1):
        rows = np.flatnonzero(tree.level == level)
        worst = int(rows[np.argmax(turns_rad[rows])])
        if broken := limits.most(math.degrees(turns_rad[worst]), "joint"):
            message = "the branch turns back at its joint: narrow the fan"
            at_mm = branch_start_mm(subject.layout, worst)
            violations.append(branch_violation(subject, [worst], message, broken, at_mm=at_mm))
    contacts_rad = np.zeros(len(tree))
    for deployment in subject.deployments:
        along_rad = _summed_along(tree, deployment.contact_turn_rad)
        contacts_rad = np.maximum(contacts_rad, along_rad)
    path_rad = _summed_along(tree, turns_rad) + contacts_rad
    worst = int(np.argmax(path_rad))
    friction = FITTED.friction.value
    factor = capstan_factor(friction, float(path_rad[worst]))
    if broken := limits.most(factor, "capstan"):
        message = (
            f"turns on the way to this tip multiply the film's tension by {factor:.1f}: "
            "straighten the path"
        )
        at_limit = math.degrees(math.log(broken.limit) / friction)
        as_turn = replace(broken, limit=at_limit, measured=math.degrees(path_rad[worst]))
        at_mm = branch_start_mm(subject.layout, worst)
        violations.append(
            branch_violation(subject, [worst], message, as_turn, at_mm=at_mm, aspect="capstan")
        )
    return RuleApplied(checked=len(tree), violations=tuple(violations))


def _summed_along(tree: BranchTree, values: Floats) -> Floats:
    """Return the sum of a value over each branch and all its ancestors, shape (n,)."""
    total = np.array(values, dtype=np.float64)
    for level in range(2, int(tree.level[-1]) + 1):
        rows = np.flatnonzero(tree.level == level)
        total[rows] += total[tree.parent[rows]]
    return total


TURN = Rule(
    id="VF-C06",
    title="paths turn little enough to grow",
    broken="a path turns too sharply or too often",
    unit="deg",
    limits={"joint_warning": 90.0, "capstan_warning": 10.0},
    reason="friction at turns multiplies the pressure that growth takes (mu 0.234, published)",
    remedy="smaller angles, or fewer levels along the path",
    check=check_turn,
)
