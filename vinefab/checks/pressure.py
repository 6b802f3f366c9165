"""Rules about the working pressure: seams and film must stand it, at the widest place most."""

from vinefab.checks.marks import mark_branches, middle_mm
from vinefab.checks.rule import Breach, Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.laser import LaserProfile, Material, Quantity
from vinefab.physics.pressure import allowed_line_load_n_mm, burst_pressure_kpa, hoop_strain

_NO_RECIPE = NotLooked(reason="needs a recipe, for the film and its seam")


def look_burst(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-P01: the working pressure keeps a safety factor below the burst pressure of each width."""
    if subject.profile is None:
        return _NO_RECIPE
    material = subject.profile.material
    allowed = allowed_n_mm(material)
    width_mm, branch = widest(subject)
    limit_kpa = burst_pressure_kpa(width_mm, allowed) / limits["safety_factor"]
    breach = Limits({"error": limit_kpa}).most(subject.design.build.pressure_kpa)
    basis = _basis(material.burst_kpa, material.burst_width_mm)
    words = (
        f"{width_mm:.1f} mm of lay-flat width may be inflated to {limit_kpa:.1f} kPa{basis}: "
        "lower the pressure or narrow the widest part"
    )
    return _looked(subject, branch, words, (subject.design.build.pressure_kpa, breach))


def look_rating(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-P02: the working pressure is not above what the seam was rated for, at any width."""
    if subject.profile is None:
        return _NO_RECIPE
    rated = subject.profile.material.burst_kpa
    breach = Limits({"error": rated.value}).most(subject.design.build.pressure_kpa)
    words = f"the seam is rated for {rated.value:g} kPa{_basis(rated)}: lower the pressure"
    return _looked(subject, 0, words, (subject.design.build.pressure_kpa, breach))


def look_strain(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-P04: the film does not balloon at the working pressure."""
    if subject.profile is None:
        return _NO_RECIPE
    width_mm, branch = widest(subject)
    strain_percent = 100.0 * _strain(subject.profile, subject.design.build.pressure_kpa, width_mm)
    breach = limits.most(strain_percent)
    words = (
        f"the film stretches a lot around {width_mm:.1f} mm of lay-flat width"
        f"{_basis(subject.profile.material.modulus_mpa)}: lower the pressure"
    )
    return _looked(subject, branch, words, (strain_percent, breach))


def allowed_n_mm(material: Material) -> float:
    """Return the line load that a material's seam stood in its burst test."""
    return allowed_line_load_n_mm(material.burst_kpa.value, material.burst_width_mm.value)


def _strain(profile: LaserProfile, pressure_kpa: float, width_mm: float) -> float:
    material = profile.material
    return hoop_strain(pressure_kpa, width_mm, material.ply_mm.value, material.modulus_mpa.value)


def widest(subject: Subject) -> tuple[float, int]:
    """Return the largest lay-flat width, pouches included, and a branch that has it."""
    layout, pouch = subject.layout, subject.design.build.pouch
    branch = int(layout.width_mm.argmax())
    width_mm = float(layout.width_mm[branch])
    if pouch is not None and pouch.flat_width_mm > width_mm:
        return pouch.flat_width_mm, int(layout.is_leaf.argmax())
    return width_mm, branch


def _basis(*numbers: Quantity) -> str:
    """Return in words how far the numbers behind a limit may be trusted."""
    standings = sorted({number.standing.value for number in numbers})
    return f" (from {' and '.join(standings)} numbers)"


def _looked(
    subject: Subject, branch: int, words: str, found: tuple[float, Breach | None]
) -> Looked:
    measured, breach = found
    if breach is None:
        return Looked(checked=1)
    hit = Hit(
        message=words,
        severity=breach.severity,
        measured=measured,
        limit=breach.limit,
        branches=subject.ids(branch),
        at_mm=middle_mm(subject.layout, branch),
        marker=mark_branches(subject.layout, [branch]),
    )
    return Looked(checked=1, hits=(hit,))


BURST = Rule(
    id="VF-P01",
    title="working pressure below the burst pressure of every width",
    unit="kPa",
    limits={"safety_factor": 1.5},
    reason="the load on a seam is pressure times width, so the widest tube bursts first",
    look=look_burst,
)
RATING = Rule(
    id="VF-P02",
    title="working pressure within the seam's rating",
    unit="kPa",
    reason="no seam was ever seen to hold more than its burst test, whatever its width",
    look=look_rating,
)
STRAIN = Rule(
    id="VF-P04",
    title="hoop strain at the working pressure",
    unit="%",
    limits={"warning": 50.0},
    reason="thin TPU balloons long before it bursts, and a ballooned robot is another robot",
    look=look_strain,
)
