"""Rules about what came out: widths in the laser's paths, and the files read again."""

import numpy as np

from vinefab.checks.marks import mark_branches, middle_mm
from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.job import Job, Operation
from vinefab.model.laser import OperationSettings
from vinefab.model.outline import Part, Segment


def look_built_width(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-W04: both sides of a branch, less seam and kerf, leave the designed lumen between them."""
    if subject.job is None or subject.profile is None:
        return NotLooked(reason="needs a recipe, for seam and kerf")
    offset_mm = beam_offset_mm(subject.profile.settings(Operation.WELDCUT))
    hits, checked = [], 0
    for name, sides in _sides(subject.job).items():
        row = subject.names.index(name)
        between_mm = _between_mm(sides)
        if between_mm == 0.0:
            continue  # one side only: its neighbour's crotch took the other (VF-C03 says so)
        checked += 1
        built_mm = between_mm - 2.0 * offset_mm
        off_mm = abs(built_mm - float(subject.layout.width_mm[row]))
        breach = limits.most(off_mm)
        if breach:
            hits.append(
                Hit(
                    message=f"the branch comes out {built_mm:.2f} mm wide in the paths: its "
                    "joint took its sides, or their seam and kerf are not the recipe's",
                    measured=off_mm,
                    limit=breach.limit,
                    branches=(name,),
                    at_mm=middle_mm(subject.layout, row),
                    marker=mark_branches(subject.layout, [row]),
                )
            )
    return Looked(checked=checked, hits=tuple(hits))


def beam_offset_mm(settings: OperationSettings) -> float:
    """Return how far outside the lumen the beam runs to cut and seal in one pass: s + k/2."""
    return settings.seam_width_mm.value + settings.kerf_mm.value / 2.0


def look_readback(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-X01: every file that was written says, read again, what it was meant to say."""
    if subject.readback is None:
        return NotLooked(reason="no file was written and read back")
    hits = [
        Hit(message=f"{name}: {problem}", aspect=name)
        for name, problems in subject.readback.items()
        for problem in problems
    ]
    return Looked(checked=len(subject.readback), hits=tuple(hits))


def _sides(job: Job) -> dict[str, list[Segment]]:
    """Return the straight side segments of each branch in the weld-cut paths."""
    found: dict[str, list[Segment]] = {}
    for path in job.along(Operation.WELDCUT):
        for segment in path.contour.segments:
            if segment.part in (Part.SIDE, Part.TAIL) and segment.branch and not segment.bulge:
                found.setdefault(segment.branch, []).append(segment)
    return found


def _between_mm(sides: list[Segment]) -> float:
    """Return the distance between the two sides, across the longest of the segments."""
    longest = max(sides, key=lambda side: side.length_mm)
    heading = longest.direction_rad()
    middles = np.array([np.add(side.start_mm, side.end_mm) / 2.0 for side in sides])
    across = middles @ np.array([-np.sin(heading), np.cos(heading)])
    return float(np.ptp(across)) if np.ptp(across) > 1e-6 else 0.0


BUILT_WIDTH = Rule(
    id="VF-W04",
    title="width as built, against the design",
    unit="mm",
    limits={"error": 0.1},
    reason="a forgotten seam and kerf offset narrows an 8 mm branch by 6 to 12 % (computed)",
    look=look_built_width,
)
READBACK = Rule(
    id="VF-X01",
    title="exported files, read again, equal the model",
    reason="programs read files, not intentions",
    look=look_readback,
)
