"""The rule about tip pouches."""

import math
from collections.abc import Iterator
from dataclasses import replace

import shapely

from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.rules.clearance import gap_violations
from vinefab.fabrication.rules.rule import (
    Limits,
    Rule,
    RuleApplied,
    Violation,
    mark_branches,
    outline_violations,
    place_mm,
)
from vinefab.fabrication.rules.spacing import spacing
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.finding import Severity

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
