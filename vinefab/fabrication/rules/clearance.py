"""Rules about branches, fillets and pouches that come too near each other on the flat sheet."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.outline.stroke import Point
from vinefab.fabrication.rules.rule import (
    BrokenLimit,
    LimitChanges,
    Limits,
    Rule,
    RuleApplied,
    Violation,
    branch_tip_mm,
    branch_violation,
    mark_line,
    outline_violations,
)
from vinefab.fabrication.rules.spacing import (
    Spacing,
    capsule_hulls,
    point_gap_mm,
    share_joint,
    spacing,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.finding import Severity
from vinefab.model.outline import Part, Segment

_MOST_FINDINGS = 100
"""Most pairs that a rule reports, tightest first; one more finding counts the rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NearBranches:
    """Two branches and where they are nearest."""

    branches: tuple[str, ...]  # ids of both
    gap_mm: float  # free distance, negative where they overlap
    at_mm: Point  # middle of the gap
    marker: str  # line across the gap, from centre line to centre line

    def violation(self, message: str, broken: BrokenLimit) -> Violation:
        """Return the violation by this pair."""
        return broken.violation(
            message, branches=self.branches, at_mm=self.at_mm, marker=self.marker
        )


def nearest_pairs(
    subject: Subject, found: Spacing, chosen: NDArray[np.bool_]
) -> tuple[list[NearBranches], int]:
    """Return chosen pairs of branches by their smallest gap, tightest first, and their count."""
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
            NearBranches(
                branches=subject.ids(*branches),
                gap_mm=float(found.gap_mm[row]),
                at_mm=((x0 + x1) / 2.0, (y0 + y1) / 2.0),
                marker=mark_line((x0, y0), (x1, y1)),
            )
        )
    return pairs, len(rows)


def _remaining(pairs: int, predicate: str) -> tuple[Violation, ...]:
    """Return one violation for all pairs beyond `MOST_FINDINGS`, if there are any."""
    if pairs <= _MOST_FINDINGS:
        return ()
    rest = f"{pairs - _MOST_FINDINGS} more pairs of branches {predicate}"
    return (Violation(message=rest, severity=Severity.INFO, aspect="rest"),)


def check_overlap(subject: Subject, _: Limits) -> RuleApplied:
    """VF-T03: branches that share no joint do not overlap."""
    found = spacing(subject.capsules, 0.0)
    nears, pairs = nearest_pairs(subject, found, ~found.joined & (found.gap_mm < 0.0))
    message = "two branches lie on one place: widen the fan, shorten one of them, or allow pieces"
    violations = [
        near.violation(
            message, BrokenLimit(severity=Severity.ERROR, limit=0.0, measured=near.gap_mm)
        )
        for near in nears
    ]
    return RuleApplied(
        checked=len(subject.layout.tree),
        violations=(*violations, *_remaining(pairs, "overlap when flat")),
    )


def least_gap_mm(rule: Rule, changed: LimitChanges, taken_mm: float) -> float:
    """Return how far apart lumens must be for a rule's least film to be left between them.

    Parameters
    ----------
    taken_mm
        What the beams of each take outside its lumen (`taken_mm` of `fabrication.job.passes`).
    """
    return rule.limits_with(changed.get(rule.id, {}))["error"] + 2.0 * taken_mm


def _film_left(subject: Subject, limits: Limits) -> tuple[Spacing, NDArray[np.bool_]]:
    """Return pairs of branches with the film left between them as gap, and which overlap flat."""
    both_mm = 2.0 * subject.taken_mm
    found = spacing(subject.capsules, max(limits["error"], limits["warning"]) + both_mm)
    return replace(found, gap_mm=found.gap_mm - both_mm), found.gap_mm < 0.0


def _without_recipe(subject: Subject) -> str:
    return "" if subject.profile else "without a recipe: seams and kerfs are not subtracted"


def check_clearance(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C01: as made, film is left between branches that share no joint.

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
        near.violation(message, broken) for near in nears if (broken := limits.least(near.gap_mm))
    ]
    return (*violations, *_remaining(pairs, "come too near each other"))


