"""Rules about the test rig that a robot is tested on, and about the corridors of maps."""

from dataclasses import dataclass, replace
from itertools import product

from vinefab.fabrication.rules.rule import Limits, Rule, RuleApplied, Violation, needed
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


_NO_RIG = "needs a test rig: vinefab rig makes one, --rig names one"


def check_solids(subject: RigSubject | Subject, _: Limits) -> RuleApplied:
    """VF-R01: every part, read again, is closed, oriented and has the right volume."""
    rig = needed(subject.rig, _NO_RIG)
    violations = [
        Violation(message=f"{part.name} {problem}: make the rig anew", aspect=part.name)
        for part in rig.parts
        for problem in part.problems
    ]
    return RuleApplied(checked=len(rig.parts), violations=tuple(violations))


def check_fits(subject: RigSubject | Subject, _: Limits) -> RuleApplied:
    """VF-R02: every part fits the machine, the margin of its bed kept."""
    rig, violations = needed(subject.rig, _NO_RIG), []
    for part in rig.parts:
        axes = zip(part.size_mm, rig.room_mm, ("wide", "deep", "high"), strict=True)
        size_mm, most_mm, axis = max(axes, key=lambda axis: axis[0] - axis[1])
        if size_mm > most_mm + _SLACK_MM:
            message = f"{part.name} is too {axis} for {rig.printer}: split or scale the rig"
            violations.append(
                Violation(message=message, measured=size_mm, limit=most_mm, aspect=part.name)
            )
    return RuleApplied(checked=len(rig.parts), violations=tuple(violations))


def check_corridors(subject: RigSubject | Subject, limits: Limits) -> RuleApplied:
    """VF-R03: corridors take the inflated diameter of every level."""
    why = "to compare corridors with the robot"
    design = needed(subject.design, f"needs a design (--design), {why}")
    corridors = needed(subject.corridors or None, f"needs a map or a rig (--map), {why}")
    violations = []
    levels = list(enumerate(map(inflated_diameter_mm, design.build.widths_mm), start=1))
    for place, (level, diameter_mm) in product(corridors, levels):
        # A dead end with less free area than the branch's cross-section is a notch.
        usable = [one for one in place.corridors if one.dead_end_mm >= diameter_mm]
        narrow = [one for one in usable if limits.least(one.width_mm / diameter_mm)]
        least = min(narrow, key=lambda one: one.width_mm, default=None)
        broken = limits.least(least.width_mm / diameter_mm) if least else None
        if least is None or broken is None:
            continue
        every = "all" if len(narrow) == len(usable) else f"{len(narrow)}"
        in_mm = replace(broken, measured=least.width_mm, limit=broken.limit * diameter_mm)
        violations.append(
            replace(
                in_mm,
                message=f"level {level} inflates to {diameter_mm:.1f} mm: {every} of the "
                f"{len(usable)} narrowest corridors of {place.name} are narrower, the least at "
                f"({least.x_mm:.1f}, {least.y_mm:.1f}) mm: narrow the tubes, or scale up the map",
                aspect=f"{place.name} level {level}",
            )
        )
    return RuleApplied(
        checked=sum(len(place.corridors) for place in corridors),
        violations=tuple(violations),
    )


def check_height(subject: RigSubject | Subject, limits: Limits) -> RuleApplied:
    """VF-R04: obstacles are higher than the inflated trunk, so that it does not climb over them."""
    why = "to compare heights with the trunk"
    rig = needed(subject.rig, f"needs a test rig (--rig), {why}")
    design = needed(subject.design, f"needs a design (--design), {why}")
    diameter_mm = inflated_diameter_mm(design.build.widths_mm[0])
    broken = limits.least(rig.height_mm / diameter_mm)
    if not broken:
        return RuleApplied(checked=1)
    in_mm = replace(broken, measured=rig.height_mm, limit=broken.limit * diameter_mm)
    violation = replace(
        in_mm,
        message=f"a trunk that inflates to {diameter_mm:.1f} mm climbs over them: make them higher "
        "(--height-mm)",
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
RIG_RULES = (RIG_SOLIDS, RIG_SIZE, CORRIDORS, OBSTACLE_HEIGHT)
"""The rules that can be applied without a design's layout, to a `RigSubject`."""
