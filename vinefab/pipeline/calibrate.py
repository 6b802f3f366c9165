"""From coupon results to a calibrated recipe: fitted numbers, each with its uncertainty."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.core.errors import BadInputError
from vinefab.files.results import Reading, Results
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile, RecipeStatus
from vinefab.physics.estimate import Estimate, mean
from vinefab.physics.growth_fit import GrownPath, fit_growth
from vinefab.physics.pressure import allowed_line_load_n_mm, line_load_n_mm
from vinefab.pipeline.kerf import fit_kerfs

BALLOONS_TESTED = 3
"""Burst balloons from which on a recipe counts as burst-tested; fewer show no spread (ours)."""

_LARGEST_TURN_DEG = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What coupons say of a recipe.

    Parameters
    ----------
    numbers
        Fitted numbers by their place in a recipe file (``weldcut.kerf_mm``,
        ``measured.burst_kpa``, ``growth.friction``).
    status
        How far the recipe has been tried now.
    remarks
        What else was found, for people.
    """

    numbers: Mapping[str, Estimate]
    status: RecipeStatus
    remarks: tuple[str, ...]


def calibrate(results: Results, profile: LaserProfile) -> Calibration:
    """Return what readings say of the recipe that the coupons were cut with.

    Raises
    ------
    BadInputError
        If readings are impossible, too few for what they are about, or of another recipe.
    """
    name = profile.recipe.name
    if results.recipe and results.recipe != name:
        words = f"{name}, or --recipe {results.recipe}"
        raise BadInputError("recipe of the coupons", results.recipe, words)
    if not results.readings:
        raise BadInputError("results", "no row with a value", "at least one reading")
    numbers = {
        **fit_kerfs(results, profile),
        **_burst(results),
        **_friction(results),
        **_growth(results),
    }
    status = _status(numbers, profile)
    return Calibration(numbers=numbers, status=status, remarks=tuple(_remarks(results, profile)))


def _burst(results: Results) -> dict[str, Estimate]:
    """Return the line load that a seam bears, as a burst pressure at the mean width tested."""
    readings = results.of("burst")
    if not readings:
        return {}
    widths = [
        _positive_setting(reading, "the balloon's lay-flat width in mm") for reading in readings
    ]
    pairs = list(zip(readings, widths, strict=True))
    load = mean(
        [allowed_line_load_n_mm(_pressure(r), w) for r, w in pairs],
        [None if r.sigma is None else line_load_n_mm(r.sigma, w) for r, w in pairs],
        "burst",
    )
    width_mm = math.fsum(widths) / len(widths)
    per_load = 1.0 / line_load_n_mm(1.0, width_mm)
    return {
        "measured.burst_kpa": Estimate(
            value=load.value * per_load,
            uncertainty=load.uncertainty * per_load,
            readings=len(readings),
        ),
        "measured.burst_width_mm": Estimate(
            value=width_mm, uncertainty=0.0, readings=len(readings)
        ),
    }


def _pressure(reading: Reading) -> float:
    if reading.value <= 0.0:
        raise reading.wrong(f"{reading.value:g} kPa", "a pressure above 0")
    return reading.value


def _friction(results: Results) -> dict[str, Estimate]:
    """Return the friction on the obstacle: mu = tan of the incline at which film slides."""
    readings = results.of("friction_incline")
    if not readings:
        return {}
    for reading in readings:
        if not 0.0 < reading.value < math.radians(80.0):
            raise reading.wrong(f"{math.degrees(reading.value):g} deg", "above 0, below 80 deg")
    slopes = [math.tan(reading.value) for reading in readings]
    sigmas = [
        None if reading.sigma is None else reading.sigma * (1.0 + slope**2)
        for reading, slope in zip(readings, slopes, strict=True)
    ]
    return {"measured.friction": mean(slopes, sigmas, "friction_incline")}


def _growth(results: Results) -> dict[str, Estimate]:
    readings, widths = results.of("growth"), results.of("growth_width")
    if not readings and not widths:
        return {}
    if len(widths) != 1 or not readings:
        words = "one growth_width, and the pressures along the paths that this tube was grown"
        raise BadInputError("growth", f"{len(widths)} widths, {len(readings)} paths", words)
    if widths[0].value <= 0.0:
        raise widths[0].wrong(f"{widths[0].value:g} mm", "a width above 0")
    fitted = fit_growth([_path(reading) for reading in readings])
    sigma = widths[0].sigma or 0.0
    width = Estimate(value=widths[0].value, uncertainty=sigma, readings=1)
    return {**{f"growth.{name}": e for name, e in fitted.items()}, "growth.width_mm": width}