OVERLAP = Rule(
    id="VF-T03",
    title="branches lie clear of each other on the sheet",
    broken="branches overlap on the sheet",
    unit="mm",
    reason="a flat sheet has no room for two branches at one place",
    remedy="widen angles, shorten or narrow the branches named, use fewer of them, or allow pieces",
    check=check_overlap,
)
CLEARANCE = Rule(
    id="VF-C01",
    title="enough film is left between branches",
    broken="too little film is left between branches",
    unit="mm",
    limits={"error": 0.0, "warning": 2.0},
    reason="where seam, web and kerf of both leave no film between them, a cut runs through a "
    "neighbour's seam; a narrow strip melts (assumed)",
    remedy="widen angles, narrow or shorten the branches named, use fewer of them, or allow pieces",
    check=check_clearance,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Web:
    """The film that a fillet adds, between its arc and the sides that it joins."""

    area: shapely.Polygon  # that film
    branch: int  # index of a branch that the fillet belongs to


def check_foreign(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C05: the film of a fillet keeps clear of all branches but those of its joint.

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
            marker = mark_line(start, end)
            violations.append(
                broken.violation(message, branches=subject.ids(*pair), at_mm=start, marker=marker)
            )
    rest = _remaining(len(order), "are reached by a fillet of another joint")
    return RuleApplied(
        checked=len(webs), violations=(*violations, *rest), note=_without_recipe(subject)
    )


def _web(segment: Segment) -> shapely.Polygon:
    """Return what lies between a fillet and the tangents at its ends, up to where they cross.

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
    deep_mm = point_gap_mm(corners, capsule_hulls(subject.capsules, row[inside][of]))
    gap_mm[inside] = -1e-6
    np.minimum.at(gap_mm, inside[of], deep_mm)
    yield from zip(web.tolist(), row.tolist(), gap_mm.tolist(), strict=True)


FOREIGN_FILLET = Rule(
    id="VF-C05",
    title="fillets touch only branches of their own joint",
    broken="a fillet reaches a branch of another joint",
    unit="mm",
    limits={"error": 0.0, "warning": 2.0},
    reason="a fillet that swallows another branch's side changes the robot",
    remedy="a smaller fillet, or more distance between the joint and the next branch",
    check=check_foreign,
)


_ARC_STEPS = 32
_LEAST_NOTCH_MM2 = 0.05
_SLACK_MM = 0.02


def notches(body: shapely.Polygon, width_mm: float) -> list[shapely.Polygon]:
    """Return where a disc of a diameter does not fit into the film around a body.

    Returns
    -------
    list of Polygon
        What morphological closing of the body by the disc adds, without slivers. A fillet of at
        least half the width adds nothing, nor does film between sides that part from such a fillet.
    """
    closed = shapely.buffer(body, width_mm / 2.0, quad_segs=_ARC_STEPS)
    closed = shapely.buffer(closed, -width_mm / 2.0, quad_segs=_ARC_STEPS)
    # The chords of both buffers leave a film as thin as their sagitta all around.
    sagitta_mm = width_mm * (1.0 - math.cos(math.pi / (4 * _ARC_STEPS)))
    added = shapely.difference(closed, shapely.buffer(body, _SLACK_MM + sagitta_mm))
    return [part for part in shapely.get_parts(added).tolist() if part.area > _LEAST_NOTCH_MM2]


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


def check_pouch(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C07: pouches are wider than their branch, as long, and clear of branches at its joint.

    Near its own parent a pouch ends in the fillets of joint and neck; where these fill the room
    between, no film is left that could be too narrow. So the drawn outline decides there.

    Their clearance to all other branches is VF-C01's and VF-T03's business, as for any branch.
    """
    pouch = subject.design.build.pouch
    if pouch is None:
        return RuleApplied(checked=0)
    found, _ = _film_left(subject, limits)
    near = _gap_violations(subject, limits, found, found.joined & found.pouch)
    violations = (*_confirmed(subject, limits, near),)
    width_mm = subject.design.build.end_widths_mm[-1]
    leaves = np.flatnonzero(subject.layout.is_leaf).tolist()
    sizes = []
    if pouch.length_mm is not None and pouch.length_mm < width_mm:
        fault = "shorter than its branch is wide: lengthen"
        sizes.append(("length", pouch.length_mm, fault))
    if pouch.flat_width_mm <= width_mm:
        sizes.append(("width", pouch.flat_width_mm, "no wider than its branch: widen"))
    at_mm = branch_tip_mm(subject.layout, leaves[0])
    for aspect, size_mm, fault in sizes:
        small = branch_violation(
            subject,
            leaves[:1],
            f"the pouch is {fault} it or leave it out",
            BrokenLimit(severity=Severity.ERROR, limit=width_mm, measured=size_mm),
            at_mm=at_mm,
            marked=leaves,
            aspect=aspect,
        )
        violations = (small, *violations)
    more = outline_violations(subject, ProblemKind.POUCH_WIDTH, known=violations)
    return RuleApplied(checked=len(leaves), violations=(*violations, *more))


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


POUCH = Rule(
    id="VF-C07",
    title="pouches are large enough and clear of neighbours",
    broken="a pouch is too small or too near a neighbour",
    unit="mm",
    limits={"error": 0.0, "warning": 2.0},
    reason="a pouch holds by being wider than its branch; two pouches that touch melt into one",
    remedy="a pouch wider than its branch; a smaller one, or a wider fan, where two touch",
    check=check_pouch,
)
