"""Rules about branches and fillets that come too near each other on the flat sheet."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.rules.rule import (
    BrokenLimit,
    Limits,
    Point,
    Rule,
    RuleApplied,
    Violation,
    mark_branches,
    mark_line,
    outline_violations,
    place_mm,
)
from vinefab.fabrication.rules.spacing import Hulls, Shapes, Spacing, point_gap_mm, spacing
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.finding import Severity
from vinefab.model.outline import Part, Segment

MOST_FINDINGS = 100
"""A rule names so many pairs, the tightest ones; the rest are counted in one more finding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Near:
    """Two branches and where they are nearest."""

    branches: tuple[str, ...]  # ids of both
    gap_mm: float  # free distance, negative where they overlap
    at_mm: Point  # middle of the gap
    marker: str  # line across the gap, from centre line to centre line


def near_branches(
    subject: Subject, found: Spacing, chosen: NDArray[np.bool_]
) -> tuple[list[Near], int]:
    """Return pairs of branches by their smallest gap, tightest first, and how many there are.

    Parameters
    ----------
    chosen
        Which of them count, shape (k,).
    """
    rows = _tightest_of_each(subject.shapes, found, np.flatnonzero(chosen))
    return [_near(subject, found, row) for row in rows[:MOST_FINDINGS].tolist()], len(rows)


def remaining_violations(pairs: int, words: str) -> tuple[Violation, ...]:
    """Return one more hit for the pairs beyond `MOST_FINDINGS`, if there are any."""
    if pairs <= MOST_FINDINGS:
        return ()
    rest = f"{pairs - MOST_FINDINGS} more pairs of branches {words}"
    return (Violation(message=rest, severity=Severity.INFO, aspect="rest"),)


