"""Rules about the whole: one tree, one valid sheet, one mouth."""

import re

import numpy as np
import shapely

from vinefab.checks.marks import mark_branches, mark_line, mark_point, middle_mm
from vinefab.checks.rule import Hit, Limits, Looked, Rule
from vinefab.checks.subject import Subject

_AT = re.compile(r"\[(\S+) (\S+)\]")
"""Where Shapely says that a polygon is not valid."""


def look_tree(subject: Subject, limits: Limits) -> Looked:
    """VF-T01: every branch hangs on the tip of its parent and has a length."""
    layout, tree = subject.layout, subject.layout.tree
    hits = []
    for row, length_mm in enumerate(tree.length_mm.tolist()):
        breach = limits.least(length_mm)
        if breach:
            hits.append(
                Hit(
                    message="the branch has next to no length: lengthen it or leave it out",
                    measured=length_mm,
                    limit=breach.limit,
                    branches=subject.ids(row),
                    at_mm=middle_mm(layout, row),
                    marker=mark_branches(layout, [row]),
                )
            )
    away = np.abs(layout.start_mm[1:] - layout.end_mm[tree.parent[1:]]).max(axis=1, initial=0.0)
    for row in (1 + np.flatnonzero(~(away < 1e-6))).tolist():
        hits.append(  # noqa: PERF401  one shape of loop for both halves of the rule
            Hit(
                message="the branch does not begin at the tip of its parent",
                measured=float(away[row - 1]),
                branches=subject.ids(row),
                aspect="joined",
            )
        )
    return Looked(checked=len(tree), hits=tuple(hits))


def look_polygon(subject: Subject, _: Limits) -> Looked:
    """VF-T02: the outline encloses one valid polygon without holes."""
    body = subject.body
    if body.is_valid:
        return Looked(checked=1)
    why = shapely.is_valid_reason(body)
    found = _AT.search(why)
    if not found:
        return Looked(checked=1, hits=(Hit(message=f"the outline is no polygon: {why}"),))
    at = float(found[1]), float(found[2])
    hit = Hit(
        message="the outline crosses itself here: a flat sheet cannot lie on itself",
        branches=_nearest(subject, at),
        at_mm=at,
        marker=mark_point(at),
    )
    return Looked(checked=1, hits=(hit,))


def look_mouth(subject: Subject, limits: Limits) -> Looked:
    """VF-T04: the outline is open at one place, the mouth, and wide enough there."""
    contour = subject.outline.contour
    if contour.closed:
        return Looked(checked=1, hits=(Hit(message="the outline has no mouth to inflate it by"),))
    first, last = contour.points_mm[0].tolist(), contour.points_mm[-1].tolist()
    gap_mm = float(np.hypot(last[0] - first[0], last[1] - first[1]))
    breach = limits.least(gap_mm)
    if not breach:
        return Looked(checked=1)
    hit = Hit(
        message="the mouth is too narrow to be opened over the base: widen the trunk",
        measured=gap_mm,
        limit=breach.limit,
        branches=subject.ids(0),
        at_mm=((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0),
        marker=mark_line(tuple(first), tuple(last)),
    )
    return Looked(checked=1, hits=(hit,))


def _nearest(subject: Subject, at_mm: tuple[float, float]) -> tuple[str, ...]:
    """Return the ids of the two branches nearest to a place, as far as there are two."""
    shapes = subject.shapes
    lines = shapely.linestrings(np.stack([shapes.start_mm, shapes.end_mm], axis=1))
    far = shapely.distance(lines, shapely.Point(at_mm)) - shapes.most_half_mm
    _, first = np.unique(shapes.branch[np.argsort(far, kind="stable")], return_index=True)
    order = shapes.branch[np.argsort(far, kind="stable")][np.sort(first)]
    return subject.ids(*sorted(order[:2].tolist()))


TREE = Rule(
    id="VF-T01",
    title="one connected tree, finite coordinates, no branch without length",
    unit="mm",
    limits={"error": 0.1},
    reason="a branch shorter than a laser spot cannot be drawn",
    look=look_tree,
)
POLYGON = Rule(
    id="VF-T02",
    title="the body is one valid polygon without holes",
    reason="two flat plies cannot lie on themselves; a crossing outline cuts the body open",
    look=look_polygon,
)
MOUTH = Rule(
    id="VF-T04",
    title="exactly one open mouth, wide enough",
    unit="mm",
    limits={"error": 5.0},
    reason="the robot is inflated and clamped through its mouth; everything else is sealed",
    look=look_mouth,
)