def _path(reading: Reading) -> GrownPath:
    words = "lengths in mm and turns in deg in turn, such as 300 90 300, as setting"
    try:
        numbers = [float(word) for word in reading.setting.replace(";", " ").split()]
    except ValueError as error:
        raise reading.wrong(reading.setting, words) from error
    lengths, turns = numbers[::2], numbers[1::2]
    sound = len(numbers) % 2 == 1 and all(0.0 < length < 1e6 for length in lengths)
    if not sound or not all(abs(turn) <= _LARGEST_TURN_DEG for turn in turns):
        raise reading.wrong(reading.setting, words)
    return GrownPath(
        lengths_mm=tuple(lengths),
        turns_rad=tuple(math.radians(turn) for turn in turns),
        pressure_kpa=_pressure(reading),
        sigma_kpa=reading.sigma,
    )


def _positive_setting(reading: Reading, words: str) -> float:
    try:
        value = float(reading.setting)
    except ValueError as error:
        raise reading.wrong(reading.setting, f"{words}, as setting") from error
    if not 0.0 < value < 1e4:
        raise reading.wrong(reading.setting, f"{words}, above 0")
    return value


def _status(numbers: Mapping[str, Estimate], profile: LaserProfile) -> RecipeStatus:
    """Return how far a recipe has been tried: never less than before.

    With kerf and seam of what seals, coupons have confirmed it; with enough burst balloons as
    well, it is burst-tested.
    """
    before = profile.recipe.status
    tried = before is not RecipeStatus.UNVERIFIED or _seal_is_known(numbers, profile)
    if not tried or before is RecipeStatus.BURST_TESTED:
        return before
    burst = numbers.get("measured.burst_kpa")
    if burst is not None and burst.readings >= BALLOONS_TESTED:
        return RecipeStatus.BURST_TESTED
    return RecipeStatus.COUPON_OK


def _seal_is_known(numbers: Mapping[str, Estimate], profile: LaserProfile) -> bool:
    if Operation.WELDCUT in profile.recipe.operations:
        return {"weldcut.kerf_mm", "weldcut.seam_width_mm"} <= set(numbers)
    return "weld.seam_width_mm" in numbers


def _remarks(results: Results, profile: LaserProfile) -> list[str]:
    remarks = []
    loads = [r.value / _positive_setting(r, "strip width in mm") for r in results.of("peel")]
    if loads:
        remarks.append(f"peel: {math.fsum(loads) / len(loads):.3f} N/mm, mean of {len(loads)}")
    crotches = results.of("crotch_burst")
    if crotches:
        best = max(crotches, key=lambda reading: reading.value)
        remarks.append(f"crotches: a fillet of {best.setting} mm held most, {best.value:.1f} kPa")
    remarks += _windows(results, profile)
    return remarks


def _windows(results: Results, profile: LaserProfile) -> list[str]:
    """Return, per focus, at which line energies the plies were sealed and cut at once."""
    good: dict[float, list[float]] = {}
    for reading in results.of("matrix"):
        energy, focus = _cell(reading)
        good.setdefault(focus, [])
        if reading.word == "weldcut":
            good[focus].append(energy)
    lines = [
        f"focus {focus:g} mm: seals and cuts at {min(found):.1f} to {max(found):.1f} mJ/mm"
        if found
        else f"focus {focus:g} mm: nowhere both sealed and cut"
        for focus, found in sorted(good.items())
    ]
    settings = profile.recipe.operations.get(Operation.WELDCUT)
    if lines and settings is not None:
        power_w = profile.machine.power_w.value * settings.power_percent.value / 100.0
        energy = 1000.0 * settings.passes * power_w / settings.speed_mm_s.value
        focus = settings.focus_offset_mm.value
        lines.append(f"the recipe runs {energy:.1f} mJ/mm at focus {focus:g} mm")
    return lines


def _cell(reading: Reading) -> tuple[float, float]:
    try:
        energy, focus = (float(word) for word in reading.setting.split())
    except ValueError as error:
        words = "line energy in mJ/mm and focus offset in mm, such as 46.8 6, as setting"
        raise reading.wrong(reading.setting, words) from error
    return energy, focus
