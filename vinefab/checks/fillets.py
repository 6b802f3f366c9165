"""The rule about fillets that reach other branches than those of their own joint."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from vinefab.checks.hulls import Hulls, point_gap_mm
from vinefab.checks.marks import mark_line
from vinefab.checks.pairs import MOST_FINDINGS, rest_hits
from vinefab.checks.rule import Breach, Hit, Limits, Looked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.outline import Part, Segment


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Web:
    """The film that a fillet adds, between its arc and the sides that it joins.

    Parameters
    ----------
    area
        That film.
    branch
        Index of a branch that the fillet belongs to.
    """

    area: shapely.Polygon
    branch: int


def look_foreign(subject: Subject, limits: Limits) -> Looked:
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
    rest = rest_hits(len(order), "are reached by a fillet of another joint")
    return Looked(checked=len(webs), hits=(*hits, *rest))


def _hit(
    subject: Subject,
    branches: tuple[int, int],
    shapes: tuple[_Web, shapely.Geometry],
    found: tuple[float, Breach],
) -> Hit:
    gap_mm, breach = found
    web, hull = shapes
    points = shapely.get_coordinates(shapely.shortest_line(web.area, hull)).tolist()
    start, end = (points[0][0], points[0][1]), (points[-1][0], points[-1][1])
    return Hit(
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
    look=look_foreign,
)
