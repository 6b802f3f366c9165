"""Rules about pressure: seams, film, growth, and the deployed shape.

Narrow leaves at the end of long, winding paths need much pressure to grow; the widest tube bursts
at the least. A robot can be deployed only where the first is less than the second. Rules about the
deployed shape read the subject's pattern (simulated, `vinefab.inflation`) and simulate nothing.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise

import numpy as np

from vinefab.fabrication.rules.clearance_rules import nearest_pairs
from vinefab.fabrication.rules.rule import (
    Limits,
    RuleApplied,
    Subject,
    Violation,
    design_rule,
    needed,
)
from vinefab.fabrication.rules.spacing import Capsules, capsules_of, spacing
from vinefab.inflation.compensation import MESH_DEG, FlatJoint
from vinefab.inflation.pattern import Pattern, PatternJoint
from vinefab.model.design import Build
from vinefab.model.finding import Severity
from vinefab.model.laser import GrowthConstants, LaserProfile, Material
from vinefab.model.quantity import Quantity, Standing, quantities
from vinefab.outline.body_outline import flat_layout
from vinefab.outline.joint import crotch_reach_mm
from vinefab.physics.growth_pressure import (
    FITTED,
    FITTED_DIAMETER_MM,
    growth_pressures_kpa,
    planned_paths,
    riding_mm,
)
from vinefab.physics.tube import (
    burst_pressure_kpa,
    hoop_strain,
    inflated_diameter_mm,
    inflated_radius_mm,
    line_load_n_mm,
    seam_load_n_mm,
)


def _film(subject: Subject) -> Material:
    return needed(subject.profile, "needs a recipe, for the film and its seam").material


@design_rule(
    "VF-P01",
    broken="the working pressure is too high for the widest tube",
    unit="kPa",
    safety_factor=1.5,
    reason="the load on a seam is pressure times width, so the widest tube bursts first; only a "
    "burst test that was measured forbids, a pressure that a tube survived is a lower bound",
    remedy="a lower working pressure or narrower tubes; burst coupons to know the seam",
)
def check_burst(subject: Subject, limits: Limits) -> RuleApplied:
    """Every width stands the working pressure with safety."""
    material = _film(subject)
    width_mm, branch = widest(subject)
    limit_kpa = safe_pressure_kpa(width_mm, material, limits)
    severity = Severity.ERROR if material.seam.is_measured_limit else Severity.WARNING
    broken = Limits({severity.value: limit_kpa}).most(subject.design.build.pressure_kpa)
    message = (
        f"a tube {width_mm:.1f} mm wide, lay-flat, bears {limit_kpa:.1f} kPa with safety "
        f"({material.seam.words()}): lower the pressure or narrow the widest part"
        f"{_or_test(material)}"
    )
    return RuleApplied.of_one(broken and broken.on(subject, [branch], message))


@design_rule(
    "VF-P02",
    broken="the working pressure exceeds that of the seam's test",
    unit="kPa",
    reason="beyond the pressure of its test a seam's strength is an extrapolation to other widths",
    remedy="a lower working pressure, or coupons that are burst at a higher one",
)
def check_rating(subject: Subject, _: Limits) -> RuleApplied:
    """The seam was tested at the working pressure or above."""
    material = _film(subject)
    tested_kpa = material.seam.pressure_kpa.value
    # In a narrower tube the same load on a seam takes more pressure: an extrapolation, so no error.
    broken = Limits({"warning": tested_kpa}).most(subject.design.build.pressure_kpa)
    message = (
        f"no seam of this film is known to hold so much: {material.seam.words()}: lower the "
        f"pressure{_or_test(material)}"
    )
    return RuleApplied.of_one(broken and broken.on(subject, [0], message))


@design_rule(
    "VF-P04",
    broken="the film stretches too far at the working pressure",
    unit="%",
    warning=50.0,
    reason="thin TPU balloons long before it bursts, and a ballooned robot is another robot",
    remedy="a lower working pressure, thicker film or narrower tubes",
)
def check_strain(subject: Subject, limits: Limits) -> RuleApplied:
    """The film stretches little at the working pressure."""
    film, (width_mm, branch) = _film(subject), widest(subject)
    strain = hoop_strain(
        subject.design.build.pressure_kpa, width_mm, film.ply_mm.value, film.modulus_mpa.value
    )
    message = (
        f"tubes {width_mm:.1f} mm wide, lay-flat, balloon ({film.modulus_mpa.standing} modulus): "
        "lower the pressure, or narrow them"
    )
    broken = limits.most(100.0 * strain)
    return RuleApplied.of_one(broken and broken.on(subject, [branch], message))


def safe_pressure_kpa(width_mm: float, material: Material, limits: Limits) -> float:
    """Return the pressure that a tube of a lay-flat width stands with the safety factor."""
    return burst_pressure_kpa(width_mm, seam_load_n_mm(material.seam)) / limits["safety_factor"]


def growth_limit_kpa(width_mm: float, material: Material, limits: Limits) -> float:
    """Return the pressure that growth may take in a tube of a width: safe, and with a margin."""
    return safe_pressure_kpa(width_mm, material, limits) / (1.0 + limits["margin_percent"] / 100.0)


def widest(subject: Subject) -> tuple[float, int]:
    """Return the largest lay-flat width, pouches included, and a branch that has it."""
    layout, pouch = subject.layout, subject.design.build.pouch
    branch = int(layout.width_mm.argmax())
    width_mm = float(layout.width_mm[branch])
    if pouch is not None and pouch.flat_width_mm > width_mm:
        return pouch.flat_width_mm, int(layout.is_leaf.argmax())
    return width_mm, branch


def _or_test(material: Material) -> str:
    return "" if material.seam.is_measured_limit else ", or burst a balloon to know the limit"


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstBranch:
    """The branch whose growth takes the most pressure."""

    pressure_kpa: float  # the pressure it takes
    branch: int  # its index
    place: str  # where it grows, as a phrase


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthConstantsRange:
    """Growth constants for film that is stored loosely and tightly."""

    loose: GrowthConstants
    tight: GrowthConstants  # equal to `loose` where the tension of stored film was measured
    diameter_mm: float  # inflated diameter of the tube that they were fitted to
    source: str  # where they come from, as a phrase
    measured: bool = False  # whether all of them were measured

    @classmethod
    def of(cls, profile: LaserProfile, limits: Limits) -> "GrowthConstantsRange":
        """Return the recipe's own fit, or the published one with the rule's range of tension."""
        own = profile.recipe.growth
        if own is not None:
            diameter_mm = inflated_diameter_mm(own.width_mm.value)
            source = "fit of the recipe, scaled by 1/D (assumed)"
            return cls(
                loose=own,
                tight=own,
                diameter_mm=diameter_mm,
                source=source,
                measured={one.standing for one in quantities(own).values()} == {Standing.MEASURED},
            )
        loose, tight = (
            FITTED.model_copy(
                update={
                    "storage_kpa": Quantity(
                        value=limits[name], standing=Standing.ASSUMED, source="limit of VF-P03"
                    )
                }
            )
            for name in ("loose_kpa", "tight_kpa")
        )
        return cls(
            loose=loose,
            tight=tight,
            diameter_mm=FITTED_DIAMETER_MM.value,
            source="published fit of one tube, scaled by 1/D; film stored loosely, assumed",
        )


def most_growth_kpa(build: Build, profile: LaserProfile, limits: Limits) -> float:
    """Return the pressure above which rule VF-P03 forbids growth, were all of it measured.

    That is what the widest tube stands and, where growth was measured, the working pressure.
    """
    stands_kpa = growth_limit_kpa(build.widest_mm, profile.material, limits)
    measured = GrowthConstantsRange.of(profile, limits).measured
    return min(stands_kpa, build.pressure_kpa) if measured else stands_kpa


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureGauge:
    """The pressure of growth to the worst tip, with the pressure that the widest part stands."""

    # loose, tight: the worst tip with film that is stored loosely and tightly
    loose: WorstBranch
    tight: WorstBranch
    source: str  # where the growth constants come from, as a phrase
    growth_measured: bool  # whether all constants of growth were
    seam_measured: bool  # whether the seam was, to its limit
    width_mm: float  # the widest lay-flat width
    safe_kpa: float  # what that stands, with the safety factor
    growth_limit_kpa: float  # what growth may take of it, with the margin


def pressure_gauge(subject: Subject, profile: LaserProfile, limits: Limits) -> PressureGauge:
    """Return the pressure of growth, in free space and over all deployments, and its limit.

    Parameters
    ----------
    limits
        Those of rule VF-P03.
    """
    fit, material = GrowthConstantsRange.of(profile, limits), profile.material
    loose, tight = worst_growths(subject, (fit.loose, fit.tight), fit.diameter_mm)
    width_mm, _ = widest(subject)
    return PressureGauge(
        loose=loose,
        tight=tight,
        source=fit.source,
        growth_measured=fit.measured,
        seam_measured=material.seam.is_measured_limit,
        width_mm=width_mm,
        safe_kpa=safe_pressure_kpa(width_mm, material, limits),
        growth_limit_kpa=growth_limit_kpa(width_mm, material, limits),
    )


@design_rule(
    "VF-P03",
    broken="growth takes more pressure than the widest tube stands",
    unit="kPa",
    safety_factor=1.5,
    margin_percent=20.0,
    loose_kpa=0.0,
    tight_kpa=FITTED.storage_kpa.value,
    reason="growth through narrow leaves must take less than the wide trunk stands; crumpled film "
    "leaves its store without tension, as the paper's robots are stored; a spool held back 8.32 "
    "kPa (published): with one, set loose_kpa to that",
    remedy="a narrower trunk, wider leaves, shorter paths or smaller turns; film stored loosely",
)
def check_window(subject: Subject, limits: Limits) -> RuleApplied:
    """The widest tube stands the pressure that growth takes.

    Checked are the paths in free space and, where there are deployments, those on the maps.

    Crumpled into the base, film leaves its store without tension; that counts. A spool that holds
    it back takes more: a note says so, where it would be too much. An error needs a seam and growth
    that were measured; a working pressure below growth is one where growth was.
    """
    gauge = pressure_gauge(subject, needed(subject.profile, "needs a recipe, for the seam"), limits)
    loose, tight, top_kpa = gauge.loose, gauge.tight, gauge.safe_kpa
    violations, measured = [], gauge.growth_measured and gauge.seam_measured
    worse = Severity.ERROR if measured else Severity.WARNING
    stands = Limits({worse.value: gauge.growth_limit_kpa})
    if broken := stands.most(loose.pressure_kpa):
        message = (
            f"to grow this tip {loose.place} takes {loose.pressure_kpa:.1f} kPa ({gauge.source}); "
            f"the widest tube, {gauge.width_mm:.1f} mm lay-flat, bears {top_kpa:.1f} kPa with "
            "safety: narrow that tube, widen the narrow branches, or shorten and straighten the way"
        )
        violations.append(_violation(subject, loose, message, broken))
    working_kpa = subject.design.build.pressure_kpa
    worse = Severity.ERROR if gauge.growth_measured else Severity.WARNING
    if weak := Limits({worse.value: working_kpa}).most(loose.pressure_kpa):
        helps = "lower what growth takes: wider branches, or a shorter and straighter way"
        if loose.pressure_kpa <= top_kpa:
            helps = f"set build.pressure_kpa, to at most {top_kpa:.1f}"
        message = f"at {working_kpa:g} kPa it does not grow to this tip {loose.place}: {helps}"
        one = _violation(subject, loose, message, weak, aspect="working")
        title = "the working pressure is too low to grow the robot"
        violations.append(replace(one, title=title))
    free = "no map given: joints only, in free space; contacts on the way add to it"
    notes = [] if subject.deployments else [free]
    if not violations and tight.pressure_kpa > gauge.growth_limit_kpa:
        notes.append(
            f"let the film lie loosely in the base: a spool that holds it back would take up to "
            f"{tight.pressure_kpa:.0f} kPa, more than the widest tube bears (published fit)"
        )
    return RuleApplied(
        checked=max(1, len(subject.deployments)),
        violations=tuple(violations),
        note="; ".join(notes),
    )


def worst_growths(
    subject: Subject,
    several: Sequence[GrowthConstants],
    fitted_mm: float,
    *,
    together: int = 128,
) -> list[WorstBranch]:
    """Return for several constants which branch takes the most pressure to grow.

    Deployments may be grown anew whenever they are asked for, so each is walked once for all, so
    many of them together.
    """
    tree = subject.grown_tree
    riding = riding_mm(tree).tolist()
    # A tapered branch is narrowest, and needs most, at its tip.
    widths_mm = tree.end_width_mm.tolist()
    tubes = [
        {
            width: constants.at_diameter(inflated_diameter_mm(width), fitted_mm)
            for width in set(widths_mm)
        }
        for constants in several
    ]
    # A branch that got stuck on a map still has to grow in free space, which is always checked.
    paths = planned_paths(tree)
    found = [
        max(
            (
                WorstBranch(
                    pressure_kpa=path.pressure_kpa(tube[widths_mm[branch]], riding[branch]),
                    branch=branch,
                    place="in free space",
                )
                for branch, path in enumerate(paths)
            ),
            key=_comparable,
        )
        for tube in tubes
    ]
    named = zip(subject.deployment_names, subject.deployments, strict=True)
    while some := list(islice(named, together)):
        deployments = [deployment for _, deployment in some]
        branches = np.concatenate([np.arange(len(each.tree)) for each in deployments])
        owner = np.repeat(np.arange(len(some)), [len(each.tree) for each in deployments])
        needed_kpa = growth_pressures_kpa(deployments, several, fitted_mm, at_end=True)
        for row, each_kpa in enumerate(np.nan_to_num(needed_kpa, nan=0.0)):
            at = int(np.argmax(np.round(each_kpa, 9)))
            worst = WorstBranch(
                pressure_kpa=float(each_kpa[at]),
                branch=int(branches[at]),
                place=f"on {some[owner[at]][0]}",
            )
            found[row] = max(found[row], worst, key=_comparable)
    return found


def _comparable(worst: WorstBranch) -> float:
    """Return a pressure; equal tips differ in the last digits only, and the first is taken."""
    return round(worst.pressure_kpa, 9)


def _violation(
    subject: Subject, worst: WorstBranch, message: str, broken: Violation, aspect: str = ""
) -> Violation:
    """Return a violation at a tip; marked are its branch and all ancestors."""
    rows, (row,) = [], subject.last_parts([worst.branch])
    while row >= 0:
        rows.append(row)
        row = int(subject.layout.tree.parent[row])
    return broken.on(subject, rows[:1], message, at=1.0, marked=rows, aspect=aspect)


def _pattern(subject: Subject) -> Pattern:
    return needed(subject.pattern, "needs a recipe, for how far the film stretches")


def degrees_text(angles_deg: tuple[float, ...]) -> str:
    """Return angles as words, without a zero that has a sign."""
    return ", ".join(f"{round(angle, 1) + 0.0:.1f}" for angle in angles_deg)


def _simulated(pattern: Pattern) -> Iterator[tuple[PatternJoint, FlatJoint]]:
    """Yield every joint that could be simulated; VF-I01 names the others."""
    for joint in pattern.joints:
        if joint.found is not None:
            yield joint, joint.found


# --- Deploys as designed --------------------------------------------------------------------------


@design_rule(
    "VF-I01",
    broken="a joint does not deploy at the designed angles",
    unit="deg",
    error=MESH_DEG,
    reason="seams cannot stretch, so that joints open or close under pressure (simulated); meshes "
    f"of the simulation differ by {MESH_DEG:g} degrees",
    remedy="a wider fan, fewer children or narrower ones",
)
def check_deployed(subject: Subject, limits: Limits) -> RuleApplied:
    """Joints deploy at the designed angles.

    Those are turned by up to 0.8 degrees where that brings tips nearer (`vinefab.inflation`).
    """
    pattern = _pattern(subject)
    compensated = pattern.design.build.compensation != "none"
    violations = []
    if not compensated and np.any(pattern.design.tree.straight.offset_rad):
        message = (
            "cut at the designed angles, which pressure changes (`vinefab inflate` shows by how "
            'much): `[build] compensation = "inflation"` cuts the robot that deploys as designed'
        )
        violations.append(Violation(message=message, severity=Severity.INFO))
    for joint in pattern.joints:
        wanted = degrees_text(joint.wanted_deg)
        helps = "widen the fan, or have fewer or narrower children"
        if joint.found is None:
            crossed = f"{joint.name}: siblings pass through each other when inflated"
            message = f"{joint.problem or crossed}: {helps}"
            violations.append(Violation().on_joint(subject, joint, message))
            continue
        off = np.subtract(joint.found.deployed_deg, joint.aimed_deg)
        off -= 360.0 * np.round(off / 360.0)
        if compensated and (broken := limits.most(float(np.abs(off).max()))):
            message = (
                f"{joint.name} is designed at {wanted} degrees, and the nearest that a flat "
                f"joint deploys at is {degrees_text(joint.found.deployed_deg)} (simulated): {helps}"
            )
            violations.append(broken.on_joint(subject, joint, message))
    return RuleApplied(checked=len(pattern.joints), violations=tuple(violations))


# --- Sensitive joints -----------------------------------------------------------------------------


@design_rule(
    "VF-I02",
    broken="a joint multiplies errors of its flat angles",
    warning=2.5,
    reason="where siblings are near each other, a small change of the flat angles changes the "
    "deployed ones much more: errors of making are multiplied (simulated; the limit is assumed)",
    remedy="wider gaps between siblings, fewer or narrower children",
)
def check_sensitivity(subject: Subject, limits: Limits) -> RuleApplied:
    """Small errors of flat angles stay small under pressure."""
    pattern = _pattern(subject)
    violations = [
        broken.on_joint(
            subject,
            joint,
            f"an error of 1 degree in the flat angles of {joint.name} becomes "
            f"{found.sensitivity:.1f} degrees under pressure (simulated): widen the gaps between "
            "siblings, or have fewer or narrower ones",
        )
        for joint, found in _simulated(pattern)
        if (broken := limits.most(found.sensitivity))
    ]
    return RuleApplied(checked=len(pattern.joints), violations=tuple(violations))


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


@design_rule(
    "VF-I03",
    broken="a weld in a crotch bears too much load",
    unit="N/mm",
    safety_factor=1.0,
    reason="a crotch opens under 2 to 5 times the load of a straight seam (simulated), on a few "
    "millimetres; published pressures come from robots with crotches, so that no factor is added "
    "(assumed), and the rule never forbids",
    remedy="a larger fillet (a third of the parent's width in place of an eighth: a fifth less), "
    "then a lower pressure, then fewer children",
)
def check_crotch_load(subject: Subject, limits: Limits) -> RuleApplied:
    """Welds in crotches bear their load.

    The load of a straight seam is taken from pressure and flat width, as in VF-P01. The crotch's is
    so many times as large for some millimetres only, and published pressures come from robots with
    crotches, so that this warns and never forbids.
    """
    pattern = _pattern(subject)
    seam = needed(subject.profile, "needs a recipe, for the seam").material.seam
    stands = Limits({"warning": seam_load_n_mm(seam) / limits["safety_factor"]})
    pressure_kpa = subject.design.build.pressure_kpa
    violations = []
    for joint, found in _simulated(pattern):
        straight = line_load_n_mm(pressure_kpa, joint.width_mm)
        if broken := stands.most(found.crotch_load * straight):
            low_kpa = pressure_kpa * broken.limit / broken.measured
            helps = [f"at most {low_kpa:.1f} kPa", "fewer children"]
            # A larger fillet, at most as wide as the child, where it helps.
            width_mm = max(joint.child_widths_mm)
            before = min(found.flat.fillets[1:-1] or found.flat.fillets)
            after = min(_FILLETS[-1], width_mm / joint.width_mm)
            if (saved := 1.0 - fillet_gain(before, after)) >= 0.05:
                helps.insert(
                    0,
                    f"a fillet of {after * joint.width_mm:.0f} mm in place of "
                    f"{before * joint.width_mm:.1f} mm (about {100.0 * saved:.0f} % less, where "
                    "the angle has room)",
                )
            message = (
                f"the crotches of {joint.name} pull on their weld {found.crotch_load:.1f} "
                f"times as hard as a straight seam (simulated; {seam.words()}): "
                f"{', then '.join(helps)}"
            )
            violations.append(broken.on_joint(subject, joint, message))
    return RuleApplied(checked=len(pattern.joints), violations=tuple(violations))


# --- Bodies under pressure ------------------------------------------------------------------------


def deployed_capsules(pattern: Pattern) -> Capsules:
    """Return the inflated branches of a deployed robot in plan, without pouches and collar."""
    build = pattern.deployed.build.changed(collar=None)
    layout = flat_layout(pattern.deployed.changed(build=build))
    flat = capsules_of(replace(layout, pouches=(None,) * len(layout.tree)), build)
    halves = flat.half_mm, flat.end_half_mm
    start, end = (inflated_radius_mm(1.0) * 2.0 * half for half in halves)
    return replace(flat, half_mm=start, end_half_mm=end)


def contact_mm(gap_deg: float, width_mm: float, other_mm: float) -> float:
    """Return the length from their joint over which two inflated siblings touch.

    Parameters
    ----------
    width_mm, other_mm
        Their lay-flat widths.

    Examples
    --------
    >>> round(contact_mm(60.0, 10.0 * math.pi, 10.0 * math.pi), 6)
    20.0
    """
    if gap_deg >= 180.0:
        return 0.0
    if width_mm != other_mm:
        radii_mm = inflated_radius_mm(width_mm), inflated_radius_mm(other_mm)
        return crotch_reach_mm(math.radians(max(0.0, gap_deg)), *radii_mm)
    half_rad = math.radians(max(0.0, gap_deg)) / 2.0
    return inflated_radius_mm(width_mm) / math.sin(half_rad) if half_rad > 0.0 else math.inf


@design_rule(
    "VF-I04",
    broken="inflated branches lie on each other",
    unit="mm",
    warning=0.0,
    sibling_share=0.5,
    collapsed_share=1.0,
    reason="branches that touch push each other aside or up, which neither growth nor the "
    "simulated joint knows; siblings may touch for half of the shorter one (assumed), and "
    "those that touch all along collapse into one body",
    remedy="a wider fan, shorter or narrower branches, fewer of them",
)
def check_bodies(subject: Subject, limits: Limits) -> RuleApplied:
    """Inflated branches lie clear of each other.

    Between branches that share no joint the free distance in plan counts, between siblings the
    length from their joint along which they lie on each other. The nearest pair stands for all of
    one robot: robots in pieces cross themselves on purpose, at many places.
    """
    pattern = _pattern(subject)
    violations = []
    share = Limits({"warning": limits["sibling_share"], "error": limits["collapsed_share"]})
    for joint, found in _simulated(pattern):
        parts = pattern.deployed.tree.straight
        lengths_mm = parts.length_mm[parts.parent == joint.rows[0]].tolist()
        touching = [
            (min(contact_mm(two - one, *widths), 2.0 * min(lengths)), min(lengths))
            for (one, two), widths, lengths in zip(
                pairwise(found.deployed_deg),
                pairwise(joint.child_widths_mm),
                pairwise(lengths_mm),
                strict=True,
            )
        ]
        if not touching:
            continue
        along_mm, length_mm = max(touching, key=lambda pair: pair[0] / pair[1])
        if broken := share.most(along_mm / length_mm):
            along_mm = min(along_mm, length_mm)
            message = (
                f"siblings of {joint.name} lie on each other for {along_mm:.0f} of "
                f"{length_mm:.0f} mm when inflated (simulated): widen the fan, or lengthen or "
                "narrow the children"
            )
            in_mm = replace(broken, limit=broken.limit * length_mm, measured=along_mm)
            violations.append(in_mm.on_joint(subject, joint, message, aspect="siblings"))
    inflated = replace(subject, capsules=deployed_capsules(pattern))
    near = spacing(inflated.capsules, max(0.0, limits["warning"]))
    nears, pairs = nearest_pairs(inflated, near, ~near.joined & (near.gap_mm < limits["warning"]))
    if nears and (broken := limits.least(nears[0].measured)):
        more = f" (and {pairs - 1} more pairs)" if pairs > 1 else ""
        message = (
            f"the branches{more} lie on each other when inflated (simulated): widen the fan, or "
            "shorten one of them"
        )
        rows = [[subject.names.index(name) for name in pair.branches] for pair in nears]
        marked = {row for pair in rows for row in pair}
        violations.append(broken.on(subject, rows[0], message, marked=marked))
    pouched = any(subject.design.pouches)
    return RuleApplied(
        checked=len(subject.layout.tree),
        violations=tuple(violations),
        note="without pouches" if pouched else "",
    )
