"""The rule about what the paths leave of seam and overcut, measured in the paths themselves."""

import math
from collections.abc import Iterator

import numpy as np

from vinefab.checks.marks import mark_branches, middle_mm
from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.sides import excesses_mm
from vinefab.checks.subject import Subject
from vinefab.checks.webs import overlaps_mm, webs_mm, whose
from vinefab.model.checked import Floats
from vinefab.model.finding import Severity
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Part, Segment

_ON_LINE_MM = 0.05
"""An end of the outline that is so near to the mouth's cut lies on it."""


def look_seams(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-P05: the paths leave the recipe's seam, and cuts cross or overlap by its overcut."""
    if subject.job is None or subject.profile is None:
        return NotLooked(reason="needs a recipe, for seam and overcut")
    profile, slack_mm = subject.profile, limits["slack"]
    seams_mm, webs = _seams_mm(subject, profile), list(webs_mm(subject, profile))
    overcuts_mm, laps_mm = list(_overcuts_mm(subject)), list(overlaps_mm(subject))
    hits = [*_seam_hits(subject, profile, seams_mm, slack_mm)]
    hits += _web_hits(profile, webs, slack_mm)
    least_mm = profile.settings(Operation.CUT).overcut_mm.value
    ways = (
        (
            overcuts_mm,
            "at the mouth",
            "cross the outline",
            "the part stays attached at its corners",
        ),
        (laps_mm, "around the robot", "pass its start", "a bridge may be left there"),
    )
    for found, where, fails, so in ways:
        overcut_mm, of = min(found, default=(math.inf, ""))
        if overcut_mm < least_mm - slack_mm:
            hits.append(
                Hit(
                    message=f"the cut {where}{of} does not {fails} by the recipe's overcut: {so}",
                    severity=Severity.WARNING,
                    measured=overcut_mm,
                    limit=least_mm,
                    branches=subject.ids(0),
                    at_mm=(-subject.design.build.tail_mm, 0.0),
                    aspect="overcut",
                )
            )
    checked = len(seams_mm) + len(webs) + len(overcuts_mm) + len(laps_mm)
    return Looked(checked=checked, hits=tuple(hits))


def _web_hits(
    profile: LaserProfile, webs: list[tuple[float, str]], slack_mm: float
) -> Iterator[Hit]:
    """Yield a hit about the seam that a cut of its own takes most of."""
    web_mm, of = min(webs, default=(math.inf, ""))
    if web_mm < -slack_mm:
        seam_mm = profile.settings(Operation.WELD).seam_width_mm.value
        yield Hit(
            message=f"the cut takes off the seam{of}: no burst test covers what is left",
            severity=Severity.WARNING,
            measured=max(0.0, seam_mm + web_mm),
            limit=seam_mm,
            aspect="web",
        )


def _seam_hits(
    subject: Subject,
    profile: LaserProfile,
    seams_mm: dict[str, tuple[float, str]],
    slack_mm: float,
) -> Iterator[Hit]:
    """Yield one hit about the branches whose seam is too narrow, at the narrowest."""
    if not seams_mm:
        return
    least_mm = profile.settings(Operation.WELDCUT).seam_width_mm.value
    low = {name: seam for name, seam in seams_mm.items() if seam[0] < least_mm - slack_mm}
    if low:
        worst = min(low, key=lambda name: round(low[name][0], 6))  # the first of those alike
        row = subject.names.index(worst)
        yield Hit(
            message=f"the paths of {len(low)} branches leave less seam than the recipe makes"
            f"{_worst_of(low[worst][1])}: no burst test covers that seam",
            severity=Severity.WARNING,
            measured=low[worst][0],
            limit=least_mm,
            branches=(worst,),
            at_mm=middle_mm(subject.layout, row),
            marker=mark_branches(subject.layout, [subject.names.index(name) for name in low]),
            aspect="seam",
        )


def _worst_of(of: str) -> str:
    return f", least on the sides{of}" if of else ""


def _seams_mm(subject: Subject, profile: LaserProfile) -> dict[str, tuple[float, str]]:
    """Return the seam between lumen and kerf on the sides of each branch that has two, and whose.

    Of several robots alike, the narrowest counts.
    """
    found: dict[str, tuple[float, str]] = {}
    paths = subject.own(Operation.WELDCUT)
    for path in paths:
        half_kerf_mm = profile.settings(Operation.WELDCUT).kerf_mm.value / 2.0
        for row, wider_mm in excesses_mm(subject, path.contour, 0.0).items():
            seam_mm = wider_mm / 2.0 - half_kerf_mm
            name = subject.names[row]
            if seam_mm < found.get(name, (math.inf, ""))[0]:
                found[name] = seam_mm, whose(path, paths)
    return found


def _overcuts_mm(subject: Subject) -> Iterator[tuple[float, str]]:
    """Yield by how much a cut at a mouth runs past each end of an outline on it, and whose."""
    ends = [
        path.contour.points_mm[row]
        for path in subject.own(Operation.WELDCUT)
        if not path.contour.closed
        for row in (0, -1)
    ]
    cuts = subject.own(Operation.CUT)
    for path in cuts:
        for segment in path.contour.segments:
            if segment.part is Part.MOUTH and not segment.bulge:
                for past_mm in _past_mm(segment, ends):
                    yield past_mm, whose(path, cuts)


def _past_mm(cut: Segment, ends: list[Floats]) -> Iterator[float]:
    start = np.array(cut.start_mm)
    along = (np.array(cut.end_mm) - start) / cut.length_mm
    for end in ends:
        x, y = end - start
        across_mm = abs(along[0] * y - along[1] * x)
        at_mm = float(along[0] * x + along[1] * y)
        near_mm = min(at_mm, cut.length_mm - at_mm)
        if across_mm < _ON_LINE_MM and near_mm > -_ON_LINE_MM:
            yield near_mm


SEAM_WIDTH = Rule(
    id="VF-P05",
    title="seam width and overcut at least the recipe's",
    unit="mm",
    limits={"slack": 0.005},
    reason="a narrower seam was never tested, and a mouth that is not cut through tears it open; "
    "the slack is what a laser's steps round away (assumed)",
    look=look_seams,
)
