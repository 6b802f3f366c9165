"""Rules about room on the flat sheet: branches, fillets and pouches near each other, and joints."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.fabrication.rules.rule import (
    BrokenLimit,
    LimitChanges,
    Limits,
    Rule,
    RuleApplied,
    Scope,
    Subject,
    Violation,
    branch_point_mm,
    design_rule,
    mark_line,
    outline_violations,
)
from vinefab.fabrication.rules.spacing import (
    Spacing,
    share_joint,
    spacing,
)
from vinefab.inflation.pattern import joint_families
from vinefab.model.design import Design, Pouch
from vinefab.model.finding import Severity
from vinefab.model.outline import Part, Segment
from vinefab.model.tree import (
    BranchTree,
)
from vinefab.outline.body_outline import DrawnTree, ProblemKind
from vinefab.outline.joint import Gap, JointPlan, joint_of
from vinefab.physics.growth_pressure import FITTED, capstan_factor

_MOST_FINDINGS = 100
"""Most pairs that a rule reports, tightest first; one more finding counts the rest."""


def nearest_pairs(
    subject: Subject, found: Spacing, chosen: NDArray[np.bool_]
) -> tuple[list[BrokenLimit], int]:
    """Return the chosen pairs of branches as violations of a limit of 0, and their count.

    Measured is the smallest gap of a pair, negative where it overlaps, the tightest pair first. A
    pair is marked by the line across the gap, from centre line to centre line.
    """
    capsules, rows = subject.capsules, np.flatnonzero(chosen)
    rows = rows[np.argsort(found.gap_mm[rows] - found.crossing_mm[rows], kind="stable")]
    one, two = capsules.branch[found.first[rows]], capsules.branch[found.second[rows]]
    # One number per pair: sorting rows of two takes many times longer.
    pair = np.minimum(one, two) * len(capsules.parent) + np.maximum(one, two)
    _, first = np.unique(pair, return_index=True)
    rows = rows[np.sort(first)]
    pairs = []
    for row in rows[:_MOST_FINDINGS].tolist():
        branches = sorted(int(capsules.branch[side[row]]) for side in (found.first, found.second))
        (x0, y0), (x1, y1) = found.first_mm[row].tolist(), found.second_mm[row].tolist()
        pairs.append(
            BrokenLimit(
                limit=0.0,
                measured=float(found.gap_mm[row]),
                branches=subject.ids(*branches),
                at_mm=((x0 + x1) / 2.0, (y0 + y1) / 2.0),
                marker=mark_line((x0, y0), (x1, y1)),
            )
        )
    return pairs, len(rows)


def _remaining(pairs: int, predicate: str) -> tuple[Violation, ...]:
    """Return one violation for all pairs beyond the most that are reported, if there are any."""
    if pairs <= _MOST_FINDINGS:
        return ()
    rest = f"{pairs - _MOST_FINDINGS} more pairs of branches {predicate}"
    return (Violation(message=rest, severity=Severity.INFO, aspect="rest"),)


@design_rule(
    "VF-T03",
    broken="branches overlap on the sheet",
    unit="mm",
    on={Scope.ROOM, Scope.PIECES},
    reason="a flat sheet has no room for two branches at one place",
    remedy="widen angles, shorten or narrow the branches named, use fewer of them, or allow pieces",
)
def check_overlap(subject: Subject, _: Limits) -> RuleApplied:
    """Branches lie clear of each other on the sheet.

    These are branches that share no joint.
    """
    found = spacing(subject.capsules, 0.0)
    nears, pairs = nearest_pairs(subject, found, ~found.joined & (found.gap_mm < 0.0))
    message = "two branches lie on one place: widen the fan, shorten one of them, or allow pieces"
    violations = [replace(near, message=message) for near in nears]
    return RuleApplied(
        checked=len(subject.layout.tree),
        violations=(*violations, *_remaining(pairs, "overlap when flat")),
    )


def least_gap_mm(rule: Rule, changed: LimitChanges, taken_mm: float) -> float:
    """Return the least distance of lumens that leaves a rule's least film between them.

    Parameters
    ----------
    taken_mm
        What the beams of each take outside its lumen (`taken_mm` of `fabrication.job.passes`).
    """
    return rule.limits_under(changed)["error"] + 2.0 * taken_mm


def _film_left(subject: Subject, limits: Limits) -> tuple[Spacing, NDArray[np.bool_]]:
    """Return pairs of branches with the film left between them as gap, and which overlap flat."""
    both_mm = 2.0 * subject.taken_mm
    found = spacing(subject.capsules, max(limits["error"], limits["warning"]) + both_mm)
    return replace(found, gap_mm=found.gap_mm - both_mm), found.gap_mm < 0.0


def _without_recipe(subject: Subject) -> str:
    return "" if subject.profile else "without a recipe: seams and kerfs are not subtracted"


@design_rule(
    "VF-C01",
    broken="too little film is left between branches",
    unit="mm",
    error=0.0,
    warning=2.0,
    on={Scope.ROOM, Scope.PIECES},
    reason="where seam, web and kerf of both leave no film between them, a cut runs through a "
    "neighbour's seam; a narrow strip melts (assumed)",
    remedy="widen angles, narrow or shorten the branches named, use fewer of them, or allow pieces",
)
def check_clearance(subject: Subject, limits: Limits) -> RuleApplied:
    """Enough film is left between branches.

    Left is what lies between their lumens, less what the beams of both take there: seam, web and
    kerf, by the process of the robot.

    Branches that share one converge there by design. Their notch ends in a fillet (VF-C04) within
    half of the shorter one (VF-C03), and from there on two straight sides only part: at the end of
    the shorter one they are a branch's width apart. Pouches can close a notch again: VF-C07.
    """
    found, overlap = _film_left(subject, limits)
    return RuleApplied(
        checked=len(subject.layout.tree),
        violations=_gap_violations(subject, limits, found, ~found.joined & ~overlap),
        note=_without_recipe(subject),
    )


def _gap_violations(
    subject: Subject, limits: Limits, found: Spacing, chosen: NDArray[np.bool_]
) -> tuple[Violation, ...]:
    """Return a violation for each chosen pair of branches with too little film between them."""
    low = chosen & (found.gap_mm < max(limits["error"], limits["warning"]))
    nears, pairs = nearest_pairs(subject, found, low)
    message = "cuts and seams leave a strip of film that melts: move the branches apart"
    violations = [
        replace(near, message=message, severity=broken.severity, limit=broken.limit)
        for near in nears
        if (broken := limits.least(near.measured))
    ]
    return (*violations, *_remaining(pairs, "come too near each other"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Web:
    """The film that a fillet adds, between its arc and the sides that it joins."""

    area: shapely.Polygon  # that film
    branch: int  # index of a branch that the fillet belongs to


@design_rule(
    "VF-C05",
    broken="a fillet reaches a branch of another joint",
    unit="mm",
    error=0.0,
    warning=2.0,
    on={Scope.ROOM, Scope.PIECES},
    reason="a fillet that swallows another branch's side changes the robot",
    remedy="a smaller fillet, or more distance between the joint and the next branch",
)
def check_foreign(subject: Subject, limits: Limits) -> RuleApplied:
    """Fillets touch only branches of their own joint.

    The capsules of VF-C01 leave fillets out; a large fillet can close the gap to a branch that is
    clear of both its sides. A fillet at a pouch's neck belongs to the joint of its branch.
    """
    index = {name: row for row, name in enumerate(subject.names)}
    webs = [
        _Web(area=_web(segment), branch=index[segment.branch])
        for segment in subject.outline.contour.segments
        if segment.part is Part.FILLET and segment.bulge
    ]
    both_mm = 2.0 * subject.taken_mm
    reach_mm = max(limits["error"], limits["warning"]) + both_mm
    capsules = subject.capsules
    ends = (capsules.start_mm, capsules.half_mm), (capsules.end_mm, capsules.end_half_mm)
    discs = [
        shapely.buffer(shapely.points(centre), np.maximum(half, 1e-6), quad_segs=64)
        for centre, half in ends
    ]
    hulls = np.asarray(shapely.convex_hull(shapely.multipolygons(np.stack(discs, axis=1))))
    nearest: dict[tuple[int, int], tuple[float, _Web, int]] = {}
    for number, row, apart_mm in _near_webs(subject, webs, hulls, reach_mm):
        gap_mm = apart_mm - both_mm
        web, other = webs[number], int(subject.capsules.branch[row])
        pair = min(web.branch, other), max(web.branch, other)
        if pair not in nearest or gap_mm < nearest[pair][0]:
            nearest[pair] = gap_mm, web, row
    order = sorted(nearest.items(), key=lambda item: item[1][0])
    violations = []
    message = "a fillet reaches a branch of another joint: make it smaller, or part the branches"
    for pair, (gap_mm, web, row) in order[:_MOST_FINDINGS]:
        if broken := limits.least(gap_mm):
            points = shapely.get_coordinates(shapely.shortest_line(web.area, hulls[row])).tolist()
            start, end = (points[0][0], points[0][1]), (points[-1][0], points[-1][1])
            marker, names = mark_line(start, end), subject.ids(*pair)
            violations.append(
                replace(broken, message=message, branches=names, at_mm=start, marker=marker)
            )
    rest = _remaining(len(order), "are reached by a fillet of another joint")
    return RuleApplied(
        checked=len(webs), violations=(*violations, *rest), note=_without_recipe(subject)
    )


def _web(segment: Segment) -> shapely.Polygon:
    """Return the area between a fillet and the tangents at its ends, up to their crossing.

    Tangents that hardly part cross far away: then up to three radii.
    """
    reach = segment.radius_mm * min(math.tan(min(abs(segment.turn_rad) / 2.0, 1.5)), 3.0)
    corners = []
    for at_end in (True, False):
        angle, point = segment.direction_rad(at_end=at_end), segment.start_mm
        if at_end:
            angle, point = angle + math.pi, segment.end_mm
        corners.append((point[0] + reach * math.cos(angle), point[1] + reach * math.sin(angle)))
    return shapely.Polygon([*segment.flattened_mm().tolist(), *corners])


def _near_webs(
    subject: Subject, webs: Sequence[_Web], hulls: NDArray[np.object_], reach_mm: float
) -> Iterator[tuple[int, int, float]]:
    """Yield web, capsule and gap (mm) of those that come near, but for branches of the web's joint.

    A gap below 0 says how deep the web's corners lie inside the capsule.
    """
    if not webs:
        return
    areas, branch = np.array([web.area for web in webs]), np.array([web.branch for web in webs])
    web, row = shapely.STRtree(hulls).query(areas, predicate="dwithin", distance=reach_mm)
    other = subject.capsules.branch[row]
    apart = branch[web] != other
    apart &= ~share_joint(subject.layout.tree.parent, branch[web], other)
    web, row = web[apart], row[apart]
    gap_mm = np.asarray(shapely.distance(areas[web], hulls[row]))
    inside = np.flatnonzero(gap_mm <= 0.0)
    corners, of = shapely.get_coordinates(areas[web[inside]], return_index=True)
    deep_mm = subject.capsules.hulls(row[inside][of]).gap_mm(corners)
    gap_mm[inside] = -1e-6
    np.minimum.at(gap_mm, inside[of], deep_mm)
    yield from zip(web.tolist(), row.tolist(), gap_mm.tolist(), strict=True)


def notches(
    body: shapely.Polygon,
    width_mm: float,
    *,
    arc_steps: int = 32,
    slack_mm: float = 0.02,
    least_mm2: float = 0.05,
) -> list[shapely.Polygon]:
    """Return where a disc of a diameter does not fit into the film around a body.

    Returns
    -------
    list of Polygon
        What morphological closing of the body by the disc adds, without slivers along its edge
        (``slack_mm``) and in corners (``least_mm2``). A fillet of at least half the width adds
        nothing, nor does film between sides that part from such a fillet.
    """
    closed = shapely.buffer(body, width_mm / 2.0, quad_segs=arc_steps)
    closed = shapely.buffer(closed, -width_mm / 2.0, quad_segs=arc_steps)
    # The chords of both buffers leave a film as thin as their sagitta all around.
    sagitta_mm = width_mm * (1.0 - math.cos(math.pi / (4 * arc_steps)))
    added = shapely.difference(closed, shapely.buffer(body, slack_mm + sagitta_mm))
    return [part for part in shapely.get_parts(added).tolist() if part.area > least_mm2]


def lies_between(
    subject: Subject, found: list[shapely.Polygon], branches: tuple[str, ...], within_mm: float
) -> bool:
    """Whether one of the notches lies near all of the branches."""
    capsules = subject.capsules
    near = []
    for name in branches:
        rows = capsules.branch == subject.names.index(name)
        lines = [
            shapely.LineString([a, b])
            for a, b in zip(capsules.start_mm[rows], capsules.end_mm[rows], strict=True)
        ]
        near.append(list(zip(lines, capsules.half_mm[rows].tolist(), strict=True)))
    return any(
        all(
            min(shapely.distance(notch, line) - half for line, half in one) < within_mm
            for one in near
        )
        for notch in found
    )


@design_rule(
    "VF-C07",
    broken="a pouch is too small or too near a neighbour",
    unit="mm",
    error=0.0,
    warning=2.0,
    on={Scope.ROOM, Scope.PIECES},
    reason="a pouch holds by being wider than its branch; two pouches that touch melt into one",
    remedy="a pouch wider than its branch; a smaller one, or a wider fan, where two touch",
)
def check_pouch(subject: Subject, limits: Limits) -> RuleApplied:
    """Pouches are large enough and clear of neighbours.

    A pouch is wider than its branch, at least as long, and clear of branches at its joint.

    Near its own parent a pouch ends in the fillets of joint and neck; where these fill the room
    between, no film is left that could be too narrow. So the drawn outline decides there.

    Their clearance to all other branches is VF-C01's and VF-T03's business, as for any branch.
    """
    pouches, end_width_mm = subject.layout.pouches, subject.layout.end_width_mm.tolist()
    by_kind: dict[tuple[Pouch, float], list[int]] = {}
    for row, pouch in enumerate(pouches):
        if pouch is not None:
            by_kind.setdefault((pouch, end_width_mm[row]), []).append(row)
    if not by_kind:
        return RuleApplied(checked=0)
    found, _ = _film_left(subject, limits)
    near = _gap_violations(subject, limits, found, found.joined & found.pouch)
    violations = (*_confirmed(subject, limits, near),)
    for (pouch, width_mm), leaves in by_kind.items():
        sizes = []
        if pouch.length_mm is not None and pouch.length_mm < width_mm:
            fault = "shorter than its branch is wide: lengthen"
            sizes.append(("length", pouch.length_mm, fault))
        if pouch.flat_width_mm <= width_mm:
            sizes.append(("width", pouch.flat_width_mm, "no wider than its branch: widen"))
        for aspect, size_mm, fault in sizes:
            message = f"the pouch is {fault} it or leave it out"
            small = Violation(limit=width_mm, measured=size_mm)
            one = small.on(subject, leaves[:1], message, at=1.0, marked=leaves, aspect=aspect)
            violations = (one, *violations)
    more = outline_violations(subject, ProblemKind.POUCH_WIDTH, known=violations)
    checked = sum(pouch is not None for pouch in pouches)
    return RuleApplied(checked=checked, violations=(*violations, *more))


def _confirmed(
    subject: Subject, limits: Limits, violations: tuple[Violation, ...]
) -> Iterator[Violation]:
    """Yield violations; of a pouch and its own parent only where the outline has a notch."""
    body = subject.body
    parents = {name: name.rpartition(".")[0] for name in subject.names}
    seen: dict[float, list[shapely.Polygon]] = {}
    for violation in violations:
        pair = violation.branches
        own = len(pair) == 2 and pair[0] == parents[pair[1]]
        if not own or not body.is_valid:
            yield violation
            continue
        for severity in (Severity.ERROR, Severity.WARNING):
            if violation.measured is None or violation.measured > limits[severity]:
                continue
            width_mm = limits[severity] + 2.0 * subject.taken_mm
            if width_mm not in seen:
                seen[width_mm] = notches(body, width_mm)
            if lies_between(subject, seen[width_mm], violation.branches, width_mm):
                yield replace(violation, severity=severity, limit=limits[severity])
                break


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelJoint:
    """A kind of joint, where children sprout from their parent's tip."""

    level: int  # level of the children, 2 or more
    joints: int  # how many such joints the design has
    parent: int  # row of the parent at the first of these joints
    children: tuple[int, ...]  # rows of its children, clockwise-most first
    plan: JointPlan  # what it is drawn from
    # Gaps around the joint on the lumen's edge, counter-clockwise, the parent's body first and
    # last. Owner 0 is the parent, 1 the first child, and so on.
    gaps: tuple[Gap, ...]
    # Smallest fillet radius drawn: the designed one, or less where the angle allows no more;
    # infinite if no gap has room for a fillet.
    fillet_mm: float

    def branch(self, owner: int) -> int:
        """Return the tree's index of a gap's owner."""
        return (self.parent, *self.children)[owner]


