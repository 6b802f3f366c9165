"""Rules about seams as tools make them: bends that a wide tip can follow, mouths that stay open."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely

from vinefab.fabrication.job.passes import bodies_of_paths
from vinefab.fabrication.rules.as_built import flat_place_mm
from vinefab.fabrication.rules.rule import (
    Limits,
    MissingInputError,
    RuleApplied,
    Scope,
    Subject,
    Violation,
    design_rule,
    made,
    mark_point,
)
from vinefab.model.job import LaserPath, Operation
from vinefab.model.machine import Tool
from vinefab.model.outline import Segment
from vinefab.outline.joint import Point


@design_rule(
    "VF-L07",
    broken="a seam bends too tightly for the tip",
    limits_in="times the seam's width",
    error=0.5,
    turn_error=5.0,
    on={Scope.SHEET, Scope.PATHS},
    reason="in a tighter bend, or a corner (degrees), the tip goes twice over one place and melts "
    "it through (geometry; half the width is where the band's edge has no radius left)",
    remedy="larger fillets, or a narrower tip",
)
def check_bends(subject: Subject, limits: Limits) -> RuleApplied:
    """Seams bend gently enough for a tip that touches the film."""
    job, profile = made(subject)
    seams = [path for path in job.along(Operation.WELD) if path.settings is None]
    if not seams or profile.settings(Operation.WELD).tool is not Tool.HOT_TIP:
        raise MissingInputError("no tool that touches the film runs along the seams")
    width_mm = profile.settings(Operation.WELD).seam_width_mm.value
    violations = []
    for path in seams:
        segments = list(path.contour.segments)
        tight = min(segments, key=lambda segment: segment.radius_mm)
        if broken := limits.least(tight.radius_mm / width_mm):
            message = (
                f"{path.label!r} has a bend of {tight.radius_mm:.2f} mm, and the seam is "
                f"{width_mm:g} mm wide: enlarge the fillet"
            )
            violations.append(_at(broken, subject, path, tight, message, "bend"))
        for before, after in pairwise(segments):
            turn_deg = math.degrees(abs(before.corner_rad(after)))
            if broken := limits.most(turn_deg, "turn"):
                message = f"{path.label!r} has a corner of {turn_deg:.0f} degrees: give it a fillet"
                violations.append(_at(broken, subject, path, after, message, "corner"))
                break
    return RuleApplied(checked=len(seams), violations=tuple(violations))


def _at(
    broken: Violation,
    subject: Subject,
    path: LaserPath,
    segment: Segment,
    message: str,
    aspect: str,
) -> Violation:
    at_mm = flat_place_mm(subject, path, segment.start_mm)
    return replace(
        broken,
        message=message,
        branches=(segment.branch,) if segment.branch else (),
        at_mm=at_mm,
        marker=mark_point(at_mm) if at_mm else "",
        aspect=f"{aspect} {path.label}",
    )


@design_rule(
    "VF-L08",
    broken="a mouth is not left open",
    on={Scope.SHEET, Scope.PATHS},
    reason="a robot is inflated and clamped through its mouth, and its pieces are joined by their "
    "open ends: what is sealed across them is lost",
    remedy="let vinefab draw the seams; do not close paths",
)
def check_open_mouths(subject: Subject, _: Limits) -> RuleApplied:
    """Every mouth stays open."""
    job, profile = made(subject)
    violations, checked = [], 0
    for operation in (Operation.WELD, Operation.WELDCUT):
        seams = [path for path in job.along(operation) if path.of]
        if not seams:
            continue
        settings = profile.settings(operation)
        half_mm = settings.seam_width_mm.value / 2.0 + settings.kerf_mm.value / 2.0
        lines = shapely.MultiLineString([path.contour.flattened_mm() for path in seams])
        for runs in bodies_of_paths(seams):
            checked += 1
            openings = list(_openings(runs, 2.0 * half_mm))
            if (
                runs[0].contour.closed
                or not openings
                or any(lines.dwithin(opening, half_mm) for opening in openings)
            ):
                message = f"{runs[0].label!r} is sealed across its mouth: leave it open"
                violations.append(Violation(message=message, aspect=f"mouth {runs[0].label}"))
    return RuleApplied(checked=checked, violations=tuple(violations))


def _openings(runs: Sequence[LaserPath], short_mm: float) -> Iterator[shapely.LineString]:
    """Yield the gaps between the runs that seal one body, without what lies next to their ends."""
    ends = [path.contour.points_mm[[0, -1]] for path in runs]
    for (_, last), (first, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        gap_mm = math.dist(first, last)
        if gap_mm > 2.0 * short_mm:
            along: Point = tuple((first - last) / gap_mm)
            step = short_mm * np.array(along)
            yield shapely.LineString([last + step, first - step])
