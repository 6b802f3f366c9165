"""Rules about the tree and its base: outline, mouth, widths, tail, clamp and reach."""

import math
import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import shapely

from vinefab.fabrication.outline.body_outline import ProblemKind
from vinefab.fabrication.rules.rule import (
    Limits,
    Rule,
    RuleApplied,
    Violation,
    branch_point_mm,
    mark_line,
    mark_point,
    needed,
    outline_violations,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.inflation.pattern import Pattern
from vinefab.model.design import Design
from vinefab.model.outline import Part
from vinefab.model.tree import Sleeve, branch_tree
from vinefab.physics.tube import lumen_area_mm2

_AT = re.compile(r"\[(\S+) (\S+)\]")
"""The place in Shapely's reason why a polygon is not valid."""


def check_tree(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-T01: every branch hangs on the tip of its parent and has a length."""
    layout, tree = subject.layout, subject.layout.tree
    violations = []
    for row, length_mm in enumerate(tree.length_mm.tolist()):
        if broken := limits.least(length_mm):
            message = "the branch is too short to be drawn: lengthen it or leave it out"
            violations.append(broken.on(subject, [row], message))
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
        violation = Violation(message=f"the outline is not a polygon: {reason}")
        return RuleApplied(checked=1, violations=(violation,))
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
    first, last = contour.points_mm[0].tolist(), contour.points_mm[-1].tolist()
    violations: tuple[Violation, ...] = ()
    if contour.closed:
        message = "the outline is closed: leave a mouth to inflate it by"
        violations = (Violation(message=message),)
    elif broken := limits.least(math.dist(first, last)):
        wider = replace(
            broken,
            message="the mouth does not open over the base: widen the trunk",
            branches=subject.ids(0),
            at_mm=((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0),
            marker=mark_line(tuple(first), tuple(last)),
        )
        violations = (wider,)
    return RuleApplied(checked=1, violations=violations)


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
    violation = replace(
        broken,
        message="too little tail to invert over the base: lengthen build.tail_mm",
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
        at_mm = branch_point_mm(subject.layout, 0, 0.0)
        violations.append(
            replace(broken, message=message, branches=subject.ids(0), at_mm=at_mm, aspect="clamp")
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
    violation = broken.on(subject, [far], message, at=1.0)
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


PACKING_SHARE = 0.1
"""Share of solid film in a bundle of crumpled thin film (assumed, uncalibrated)."""


def occupancies(
    design: Design, film_mm: float, packing: float = PACKING_SHARE
) -> tuple[float, ...]:
    """Return, for each level that film rides in, how much of its lumen that film fills.

    While a branch grows, all its undeployed descendants are drawn through it one level after
    the other, the branches of one level side by side. A branch of width w has a solid cross-section
    of w x film, which crumpling expands to w x film / packing. The fullest cross-section below
    level i is that of the level with the most width in it:

        occupancy_i = max over j > i of  n_ij w_j film / packing / (w_i^2 / pi)

    with n_ij descendants of level j per branch of level i. Where a level tapers, w_i is its width
    at the end and w_j at the beginning; leaves are as wide as their pouches. A pouch wider than its
    own branch rides in that too, so that the leaves are the last level then. The branch's own
    inverted wall is not counted. The formula is vinefab's and uncalibrated; it neglects that levels
    of uneven branch lengths overlap.
    """
    widths_mm, ends_mm = list(design.build.widths_mm), design.build.end_widths_mm
    pouch = design.build.pouch
    pouch_mm = pouch.flat_width_mm if pouch else 0.0
    widths_mm[-1] = max(widths_mm[-1], pouch_mm)
    shares = []
    for above in range(len(design.levels)):
        count, most_mm = 1, 0.0
        for below in range(above, len(design.levels)):
            count *= design.levels[below].branches
            most_mm = max(most_mm, count * widths_mm[below + 1])
        shares.append(most_mm * film_mm / packing / lumen_area_mm2(ends_mm[above]))
    if pouch_mm > ends_mm[-1]:
        shares.append(pouch_mm * film_mm / packing / lumen_area_mm2(ends_mm[-1]))
    return tuple(shares)


def lap_occupancies(
    design: Design,
    sleeves: Iterable[Sleeve],
    film_mm: float,
    packing: float = PACKING_SHARE,
) -> dict[int, float]:
    """Return, for each branch that laps ride in, how much of its lumen the film there fills.

    As `occupancies`, but with the film doubled where the plug of a sleeve lies in the socket: a
    cross-section of 2 w + 2 rise in place of w, with the rise of the socket's edge over the
    branch's. The descendants k of one level of branch b lie side by side, each at its widest:

        occupancy_b = max over j of  sum over k of level j of c_k film / packing / (w_b^2 / pi)

    with c_k = max(w_j, 2 w_k + 2 rise) where a sleeve of width w_k is on k, else w_j. The formula
    is vinefab's and uncalibrated; it neglects where along their branches the laps lie.
    """
    tree, pouch = branch_tree(design), design.build.pouch
    widths_mm = np.array(design.build.widths_mm)
    widths_mm[-1] = max(widths_mm[-1], pouch.flat_width_mm if pouch else 0.0)
    across_mm = widths_mm[tree.level - 1]
    has_lap = np.zeros(len(tree), dtype=bool)
    for sleeve in sleeves:
        lap_mm = 2.0 * (sleeve.width_mm + sleeve.rise_mm)
        across_mm[sleeve.branch] = max(across_mm[sleeve.branch], lap_mm)
        has_lap[sleeve.branch] = True
    # Below each branch: the cross-section by level, and whether a lap is in it.
    below_mm = np.zeros((len(tree), len(widths_mm)))
    holds_lap = np.zeros(len(tree), dtype=bool)
    for branch in range(len(tree) - 1, 0, -1):
        parent = tree.parent[branch]
        below_mm[parent] += below_mm[branch]
        below_mm[parent, tree.level[branch] - 1] += across_mm[branch]
        holds_lap[parent] |= holds_lap[branch] or has_lap[branch]
    ends_mm = design.build.end_widths_mm
    return {
        branch: float(below_mm[branch].max())
        * film_mm
        / packing
        / lumen_area_mm2(ends_mm[int(tree.level[branch]) - 1])
        for branch in np.flatnonzero(holds_lap).tolist()
    }


def passages_of(pattern: Pattern | None) -> dict[int, float]:
    """Return the passage into the branches of each level, as far as their joint was simulated."""
    joints = pattern.joints if pattern else ()
    return {joint.level: joint.found.passage for joint in joints if joint.found is not None}


def check_least_width(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-W01: no level is too narrow to be inflated and turned inside out."""
    build = subject.design.build
    widths_mm = build.end_widths_mm
    violations = [
        broken.on_level(
            subject,
            level,
            f"tubes of level {level} may burst before they grow: widen them, or the whole robot",
        )
        for level, width_mm in enumerate(widths_mm, start=1)
        if (broken := limits.least(width_mm))
    ]
    more = outline_violations(subject, ProblemKind.VANISHED, known=tuple(violations))
    if build.pouch and build.pouch.length_mm and (broken := limits.least(build.pouch.length_mm)):
        message = "the pouch is too short along its branch to be inflated: lengthen it"
        short = broken.on_level(subject, subject.design.depth, message, aspect="pouch")
        more = (*more, short)
    return RuleApplied(checked=len(widths_mm), violations=(*violations, *more))


def check_width_ratio(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-W02: a parent is much wider than its children."""
    widths_mm = subject.design.build.widths_mm
    ends_mm = subject.design.build.end_widths_mm
    ratios = [wide / narrow for wide, narrow in zip(ends_mm, widths_mm[1:], strict=False)]
    violations = [
        broken.on_level(
            subject,
            level,
            f"level {level} is nearly as wide as the level before it: narrow it, or widen that one",
        )
        for level, ratio in enumerate(ratios, start=2)
        if (broken := limits.least(ratio))
    ]
    more = outline_violations(subject, ProblemKind.CHILD_WIDTH, known=tuple(violations))
    return RuleApplied(checked=len(ratios), violations=(*violations, *more))


def check_packing(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-W03: folded descendants and pouches leave room in the lumen that they ride in.

    What rides in a child comes through its joint. Where the joint was simulated, the cross-section
    there counts: that of the child's tube times the joint's passage.
    """
    profile = needed(subject.profile, "needs a recipe, for the film's thickness")
    film_mm = profile.material.film_mm
    found = [*occupancies(subject.design, film_mm, limits["packing"])]
    for level, passage in passages_of(subject.pattern).items():
        if level <= len(found):
            found[level - 1] /= passage
    violations = [
        broken.on_level(
            subject,
            level,
            f"folded pouches may jam in level {level}: narrow them, or widen the level"
            if level == subject.design.depth
            else f"folded film may jam in level {level}: fewer or narrower children, or widen it",
        )
        for level, share in enumerate(found, start=1)
        if (broken := limits.most(100.0 * share))
    ]
    return RuleApplied(checked=len(found), violations=tuple(violations))


LEAST_WIDTH = Rule(
    id="VF-W01",
    title="every level is wide enough to inflate",
    broken="a level or pouch is too narrow to inflate",
    unit="mm",
    limits={"error": 5.0, "warning": 8.0},
    reason="narrow tubes burst before they grow: 3 mm tubes did, 4 to 7 mm worked (published)",
    remedy="widen the level; with a width ratio, raise it or the trunk's width",
    check=check_least_width,
)
WIDTH_RATIO = Rule(
    id="VF-W02",
    title="every parent is much wider than its children",
    broken="a child is too wide for its parent",
    limits={"error": 1.2, "warning": 1.5},
    reason="each level should be much wider than the next one, or it does not deploy (paper)",
    remedy="narrow the child's level or widen its parent's",
    check=check_width_ratio,
)
PACKING = Rule(
    id="VF-W03",
    title="folded film leaves room in every branch",
    broken="too much folded film rides in a branch",
    unit="%",
    limits={"error": 60.0, "warning": 30.0, "packing": 0.1},
    reason="undeployed film rides inside the body and jams when it is packed (uncalibrated)",
    remedy="fewer, shorter or narrower descendants, smaller pouches, or a wider parent",
    check=check_packing,
)
