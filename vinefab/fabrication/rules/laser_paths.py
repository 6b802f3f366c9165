"""Rules about the laser's paths: marks, overlaps, sizes, order."""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.fabrication.job.passes import frees
from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.rules.rule import (
    Limits,
    Rule,
    RuleApplied,
    RuleNotApplicable,
    Violation,
    outline_violations,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.finding import Severity
from vinefab.model.job import Job, LaserPath, Operation

_NO_RECIPE = RuleNotApplicable(reason="needs a recipe, which the paths follow from")
_ORDER = tuple(Operation)


def check_marks(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-L01: marks stay off the pressurised body; those left out are reported."""
    if subject.job is None or subject.profile is None:
        return _NO_RECIPE
    marks = subject.job.along(Operation.MARK)
    sealed = (*subject.job.along(Operation.WELD), *subject.job.along(Operation.WELDCUT))
    bodies = [_Body(path) for path in sealed] if marks else []
    violations: dict[str, Violation] = {}
    for mark in marks:
        away_mm = min((body.apart_mm(mark) for body in bodies), default=math.inf)
        broken = limits.least(away_mm)
        # The strokes of one label share its name: the nearest of them stands for all.
        if broken and (
            mark.label not in violations or away_mm < (violations[mark.label].measured or 0.0)
        ):
            violations[mark.label] = Violation(
                message=f"mark {mark.label!r} touches the body or its rim: move it away",
                measured=away_mm,
                limit=broken.limit,
                aspect=mark.label,
            )
    can_mark = Operation.MARK in subject.profile.recipe.operations
    note = "" if can_mark else "the recipe has no mark: no fold line, no label"
    return RuleApplied(
        checked=len(marks), violations=(*violations.values(), *_left_out(subject.job)), note=note
    )


def _left_out(job: Job) -> Iterator[Violation]:
    """Yield a violation for each mark that was left out."""
    reasons = job.facts.get("marks_left_out", ())
    for reason in reasons if isinstance(reasons, list) else ():
        yield Violation(
            message=f"{reason}: mark the film by hand", severity=Severity.INFO, aspect=reason
        )


def check_paths(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-L02: no path runs over another, no segment is too small for the machine."""
    if subject.job is None:
        return _NO_RECIPE
    paths = [path for path in subject.job.paths if path.operation.is_machined]
    violations = [violation for path in paths for violation in _small_segments(path, limits)]
    lines = np.array([_line(path) for path in paths], dtype=object)
    first, second = shapely.STRtree(lines).query(lines, predicate="intersects")
    for one, two in zip(*(rows[first < second].tolist() for rows in (first, second)), strict=True):
        shared_mm = float(shapely.length(shapely.intersection(lines[one], lines[two])))
        broken = limits.most(shared_mm, "shared")
        if broken:
            message = f"{paths[one].label!r} and {paths[two].label!r} run over each other"
            violations.append(
                Violation(message=message, measured=shared_mm, limit=broken.limit, aspect="shared")
            )
    violations += outline_violations(subject, ProblemKind.SHORT_SEGMENT, known=tuple(violations))
    return RuleApplied(checked=len(paths), violations=tuple(violations))


def check_order(subject: Subject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-L03: marks, welds, weld-cuts, cuts; among cuts, what lies inside comes first."""
    if subject.job is None:
        return _NO_RECIPE
    paths = [path for path in subject.job.paths if path.operation.is_machined]
    violations = []
    for before, after in pairwise(paths):
        if _ORDER.index(before.operation) > _ORDER.index(after.operation):
            message = f"{after.operation} {after.label!r} comes after {before.operation}"
            message += f" {before.label!r}: the film has moved by then"
            violations.append(
                Violation(message=message, aspect=f"{before.operation} {after.operation}")
            )
    rings = [(place, path) for place, path in enumerate(paths) if frees(path)]
    for place, before in rings:
        for after in paths[place + 1 :]:
            if before.operation is after.operation and bool(_inside(before, after).all()):
                message = (
                    f"{before.label!r} frees the sheet before {after.label!r} inside it is cut"
                )
                violations.append(Violation(message=message, aspect="inner"))
    return RuleApplied(checked=len(paths), violations=tuple(violations))


def _small_segments(path: LaserPath, limits: Limits) -> list[Violation]:
    segments = list(path.contour.segments)
    short = min(segments, key=lambda segment: segment.length_mm)
    sharp = min(segments, key=lambda segment: segment.radius_mm)
    found = (
        ("segment", "line or arc", short, short.length_mm),
        ("radius", "arc's radius", sharp, sharp.radius_mm),
    )
    violations = []
    for name, what, segment, size_mm in found:
        broken = limits.least(size_mm, name)
        if broken:
            violations.append(
                Violation(
                    message=f"a {what} of {path.label!r} is too small to be run",
                    severity=broken.severity,
                    measured=size_mm,
                    limit=broken.limit,
                    branches=(segment.branch,) if segment.branch else (),
                    aspect=f"{name} {path.label}",
                )
            )
    return violations


class _Body:
    """A body that marks must keep clear of: the area enclosed by its outline, and the outline."""

    def __init__(self, outline: LaserPath) -> None:
        points = outline.contour.flattened_mm()
        # A single straight seam encloses nothing.
        self.area = shapely.Polygon(points if len(points) > 2 else None)
        # Line to line: making an area of an outline that crosses itself can take minutes.
        self.edge = shapely.LineString(_ring(outline))
        shapely.prepare([self.area, self.edge])

    def apart_mm(self, mark: LaserPath) -> float:
        """Return the distance of a mark from the body, 0 where it reaches inside."""
        points = mark.contour.flattened_mm()
        if shapely.contains_xy(self.area, points[:, 0], points[:, 1]).any():
            return 0.0
        return float(shapely.distance(self.edge, _line(mark)))


def _inside(outer: LaserPath, inner: LaserPath) -> NDArray[np.bool_]:
    """Return which points of a path lie inside another one, which is closed if it is open."""
    points, around = inner.contour.flattened_mm(), outer.contour.flattened_mm()
    if len(around) < 3:
        return np.zeros(len(points), dtype=np.bool_)
    area = shapely.Polygon(around)
    return np.asarray(shapely.contains_xy(area, points[:, 0], points[:, 1]))


def _ring(path: LaserPath) -> Floats:
    points = path.contour.flattened_mm()
    return np.concatenate([points, points[:1]])


def _line(path: LaserPath) -> shapely.LineString:
    return shapely.LineString(_ring(path) if path.contour.closed else path.contour.flattened_mm())


MARKS = Rule(
    id="VF-L01",
    title="no mark inside the body or near its rim, none left out",
    unit="mm",
    limits={"error": 3.0},
    reason="a mark weakens film under pressure; a robot without a label is soon nobody's",
    check=check_marks,
)
PATHS = Rule(
    id="VF-L02",
    title="no overlapping paths, no piece too small",
    unit="mm",
    limits={"segment_error": 0.2, "radius_error": 0.5, "shared_error": 0.2},
    reason="a path run twice cuts through the weld; tiny pieces stop the head and burn",
    check=check_paths,
)
ORDER = Rule(
    id="VF-L03",
    title="weld before cut, inner before outer",
    reason="film that is cut free moves",
    check=check_order,
)
