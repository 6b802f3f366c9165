"""Rules about the recipe: whether it suits the film, the machine and the person who trusts it."""

import math
from collections.abc import Iterator

from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.finding import Severity
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile, RecipeStatus

_NO_RECIPE = NotLooked(reason="needs a recipe")


def look_ply(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-L04: the film is one that the recipe's laser can weld."""
    if subject.profile is None:
        return _NO_RECIPE
    if not all(settings.by_laser for settings in subject.profile.recipe.operations.values()):
        return NotLooked(reason="an impulse sealer makes the seams of this recipe, not the laser")
    material = subject.profile.material
    breach = limits.most(material.ply_mm.value)
    if material.weldable and not breach:
        return Looked(checked=1)
    hit = Hit(
        message=f"{material.title} does not weld with a laser: use a thinner film or a heat sealer",
        measured=material.ply_mm.value,
        limit=limits["error"],
    )
    return Looked(checked=1, hits=(hit,))


def look_machine(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-L05: the recipe asks the machine for no more speed and acceleration than it has."""
    if subject.profile is None or subject.job is None:
        return _NO_RECIPE
    machine = subject.profile.machine
    hits = []
    for operation, settings in subject.profile.recipe.operations.items():
        speed = settings.speed_mm_s.value
        top = machine.speed_max_mm_s.value
        if speed > top:
            words = f"{operation} is faster than the machine: slow it to {top:g} mm/s"
            hits.append(_warning(words, f"speed {operation}"))
        radius_mm = _sharpest_mm(subject, operation)
        if speed**2 / radius_mm > machine.acceleration_mm_s2.value:
            fit = math.sqrt(machine.acceleration_mm_s2.value * radius_mm)
            words = f"{operation} takes arcs of {radius_mm:.2f} mm too fast: the machine slows"
            words += f" there and burns; run it at {fit:.0f} mm/s or less"
            hits.append(_warning(words, f"arcs {operation}"))
    return Looked(checked=len(subject.profile.recipe.operations), hits=tuple(hits))


def look_status(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-L06: the recipe was tried on the user's machine, and runs what came out right there."""
    if subject.profile is None:
        return _NO_RECIPE
    recipe = subject.profile.recipe
    hits = [*_energy_hits(subject.profile)]
    if recipe.status is RecipeStatus.UNVERIFIED:
        words = f"recipe {recipe.name} is unverified: cut the coupons and calibrate it first"
        hits.insert(0, _warning(words, ""))
    return Looked(checked=1 + len(recipe.windows), hits=tuple(hits))


def _energy_hits(profile: LaserProfile) -> Iterator[Hit]:
    """Yield a hit for each operation that runs an energy that failed on the coupons."""
    for window in profile.recipe.windows:
        settings = profile.recipe.operations.get(window.operation)
        if settings is None or settings.focus_offset_mm.value != window.focus_mm:
            continue
        energy = settings.line_energy_mj_mm(profile.machine)
        if not window.holds(energy):
            words = f"{window.operation} runs {energy:.1f} mJ/mm, but the coupons say: "
            yield _warning(f"{words}{window.words()}", f"energy {window.operation}")


def _warning(words: str, aspect: str) -> Hit:
    return Hit(message=words, severity=Severity.WARNING, aspect=aspect)


def _sharpest_mm(subject: Subject, operation: str) -> float:
    """Return the smallest arc radius along an operation's paths; infinite without arcs."""
    paths = [] if subject.job is None else subject.job.along(Operation(operation))
    return min((s.radius_mm for path in paths for s in path.contour.segments), default=math.inf)


PLY = Rule(
    id="VF-L04",
    title="the film can be welded by laser",
    unit="mm",
    limits={"error": 0.0475},
    reason="0.0375 mm film welded and 0.05 mm film did not (paper); the limit between is assumed",
    look=look_ply,
)
MACHINE = Rule(
    id="VF-L05",
    title="speeds and accelerations within the machine",
    reason="a head that must slow down in an arc puts more energy there than the recipe says",
    look=look_machine,
)
STATUS = Rule(
    id="VF-L06",
    title="the recipe is calibrated",
    reason="no laser settings for this film were found in any source; only coupons tell",
    look=look_status,
)