def _tightest_of_each(shapes: Shapes, found: Spacing, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    rows = rows[np.argsort(found.gap_mm[rows] - found.crossing_mm[rows], kind="stable")]
    pair = np.sort(
        np.column_stack([shapes.branch[found.first[rows]], shapes.branch[found.second[rows]]])
    )
    _, first = np.unique(pair, axis=0, return_index=True)
    return np.asarray(rows[np.sort(first)])


def _near(subject: Subject, found: Spacing, row: int) -> Near:
    capsules = (int(found.first[row]), int(found.second[row]))
    branches = sorted(int(subject.shapes.branch[capsule]) for capsule in capsules)
    (x0, y0), (x1, y1) = found.first_mm[row].tolist(), found.second_mm[row].tolist()
    return Near(
        branches=subject.ids(*branches),
        gap_mm=float(found.gap_mm[row]),
        at_mm=((x0 + x1) / 2.0, (y0 + y1) / 2.0),
        marker=mark_line((x0, y0), (x1, y1)),
    )


def check_overlap(subject: Subject, _: Limits) -> RuleApplied:
    """VF-T03: branches that share no joint do not overlap."""
    found = spacing(subject.shapes, 0.0)
    nears, pairs = near_branches(subject, found, ~found.joined & (found.gap_mm < 0.0))
    hits = [
        Violation(
            message="the branches overlap when flat: widen the fan, or shorten one of them",
            measured=near.gap_mm,
            limit=0.0,
            branches=near.branches,
            at_mm=near.at_mm,
            marker=near.marker,
        )
        for near in nears
    ]
    return RuleApplied(
        checked=len(subject.layout.tree),
        hits=(*hits, *remaining_violations(pairs, "overlap when flat")),
    )


def check_clearance(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-C01: film is left between branches that share no joint.

    Branches that share one converge there by design. Their notch ends in a fillet (VF-C04) within
    half of the shorter one (VF-C03), and from there on two straight sides only part: at the end of
    the shorter one they are a branch's width apart. Pouches can close a notch again: VF-C07.
    """
    found = spacing(subject.shapes, max(limits["error"], limits["warning"]))
    apart = ~found.joined & (found.gap_mm >= 0.0)
    return RuleApplied(
        checked=len(subject.layout.tree), hits=gap_violations(subject, limits, found, apart)
    )


def gap_violations(
    subject: Subject, limits: Limits, found: Spacing, chosen: NDArray[np.bool_]
) -> tuple[Violation, ...]:
    """Return a hit for each pair of branches whose gap is below the limits.

    Parameters
    ----------
    chosen
        Which of them count, shape (k,).
    """
    low = chosen & (found.gap_mm < max(limits["error"], limits["warning"]))
    nears, pairs = near_branches(subject, found, low)
    hits = []
    for near in nears:
        breach = limits.least(near.gap_mm)
        if breach:
            hits.append(
                Violation(
                    message="too little film is left between the branches: move them apart",
                    severity=breach.severity,
                    measured=near.gap_mm,
                    limit=breach.limit,
                    branches=near.branches,
                    at_mm=near.at_mm,
                    marker=near.marker,
                )
            )
    return (*hits, *remaining_violations(pairs, "come too near each other"))


OVERLAP = Rule(
    id="VF-T03",
    title="branches that are not joined do not overlap when flat",
    unit="mm",
    reason="a flat sheet has no room for two branches at one place",
    look=check_overlap,
)
CLEARANCE = Rule(
    id="VF-C01",
    title="clearance between branches",
    unit="mm",
    limits={"error": 3.0, "warning": 5.0},
    reason="seam, kerf and heat of two outlines need room between them, or they melt into one",
    look=check_clearance,
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
    webs = list(_webs(subject))
    reach_mm = max(limits["error"], limits["warning"])
    shapes = subject.shapes
    hulls = _hulls(subject)
    tree = shapely.STRtree(hulls)
    nearest: dict[tuple[int, int], tuple[float, _Web, int]] = {}
    for web in webs:
        for row in tree.query(web.area, predicate="dwithin", distance=reach_mm).tolist():
            other = int(shapes.branch[row])
            if _related(subject, web.branch, other):
                continue
            gap_mm = _gap_mm(subject, web.area, hulls[row], row)
            pair = min(web.branch, other), max(web.branch, other)
            if pair not in nearest or gap_mm < nearest[pair][0]:
                nearest[pair] = gap_mm, web, row
    order = sorted(nearest.items(), key=lambda item: item[1][0])
    hits = []
    for (one, two), (gap_mm, web, row) in order[:MOST_FINDINGS]:
        breach = limits.least(gap_mm)
        if breach:
            hits.append(_hit(subject, (one, two), (web, hulls[row]), (gap_mm, breach)))
    rest = remaining_violations(len(order), "are reached by a fillet of another joint")
    return RuleApplied(checked=len(webs), hits=(*hits, *rest))


def _hit(
    subject: Subject,
    branches: tuple[int, int],
    shapes: tuple[_Web, shapely.Geometry],
    found: tuple[float, BrokenLimit],
) -> Violation:
    gap_mm, breach = found
    web, hull = shapes
    points = shapely.get_coordinates(shapely.shortest_line(web.area, hull)).tolist()
    start, end = (points[0][0], points[0][1]), (points[-1][0], points[-1][1])
    return Violation(
        message="a fillet reaches a branch of another joint: make it smaller, or part the branches",
        severity=breach.severity,
        measured=gap_mm,
        limit=breach.limit,
        branches=subject.ids(*branches),
        at_mm=start,
        marker=mark_line(start, end),
    )


def _webs(subject: Subject) -> Iterator[_Web]:
    rows = {name: row for row, name in enumerate(subject.names)}
    for segment in subject.outline.contour.segments:
        if segment.part is Part.FILLET and segment.bulge:
            yield _Web(area=_web(segment), branch=rows[segment.branch])


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


def _hulls(subject: Subject) -> np.ndarray:
    """Return the capsules as shapes."""
    shapes = subject.shapes
    ends = (shapes.start_mm, shapes.half_mm), (shapes.end_mm, shapes.end_half_mm)
    discs = [
        shapely.buffer(shapely.points(centre), np.maximum(half, 1e-6), quad_segs=64)
        for centre, half in ends
    ]
    return np.asarray(shapely.convex_hull(shapely.union_all(np.stack(discs, axis=1), axis=1)))


def _gap_mm(subject: Subject, area: shapely.Polygon, hull: shapely.Geometry, row: int) -> float:
    """Return the distance of a web from a capsule; below 0 how deep its corners lie inside."""
    gap_mm = float(shapely.distance(area, hull))
    if gap_mm > 0.0:
        return gap_mm
    points, shapes = shapely.get_coordinates(area), subject.shapes
    rows = np.full(len(points), row)
    capsules = Hulls(
        start_mm=shapes.start_mm[rows],
        run_mm=shapes.end_mm[rows] - shapes.start_mm[rows],
        half_mm=shapes.half_mm[rows],
        growth_mm=shapes.end_half_mm[rows] - shapes.half_mm[rows],
    )
    return min(-1e-6, float(point_gap_mm(points, capsules).min()))


def _related(subject: Subject, one: int, two: int) -> bool:
    """Whether two branches share a joint, or are the same."""
    parent = subject.layout.tree.parent
    return bool(
        one == two or parent[one] == parent[two] or parent[one] == two or parent[two] == one
    )


FOREIGN_FILLET = Rule(
    id="VF-C05",
    title="a fillet joins nothing but its own joint",
    unit="mm",
    limits={"error": 0.0, "warning": 3.0},
    reason="a fillet that swallows another branch's side changes the robot",
    look=check_foreign,
)


_ARC_STEPS = 32
_LEAST_MM2 = 0.05
_SLACK_MM = 0.02


def notches(body: shapely.Polygon, width_mm: float) -> list[shapely.Polygon]:
    """Return where a disc of a diameter does not fit into the film around a body.

    Returns
    -------
    list of Polygon
        What closing the body by the disc adds, slivers left out. A fillet of at least half the
        width adds nothing, nor does film between sides that part from such a fillet on.
    """
    closed = shapely.buffer(body, width_mm / 2.0, quad_segs=_ARC_STEPS)
    closed = shapely.buffer(closed, -width_mm / 2.0, quad_segs=_ARC_STEPS)
    # The chords of both buffers leave a film as thin as their sagitta all around.
    sagitta_mm = width_mm * (1.0 - math.cos(math.pi / (4 * _ARC_STEPS)))
    added = shapely.difference(closed, shapely.buffer(body, _SLACK_MM + sagitta_mm))
    return [part for part in shapely.get_parts(added).tolist() if part.area > _LEAST_MM2]


def between(
    subject: Subject, found: list[shapely.Polygon], branches: tuple[str, ...], within_mm: float
) -> bool:
    """Return whether one of some notches lies near every one of some branches.

    Parameters
    ----------
    subject
        Gives the branches' shapes.
    """
    shapes = subject.shapes
    near = []
    for name in branches:
        rows = shapes.branch == subject.names.index(name)
        lines = [
            shapely.LineString([a, b])
            for a, b in zip(shapes.start_mm[rows], shapes.end_mm[rows], strict=True)
        ]
        near.append(list(zip(lines, shapes.half_mm[rows].tolist(), strict=True)))
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
    reach_mm = max(limits["error"], limits["warning"])
    found = spacing(subject.shapes, reach_mm)
    hits = gap_violations(subject, limits, found, found.joined & found.pouch)
    hits = (*_drawn(subject, limits, hits),)
    width_mm = subject.design.build.end_widths_mm[-1]
    if pouch.length_mm is not None and pouch.length_mm < width_mm:
        words = "shorter than its branch is wide: lengthen it"
        hits = (_too_small(subject, pouch.length_mm, words, "length"), *hits)
    if pouch.flat_width_mm <= width_mm:
        words = "no wider than its branch: widen it"
        hits = (_too_small(subject, pouch.flat_width_mm, words, "width"), *hits)
    more = outline_violations(subject, frozenset({ProblemKind.POUCH_WIDTH}), hits)
    return RuleApplied(checked=len(_leaves(subject)), hits=(*hits, *more))


def _too_small(subject: Subject, measured_mm: float, words: str, aspect: str) -> Violation:
    """Return a hit about a size of the pouches, all alike, that is less than the leaf's width."""
    leaves = _leaves(subject)
    return Violation(
        message=f"the pouch is {words} or leave it out",
        measured=measured_mm,
        limit=subject.design.build.end_widths_mm[-1],
        branches=subject.ids(leaves[0]),
        at_mm=place_mm(subject.layout, leaves[0], at_tip=True),
        marker=mark_branches(subject.layout, leaves),
        aspect=aspect,
    )


def _leaves(subject: Subject) -> list[int]:
    return [row for row, leaf in enumerate(subject.layout.is_leaf.tolist()) if leaf]


def _drawn(subject: Subject, limits: Limits, hits: tuple[Violation, ...]) -> Iterator[Violation]:
    """Yield hits, those about a pouch and its own parent only where the outline has a notch."""
    body = subject.body
    parents = {name: name.rpartition(".")[0] for name in subject.names}
    seen: dict[float, list[shapely.Polygon]] = {}
    for hit in hits:
        own = len(hit.branches) == 2 and hit.branches[0] == parents[hit.branches[1]]
        if not own or not body.is_valid:
            yield hit
            continue
        for severity in (Severity.ERROR, Severity.WARNING):
            width_mm = limits[severity]
            if hit.measured is None or hit.measured > width_mm:
                continue
            if width_mm not in seen:
                seen[width_mm] = notches(body, width_mm)
            if between(subject, seen[width_mm], hit.branches, width_mm):
                yield replace(hit, severity=severity, limit=width_mm)
                break


POUCH = Rule(
    id="VF-C07",
    title="pouch wider and longer than its branch is wide, clear of its neighbours at the joint",
    unit="mm",
    limits={"error": 3.0, "warning": 5.0},
    reason="a pouch holds by being wider than its branch; two pouches that touch melt into one",
    look=check_pouch,
)
