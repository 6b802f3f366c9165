"""The rule about tip pouches."""

from collections.abc import Iterator
from dataclasses import replace

import shapely

from vinefab.checks.clearance import gap_hits
from vinefab.checks.marks import mark_branches, place_mm
from vinefab.checks.notches import between, notches
from vinefab.checks.problems import problem_hits
from vinefab.checks.rule import Hit, Limits, Looked, Rule
from vinefab.checks.spacing import spacing
from vinefab.checks.subject import Subject
from vinefab.geometry.problem import ProblemKind
from vinefab.model.finding import Severity


def look_pouch(subject: Subject, limits: Limits) -> Looked:
    """VF-C07: pouches are wider than their branch, as long, and clear of branches at its joint.

    Near its own parent a pouch ends in the fillets of joint and neck; where these fill the room
    between, no film is left that could be too narrow. So the drawn outline decides there.

    Their clearance to all other branches is VF-C01's and VF-T03's business, as for any branch.
    """
    pouch = subject.design.build.pouch
    if pouch is None:
        return Looked(checked=0)
    reach_mm = max(limits["error"], limits["warning"])
    found = spacing(subject.shapes, reach_mm)
    hits = gap_hits(subject, limits, found, found.joined & found.pouch)
    hits = (*_drawn(subject, limits, hits),)
    width_mm = subject.design.build.end_widths_mm[-1]
    if pouch.length_mm is not None and pouch.length_mm < width_mm:
        words = "shorter than its branch is wide: lengthen it"
        hits = (_too_small(subject, pouch.length_mm, words, "length"), *hits)
    if pouch.flat_width_mm <= width_mm:
        words = "no wider than its branch: widen it"
        hits = (_too_small(subject, pouch.flat_width_mm, words, "width"), *hits)
    more = problem_hits(subject, frozenset({ProblemKind.POUCH_WIDTH}), hits)
    return Looked(checked=len(_leaves(subject)), hits=(*hits, *more))


def _too_small(subject: Subject, measured_mm: float, words: str, aspect: str) -> Hit:
    """Return a hit about a size of the pouches, all alike, that is less than the leaf's width."""
    leaves = _leaves(subject)
    return Hit(
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


def _drawn(subject: Subject, limits: Limits, hits: tuple[Hit, ...]) -> Iterator[Hit]:
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
    look=look_pouch,
)
