"""The rule about tip pouches."""

from vinefab.checks.clearance import gap_hits
from vinefab.checks.marks import mark_branches, place_mm
from vinefab.checks.problems import problem_hits
from vinefab.checks.rule import Hit, Limits, Looked, Rule
from vinefab.checks.spacing import spacing
from vinefab.checks.subject import Subject
from vinefab.geometry.problem import ProblemKind


def look_pouch(subject: Subject, limits: Limits) -> Looked:
    """VF-C07: pouches are wider than their branch, as long, and clear of branches at its joint.

    Their clearance to all other branches is VF-C01's and VF-T03's business, as for any branch.
    """
    pouch = subject.design.build.pouch
    leaves = [row for row, leaf in enumerate(subject.layout.is_leaf.tolist()) if leaf]
    if pouch is None:
        return Looked(checked=0)
    reach_mm = max(limits["error"], limits["warning"])
    found = spacing(subject.shapes, reach_mm)
    hits = gap_hits(subject, limits, found, found.joined & found.pouch)
    width_mm = subject.design.build.end_widths_mm[-1]
    if pouch.flat_width_mm <= width_mm:
        wider = Hit(
            message="the pouch is no wider than its branch: widen it or leave it out",
            measured=pouch.flat_width_mm,
            limit=width_mm,
            branches=subject.ids(leaves[0]),
            at_mm=place_mm(subject.layout, leaves[0], at_tip=True),
            marker=mark_branches(subject.layout, leaves),
            aspect="width",
        )
        hits = (wider, *hits)
    if pouch.length_mm is not None and pouch.length_mm < width_mm:
        longer = Hit(
            message="the pouch is shorter than its branch is wide: lengthen it or leave it out",
            measured=pouch.length_mm,
            limit=width_mm,
            branches=subject.ids(leaves[0]),
            at_mm=place_mm(subject.layout, leaves[0], at_tip=True),
            marker=mark_branches(subject.layout, leaves),
            aspect="length",
        )
        hits = (longer, *hits)
    more = problem_hits(subject, frozenset({ProblemKind.POUCH_WIDTH}), hits)
    return Looked(checked=len(leaves), hits=(*hits, *more))


POUCH = Rule(
    id="VF-C07",
    title="pouch wider and longer than its branch is wide, clear of its neighbours at the joint",
    unit="mm",
    limits={"error": 3.0, "warning": 5.0},
    reason="a pouch holds by being wider than its branch; two pouches that touch melt into one",
    look=look_pouch,
)
