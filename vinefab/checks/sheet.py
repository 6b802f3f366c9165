"""Rules about the sheet: the bed that it lies on and the film that it is cut from."""

from collections.abc import Iterator

import shapely

from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.finding import Severity
from vinefab.model.job import Job
from vinefab.model.laser import Machine

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
    if subject.job.tiles:
        return Looked(checked=len(subject.job.tiles), hits=tuple(_tile_hits(subject.job, machine)))
    over_mm, checked = _over_mm(subject.job, machine)
    if over_mm <= _SLACK_MM:
        return Looked(checked=checked)
    wide_mm, high_mm = machine.usable_mm
    why = facts.get("tiling")
    hit = Hit(
        message=f"the robot does not fit the {wide_mm:g} x {high_mm:g} mm of the bed in any "
        f"rotation tried{f' and cannot be cut in tiles: {why}' if why else ''}: shorten it, scale "
        "it down or use a larger machine",
        measured=over_mm,
        limit=0.0,
    )
    return Looked(checked=checked, hits=(hit,))


def _over_mm(job: Job, machine: Machine) -> tuple[float, int]:
    """Return how far a job's paths reach beyond the usable bed, and how many there are."""
    paths = [path for path in job.paths if path.operation.is_machined]
    margin_mm = machine.margin_mm.value
    right_mm = machine.bed_width_mm.value - margin_mm
    top_mm = machine.bed_height_mm.value - margin_mm
    boxes = [path.contour.box_mm for path in paths]
    over_mm = max(
        max(margin_mm - x0, margin_mm - y0, x1 - right_mm, y1 - top_mm) for x0, y0, x1, y1 in boxes
    )
    return over_mm, len(paths)


def _tile_hits(job: Job, machine: Machine) -> Iterator[Hit]:
    """Yield a hit for each tile that hangs over the bed or that cannot be aligned."""
    for number, tile in enumerate(job.tiles, start=1):
        over_mm, _ = _over_mm(tile, machine)
        if over_mm > _SLACK_MM:
            words = f"tile {number} hangs over the bed"
            yield Hit(message=words, measured=over_mm, limit=0.0, aspect=f"tile {number}")
        found = tile.facts["targets_found_mm"]
        if number > 1 and not (isinstance(found, list) and len(found) >= 2):
            words = f"tile {number} has no two targets to align it by"
            yield Hit(message=words, aspect=f"targets {number}")


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
    title="fits the bed after rotation, or in tiles",
    unit="mm",
    reason="what hangs over the bed is not cut; tiles need targets to be aligned by",
    look=look_bed,
)
FILM = Rule(
    id="VF-S02",
    title="fits the roll of film",
    unit="mm",
    reason="a robot wider than the roll needs a seam across the film",
    look=look_film,
)
