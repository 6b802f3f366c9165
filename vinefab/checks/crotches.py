"""Rules about joints: angles, crotches and fillets."""

import math

from vinefab.checks.joints import Joint, joints_of, share_in_crotch, shorter_mm
from vinefab.checks.marks import mark_branches, place_mm
from vinefab.checks.problems import problem_hits
from vinefab.checks.rule import Breach, Hit, Limits, Looked, Rule
from vinefab.checks.subject import Subject
from vinefab.geometry.crotch import Gap
from vinefab.geometry.problem import ProblemKind
from vinefab.model.finding import Severity


def look_angle(subject: Subject, limits: Limits) -> Looked:
    """VF-C02: neighbours round a joint, the parent's body among them, part at an angle."""
    joints = joints_of(subject.design)
    hits = []
    for joint in joints:
        # Between children all angles are alike, and the last one beside the parent mirrors the
        # first: two gaps stand for all.
        for gap in joint.gaps[:2][: len(joint.gaps) - 1]:
            angle_deg = math.degrees(gap.angle_rad)
            breach = limits.least(angle_deg)
            if breach:
                words = "almost parallel: widen the fan or have fewer children"
                if 0 in (gap.first.owner, gap.second.owner):
                    words = "almost folded onto its parent: narrow the fan"
                hits.append(_hit(subject, (joint, gap), words, (angle_deg, breach)))
    return Looked(checked=sum(len(joint.gaps) for joint in joints), hits=tuple(hits))


def look_crotch(subject: Subject, limits: Limits) -> Looked:
    """VF-C03: the filleted crotch ends within a share of the shorter neighbour."""
    joints = joints_of(subject.design)
    hits = []
    for joint in joints:
        gap = max(joint.gaps, key=share_in_crotch)
        share = share_in_crotch(gap)
        breach = limits.most(share)
        if breach:
            words = (
                f"webbed together for {gap.reach_mm:.1f} mm from the joint: lengthen the child, "
                "widen the angle or narrow the branches"
            )
            in_mm = Breach(severity=breach.severity, limit=breach.limit * shorter_mm(gap))
            hits.append(_hit(subject, (joint, gap), words, (gap.reach_mm, in_mm)))
    # The worst gap stands for its joint: the outline's word about its other gaps adds nothing.
    told = {hit.at_mm for hit in hits}
    crotches = problem_hits(subject, frozenset({ProblemKind.NARROW_CROTCH}))
    hits += [hit for hit in crotches if hit.at_mm not in told]
    hits += problem_hits(subject, frozenset({ProblemKind.NO_ROOM}))
    return Looked(checked=sum(len(joint.gaps) for joint in joints), hits=tuple(hits))


def look_fillet(subject: Subject, limits: Limits) -> Looked:
    """VF-C04: fillets are large enough, for the laser and for their child."""
    joints = joints_of(subject.design)
    hits = []
    for joint in joints:
        radius_mm = joint.fillet_mm
        width_mm = subject.design.build.widths_mm[joint.level - 1]
        least_mm = max(limits["warning"], limits["share_of_width"] * width_mm)
        breach = Limits({"error": limits["error"], "warning": least_mm}).least(radius_mm)
        if breach:
            words = (
                f"joined with too small a fillet: design {least_mm:.1f} mm or more, and widen the "
                "angle if it is drawn smaller than designed"
            )
            hits.append(_hit(subject, (joint, joint.gaps[0]), words, (radius_mm, breach)))
        hits += _large_fillet(subject, joint, limits)
    return Looked(checked=len(joints), hits=tuple(hits))


def _large_fillet(subject: Subject, joint: Joint, limits: Limits) -> list[Hit]:
    """Return hits about a fillet that swells its child, or that is drawn smaller than designed."""
    width_mm = subject.design.build.widths_mm[joint.level - 1]
    designed_mm = subject.design.build.fillet_mm[joint.level - 2]
    shares = {name: limits[f"most_{name}_share"] * width_mm for name in ("error", "warning")}
    breach = Limits(shares).most(designed_mm)
    where = joint, joint.gaps[0]
    if breach:
        words = (
            f"joined with so large a fillet that the child is wider than designed far from the "
            f"joint: design {breach.limit:.1f} mm or less"
        )
        return [_hit(subject, where, words, (designed_mm, breach))]
    if joint.fillet_mm < designed_mm * (1.0 - 1e-9):
        less = Breach(severity=Severity.INFO, limit=designed_mm)
        words = f"joined with a fillet of {joint.fillet_mm:.2f} mm: the angle has no room for more"
        return [_hit(subject, where, words, (joint.fillet_mm, less))]
    return []


def _hit(
    subject: Subject, where: tuple[Joint, Gap], words: str, found: tuple[float, Breach]
) -> Hit:
    """Return a hit about all joints of a level, at the first of them."""
    joint, gap = where
    measured, breach = found
    rows = sorted(joint.branch(strip.owner) for strip in (gap.first, gap.second))
    all_joints = f" (and at {joint.joints - 1} more joints)" if joint.joints > 1 else ""
    names = " and ".join(subject.ids(*rows))
    return Hit(
        message=f"branches {names}{all_joints} are {words}",
        severity=breach.severity,
        measured=measured,
        limit=breach.limit,
        branches=subject.ids(*rows),
        at_mm=place_mm(subject.layout, joint.first_child),
        marker=mark_branches(subject.layout, rows),
    )


ANGLE = Rule(
    id="VF-C02",
    title="angle between neighbours round a joint, the parent's body included",
    unit="deg",
    limits={"error": 15.0, "warning": 20.0},
    reason="narrower crotches leave a sliver of film that the laser melts shut",
    look=look_angle,
)
CROTCH = Rule(
    id="VF-C03",
    title="the filleted crotch ends within half of the shorter neighbour",
    unit="mm",
    limits={"error": 0.5},
    reason="a longer web ties branches together that should bend apart",
    look=look_crotch,
)
FILLET = Rule(
    id="VF-C04",
    title="fillet radius",
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
    look=look_fillet,
)
