"""The rule about what the paths leave of seam and overcut, measured in the paths themselves."""

from collections.abc import Iterator

import numpy as np

from vinefab.checks.marks import mark_branches, middle_mm
from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.sides import excesses_mm
from vinefab.checks.subject import Subject
from vinefab.model.checked import Floats
from vinefab.model.finding import Severity
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Part, Segment

_ON_LINE_MM = 0.05
"""An end of the outline that is so near to the mouth's cut lies on it."""


def look_seams(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-P05: the paths leave the recipe's seam inside, and cross at the mouth by its overcut."""
    if subject.job is None or subject.profile is None:
        return NotLooked(reason="needs a recipe, for seam and overcut")
    slack_mm = limits["slack"]
    seams_mm = _seams_mm(subject, subject.profile)
    overcuts_mm = list(_overcuts_mm(subject.job))
    hits = [*_seam_hits(subject, subject.profile, seams_mm, slack_mm)]
    least_mm = subject.profile.settings(Operation.CUT).overcut_mm.value
    if overcuts_mm and min(overcuts_mm) < least_mm - slack_mm:
        hits.append(
            Hit(
                message="the cut at the mouth does not cross the outline by the recipe's overcut: "
                "the part stays attached at its corners",
                severity=Severity.WARNING,
                measured=min(overcuts_mm),
                limit=least_mm,
                branches=subject.ids(0),
                at_mm=(-subject.design.build.tail_mm, 0.0),
                aspect="overcut",
            )
        )
    return Looked(checked=len(seams_mm) + len(overcuts_mm), hits=tuple(hits))


def _seam_hits(
    subject: Subject, profile: LaserProfile, seams_mm: dict[str, float], slack_mm: float
) -> Iterator[Hit]:
    """Yield one hit about the branches whose seam is too narrow, at the narrowest."""
    least_mm = profile.settings(Operation.WELDCUT).seam_width_mm.value
    low = {name: seam for name, seam in seams_mm.items() if seam < least_mm - slack_mm}
    if low:
        worst = min(low, key=lambda name: round(low[name], 6))  # the first of those alike
        row = subject.names.index(worst)
        yield Hit(
            message=f"the paths of {len(low)} branches leave less seam than the recipe makes: "
            "no burst test covers that seam",
            severity=Severity.WARNING,
            measured=low[worst],
            limit=least_mm,
            branches=(worst,),
            at_mm=middle_mm(subject.layout, row),
            marker=mark_branches(subject.layout, [subject.names.index(name) for name in low]),
            aspect="seam",
        )


def _seams_mm(subject: Subject, profile: LaserProfile) -> dict[str, float]:
    """Return the seam between lumen and kerf on the sides of each branch that has two."""
    half_kerf_mm = profile.settings(Operation.WELDCUT).kerf_mm.value / 2.0
    found: dict[str, float] = {}
    for path in subject.own(Operation.WELDCUT):
        for row, wider_mm in excesses_mm(subject, path.contour, 0.0).items():
            seam_mm = wider_mm / 2.0 - half_kerf_mm
            name = subject.names[row]
            found[name] = min(seam_mm, found.get(name, seam_mm))
    return found


def _overcuts_mm(job: Job) -> Iterator[float]:
    """Yield by how much a cut at a mouth runs past each end of an outline that lies on it."""
    ends = [
        path.contour.points_mm[row]
        for path in job.along(Operation.WELDCUT)
        if not path.contour.closed
        for row in (0, -1)
    ]
    for path in job.along(Operation.CUT):
        for segment in path.contour.segments:
            if segment.part is Part.MOUTH and not segment.bulge:
                yield from _past_mm(segment, ends)


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