def level_joints(design: Design) -> tuple[LevelJoint, ...]:
    """Return every kind of joint and bend."""
    return _level_joints(DrawnTree.of(design))


@lru_cache(maxsize=16)
def _level_joints(drawn: DrawnTree) -> tuple[LevelJoint, ...]:
    # Three rules ask for the joints of each robot.
    found = list[LevelJoint]()
    for family in joint_families(drawn):
        joint, first = joint_of(family.plan, 0.0), family.rows[0]
        pairs = zip(joint.fillets_mm, joint.allowed_mm, strict=True)
        radii_mm = (min(pair) for pair in pairs if pair[1] >= 0.0)
        found.append(
            LevelJoint(
                level=family.level,
                joints=len(family.rows),
                parent=first,
                children=tuple(drawn.children[first]),
                plan=family.plan,
                gaps=joint.gaps,
                fillet_mm=min(radii_mm, default=math.inf),
            )
        )
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

    Neighbours at less than a millionth of a radian never part and give infinity.
    """
    return gap.reach_mm / shorter_mm(gap) if gap.angle_rad > 1e-6 else math.inf


@design_rule(
    "VF-C02",
    broken="the angle at a joint is too small",
    unit="deg",
    error=15.0,
    warning=20.0,
    reason="narrower crotches leave a sliver of film that the laser melts shut",
    remedy="widen the fan, or use fewer branches in it",
)
def check_angle(subject: Subject, limits: Limits) -> RuleApplied:
    """Neighbours at every joint part widely enough.

    The parent's body is one of the neighbours.
    """
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
    return RuleApplied(
        checked=sum(len(joint.gaps) for joint in joints),
        violations=tuple(violations),
        note="; ".join(subject.design.idle_values),
    )


@design_rule(
    "VF-C03",
    broken="a crotch webs its branches together too far",
    unit="mm",
    limits_in="times the length of the shorter neighbour",
    error=0.5,
    reason="a longer web ties branches together that should bend apart",
    remedy="a smaller fillet, a wider angle, or a longer child",
)
def check_crotch(subject: Subject, limits: Limits) -> RuleApplied:
    """Crotches end within half of the shorter neighbour."""
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


@design_rule(
    "VF-C04",
    broken="a fillet is too small or too large",
    unit="mm",
    error=1.0,
    warning=2.0,
    share_of_width=0.25,
    most_warning_share=1.0,
    most_error_share=2.0,
    reason="a sharp crotch is where seams begin to peel; the radius should grow with the child, "
    "but a fillet much larger than the child makes it wide where it should be narrow",
    remedy="a larger fillet on a sharp crotch, a smaller one next to a narrow child",
)
def check_fillet(subject: Subject, limits: Limits) -> RuleApplied:
    """Fillets are of the right size."""
    joints = level_joints(subject.design)
    violations = []
    for joint in joints:
        children = joint.plan.children
        width_mm = 2.0 * max(one.half_mm for one in children)
        designed_mm = max(one.fillet_mm for one in children)
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
            violations.append(
                _violation(subject, joint, joint.gaps[0], predicate, large, aspect="large")
            )
        elif joint.fillet_mm < designed_mm * (1.0 - 1e-9):
            less = Violation(severity=Severity.INFO, limit=designed_mm, measured=joint.fillet_mm)
            predicate = (
                f"joined with a fillet of {joint.fillet_mm:.2f} mm: the angle has no room for more"
            )
            violations.append(
                _violation(subject, joint, joint.gaps[0], predicate, less, aspect="drawn")
            )
    return RuleApplied(checked=len(joints), violations=tuple(violations))


def _violation(
    subject: Subject,
    joint: LevelJoint,
    gap: Gap,
    predicate: str,
    broken: Violation,
    aspect: str = "",
) -> Violation:
    """Return a violation by all joints of a level, placed at the first of them."""
    rows = sorted(joint.branch(strip.owner) for strip in (gap.first, gap.second))
    all_joints = f" (and at {joint.joints - 1} more joints)" if joint.joints > 1 else ""
    names = " and ".join(subject.called(*rows))
    message = f"branches {names}{all_joints} are {predicate}"
    at_mm = branch_point_mm(subject.layout, joint.children[0], 0.0)
    return broken.on(subject, rows, message, at=at_mm, aspect=aspect)


@design_rule(
    "VF-C06",
    broken="a path turns too sharply or too often",
    unit="deg",
    joint_warning=90.0,
    capstan_warning=10.0,
    reason="friction at turns multiplies the pressure that growth takes (mu 0.234, published)",
    remedy="smaller angles, or fewer levels along the path",
)
def check_turn(subject: Subject, limits: Limits) -> RuleApplied:
    """Paths turn little enough to grow.

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
            violations.append(broken.on(subject, [worst], message, at=0.0))
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
        violations.append(as_turn.on(subject, [worst], message, at=0.0, aspect="capstan"))
    return RuleApplied(checked=len(tree), violations=tuple(violations))


def _summed_along(tree: BranchTree, values: Floats) -> Floats:
    """Return the sum of a value over each branch and all its ancestors, shape (n,)."""
    total = np.array(values, dtype=np.float64)
    for level in range(2, int(tree.level[-1]) + 1):
        rows = np.flatnonzero(tree.level == level)
        total[rows] += total[tree.parent[rows]]
    return total
