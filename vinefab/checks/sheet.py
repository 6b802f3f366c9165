"""Rules about the sheet: the bed that it lies on and the film that it is cut from."""

import shapely

from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.finding import Severity

_NO_RECIPE = NotLooked(reason="needs a recipe, for the machine's bed and the film")
_SLACK_MM = 1e-6


def look_bed(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-S01: every machined path lies on the bed, inside its margins."""
    if subject.profile is None or subject.job is None:
        return _NO_RECIPE
    machine, facts = subject.profile.machine, subject.job.facts
    wanted, placed = facts.get("robots_wanted", 1), facts.get("robots_placed", 1)
    if wanted != placed:
        words = f"only {placed} of {wanted} robots find room on the bed: make fewer at once"
        return Looked(checked=1, hits=(Hit(message=words, aspect="copies"),))
    paths = [path for path in subject.job.paths if path.operation.is_machined]
    boxes = [path.contour.box_mm for path in paths]
    margin_mm = machine.margin_mm.value
    right_mm = machine.bed_width_mm.value - margin_mm
    top_mm = machine.bed_height_mm.value - margin_mm
    over_mm = max(
        max(margin_mm - x0, margin_mm - y0, x1 - right_mm, y1 - top_mm) for x0, y0, x1, y1 in boxes
    )
    if over_mm <= _SLACK_MM:
        return Looked(checked=len(paths))
    wide_mm, high_mm = machine.usable_mm
    hit = Hit(
        message=f"the robot does not fit the {wide_mm:g} x {high_mm:g} mm of the bed in any "
        "rotation tried: shorten it, scale it down or use a larger machine",
        measured=over_mm,
        limit=0.0,
    )
    return Looked(checked=len(paths), hits=(hit,))


def look_film(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-S02: the robot, turned as it may be, is no wider than the roll of film."""
    if subject.profile is None:
        return _NO_RECIPE
    roll_mm = subject.profile.material.roll_width_mm.value
    box = shapely.minimum_rotated_rectangle(
        shapely.MultiPoint(subject.outline.contour.flattened_mm().tolist())
    )
    x, y = shapely.get_coordinates(box)[:3].T
    sides = ((x[1:] - x[:-1]) ** 2 + (y[1:] - y[:-1]) ** 2) ** 0.5
    width_mm = float(sides.min())
    if width_mm <= roll_mm:
        return Looked(checked=1)
    hit = Hit(
        message="the robot is wider than the roll of film: shorten branches or narrow fans",
        severity=Severity.WARNING,
        measured=width_mm,
        limit=roll_mm,
    )
    return Looked(checked=1, hits=(hit,))


BED = Rule(
    id="VF-S01",
    title="fits the bed after rotation",
    unit="mm",
    reason="what hangs over the bed is not cut; this version does not tile",
    look=look_bed,
)
FILM = Rule(
    id="VF-S02",
    title="fits the roll of film",
    unit="mm",
    reason="a robot wider than the roll needs a seam across the film",
    look=look_film,
)
