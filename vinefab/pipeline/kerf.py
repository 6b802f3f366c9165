"""Kerf and seam from coupons: squares, rims under the loupe and the width ladder, fitted together.

A square cut on a path of 50 mm comes out a kerf too small; the hole that it leaves is a kerf too
large. A finger of the ladder whose outline was offset by d is w + 2 (d - s - k / 2) wide.
"""

from collections.abc import Iterator

from vinefab.core.errors import BadInputError
from vinefab.files.results import Reading, Results
from vinefab.geometry.coupon import SQUARE_MM
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile
from vinefab.physics.estimate import Equation, Estimate, solve

_CUTTING = (Operation.WELDCUT, Operation.CUT)
_SEALING = (Operation.WELDCUT, Operation.WELD)


def fit_kerfs(results: Results, profile: LaserProfile) -> dict[str, Estimate]:
    """Return the kerfs and seam widths that readings give, by ``OPERATION.kerf_mm`` and so on.

    Parameters
    ----------
    results
        The readings.
    profile
        The recipe that the coupons were cut with.

    Raises
    ------
    BadInputError
        If a reading is impossible, or the readings cannot tell kerf and seam apart.
    """
    equations = list(_equations(results, profile))
    if not equations:
        return {}
    found = solve(equations, "kerf and seam")
    for name, estimate in found.items():
        if estimate.value < 0.0:
            words = "0 or more: look for readings of the wrong piece, unit or operation"
            raise BadInputError(name, f"{estimate.value:.3f} mm", words)
    return found


def _equations(results: Results, profile: LaserProfile) -> Iterator[Equation]:
    for reading in results.of("kerf_piece"):
        yield _equation(reading, {_kerf(reading, profile): 1.0}, SQUARE_MM - reading.value)
    for reading in results.of("kerf_hole"):
        yield _equation(reading, {_kerf(reading, profile): 1.0}, reading.value - SQUARE_MM)
    for reading in results.of("seam"):
        operation = _operation(reading, _SEALING, profile)
        yield _equation(reading, {f"{operation}.seam_width_mm": 1.0}, reading.value)
    for reading in results.of("width"):
        offset_mm = _offset_mm(results, reading, profile)
        # s + k / 2 = d - (measured - w) / 2; half a width has half its uncertainty.
        target = offset_mm - (reading.value - _width_mm(reading)) / 2.0
        sigma = None if reading.sigma is None else reading.sigma / 2.0
        factors = {"weldcut.seam_width_mm": 1.0, "weldcut.kerf_mm": 0.5}
        yield Equation(factors=factors, value=target, sigma=sigma)


def _equation(reading: Reading, factors: dict[str, float], value: float) -> Equation:
    if value < 0.0:
        words = f"a square of {SQUARE_MM:g} mm comes out smaller, its hole larger"
        raise reading.wrong(f"{reading.value:g} mm, a kerf of {value:.3f} mm", words)
    return Equation(factors=factors, value=value, sigma=reading.sigma)


def _kerf(reading: Reading, profile: LaserProfile) -> str:
    return f"{_operation(reading, _CUTTING, profile)}.kerf_mm"


def _operation(reading: Reading, allowed: tuple[Operation, ...], profile: LaserProfile) -> str:
    known = [str(operation) for operation in allowed if operation in profile.recipe.operations]
    if reading.setting not in known:
        raise reading.wrong(reading.setting, f"one of {', '.join(known)}, as setting")
    return reading.setting


def _width_mm(reading: Reading) -> float:
    try:
        width = float(reading.setting)
    except ValueError as error:
        raise reading.wrong(reading.setting, "the designed width in mm, as setting") from error
    if not 0.5 * width < reading.value < 1.5 * width:
        raise reading.wrong(f"{reading.value:g} mm", f"near the designed {width:g} mm")
    return width


def _offset_mm(results: Results, reading: Reading, profile: LaserProfile) -> float:
    """Return the outline's offset on the coupons: what their table says, else the recipe's."""
    settings = profile.recipe.operations.get(Operation.WELDCUT)
    if settings is None:
        raise reading.wrong(reading.setting, "a recipe that cuts and seals in one pass")
    recipe_mm = settings.seam_width_mm.value + settings.kerf_mm.value / 2.0
    if results.offset_mm is None:
        return recipe_mm
    if abs(results.offset_mm - recipe_mm) > 1e-6:
        raise BadInputError(
            "weldcut_offset_mm",
            results.offset_mm,
            f"{recipe_mm:g}, that of recipe {profile.recipe.name}; name the recipe that the"
            " coupons were cut with",
        )
    return recipe_mm
