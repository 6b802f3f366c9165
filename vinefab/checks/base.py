"""Rules about the base: the tail that is inverted and clamped, and the reach of the robot."""

import math

import numpy as np

from vinefab.checks.marks import mark_branches, mark_line, place_mm
from vinefab.checks.problems import problem_hits
from vinefab.checks.rule import Hit, Limits, Looked, Rule
from vinefab.checks.subject import Subject
from vinefab.geometry.problem import ProblemKind
from vinefab.model.outline import Part

_STRAIGHT_MM = 1e-6


def look_tail(subject: Subject, limits: Limits) -> Looked:
    """VF-B01: the tail is long enough to be inverted over the base and clamped."""
    tail_mm = subject.design.build.tail_mm
    breach = limits.least(tail_mm)
    if not breach:
        return Looked(checked=1)
    hit = Hit(
        message="the tail is too short to be inverted over the base: set build.tail_mm",
        severity=breach.severity,
        measured=tail_mm,
        limit=breach.limit,
        branches=subject.ids(0),
        at_mm=(-tail_mm, 0.0),
        marker=mark_line((-tail_mm, 0.0), (0.0, 0.0)),
    )
    return Looked(checked=1, hits=(hit,))


def look_clamp(subject: Subject, limits: Limits) -> Looked:
    """VF-B02: the tail is straight all along and its mouth fits the clamp of the base.

    With a collar the outline's mouth must be as wide as a tube that fits the clamp; without one it
    must be no wider than a common clamp. The collar's transition is the only bend allowed.
    """
    contour = subject.outline.contour
    mouth_mm = math.dist(contour.points_mm[0], contour.points_mm[-1])
    hits = list(problem_hits(subject, frozenset({ProblemKind.COLLAR, ProblemKind.COLLAR_FLARE})))
    collar = subject.design.build.collar
    breach = limits.most(mouth_mm)
    off_mm = 0.0 if collar is None else abs(mouth_mm - collar.flat_width_mm)
    if collar is not None:
        breach = limits.most(off_mm, "fit")
    if breach:
        words = "wider than the clamp of the base: narrow the trunk or give it a collar"
        hits.append(
            Hit(
                message=f"the tail is {words}" if collar is None else "the collar misses the clamp",
                severity=breach.severity,
                measured=mouth_mm if collar is None else off_mm,
                limit=breach.limit,
                branches=subject.ids(0),
                at_mm=place_mm(subject.layout, 0),
                aspect="clamp",
            )
        )
    tail = [s for s in contour.segments if s.part is Part.TAIL]
    bent = [s for s in tail if s.bulge or abs(s.start_mm[1] - s.end_mm[1]) > _STRAIGHT_MM]
    if bent:
        hits.append(
            Hit(
                message="the tail's side is not straight",
                branches=subject.ids(0),
                at_mm=bent[0].start_mm,
                marker=mark_line(bent[0].start_mm, bent[0].end_mm),
                aspect="straight",
            )
        )
    return Looked(checked=1, hits=tuple(hits))


def look_reach(subject: Subject, limits: Limits) -> Looked:
    """VF-B03: the longest path from base to tip is of a length that was tried."""
    tree = subject.layout.tree
    path_mm = np.array(tree.length_mm)
    for row in range(1, len(tree)):
        path_mm[row] += path_mm[tree.parent[row]]
    far = int(path_mm.argmax())
    longest_mm = float(path_mm[far])
    breach = limits.least(longest_mm, "short") or limits.most(longest_mm, "long")
    if not breach:
        return Looked(checked=1)
    hit = Hit(
        message="robots of this deployed length are untested: change the lengths or the scale",
        severity=breach.severity,
        measured=longest_mm,
        limit=breach.limit,
        branches=subject.ids(far),
        at_mm=place_mm(subject.layout, far, at_tip=True),
        marker=mark_branches(subject.layout, [far]),
    )
    return Looked(checked=1, hits=(hit,))


TAIL = Rule(
    id="VF-B01",
    title="tail length",
    unit="mm",
    limits={"error": 150.0, "warning": 200.0},
    reason="the last 200 mm are inverted over the base and clamped (paper)",
    look=look_tail,
)
CLAMP = Rule(
    id="VF-B02",
    title="tail straight, its mouth fits the clamp",
    unit="mm",
    limits={"error": 100.0, "fit_error": 0.1},
    reason="a clamp seals a straight tube only; without a collar 100 mm is assumed",
    look=look_clamp,
)
REACH = Rule(
    id="VF-B03",
    title="deployed length of the longest path",
    unit="mm",
    limits={"short_warning": 250.0, "long_warning": 2000.0},
    reason="untested above 2 m and below 0.25 m (paper)",
    look=look_reach,
)
