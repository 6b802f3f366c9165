"""Rules about the test rig that a robot is tried on, and about the corridors of maps."""

from collections.abc import Callable
from dataclasses import dataclass

from vinefab.fabrication.rules.rule import Limits, Rule, RuleApplied, RuleNotApplicable, Violation
from vinefab.fabrication.rules.subject import MapCorridors, RigFacts, Subject
from vinefab.model.design import Design
from vinefab.physics.tube import inflated_diameter_mm

_SLACK_MM = 1e-3
"""Parts are rounded to single precision: this much over the bed is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigSubject:
    """What these rules look at; each part of it may be missing."""

    design: Design | None = None  # the robot
    rig: RigFacts | None = None  # the test rig
    courses: tuple[MapCorridors, ...] = ()  # maps, or the rig, with their narrow corridors


RigCheck = Callable[[RigSubject, Limits], RuleApplied | RuleNotApplicable]


def check_solids(stand: RigSubject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-R01: every part, read again, is closed, oriented and has the right volume."""
    if stand.rig is None:
        return RuleNotApplicable(reason="needs a test rig: vinefab rig makes one, --rig names one")
    hits = [
        Violation(message=f"{part.name} {problem}", aspect=part.name)
        for part in stand.rig.parts
        for problem in part.problems
    ]
    return RuleApplied(checked=len(stand.rig.parts), hits=tuple(hits))


def check_fits(stand: RigSubject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-R02: every part fits the machine, the margin of its bed kept."""
    if stand.rig is None:
        return RuleNotApplicable(reason="needs a test rig: vinefab rig makes one, --rig names one")
    room, hits = stand.rig.room_mm, []
    for part in stand.rig.parts:
        axes = zip(part.size_mm, room, ("wide", "deep", "high"), strict=True)
        size_mm, most_mm, axis = max(axes, key=lambda axis: axis[0] - axis[1])
        if size_mm > most_mm + _SLACK_MM:
            words = f"{part.name} is too {axis} for {stand.rig.printer}: split or scale the rig"
            hits.append(Violation(message=words, measured=size_mm, limit=most_mm, aspect=part.name))
    return RuleApplied(checked=len(stand.rig.parts), hits=tuple(hits))


def check_corridors(stand: RigSubject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-R03: corridors take the inflated diameter of every level."""
    if stand.design is None or not stand.courses:
        missing = "a map or a rig (--map)" if stand.design else "a design (--design)"
        return RuleNotApplicable(reason=f"needs {missing}, to compare corridors with the robot")
    hits = [
        hit
        for course in stand.courses
        for level, width_mm in enumerate(stand.design.build.widths_mm, 1)
        if (hit := _tight(course, level, inflated_diameter_mm(width_mm), limits))
    ]
    return RuleApplied(
        checked=sum(len(course.corridors) for course in stand.courses), hits=tuple(hits)
    )


def check_height(stand: RigSubject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-R04: obstacles are higher than the inflated trunk, so that it does not climb over them."""
    if stand.design is None or stand.rig is None:
        missing = "a test rig (--rig)" if stand.rig is None else "a design (--design)"
        return RuleNotApplicable(reason=f"needs {missing}, to compare heights with the trunk")
    diameter_mm = inflated_diameter_mm(stand.design.build.widths_mm[0])
    breach = limits.least(stand.rig.height_mm / diameter_mm)
    if not breach:
        return RuleApplied(checked=1)
    hit = Violation(
        message=f"obstacles are low for a trunk that inflates to {diameter_mm:.1f} mm, which "
        "climbs over them: make them higher (--height-mm)",
        severity=breach.severity,
        measured=stand.rig.height_mm,
        limit=breach.limit * diameter_mm,
    )
    return RuleApplied(checked=1, hits=(hit,))


def _tight(
    course: MapCorridors, level: int, diameter_mm: float, limits: Limits
) -> Violation | None:
    """Return what is wrong for one level on one course, if anything."""
    narrow = [one for one in course.corridors if limits.least(one.width_mm / diameter_mm)]
    if not narrow:
        return None
    least = min(narrow, key=lambda one: one.width_mm)
    breach = limits.least(least.width_mm / diameter_mm)
    if breach is None:
        return None
    every = "all" if len(narrow) == len(course.corridors) else f"{len(narrow)}"
    return Violation(
        message=f"level {level} inflates to {diameter_mm:.1f} mm: {every} of the "
        f"{len(course.corridors)} narrowest corridors of {course.name} are narrower, the least at "
        f"({least.x_mm:.1f}, {least.y_mm:.1f}) mm; no branch of that level gets through",
        severity=breach.severity,
        measured=least.width_mm,
        limit=breach.limit * diameter_mm,
        aspect=f"{course.name} level {level}",
    )


def _of_subject(look: RigCheck) -> Callable[[Subject, Limits], RuleApplied | RuleNotApplicable]:
    """Return a look that takes what it needs from the subject of a whole check."""

    def from_subject(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
        stand = RigSubject(design=subject.design, rig=subject.rig, courses=subject.courses)
        return look(stand, limits)

    return from_subject


RIG_SOLIDS = Rule(
    id="VF-R01",
    title="every rig part is a closed, oriented solid with the right volume",
    reason="slicers guess what an open mesh means",
    look=_of_subject(check_solids),
)
RIG_SIZE = Rule(
    id="VF-R02",
    title="every rig part fits the printer",
    unit="mm",
    reason="a part that does not fit cannot be printed",
    look=_of_subject(check_fits),
)
CORRIDORS = Rule(
    id="VF-R03",
    title="corridors are at least the inflated diameter of the branches meant to pass",
    unit="mm",
    limits={"warning": 1.0},
    reason="an inflated body does not pass a narrower gap; the limit is times its diameter",
    look=_of_subject(check_corridors),
)
OBSTACLE_HEIGHT = Rule(
    id="VF-R04",
    title="obstacle height at least 1.2 times the trunk's diameter",
    unit="mm",
    limits={"warning": 1.2},
    reason="a tube climbs over an obstacle that is lower; 1.2 diameters are assumed",
    look=_of_subject(check_height),
)
RIG_CHECKS: dict[str, tuple[Rule, RigCheck]] = {
    RIG_SOLIDS.id: (RIG_SOLIDS, check_solids),
    RIG_SIZE.id: (RIG_SIZE, check_fits),
    CORRIDORS.id: (CORRIDORS, check_corridors),
    OBSTACLE_HEIGHT.id: (OBSTACLE_HEIGHT, check_height),
}
"""The rules that can be applied without a design's layout, by id."""
