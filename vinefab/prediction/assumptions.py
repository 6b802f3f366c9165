"""What predictions rest on beside the laser profile: every number with its standing."""

from vinefab.core.units import deg
from vinefab.fabrication.rules.catalog import RULES
from vinefab.growth.options import GrowthOptions
from vinefab.model.laser import Quantity, Standing
from vinefab.physics.anchoring import ASSUMED_FRICTION
from vinefab.physics.growth_pressure import FITTED, FITTED_DIAMETER_MM, NO_TENSION
from vinefab.prediction.sensitivity import ANGLE_TOLERANCE_DEG, LENGTH_TOLERANCE_PERCENT
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.reach import Reach

Numbers = tuple[tuple[str, Quantity], ...]


def model_assumptions(options: GrowthOptions) -> Numbers:
    """Return the numbers of the models behind predictions, by name with unit."""
    return (*_growth_numbers(options), *_pressure_numbers(), *_task_numbers())


def _growth_numbers(options: GrowthOptions) -> Numbers:
    half_angle = deg(options.head_on_half_angle_rad)
    return (
        _assumed("growth.head_on_half_angle_deg", half_angle, "real robots: at most about 15"),
        _assumed(
            "making.length_tolerance_percent", LENGTH_TOLERANCE_PERCENT, "measure your robots"
        ),
        _assumed("making.angle_tolerance_deg", ANGLE_TOLERANCE_DEG, "measure your robots"),
    )


def _pressure_numbers() -> Numbers:
    factor = RULES["VF-P01"].limits["safety_factor"]
    return (
        ("pressure.yield_kpa", FITTED.yield_kpa),
        ("pressure.drag_kpa_m", FITTED.drag_kpa_m),
        ("pressure.storage_tight_kpa", FITTED.storage_kpa),
        ("pressure.storage_loose_kpa", NO_TENSION),
        ("pressure.friction", FITTED.friction),
        ("pressure.fitted_diameter_mm", FITTED_DIAMETER_MM),
        _assumed("pressure.safety_factor", factor, "burst over allowed pressure"),
    )


def _task_numbers() -> Numbers:
    coverage, friction = Coverage(), ASSUMED_FRICTION
    own = "vinefab's own, the paper does not give it"
    return (
        _assumed("anchoring.friction", friction.value, "film on printed plastic"),
        _assumed("anchoring.friction_low", friction.low, "film on printed plastic"),
        _assumed("anchoring.friction_high", friction.high, "film on printed plastic"),
        _assumed("coverage.sensor_radius_mm", coverage.radius_mm, own),
        _assumed("coverage.weight_area", coverage.weight_area, own),
        _assumed("coverage.weight_count", coverage.weight_count, own),
        _assumed("coverage.weight_length", coverage.weight_length, own),
        _assumed("coverage.weight_film", coverage.weight_film, own),
        _assumed("reach.buffer_mm", Reach().buffer_mm, own),
    )


def _assumed(name: str, value: float, source: str) -> tuple[str, Quantity]:
    return name, Quantity(value=value, standing=Standing.ASSUMED, source=source)
