"""Rules about pressure: what seams and film stand, and what growth takes.

Narrow leaves at the end of long, winding paths need much pressure to grow; the widest tube bursts
at the least. Whether anything is left between the two decides whether a robot can be deployed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

from vinefab.fabrication.rules.rule import (
    BrokenLimit,
    Limits,
    Rule,
    RuleApplied,
    RuleNotApplicable,
    Violation,
    branch_tip_mm,
    branch_violation,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.design import Build
from vinefab.model.finding import Severity
from vinefab.model.laser import (
    GrowthConstants,
    LaserProfile,
    Material,
    Quantity,
    Standing,
    quantities,
)
from vinefab.physics.growth_pressure import (
    FITTED,
    FITTED_DIAMETER_MM,
    grown_paths,
    planned_paths,
    riding_mm,
)
from vinefab.physics.seam import burst_pressure_kpa, hoop_strain, seam_load_n_mm
from vinefab.physics.tube import inflated_diameter_mm

_NO_RECIPE = RuleNotApplicable(reason="needs a recipe, for the film and its seam")


def check_burst(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-P01: the working pressure keeps a safety factor below the burst pressure of each width."""
    if subject.profile is None:
        return _NO_RECIPE
    material = subject.profile.material
    width_mm, branch = widest(subject)
    limit_kpa = safe_pressure_kpa(width_mm, material, limits)
    severity = Severity.ERROR if material.seam.is_measured_limit else Severity.WARNING
    broken = Limits({severity.value: limit_kpa}).most(subject.design.build.pressure_kpa)
    message = (
        f"a tube {width_mm:.1f} mm wide, lay-flat, bears {limit_kpa:.1f} kPa with safety "
        f"({material.seam.words()}): lower the pressure or narrow the widest part"
        f"{_or_test(material)}"
    )
    return _applied(subject, branch, message, broken)


