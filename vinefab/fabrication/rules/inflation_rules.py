"""Rules about what a flat robot becomes under pressure (simulated; see `vinefab.inflation`).

They read the pattern that comes with a subject and simulate nothing themselves.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from vinefab.fabrication.outline.layout import flat_layout
from vinefab.fabrication.rules.clearance import nearest_pairs
from vinefab.fabrication.rules.rule import (
    BrokenLimit,
    Limits,
    Rule,
    RuleApplied,
    RuleNotApplicable,
    Violation,
    branch_start_mm,
    branch_violation,
)
from vinefab.fabrication.rules.spacing import Capsules, capsules_of, spacing
from vinefab.fabrication.rules.subject import Subject
from vinefab.inflation.compensation import MESH_DEG, FlatJoint
from vinefab.inflation.pattern import Pattern, PatternJoint
from vinefab.model.design import Design
from vinefab.model.finding import Severity
from vinefab.model.tree import child_lengths_mm, fan_offsets_rad
from vinefab.physics.seam import line_load_n_mm, seam_load_n_mm
from vinefab.physics.tube import inflated_radius_mm

_NO_RECIPE = RuleNotApplicable(reason="needs a recipe, for how far the film stretches")


def degrees_text(angles_deg: tuple[float, ...]) -> str:
    """Return angles as words, without a zero that has a sign."""
    return ", ".join(f"{round(angle, 1) + 0.0:.1f}" for angle in angles_deg)


def _joint_violation(
    subject: Subject, level: int, message: str, broken: BrokenLimit, aspect: str = ""
) -> Violation:
    """Return a violation by all joints whose children are of one level, placed at the first."""
    rows = np.flatnonzero(subject.layout.tree.level == level).tolist()
    at_mm = branch_start_mm(subject.layout, rows[0])
    return branch_violation(
        subject, rows[:1], message, broken, at_mm=at_mm, marked=rows, aspect=aspect
    )


def _simulated(pattern: Pattern) -> Iterator[tuple[PatternJoint, FlatJoint]]:
    """Yield every joint that could be simulated; VF-I01 names the others."""
    for joint in pattern.joints:
        if joint.found is not None:
            yield joint, joint.found


# --- Deploys as designed --------------------------------------------------------------------------


def check_deployed(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-I01: the children of every joint deploy at their designed angles.

    Those are turned by up to 0.8 degrees where that brings tips nearer (`vinefab.inflation`).
    """
    pattern = subject.pattern
    if pattern is None:
        return _NO_RECIPE
    compensated = pattern.design.build.compensation != "none"
    violations = [] if compensated else _flat_is_not_deployed(pattern.design)
    for joint in pattern.joints:
        wanted = degrees_text(joint.wanted_deg)
        helps = "widen the fan, or have fewer or narrower children"
        if joint.found is None:
            unknown = BrokenLimit(severity=Severity.ERROR, limit=0.0, measured=0.0)
            crossed = f"level {joint.level}: siblings pass through each other when inflated"
            message = f"{joint.problem or crossed}: {helps}"
            one = _joint_violation(subject, joint.level, message, unknown)
            violations.append(replace(one, measured=None, limit=None))
            continue
        off = np.subtract(joint.found.deployed_deg, joint.aimed_deg)
        off -= 360.0 * np.round(off / 360.0)
        if compensated and (broken := limits.most(float(np.abs(off).max()))):
            message = (
                f"level {joint.level} is designed at {wanted} degrees, and the nearest that a flat "
                f"joint deploys at is {degrees_text(joint.found.deployed_deg)} (simulated): {helps}"
            )
            violations.append(_joint_violation(subject, joint.level, message, broken))
    return RuleApplied(checked=len(pattern.joints), violations=tuple(violations))


def _flat_is_not_deployed(design: Design) -> list[Violation]:
    """Return what to know of a robot whose flat angles are not made for inflation."""
    if not any(np.any(fan_offsets_rad(level)) for level in design.levels):
        return []
    message = (
        "cut at the designed angles, which pressure changes (`vinefab inflate` shows by how much): "
        '`[build] compensation = "inflation"` cuts the robot that deploys as designed'
    )
    return [Violation(message=message, severity=Severity.INFO)]


DEPLOYED = Rule(
    id="VF-I01",
    title="joints deploy at the designed angles",
    broken="a joint does not deploy at the designed angles",
    unit="deg",
    limits={"error": MESH_DEG},
    reason="seams cannot stretch, so that joints open or close under pressure (simulated); meshes "
    f"of the simulation differ by {MESH_DEG:g} degrees",
    remedy="a wider fan, fewer children or narrower ones",
    check=check_deployed,
)


