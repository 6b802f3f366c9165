"""What predictions rest on: assumed and published numbers, inputs, versions, the command."""

from collections.abc import Sequence

from vinefab.core.hashing import sha256_of
from vinefab.core.limits import deg
from vinefab.core.view import Origin
from vinefab.fabrication.rules.catalog import RULES
from vinefab.growth.options import GrowthOptions
from vinefab.model.contacts import MeasuredNumber
from vinefab.model.design import Design, design_text
from vinefab.model.files.run_context import RunContext
from vinefab.model.laser import LaserProfile, Quantity, Standing
from vinefab.physics.anchoring import ASSUMED_FRICTION
from vinefab.physics.growth_pressure import FITTED, FITTED_DIAMETER_MM, NO_TENSION
from vinefab.prediction.family_deployments import MapFamily
from vinefab.prediction.prediction_width import ANGLE_TOLERANCE_DEG, LENGTH_TOLERANCE_PERCENT
from vinefab.search.record.identity import map_fingerprint, package_versions
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.reach import Reach

_MOST_NAMED = 12
"""Maps of a family are listed one by one up to so many."""


def origin_of(
    command: str,
    designs: Sequence[Design],
    profile: LaserProfile | None,
    families: Sequence[MapFamily],
) -> Origin:
    """Return where a result comes from."""
    inputs = {f"design {d.name}": sha256_of(design_text(d).encode())[:12] for d in designs}
    if profile is not None:
        inputs[f"recipe {profile.recipe.name}"] = sha256_of(repr(profile).encode())[:12]
        if any(design.build.pieces is not None for design in designs):
            bond = repr(profile.recipe.lap)  # only robots in pieces have laps
            inputs[f"bond of recipe {profile.recipe.name}"] = sha256_of(bond.encode())[:12]
    worlds = [world for family in families for world in family.worlds]
    for design in designs:
        if seen := RunContext.of(design).seen_words(worlds):
            inputs[f"training of {design.name}"] = seen
    for family in families:
        prints = [map_fingerprint(world) for world in family.worlds]
        if len(prints) <= _MOST_NAMED:
            inputs |= {
                f"map {index}: {world.name}": found
                for index, (world, found) in enumerate(zip(family.worlds, prints, strict=True), 1)
            }
        else:
            inputs[family.label] = sha256_of("".join(prints).encode())[:12]
    return Origin(command=command, inputs=inputs, versions=package_versions())


Numbers = tuple[tuple[str, Quantity], ...]


def model_assumptions(options: GrowthOptions) -> Numbers:
    """Return the numbers of the models behind predictions, by name with unit."""
    angles = dict.fromkeys(deg(angle_rad) for angle_rad in options.half_angle_range_rad)
    found, name = options.measured_half_angle, "growth.head_on_half_angle_deg"
    factor = RULES["VF-P01"].limits["safety_factor"]
    coverage, friction = Coverage(), ASSUMED_FRICTION
    yours, printed = "measure your robots", "film on printed plastic"
    own = "vinefab's own, the paper does not give it"
    return (
        *(
            _assumed(name, angle, "real robots: at most about 15")
            if found is None or angle not in _ends_of(found)
            else (name, _of_photos(found, angle))
            for angle in angles
        ),
        _assumed("making.length_tolerance_percent", LENGTH_TOLERANCE_PERCENT, yours),
        _assumed("making.angle_tolerance_deg", ANGLE_TOLERANCE_DEG, yours),
        *_contact_numbers(options),
        ("pressure.yield_kpa", FITTED.yield_kpa),
        ("pressure.drag_kpa_m", FITTED.drag_kpa_m),
        ("pressure.storage_tight_kpa", FITTED.storage_kpa),
        ("pressure.storage_loose_kpa", NO_TENSION),
        ("pressure.friction", FITTED.friction),
        ("pressure.fitted_diameter_mm", FITTED_DIAMETER_MM),
        _assumed("pressure.safety_factor", factor, "burst over allowed pressure"),
        _assumed("anchoring.friction", friction.value, printed),
        _assumed("anchoring.friction_low", friction.low, printed),
        _assumed("anchoring.friction_high", friction.high, printed),
        _assumed("coverage.sensor_radius_mm", coverage.radius_mm, own),
        _assumed("coverage.weight_area", coverage.weight_area, own),
        _assumed("coverage.weight_count", coverage.weight_count, own),
        _assumed("coverage.weight_length", coverage.weight_length, own),
        _assumed("coverage.weight_film", coverage.weight_film, own),
        _assumed("reach.buffer_mm", Reach().buffer_mm, own),
    )


def _ends_of(found: MeasuredNumber) -> list[float]:
    """Return the measurement of a number: value and interval, or the one bound."""
    bounds = {"both": [found.low, found.high], "upper": [found.high], "lower": [found.low]}
    return [*([] if found.value is None else [found.value]), *bounds[found.side]]


def _contact_numbers(options: GrowthOptions) -> Numbers:
    """Return the width of bodies: the one measured on photos and the one that growth uses."""
    contacts, ratio = options.contacts, options.body_width_ratio
    found = None if contacts is None else contacts.body_width_ratio
    rows = list[tuple[str, Quantity]]()
    if found is not None and found.value == ratio:
        rows.append(("growth.body_width_ratio", _of_photos(found, ratio)))
    elif ratio != 1.0:
        rows.append(_assumed("growth.body_width_ratio", ratio, "given with the command"))
    friction = None if contacts is None else contacts.tip_friction
    if friction is not None:
        name = "contact.tip_friction"
        rows += [(name, _of_photos(friction, end)) for end in _ends_of(friction)]
    share = None if contacts is None else contacts.emergence
    if share is not None and share.value == options.emergence:
        source = f"{share.text}; {share.source}"
        measured = Quantity(value=share.value, standing=Standing.MEASURED, source=source)
        rows.append(("growth.emergence", measured))
    elif options.emergence < 1.0:
        rows.append(_assumed("growth.emergence", options.emergence, "given with the command"))
    return tuple(rows)


def _of_photos(found: MeasuredNumber, value: float) -> Quantity:
    source = f"{found.text()}; {found.source}"
    return Quantity(value=value, standing=Standing.MEASURED, source=source)


def _assumed(name: str, value: float, source: str) -> tuple[str, Quantity]:
    return name, Quantity(value=value, standing=Standing.ASSUMED, source=source)