def check_rating(subject: Subject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-P02: the working pressure is not above that of the seam's test, at any width."""
    if subject.profile is None:
        return _NO_RECIPE
    material = subject.profile.material
    tested_kpa = material.seam.pressure_kpa.value
    # In a narrower tube the same load on a seam takes more pressure: an extrapolation, so no error.
    broken = Limits({"warning": tested_kpa}).most(subject.design.build.pressure_kpa)
    message = (
        f"no seam of this film is known to hold so much: {material.seam.words()}: lower the "
        f"pressure{_or_test(material)}"
    )
    return _applied(subject, 0, message, broken)


def check_strain(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-P04: the film does not balloon at the working pressure."""
    if subject.profile is None:
        return _NO_RECIPE
    film, (width_mm, branch) = subject.profile.material, widest(subject)
    strain = hoop_strain(
        subject.design.build.pressure_kpa, width_mm, film.ply_mm.value, film.modulus_mpa.value
    )
    message = (
        f"tubes {width_mm:.1f} mm wide, lay-flat, balloon ({film.modulus_mpa.standing} modulus): "
        "lower the pressure, or narrow them"
    )
    return _applied(subject, branch, message, limits.most(100.0 * strain))


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


def _applied(
    subject: Subject, branch: int, message: str, broken: BrokenLimit | None
) -> RuleApplied:
    found = (branch_violation(subject, [branch], message, broken),) if broken else ()
    return RuleApplied(checked=1, violations=found)


BURST = Rule(
    id="VF-P01",
    title="every width stands the working pressure with safety",
    broken="the working pressure is too high for the widest tube",
    unit="kPa",
    limits={"safety_factor": 1.5},
    reason="the load on a seam is pressure times width, so the widest tube bursts first; only a "
    "burst test that was measured forbids, a pressure that a tube survived is a lower bound",
    remedy="a lower working pressure or narrower tubes; burst coupons to know the seam",
    check=check_burst,
)
RATING = Rule(
    id="VF-P02",
    title="the seam was tested at the working pressure or above",
    broken="the working pressure exceeds that of the seam's test",
    unit="kPa",
    reason="beyond the pressure of its test a seam's strength is an extrapolation to other widths",
    remedy="a lower working pressure, or coupons that are burst at a higher one",
    check=check_rating,
)
STRAIN = Rule(
    id="VF-P04",
    title="the film stretches little at the working pressure",
    broken="the film stretches too far at the working pressure",
    unit="%",
    limits={"warning": 50.0},
    reason="thin TPU balloons long before it bursts, and a ballooned robot is another robot",
    remedy="a lower working pressure, thicker film or narrower tubes",
    check=check_strain,
)


_FREE = "no map given: joints only, in free space; contacts on the way add to it"


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
    """What growth to the worst tip takes beside what the widest part stands."""

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
    """Return what growth takes, in free space and over all deployments, and what it may take.

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


def check_window(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-P03: growth to the worst tip takes less than the widest tube stands, with a margin.

    Checked are the paths in free space and, where there are deployments, those on the maps.

    Crumpled into the base, film leaves its store without tension; that counts. A spool that holds
    it back takes more: a note says so, where it would be too much. An error needs a seam and growth
    that were measured; a working pressure below growth is one where growth was.
    """
    if subject.profile is None:
        return RuleNotApplicable(reason="needs a recipe, for the seam")
    gauge = pressure_gauge(subject, subject.profile, limits)
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
    notes = [] if subject.deployments else [_FREE]
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
    subject: Subject, several: Sequence[GrowthConstants], fitted_mm: float
) -> list[WorstBranch]:
    """Return for several constants which branch takes the most pressure to grow.

    Deployments may be grown anew whenever they are asked for, so each is walked once for all.
    """
    build, tree = subject.design.build, subject.grown_tree
    riding, level = riding_mm(tree, build.widths_mm).tolist(), tree.level.tolist()
    # A tapered branch is narrowest, and needs most, at its tip.
    diameters_mm = [inflated_diameter_mm(end_mm) for end_mm in build.end_widths_mm]
    by_level = [[c.at_diameter(d_mm, fitted_mm) for d_mm in diameters_mm] for c in several]
    found: list[list[WorstBranch]] = [[] for _ in several]
    # A branch that got stuck on a map still has to grow in free space, which is always checked.
    walks = [("in free space", dict(enumerate(planned_paths(tree))))]
    named = zip(subject.deployment_names, subject.deployments, strict=True)
    for place, paths in chain(
        walks, ((f"on {name}", grown_paths(deployment)) for name, deployment in named)
    ):
        for worst, constants in zip(found, by_level, strict=True):
            here = (
                WorstBranch(
                    pressure_kpa=path.pressure_kpa(constants[level[branch] - 1], riding[branch]),
                    branch=branch,
                    place=place,
                )
                for branch, path in paths.items()
            )
            # Equal tips differ in the last digits only: the first of them stands for all.
            worst[:] = [max((*worst, *here), key=lambda each: round(each.pressure_kpa, 9))]
    return [worst for (worst,) in found]


def _violation(
    subject: Subject, worst: WorstBranch, message: str, broken: BrokenLimit, aspect: str = ""
) -> Violation:
    """Return a violation at a tip; marked are its branch and all ancestors."""
    rows, row = [], worst.branch
    while row >= 0:
        rows.append(row)
        row = int(subject.layout.tree.parent[row])
    at_mm = branch_tip_mm(subject.layout, worst.branch)
    return branch_violation(
        subject, rows[:1], message, broken, at_mm=at_mm, marked=rows, aspect=aspect
    )


WINDOW = Rule(
    id="VF-P03",
    title="the widest tube stands the pressure that growth takes",
    broken="growth takes more pressure than the widest tube stands",
    unit="kPa",
    limits={
        "safety_factor": 1.5,
        "margin_percent": 20.0,
        "loose_kpa": 0.0,
        "tight_kpa": FITTED.storage_kpa.value,
    },
    reason="growth through narrow leaves must take less than the wide trunk stands; crumpled film "
    "leaves its store without tension, as the paper's robots are stored; a spool held back 8.32 "
    "kPa (published): with one, set loose_kpa to that",
    remedy="a narrower trunk, wider leaves, shorter paths or smaller turns; film stored loosely",
    check=check_window,
)