# --- Sensitive joints -----------------------------------------------------------------------------


def check_sensitivity(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-I02: errors of flat angles do not grow much under pressure."""
    pattern = subject.pattern
    if pattern is None:
        return _NO_RECIPE
    violations = [
        _joint_violation(
            subject,
            joint.level,
            f"an error of 1 degree in the flat angles of level {joint.level} becomes "
            f"{found.sensitivity:.1f} degrees under pressure (simulated): widen the gaps between "
            "siblings, or have fewer or narrower ones",
            broken,
        )
        for joint, found in _simulated(pattern)
        if (broken := limits.most(found.sensitivity))
    ]
    return RuleApplied(checked=len(pattern.joints), violations=tuple(violations))


SENSITIVITY = Rule(
    id="VF-I02",
    title="small errors of flat angles stay small under pressure",
    broken="a joint multiplies errors of its flat angles",
    limits={"warning": 2.5},
    reason="where siblings are near each other, a small change of the flat angles changes the "
    "deployed ones much more: errors of making are multiplied (simulated; the limit is assumed)",
    remedy="wider gaps between siblings, fewer or narrower children",
    check=check_sensitivity,
)


# --- Crotch load ----------------------------------------------------------------------------------

_FILLETS, _LOADS = (0.075, 0.125, 1.0 / 6.0, 1.0 / 3.0), (1.2, 1.0, 0.9, 0.8)
"""Fillets in widths of the parent, and the load of a crotch over that with a fillet of an eighth:
medians of 18 fans of two to four children at hoop strains of 1 and 14 % (simulated). Larger fillets
change it by no more than 5 %."""


def fillet_gain(before: float, after: float) -> float:
    """Return the load of a crotch with one fillet over that with another, both in parent's widths.

    Examples
    --------
    >>> round(fillet_gain(0.125, 1.0 / 3.0), 2)
    0.8
    """
    one, two = np.interp([before, after], _FILLETS, _LOADS)
    return float(two / one)


def check_crotch_load(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-I03: the weld in a crotch bears no more than the seam of the recipe is known to stand.

    The load of a straight seam is taken from pressure and flat width, as in VF-P01. The crotch's is
    so many times as large for some millimetres only, and published pressures come from robots with
    crotches, so that this warns and never forbids.
    """
    pattern = subject.pattern
    if pattern is None:
        return _NO_RECIPE
    if subject.profile is None:
        return RuleNotApplicable(reason="needs a recipe, for the seam")
    seam = subject.profile.material.seam
    stands = Limits({"warning": seam_load_n_mm(seam) / limits["safety_factor"]})
    pressure_kpa = subject.design.build.pressure_kpa
    violations = []
    for joint, found in _simulated(pattern):
        straight = line_load_n_mm(pressure_kpa, joint.width_mm)
        if broken := stands.most(found.crotch_load * straight):
            low_kpa = pressure_kpa * broken.limit / broken.measured
            helps = [
                *_larger_fillet(subject, joint, found),
                f"at most {low_kpa:.1f} kPa",
                "fewer children",
            ]
            message = (
                f"the crotches of level {joint.level} pull on their weld {found.crotch_load:.1f} "
                f"times as hard as a straight seam (simulated; {seam.words()}): "
                f"{', then '.join(helps)}"
            )
            violations.append(_joint_violation(subject, joint.level, message, broken))
    return RuleApplied(checked=len(pattern.joints), violations=tuple(violations))


def _larger_fillet(subject: Subject, joint: PatternJoint, found: FlatJoint) -> tuple[str, ...]:
    """Return by how much a larger fillet helps, if one that is no wider than the child does."""
    inner = found.flat.fillets[1:-1] or found.flat.fillets
    before = min(inner)
    after = min(_FILLETS[-1], subject.design.build.widths_mm[joint.level - 1] / joint.width_mm)
    saved = 1.0 - fillet_gain(before, after)
    if saved < 0.05:
        return ()
    return (
        f"a fillet of {after * joint.width_mm:.0f} mm in place of {before * joint.width_mm:.1f} mm "
        f"(about {100.0 * saved:.0f} % less, where the angle has room)",
    )


CROTCH_LOAD = Rule(
    id="VF-I03",
    title="welds in crotches bear their load",
    broken="a weld in a crotch bears too much load",
    unit="N/mm",
    limits={"safety_factor": 1.0},
    reason="a crotch opens under 2 to 5 times the load of a straight seam (simulated), on a few "
    "millimetres; published pressures come from robots with crotches, so that no factor is added "
    "(assumed), and the rule never forbids",
    remedy="a larger fillet (a third of the parent's width in place of an eighth: a fifth less), "
    "then a lower pressure, then fewer children",
    check=check_crotch_load,
)


# --- Bodies under pressure ------------------------------------------------------------------------


def deployed_capsules(pattern: Pattern) -> Capsules:
    """Return the inflated branches of a deployed robot in plan, without pouches and collar."""
    build = pattern.deployed.build.changed(pouch=None, collar=None)
    flat = capsules_of(flat_layout(pattern.deployed.changed(build=build)), build)
    halves = flat.half_mm, flat.end_half_mm
    start, end = (inflated_radius_mm(1.0) * 2.0 * half for half in halves)
    return replace(flat, half_mm=start, end_half_mm=end)


def contact_mm(gap_deg: float, width_mm: float) -> float:
    """Return how far from their joint two inflated siblings of one width lie on each other.

    Examples
    --------
    >>> round(contact_mm(60.0, 10.0 * math.pi), 6)
    20.0
    """
    if gap_deg >= 180.0:
        return 0.0
    half_rad = math.radians(max(0.0, gap_deg)) / 2.0
    return inflated_radius_mm(width_mm) / math.sin(half_rad) if half_rad > 0.0 else math.inf


def check_bodies(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-I04: inflated branches do not lie on each other, siblings at most near their joint.

    Between branches that share no joint the free distance in plan counts, between siblings the
    length from their joint along which they lie on each other. The nearest pair stands for all of
    one robot: robots in pieces cross themselves on purpose, at many places.
    """
    pattern = subject.pattern
    if pattern is None:
        return _NO_RECIPE
    violations = []
    share = Limits({"warning": limits["sibling_share"], "error": limits["collapsed_share"]})
    for joint, found in _simulated(pattern):
        width_mm = subject.design.build.widths_mm[joint.level - 1]
        lengths_mm = child_lengths_mm(pattern.deployed.levels[joint.level - 2]).tolist()
        touching = [
            (min(contact_mm(two - one, width_mm), 2.0 * min(lengths)), min(lengths))
            for (one, two), lengths in zip(
                pairwise(found.deployed_deg), pairwise(lengths_mm), strict=True
            )
        ]
        if not touching:
            continue
        along_mm, length_mm = max(touching, key=lambda pair: pair[0] / pair[1])
        if broken := share.most(along_mm / length_mm):
            along_mm = min(along_mm, length_mm)
            message = (
                f"siblings of level {joint.level} lie on each other for {along_mm:.0f} of "
                f"{length_mm:.0f} mm when inflated (simulated): widen the fan, or lengthen or "
                "narrow the children"
            )
            in_mm = replace(broken, limit=broken.limit * length_mm, measured=along_mm)
            violations.append(
                _joint_violation(subject, joint.level, message, in_mm, aspect="siblings")
            )
    inflated = replace(subject, capsules=deployed_capsules(pattern))
    near = spacing(inflated.capsules, max(0.0, limits["warning"]))
    nears, pairs = nearest_pairs(inflated, near, ~near.joined & (near.gap_mm < limits["warning"]))
    if nears and (broken := limits.least(nears[0].gap_mm)):
        more = f" (and {pairs - 1} more pairs)" if pairs > 1 else ""
        message = (
            f"the branches{more} lie on each other when inflated (simulated): widen the fan, or "
            "shorten one of them"
        )
        rows = [[subject.names.index(name) for name in pair.branches] for pair in nears]
        marked = {row for pair in rows for row in pair}
        violations.append(branch_violation(subject, rows[0], message, broken, marked=marked))
    pouched = subject.design.build.pouch is not None
    return RuleApplied(
        checked=len(subject.layout.tree),
        violations=tuple(violations),
        note="without pouches" if pouched else "",
    )


BODIES = Rule(
    id="VF-I04",
    title="inflated branches lie clear of each other",
    broken="inflated branches lie on each other",
    unit="mm",
    limits={"warning": 0.0, "sibling_share": 0.5, "collapsed_share": 1.0},
    reason="branches that touch push each other aside or up, which neither growth nor the "
    "simulated joint knows; siblings may touch for half of the shorter one (assumed), and "
    "those that touch all along collapse into one body",
    remedy="a wider fan, shorter or narrower branches, fewer of them",
    check=check_bodies,
)
