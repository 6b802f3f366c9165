"""Rules about the tree as a whole and its base: polygon, mouth, tail, clamp and reach."""

import math
import re

import numpy as np
import shapely

from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.rules.rule import (
    Limits,
    Rule,
    RuleApplied,
    Violation,
    branch_start_mm,
    branch_tip_mm,
    branch_violation,
    mark_line,
    mark_point,
    outline_violations,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.outline import Part

_AT = re.compile(r"\[(\S+) (\S+)\]")
"""The place in Shapely's reason why a polygon is not valid."""


def check_tree(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-T01: every branch hangs on the tip of its parent and has a length."""
    layout, tree = subject.layout, subject.layout.tree
    violations = []
    for row, length_mm in enumerate(tree.length_mm.tolist()):
        if broken := limits.least(length_mm):
            message = "the branch is too short to be drawn: lengthen it or leave it out"
            violations.append(branch_violation(subject, [row], message, broken))
    away = np.abs(layout.start_mm[1:] - layout.end_mm[tree.parent[1:]]).max(axis=1, initial=0.0)
    for row in (1 + np.flatnonzero(~(away < 1e-6))).tolist():
        violations.append(  # noqa: PERF401  one shape of loop for both halves of the rule
            Violation(
                message="the branch does not begin at the tip of its parent: join them",
                measured=float(away[row - 1]),
                branches=subject.ids(row),
                aspect="joined",
            )
        )
    return RuleApplied(checked=len(tree), violations=tuple(violations))


def check_outline_polygon(subject: Subject, _: Limits) -> RuleApplied:
    """VF-T02: the outline encloses one valid polygon without holes."""
    body = subject.body
    if body.is_valid:
        return RuleApplied(checked=1)
    reason = shapely.is_valid_reason(body)
    found = _AT.search(reason)
    if not found:
        return RuleApplied(
            checked=1, violations=(Violation(message=f"the outline is no polygon: {reason}"),)
        )
    at = float(found[1]), float(found[2])
    # Named are the (up to) two branches nearest to the place.
    capsules = subject.capsules
    lines = shapely.linestrings(np.stack([capsules.start_mm, capsules.end_mm], axis=1))
    far = shapely.distance(lines, shapely.Point(at)) - capsules.most_half_mm
    near = capsules.branch[np.argsort(far, kind="stable")]
    violation = Violation(
        message="the outline crosses itself here, and a flat sheet cannot: widen the angle, or "
        "shorten or narrow the branches",
        branches=subject.ids(*sorted(list(dict.fromkeys(near.tolist()))[:2])),
        at_mm=at,
        marker=mark_point(at),
    )
    return RuleApplied(checked=1, violations=(violation,))


def check_mouth(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-T04: the outline is open at one place, the mouth, and wide enough there."""
    contour = subject.outline.contour
    if contour.closed:
        return RuleApplied(
            checked=1,
            violations=(
                Violation(message="the outline is closed: leave a mouth to inflate it by"),
            ),
        )
    first, last = contour.points_mm[0].tolist(), contour.points_mm[-1].tolist()
    gap_mm = float(np.hypot(last[0] - first[0], last[1] - first[1]))
    broken = limits.least(gap_mm)
    if not broken:
        return RuleApplied(checked=1)
    violation = broken.violation(
        "the mouth does not open over the base: widen the trunk",
        branches=subject.ids(0),
        at_mm=((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0),
        marker=mark_line(tuple(first), tuple(last)),
    )
    return RuleApplied(checked=1, violations=(violation,))


TREE = Rule(
    id="VF-T01",
    title="every branch hangs on its parent and has a length",
    broken="a branch has no length or hangs on nothing",
    unit="mm",
    limits={"error": 0.1},
    reason="a branch shorter than a laser spot cannot be drawn",
    remedy="lengthen the branch, or remove its level",
    check=check_tree,
)
POLYGON = Rule(
    id="VF-T02",
    title="the outline stays clear of itself",
    broken="the outline crosses itself",
    reason="two flat plies cannot lie on themselves; a crossing outline cuts the body open",
    remedy="widen angles, shorten or narrow branches until none crosses another, or pieces",
    check=check_outline_polygon,
)
MOUTH = Rule(
    id="VF-T04",
    title="the mouth is open and wide enough",
    broken="the mouth is missing or too narrow",
    unit="mm",
    limits={"error": 5.0},
    reason="the robot is inflated and clamped through its mouth; everything else is sealed",
    remedy="widen the trunk",
    check=check_mouth,
)


_STRAIGHT_MM = 1e-6


def check_tail(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-B01: the tail is long enough to be inverted over the base and clamped."""
    tail_mm = subject.design.build.tail_mm
    broken = limits.least(tail_mm)
    if not broken:
        return RuleApplied(checked=1)
    violation = broken.violation(
        "too little tail to invert over the base: lengthen build.tail_mm",
        branches=subject.ids(0),
        at_mm=(-tail_mm, 0.0),
        marker=mark_line((-tail_mm, 0.0), (0.0, 0.0)),
    )
    return RuleApplied(checked=1, violations=(violation,))


def check_clamp(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-B02: the tail is straight all along and its mouth fits the clamp of the base.

    With a collar the outline's mouth must be as wide as a tube that fits the clamp; without one it
    must be no wider than a common clamp. The collar's transition is the only bend allowed.
    """
    contour = subject.outline.contour
    mouth_mm = math.dist(contour.points_mm[0], contour.points_mm[-1])
    violations = list(outline_violations(subject, ProblemKind.COLLAR, ProblemKind.COLLAR_FLARE))
    collar = subject.design.build.collar
    if collar is None:
        broken = limits.most(mouth_mm)
        message = (
            "the tail is wider than the clamp of the base: narrow the trunk or give it a collar"
        )
    else:
        broken = limits.most(abs(mouth_mm - collar.flat_width_mm), "fit")
        message = "the collar is not as wide as the clamp: set build.collar to the clamp's size"
    if broken:
        at_mm = branch_start_mm(subject.layout, 0)
        violations.append(
            broken.violation(message, branches=subject.ids(0), at_mm=at_mm, aspect="clamp")
        )
    tail = [s for s in contour.segments if s.part is Part.TAIL]
    bent = [s for s in tail if s.bulge or abs(s.start_mm[1] - s.end_mm[1]) > _STRAIGHT_MM]
    if bent:
        violations.append(
            Violation(
                message="the tail bends, and a clamp seals straight tubes only: straighten it",
                branches=subject.ids(0),
                at_mm=bent[0].start_mm,
                marker=mark_line(bent[0].start_mm, bent[0].end_mm),
                aspect="straight",
            )
        )
    return RuleApplied(checked=1, violations=tuple(violations))


def check_reach(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-B03: the longest path from base to tip has a length that has been tested."""
    tree = subject.grown_tree
    path_mm = np.array(tree.length_mm)
    for row in range(1, len(tree)):
        path_mm[row] += path_mm[tree.parent[row]]
    far = int(path_mm.argmax())
    longest_mm = float(path_mm[far])
    broken = limits.least(longest_mm, "short") or limits.most(longest_mm, "long")
    if not broken:
        return RuleApplied(checked=1)
    than = "shorter" if limits.least(longest_mm, "short") else "longer"
    message = f"robots with {than} paths are untested: change the lengths or the scale"
    at_mm = branch_tip_mm(subject.layout, far)
    violation = branch_violation(subject, [far], message, broken, at_mm=at_mm)
    return RuleApplied(checked=1, violations=(violation,))


TAIL = Rule(
    id="VF-B01",
    title="the tail is long enough to invert and clamp",
    broken="the tail is too short to invert and clamp",
    unit="mm",
    limits={"error": 150.0, "warning": 200.0},
    reason="the last 200 mm are inverted over the base and clamped (paper)",
    remedy="a longer tail",
    check=check_tail,
)
CLAMP = Rule(
    id="VF-B02",
    title="the tail is straight and fits the clamp",
    broken="the tail does not fit the clamp",
    unit="mm",
    limits={"error": 100.0, "fit_error": 0.1},
    reason="a clamp seals a straight tube only; without a collar 100 mm is assumed",
    remedy="a collar that fits the clamp, or another trunk width",
    check=check_clamp,
)
DEPLOYED_LENGTH = Rule(
    id="VF-B03",
    title="the longest path has a length that was tested",
    broken="the longest path is too short or too long: untested",
    unit="mm",
    limits={"short_warning": 250.0, "long_warning": 2000.0},
    reason="untested above 2 m and below 0.25 m (paper)",
    remedy="change the lengths, or accept that such a length was never tried",
    check=check_reach,
)
