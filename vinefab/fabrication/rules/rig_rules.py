"""Rules about the test rig that a robot is tested on, and about the corridors of maps."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

from vinefab.fabrication.rules.rule import Limits, Rule, RuleApplied, RuleNotApplicable, Violation
from vinefab.fabrication.rules.subject import MapCorridors, RigFacts, Subject
from vinefab.model.design import Design
from vinefab.physics.tube import inflated_diameter_mm

_SLACK_MM = 1e-3
"""Tolerance of a part's size: files hold it in single precision."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigSubject:
    """What the rules about rigs check; every field may be missing."""

    design: Design | None = None
    rig: RigFacts | None = None
    corridors: tuple[MapCorridors, ...] = ()  # of maps, or of the rig


RigCheck = Callable[["RigSubject | Subject", Limits], RuleApplied | RuleNotApplicable]

_NO_RIG = RuleNotApplicable(reason="needs a test rig: vinefab rig makes one, --rig names one")


def check_solids(subject: RigSubject | Subject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-R01: every part, read again, is closed, oriented and has the right volume."""
    if subject.rig is None:
        return _NO_RIG
    violations = [
        Violation(message=f"{part.name} {problem}: make the rig anew", aspect=part.name)
        for part in subject.rig.parts
        for problem in part.problems
    ]
    return RuleApplied(checked=len(subject.rig.parts), violations=tuple(violations))


def check_fits(subject: RigSubject | Subject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-R02: every part fits the machine, the margin of its bed kept."""
    if subject.rig is None:
        return _NO_RIG
    room, violations = subject.rig.room_mm, []
    for part in subject.rig.parts:
        axes = zip(part.size_mm, room, ("wide", "deep", "high"), strict=True)
        size_mm, most_mm, axis = max(axes, key=lambda axis: axis[0] - axis[1])
        if size_mm > most_mm + _SLACK_MM:
            message = f"{part.name} is too {axis} for {subject.rig.printer}: split or scale the rig"
            violations.append(
                Violation(message=message, measured=size_mm, limit=most_mm, aspect=part.name)
            )
    return RuleApplied(checked=len(subject.rig.parts), violations=tuple(violations))


def check_corridors(
    subject: RigSubject | Subject, limits: Limits
) -> RuleApplied | RuleNotApplicable:
    """VF-R03: corridors take the inflated diameter of every level."""
    if subject.design is None or not subject.corridors:
        missing = "a map or a rig (--map)" if subject.design else "a design (--design)"
        return RuleNotApplicable(reason=f"needs {missing}, to compare corridors with the robot")
    violations = []
    levels = list(enumerate(map(inflated_diameter_mm, subject.design.build.widths_mm), start=1))
    for place, (level, diameter_mm) in product(subject.corridors, levels):
        # A dead end with less free area than the branch's cross-section is no corridor: a notch.
        usable = [one for one in place.corridors if one.dead_end_mm >= diameter_mm]
        narrow = [one for one in usable if limits.least(one.width_mm / diameter_mm)]
        least = min(narrow, key=lambda one: one.width_mm, default=None)
        broken = limits.least(least.width_mm / diameter_mm) if least else None
        if least is None or broken is None:
            continue
        every = "all" if len(narrow) == len(usable) else f"{len(narrow)}"
        in_mm = replace(broken, measured=least.width_mm, limit=broken.limit * diameter_mm)
        violations.append(
            in_mm.violation(
                f"level {level} inflates to {diameter_mm:.1f} mm: {every} of the "
                f"{len(usable)} narrowest corridors of {place.name} are narrower, the least at "
                f"({least.x_mm:.1f}, {least.y_mm:.1f}) mm: narrow the tubes, or scale up the map",
                aspect=f"{place.name} level {level}",
            )
        )
    return RuleApplied(
        checked=sum(len(place.corridors) for place in subject.corridors),
        violations=tuple(violations),
    )


def check_height(subject: RigSubject | Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-R04: obstacles are higher than the inflated trunk, so that it does not climb over them."""
    if subject.design is None or subject.rig is None:
        missing = "a test rig (--rig)" if subject.rig is None else "a design (--design)"
        return RuleNotApplicable(reason=f"needs {missing}, to compare heights with the trunk")
    diameter_mm = inflated_diameter_mm(subject.design.build.widths_mm[0])
    broken = limits.least(subject.rig.height_mm / diameter_mm)
    if not broken:
        return RuleApplied(checked=1)
    in_mm = replace(broken, measured=subject.rig.height_mm, limit=broken.limit * diameter_mm)
    violation = in_mm.violation(
        f"a trunk that inflates to {diameter_mm:.1f} mm climbs over them: make them higher "
        "(--height-mm)"
    )
    return RuleApplied(checked=1, violations=(violation,))


RIG_SOLIDS = Rule(
    id="VF-R01",
    title="every rig part is a closed solid of the right volume",
    broken="a rig part is not a closed solid of the right volume",
    reason="slicers guess what an open mesh means",
    remedy="make the rig anew; report it if the part still is not closed",
    check=check_solids,
)
RIG_SIZE = Rule(
    id="VF-R02",
    title="every rig part fits the machine",
    broken="a rig part is too large for the machine",
    unit="mm",
    reason="a part that does not fit cannot be printed",
    remedy="another printer, a smaller scale, or lower obstacles",
    check=check_fits,
)
CORRIDORS = Rule(
    id="VF-R03",
    title="corridors let every inflated branch through",
    broken="corridors are too narrow for inflated branches",
    unit="mm",
    limits_in="times the inflated diameter",
    limits={"warning": 1.0},
    reason="an inflated body does not pass a narrower gap. A dead "
    "end with less free area than the body's cross-section is a notch in a wall and no corridor, "
    "unless a start is in it",
    remedy="narrower tubes, a larger scale, or another map",
    check=check_corridors,
)
OBSTACLE_HEIGHT = Rule(
    id="VF-R04",
    title="obstacles are higher than the inflated trunk climbs",
    broken="obstacles are too low: the inflated trunk climbs over them",
    unit="mm",
    limits_in="times the inflated diameter of the trunk",
    limits={"warning": 1.2},
    reason="a tube climbs over an obstacle that is lower; 1.2 diameters are assumed",
    remedy="higher obstacles, or a narrower trunk",
    check=check_height,
)
RIG_CHECKS: dict[str, tuple[Rule, RigCheck]] = {
    RIG_SOLIDS.id: (RIG_SOLIDS, check_solids),
    RIG_SIZE.id: (RIG_SIZE, check_fits),
    CORRIDORS.id: (CORRIDORS, check_corridors),
    OBSTACLE_HEIGHT.id: (OBSTACLE_HEIGHT, check_height),
}
"""The rules that can be applied without a design's layout, by id."""
