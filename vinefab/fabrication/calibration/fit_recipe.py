"""From coupon results to a calibrated recipe: fitted numbers, each with its uncertainty.

A square cut on a path of 50 mm comes out a kerf too small; the hole that it leaves is a kerf too
large. A finger of the ladder whose outline was offset by d is w + 2 (d - s - k / 2) wide; sealed
alone, w + s (recipe) - s. What is welded then shrinks: what measures m was m (1 + e) as drawn, with
e = 1 / (1 - shrinkage) - 1. The sheet around a hole is taken not to shrink, nor is what is only cut
(assumed).
"""

import itertools
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

import scipy  # its parts load at their first use
import tomli_w

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import GENERATOR, counted, visible
from vinefab.core.validation import number as checked_number
from vinefab.core.view import Block, Data, Notes, WrittenResult
from vinefab.fabrication.calibration.coupons import SQUARE_MM, Reading, Results, joint_designs
from vinefab.fabrication.calibration.estimate import (
    GROWTH_CONSTANTS,
    Equation,
    Estimate,
    GrownPath,
    ReadingScatter,
    fit_closing,
    fit_growth,
    fit_modulus,
    mean_estimate,
    solve_equations,
)
from vinefab.fabrication.calibration.seal_grid import grid_settings
from vinefab.fabrication.job.passes import in_one_pass, weldcut_offset_mm
from vinefab.model.contacts import MeasuredShare
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import read_toml
from vinefab.model.job import Operation
from vinefab.model.laser import (
    SHRINKAGE_PERCENT,
    DerivedFor,
    EnergyWindow,
    LapMethod,
    LaserProfile,
    Material,
    RecipeStatus,
    profile_of,
)
from vinefab.model.quantity import Quantity, Standing, quantities
from vinefab.physics.growth_pressure import FITTED, FITTED_DIAMETER_MM
from vinefab.physics.tube import (
    allowed_line_load_n_mm,
    inflated_diameter_mm,
    lap_load_n_mm,
    line_load_n_mm,
)

_CUTTING = (Operation.WELDCUT, Operation.CUT)
_SEALING = (Operation.WELDCUT, Operation.WELD)
_REGAIN, _ENDS = "regain", "ends"
"""Unknowns: e, and by how much all lengths of the ladder are off alike, from seam and kerf."""


class _Parts:
    """Groups of readings, each fitted alone: one that cannot be fitted costs its own numbers."""

    def __init__(self) -> None:
        self.refused: dict[str, BadInputError] = {}

    @contextmanager
    def group(self, name: str) -> Iterator[str]:
        """Give a group's name, and note why it cannot be fitted."""
        try:
            yield name
        except BadInputError as error:
            self.refused[name] = error


def _ladder_shrinkage(results: Results) -> Estimate:
    """Return e of the ladder of lengths."""
    equations = [
        Equation(
            factors={_REGAIN: reading.value, _ENDS: 1.0},
            value=_designed_mm(reading) - reading.value,
            sigma=reading.sigma,
        )
        for reading in results.of("length")
    ]
    found = solve_equations(equations, "length")[0][_REGAIN]
    percent = _shrinkage_percent(found).value
    low, high = SHRINKAGE_PERCENT
    if not low <= percent <= high:
        raise BadInputError("shrinkage", f"{percent:.3g} %", f"{low:g} to {high:g} %")
    return found


def _shrinkage_percent(regain: Estimate) -> Estimate:
    left = 1.0 / (1.0 + regain.value)
    return Estimate(
        value=100.0 * (1.0 - left),
        uncertainty=100.0 * regain.uncertainty * left**2,
        readings=regain.readings,
        degrees=regain.degrees,
    )


def _kerfs(
    results: Results, profile: LaserProfile, regain: Estimate, parts: _Parts
) -> tuple[dict[str, Estimate], list[str]]:
    """Return kerfs and seam widths, by ``OPERATION.kerf_mm`` and so on, and remarks on them.

    Operations are fitted one by one. Where one has too few readings to scatter, and states no
    uncertainties, it takes the scatter of the operation with most.
    """
    groups: dict[str, list[Reading]] = {}
    for reading in results.readings:
        if reading.measure in ("kerf_piece", "kerf_hole", "seam", "width"):
            operation = _widths_by(profile) if reading.measure == "width" else reading.setting
            groups.setdefault(operation, []).append(reading)
    found: dict[str, Estimate] = {}
    remarks: list[str] = []
    like: ReadingScatter | None = None
    for operation, readings in sorted(groups.items(), key=lambda item: -len(item[1])):
        with parts.group(f"kerf and seam of {operation}") as key:
            equations = [_equation(reading, regain, results, profile) for reading in readings]
            numbers, spread = _block(equations, regain, key, like)
            found |= numbers
            remarks += _growing(equations, regain, profile)
            like = like or (spread if equations[0].sigma is None else None)
    return found, remarks


def _block(
    equations: Sequence[Equation], regain: Estimate, key: str, like: ReadingScatter | None
) -> tuple[dict[str, Estimate], ReadingScatter]:
    """Return the fit of one operation for a known e, its uncertainty included."""

    def solved(value: float) -> tuple[dict[str, Estimate], ReadingScatter]:
        return solve_equations([e.knowing(_REGAIN, value) for e in equations], key, like)

    numbers, spread = solved(regain.value)
    moved, _ = solved(regain.value + regain.uncertainty)
    for name, estimate in numbers.items():
        if estimate.value < 0.0:
            allowed = "0 or more: look for readings of the wrong piece, unit or operation"
            raise BadInputError(name, f"{estimate.value:.3f} mm", allowed)
        by = abs(moved[name].value - estimate.value)
        numbers[name] = estimate.widened(by, regain.degrees)
    return numbers, spread


def _growing(
    equations: Sequence[Equation], regain: Estimate, profile: LaserProfile
) -> Iterator[str]:
    """Yield a remark where sizes are off by more, the larger they are, than shrinkage explains."""
    try:
        numbers, _ = solve_equations(equations, "")
    except BadInputError:  # too few readings to tell
        return
    free = numbers.get(_REGAIN)
    if free is None:
        return
    beyond = replace(free, value=free.value - regain.value)
    beyond = beyond.widened(regain.uncertainty, regain.degrees)
    if abs(beyond.value) <= beyond.half_width(0.99):
        return
    percent = _shrinkage_percent(free)
    kerf = numbers.get("weldcut.kerf_mm")
    so = f" and a kerf of {kerf.value:.3g} mm" if kerf else ""
    if regain.readings:
        along = _shrinkage_percent(regain).value
        advice = f"the lengths say {along:.2g} %: the film shrinks unlike along and across"
    else:
        known = profile.material.shrinkage_percent
        advice = (
            f"kerf and seam above are for {known.value:g} % ({known.standing}): measure the"
            " fingers L (rows length) before you trust them"
        )
    yield (
        "warning: the larger a welded size, the more it is off; a fit of its shrinkage gives"
        f" {percent.value:.2g} +- {percent.half_width():.2g} %{so}. {advice[0].upper()}{advice[1:]}"
    )


def _equation(
    reading: Reading, regain: Estimate, results: Results, profile: LaserProfile
) -> Equation:
    """Return a reading of a kerf, a seam or a width as an equation."""
    measure, value = reading.measure, reading.value
    if measure == "width":
        grown_mm = value - _designed_mm(reading)
        if _widths_by(profile) == Operation.WELD:
            # The seam's middle runs s / 2 of the recipe outside: s = s (recipe) - what it grew by.
            drawn_mm = profile.settings(Operation.WELD).seam_width_mm.value
            factors = {"weld.seam_width_mm": 1.0, _REGAIN: value}
            return Equation(factors=factors, value=drawn_mm - grown_mm, sigma=reading.sigma)
        # s + k / 2 = d - (measured (1 + e) - w) / 2; half a width has half its uncertainty.
        return Equation(
            factors={"weldcut.seam_width_mm": 1.0, "weldcut.kerf_mm": 0.5, _REGAIN: value / 2.0},
            value=_offset_mm(results, profile) - grown_mm / 2.0,
            sigma=None if reading.sigma is None else reading.sigma / 2.0,
        )
    makes = _SEALING if measure == "seam" else _CUTTING
    known = [str(operation) for operation in makes if operation in profile.recipe.by_operation]
    if reading.setting not in known:
        raise reading.wrong(reading.setting, f"one of {', '.join(known)}, as setting")
    if measure == "seam":
        factors = {f"{reading.setting}.seam_width_mm": 1.0, _REGAIN: -value}
        return Equation(factors=factors, value=value, sigma=reading.sigma)
    factors = {f"{reading.setting}.kerf_mm": 1.0}
    kerf_mm = value - SQUARE_MM
    if measure == "kerf_piece":
        kerf_mm = SQUARE_MM - value
        factors |= {_REGAIN: value} if reading.setting in _SEALING else {}
    regained_mm = kerf_mm - regain.value * factors.get(_REGAIN, 0.0)
    if regained_mm < 0.0:
        allowed = f"a square of {SQUARE_MM:g} mm comes out smaller, its hole larger"
        raise reading.wrong(f"{value:g} mm, a kerf of {regained_mm:.3f} mm", allowed)
    return Equation(factors=factors, value=kerf_mm, sigma=reading.sigma)


def _designed_mm(reading: Reading) -> float:
    try:
        designed = float(reading.setting)
    except ValueError as error:
        raise reading.wrong(reading.setting, "the designed size in mm, as setting") from error
    if not 0.5 * designed < reading.value < 1.5 * designed:
        raise reading.wrong(f"{reading.value:g} mm", f"near the designed {designed:g} mm")
    return designed


def _widths_by(profile: LaserProfile) -> Operation:
    """Return the operation that seals the fingers of the width ladder."""
    return Operation.WELDCUT if in_one_pass(profile) else Operation.WELD


def _offset_mm(results: Results, profile: LaserProfile) -> float:
    """Return the outline's offset on the coupons: that in their table, else the recipe's."""
    recipe_mm = weldcut_offset_mm(profile)
    if results.offset_mm is None:
        return recipe_mm
    if abs(results.offset_mm - recipe_mm) > 1e-6:
        problem = (
            f"the coupons have {results.offset_mm:g}, and recipe {profile.recipe.name} has "
            f"{recipe_mm:g}"
        )
        remedy = "name the recipe that they were cut with"
        raise UnfitInputError("weldcut_offset_mm", problem, remedy)
    return recipe_mm


_MAKES = {Operation.WELD: "weld", Operation.WELDCUT: "weldcut"}
"""Outcome of a line of the matrix that is right for an operation."""


def energy_windows(results: Results, profile: LaserProfile) -> tuple[EnergyWindow, ...]:
    """Return the energies that were right, per operation of the recipe and focus offset.

    They are the longest run of neighbouring lines that were right: energies between lines that
    failed are not claimed. Without such a line the window is empty, which is a result too.
    """
    lines: dict[float, list[tuple[float, str]]] = {}
    for reading in results.of("matrix"):
        allowed = "line energy in mJ/mm and focus offset in mm, such as 46.8 6, as setting"
        energy, focus = reading.two_numbers(allowed)
        lines.setdefault(focus, []).append((energy, reading.outcome))
    beams = {name: machine for name, _, machine in profile.beams}
    by_laser = [operation for operation in _MAKES if operation in beams]
    windows = []
    for operation, (focus, found) in itertools.product(by_laser, sorted(lines.items())):
        best, run, right = list[float](), list[float](), _MAKES[operation]
        for energy in sorted({energy for energy, _ in found}):
            good = all(word == right for at, word in found if at == energy)
            run = [*run, energy] if good else []
            best = max(best, run, key=len)
        count = sum(word == right for _, word in found)
        source = (
            f"energy matrix: {count} of {counted(len(found), 'line')}, power of"
            f" {beams[operation].name}"
        )
        least, most = (
            Quantity(value=best[end], standing=Standing.MEASURED, source=source) if best else None
            for end in (0, -1)
        )
        windows.append(
            EnergyWindow(operation=operation, focus_mm=focus, least_mj_mm=least, most_mj_mm=most)
        )
    return tuple(windows)


def window_lines(windows: Sequence[EnergyWindow], profile: LaserProfile) -> list[str]:
    """Return windows as lines for the user, with the energies that the recipe runs."""
    lines = [window.words() for window in windows]
    known = {window.operation for window in windows}
    for operation, settings, machine in profile.beams:
        if operation not in known:
            continue
        energy = settings.line_energy_mj_mm(machine)
        focus = settings.focus_offset_mm.value
        lines.append(f"the recipe runs {operation} at {energy:.1f} mJ/mm, focus {focus:g} mm")
    return lines


_LEAST_LOAD_N_MM, _LARGEST_LOAD_N_MM = 1e-4, 1e4
"""Of a lap: far less and far more than any film bears."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Calibration(WrittenResult):
    """A recipe's numbers as fitted to coupon results."""

    # fitted numbers by their place in a recipe file (``weldcut.kerf_mm``, ``measured.burst_kpa``,
    # ``growth.friction``)
    fitted: Mapping[str, Estimate]
    windows: tuple[EnergyWindow, ...]  # line energies at which the matrix came out right
    status: RecipeStatus
    remarks: tuple[str, ...]  # further results, for people
    emergence: MeasuredShare | None = None  # children that came out; None if none were tried
    lap_method: LapMethod | None = None  # how the laps tested were bonded; None if none was
    refused: Mapping[str, str] = field(default_factory=dict)  # groups not fitted, and why
    path: Path | None = None  # the recipe with these numbers
    schema = "vinefab/calibration-1"

    def view(self) -> Iterator[Block]:
        """Yield the fitted numbers, remarks, and the groups that were not fitted."""
        width = max((len(name) for name in self.fitted), default=0)
        words = [f"{name:<{width}}  {number.words}" for name, number in self.fitted.items()]
        refused = [f"not fitted: {group}: {why}" for group, why in self.refused.items()]
        use = [f"use it with --recipe {self.path}"] if self.path is not None else []
        yield Notes((*words, *self.remarks, *refused, f"status: {self.status}", *use))
        yield Data(
            {
                "status": str(self.status),
                "numbers": {
                    name: {
                        "value": number.value,
                        "uncertainty": number.uncertainty,
                        "uncertainty_95": number.half_width(),
                        "readings": number.readings,
                    }
                    for name, number in self.fitted.items()
                },
                "windows": [
                    {"least_mj_mm": None, "most_mj_mm": None} | window.content
                    for window in self.windows
                ],
                "remarks": list(self.remarks),
                "refused": dict(self.refused),
            }
        )


def children_out(results: Results) -> tuple[MeasuredShare, ...]:
    """Return the share of joint coupons' children that came out, by rising pressure.

    Intervals are those of Jeffreys: quantiles of a beta distribution.
    """
    children = {joint.name: joint.branch_count - 1 for joint in joint_designs()}
    found: dict[float, tuple[int, int]] = {}
    for reading in results.of("children_out"):
        name, _, pressure = reading.setting.partition(" ")
        if name not in children:
            raise reading.wrong(name, f"a joint coupon: {', '.join(children)}")
        try:
            pressure_kpa = checked_number("pressure", float(pressure), 0.0, 1000.0, "kPa")
        except ValueError as error:
            raise reading.wrong(pressure, "the coupon and a pressure in kPa") from error
        if reading.value not in range(children[name] + 1):
            raise reading.wrong(reading.value, f"0 to {children[name]}, a whole number")
        out, tried = found.get(pressure_kpa, (0, 0))
        found[pressure_kpa] = out + int(reading.value), tried + children[name]
    shares = []
    for pressure_kpa, (out, tried) in sorted(found.items()):
        if out == 0:
            place = results.of("children_out")[0]
            raise place.wrong(f"none of {tried} at {pressure_kpa:g} kPa", "at least one came out")
        ends = [
            float(scipy.stats.beta.ppf(q, out + 0.5, tried - out + 0.5)) for q in (0.025, 0.975)
        ]
        shares.append(
            MeasuredShare(
                low=ends[0],
                high=1.0 if out == tried else ends[1],
                count=out,
                tried=tried,
                pressure_kpa=pressure_kpa,
                source="joint coupons that were grown; Jeffreys interval",
            )
        )
    return tuple(shares)


_LEAST = "measure at least one; two of kerf_piece and one of seam are enough to begin"


def fitted_recipe(results: Results, profile: LaserProfile) -> Calibration:
    """Fit the numbers of the recipe that the coupons were cut with.

    Parameters
    ----------
    results
        The table of results.
    profile
        Machine, material and the recipe of the coupons.

    Raises
    ------
    BadInputError
        If the table is for another recipe, or no group of its readings can be fitted; the error
        names group and row.
    """
    name = profile.recipe.name
    if results.recipe and results.recipe != name:
        problem = f"the coupons are of recipe {results.recipe}, and {name} is asked for"
        raise UnfitInputError("recipe", problem, f"give --recipe {results.recipe}")
    if not results.readings:
        raise UnfitInputError("value", "it is empty in every row", _LEAST)
    parts, numbers, remarks = _Parts(), dict[str, Estimate](), list[str]()
    known = profile.material.shrinkage_percent
    left = 1.0 - known.value / 100.0
    percent = known.uncertainty or 0.0
    if known.uncertainty_95 is not None:  # readings may have been few
        percent = known.uncertainty_95 / 1.96
    uncertainty = percent / 100.0 / left**2
    regain = Estimate(value=1.0 / left - 1.0, uncertainty=uncertainty, readings=0)
    with parts.group("shrinkage"):
        if results.of("length"):
            regain = _ladder_shrinkage(results)
            numbers["measured.shrinkage_percent"] = _shrinkage_percent(regain)
    kerfs, found = _kerfs(results, profile, regain, parts)
    numbers |= kerfs
    remarks += found
    for group, fit in _FITS.items():
        with parts.group(group):
            numbers |= fit(results)
    with parts.group("modulus"):
        numbers |= fit_modulus(results, profile)
    with parts.group("closing gain"):
        bent, found = fit_closing(results, profile, numbers.get("measured.modulus_mpa"))
        numbers |= bent
        remarks += found
    windows: tuple[EnergyWindow, ...] = ()
    with parts.group("energy matrix"):
        windows = energy_windows(results, profile)
        remarks += window_lines(windows, profile)
    method = None
    with parts.group("laps"):
        bond = _lap_method(results, profile)
        laps, found = _laps(results)
        numbers |= laps
        method = bond
        remarks += found
    shares: tuple[MeasuredShare, ...] = ()
    with parts.group("children out"):
        shares = children_out(results)
    remarks += [f"came out: {share.text} (measured)" for share in shares]
    if parts.refused and not numbers and not windows and not shares:
        errors = list(parts.refused.values())
        if len(errors) == 1:
            raise errors[0]
        reasons = "; ".join(f"{group}: {error}" for group, error in parts.refused.items())
        raise UnfitInputError("", "no group can be fitted", f"measure more ({reasons})")
    if kept := [place for place, number in numbers.items() if number.readings == 0]:
        remarks.append(
            f"{' and '.join(kept)}: the readings say less than the published fit (assumed for this"
            " tube), which is kept; grow the paths of the table of vinefab coupon"
        )
    return Calibration(
        fitted=numbers,
        windows=windows,
        status=_status(numbers, profile),
        remarks=tuple(remarks),
        emergence=max(shares, key=lambda share: share.tried, default=None),
        lap_method=method,
        refused={group: str(error) for group, error in parts.refused.items()},
    )


def _burst(results: Results) -> dict[str, Estimate]:
    """Return the line load that a seam bears, as a burst pressure at the mean width tested."""
    readings = results.of("burst")
    if not readings:
        return {}
    widths = [
        _positive_setting(reading, "the balloon's lay-flat width in mm") for reading in readings
    ]
    pairs = list(zip(readings, widths, strict=True))
    load = mean_estimate(
        [allowed_line_load_n_mm(_pressure(r), w) for r, w in pairs],
        [None if r.sigma is None else line_load_n_mm(r.sigma, w) for r, w in pairs],
        "burst",
    )
    width_mm = math.fsum(widths) / len(widths)
    return {
        "measured.burst_kpa": load.times(1.0 / line_load_n_mm(1.0, width_mm)),
        "measured.burst_width_mm": Estimate(
            value=width_mm, uncertainty=0.0, readings=len(readings)
        ),
    }


def _laps(results: Results) -> tuple[dict[str, Estimate], list[str]]:
    """Return the load that laps bear per millimetre of rim, the width of their band, and remarks.

    A coupon that failed elsewhere says only that its lap bears more. Where no lap failed, the mean
    load that they bore is a lower bound of their strength; where some did, it says nothing new.
    """
    found, remarks = dict[str, Estimate](), list[str]()
    bands, failed, bore = (results.of(f"lap_{kind}") for kind in ("band", "burst", "survived"))
    if bands:
        widths = [_positive(reading, "mm", "a width") for reading in bands]
        found["lap.band_mm"] = _average(widths, [reading.sigma for reading in bands])
    if failed:
        found["lap.strength_n_per_mm"] = mean_estimate(*_lap_loads(failed), "lap_burst")
    elif bore:
        found["lap.survived_n_per_mm"] = _average(*_lap_loads(bore))
    if bore:
        loads, _ = _lap_loads(bore)
        most = f"{max(loads):.3g} N/mm at most"
        remarks.append(
            f"{counted(len(bore), 'lap')} did not fail ({most}): left out of the strength"
            if failed
            else f"no lap failed ({most}): a lower bound, above which rule VF-J03 warns"
        )
    return found, remarks


def _lap_loads(readings: Sequence[Reading]) -> tuple[list[float], list[float | None]]:
    """Return the load P w / (2 pi) on each lap, and its uncertainty."""

    def lap_load(reading: Reading, width_mm: float) -> float:
        load_n_mm = lap_load_n_mm(_pressure(reading), width_mm)
        if not _LEAST_LOAD_N_MM <= load_n_mm <= _LARGEST_LOAD_N_MM:
            allowed = f"{_LEAST_LOAD_N_MM:g} to {_LARGEST_LOAD_N_MM:g} N/mm"
            raise reading.wrong(f"{load_n_mm:.3g} N/mm on the lap", allowed)
        return load_n_mm

    widths = [_positive_setting(r, "the coupon's lay-flat width in mm") for r in readings]
    pairs = list(zip(readings, widths, strict=True))
    return (
        [lap_load(r, w) for r, w in pairs],
        [None if r.sigma is None else lap_load_n_mm(r.sigma, w) for r, w in pairs],
    )


def _lap_method(results: Results, profile: LaserProfile) -> LapMethod | None:
    """Return the bonding method of the laps tested: from the table, else from the recipe."""
    bands = results.of("lap_band")
    tested = (*results.of("lap_burst"), *results.of("lap_survived"))
    known = profile.recipe.lap
    methods = {}
    for reading in bands:
        if reading.setting not in set(LapMethod):
            raise reading.wrong(reading.setting, f"{' or '.join(LapMethod)}, as setting")
        methods[LapMethod(reading.setting)] = reading
    if len(methods) > 1:
        raise bands[-1].wrong(", ".join(methods), "one method in one table")
    method = next(iter(methods), known.method if known else None)
    if tested and method is None:
        allowed = "a row lap_band: recipe {} has no [lap], so say how they were bonded"
        raise tested[0].wrong("no lap_band", allowed.format(profile.recipe.name))
    if bands and not tested and (known is None or known.method is not method):
        bond = "has no [lap]" if known is None else f"knows the strength of {known.method}"
        allowed = f"rows lap_burst or lap_survived too: recipe {profile.recipe.name} {bond}"
        raise bands[0].wrong(str(method), allowed)
    return method if bands or tested else None


def _positive(reading: Reading, unit: str, meaning: str) -> float:
    if reading.value <= 0.0:
        raise reading.wrong(f"{reading.value:g} {unit}", f"{meaning} above 0")
    return reading.value


def _pressure(reading: Reading) -> float:
    return _positive(reading, "kPa", "a pressure")


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
    return {"measured.friction": mean_estimate(slopes, sigmas, "friction_incline")}


def _growth(results: Results) -> dict[str, Estimate]:
    readings, widths = results.of("growth"), results.of("growth_width")
    readings += results.of("growth_free")
    if not readings and not widths:
        return {}
    if len(widths) != 1 or not readings:
        problem = f"{counted(len(widths), 'width')} and {counted(len(readings), 'path')} are given"
        remedy = "give one growth_width, and the pressures along the paths of this tube"
        raise UnfitInputError("growth", problem, remedy)
    width_mm = _positive(widths[0], "mm", "a width")
    published = FITTED.at_diameter(inflated_diameter_mm(width_mm), FITTED_DIAMETER_MM.value)
    usual = {name: getattr(published, name).value for name in GROWTH_CONSTANTS}
    fitted = fit_growth([_path(reading) for reading in readings], usual)
    width = Estimate(value=width_mm, uncertainty=widths[0].sigma or 0.0, readings=1)
    return {**{f"growth.{name}": e for name, e in fitted.items()}, "growth.width_mm": width}


def _path(reading: Reading) -> GrownPath:
    allowed = "lengths in mm and turns in deg in turn, such as 300 90 300, as setting"
    try:
        numbers = [float(word) for word in reading.setting.replace(";", " ").split()]
    except ValueError as error:
        raise reading.wrong(reading.setting, allowed) from error
    lengths, turns = numbers[::2], numbers[1::2]
    sound = len(numbers) % 2 == 1 and all(0.0 < length < 1e6 for length in lengths)
    most_turns_deg = 3600.0
    if not sound or not sum(map(abs, turns)) <= most_turns_deg:
        raise reading.wrong(reading.setting, allowed)
    return GrownPath(
        lengths_mm=tuple(lengths),
        turns_rad=tuple(math.radians(turn) for turn in turns),
        pressure_kpa=_pressure(reading),
        sigma_kpa=reading.sigma,
        is_free=reading.measure == "growth_free",
    )


def _positive_setting(reading: Reading, meaning: str) -> float:
    try:
        value = float(reading.setting)
    except ValueError as error:
        raise reading.wrong(reading.setting, f"{meaning}, as setting") from error
    if not 0.0 < value < 1e4:
        raise reading.wrong(reading.setting, f"{meaning}, above 0")
    return value


def _status(numbers: Mapping[str, Estimate], profile: LaserProfile) -> RecipeStatus:
    """Return the status of a recipe, never lower than before.

    With kerf and seam of the sealing operation, coupons have confirmed it. With enough burst
    balloons as well, it is burst-tested.
    """
    before = profile.recipe.status
    sealed = {"weld.seam_width_mm"}
    if Operation.WELDCUT in profile.recipe.by_operation:
        sealed = {"weldcut.kerf_mm", "weldcut.seam_width_mm"}
    tried = before is not RecipeStatus.UNVERIFIED or sealed <= set(numbers)
    if not tried or before is RecipeStatus.BURST_TESTED:
        return before
    burst = numbers.get("measured.burst_kpa")
    # Least number of burst balloons for a burst-tested recipe; fewer show no spread (our choice).
    balloons_tested = 3
    if burst is not None and burst.readings >= balloons_tested:
        return RecipeStatus.BURST_TESTED
    return RecipeStatus.COUPON_OK


def _peel(results: Results) -> dict[str, Estimate]:
    """Return the force that parts the plies, per width of the strip."""
    readings = results.of("peel")
    if not readings:
        return {}
    widths = [_positive_setting(reading, "strip width in mm") for reading in readings]
    sigmas = [
        None if r.sigma is None else r.sigma / w for r, w in zip(readings, widths, strict=True)
    ]
    loads = [r.value / w for r, w in zip(readings, widths, strict=True)]
    return {"coupons.peel_n_mm": _average(loads, sigmas)}


def _crotches(results: Results) -> dict[str, Estimate]:
    """Return the crotch fillet that held most, and the pressure that it held."""
    held: dict[float, list[Reading]] = {}
    for reading in results.of("crotch_burst"):
        radius_mm = _positive_setting(reading, "fillet radius in mm")
        _pressure(reading)
        held.setdefault(radius_mm, []).append(reading)
    if not held:
        return {}
    burst = {
        radius: _average([r.value for r in readings], [r.sigma for r in readings])
        for radius, readings in held.items()
    }
    best = max(burst, key=lambda radius: (burst[radius].value, -radius))
    radius = Estimate(value=best, uncertainty=0.0, readings=burst[best].readings)
    return {"coupons.crotch_burst_kpa": burst[best], "coupons.crotch_fillet_mm": radius}


def _average(values: Sequence[float], sigmas: Sequence[float | None]) -> Estimate:
    """Return a mean that nothing is predicted from: one reading without uncertainty will do.

    The worse of scatter and stated uncertainties counts; 0 where there is neither.
    """
    count = len(values)
    scatter = stdev(values) / math.sqrt(count) if count > 1 else 0.0
    stated = math.hypot(*(sigma or 0.0 for sigma in sigmas)) / count
    return Estimate(
        value=fmean(values),
        uncertainty=max(scatter, stated),
        readings=count,
        degrees=count - 1.0 if scatter > stated else math.inf,
    )


_FITS = {
    "burst": _burst,
    "friction": _friction,
    "growth": _growth,
    "peel": _peel,
    "crotch": _crotches,
    "grid": grid_settings,
}
"""Fits of groups that need nothing but their own readings."""


_OWN_TABLES = ("measured", "growth", "coupons", "lap")


def calibrated_recipe(
    calibration: Calibration, recipe: str | Path, out: Path, results: Path
) -> str:
    """Return a recipe file with fitted numbers as text, read back to be sure that it is valid."""
    if out.suffix != ".toml":
        raise BadInputError("--out", str(out), "a file that ends in .toml")
    document = read_toml(locate("recipe", recipe))
    before = document["name"]
    document["name"] = visible(out.stem)
    document["status"] = str(calibration.status)
    document["source"] = f"{before}, calibrated with {results.name}; before: {document['source']}"
    for place, estimate in calibration.fitted.items():
        table, key = place.split(".")
        spread = {}
        if estimate.uncertainty > 0.0:
            spread["uncertainty"] = float(f"{estimate.uncertainty:.3g}")
            spread["uncertainty_95"] = float(f"{estimate.half_width():.3g}")
        measured = f"{results.name}: {counted(estimate.readings, 'reading')}"
        kept = f"published fit, scaled to this tube: {results.name} does not say"
        _table(document, table)[key] = Quantity(
            value=float(f"{estimate.value:.6g}"),
            standing=Standing.MEASURED if estimate.readings else Standing.ASSUMED,
            source=measured if estimate.readings else kept,
            **spread,
        ).content
    if calibration.windows:
        windows = []
        for window in calibration.windows:  # its ends name the file of their readings
            ends = quantities(window).items()
            named = {k: end.changed(source=f"{results.name}: {end.source}") for k, end in ends}
            windows.append(window.changed(**named).content)
        _table(document, "coupons")["windows"] = windows
    if calibration.lap_method is not None:
        # The bond of the laps tested; no load of another bond or of less standing is left.
        lap = document["lap"]
        changed = lap.get("method", "") != calibration.lap_method
        lap["method"] = str(calibration.lap_method)
        measured = lap.get("strength_n_per_mm", {}).get("standing") == Standing.MEASURED
        if "lap.strength_n_per_mm" in calibration.fitted:
            stale = "survived_n_per_mm" if changed else ""
        else:
            # What laps bore counts where none failed: it takes the place of an assumed strength.
            bore = "lap.survived_n_per_mm" in calibration.fitted
            stale = "strength_n_per_mm" if bore and (changed or not measured) else ""
        lap.pop(stale, None)
    _derive_for_film(document, calibration, profile_of(document, out).material)
    text = f"# {GENERATOR}\n{tomli_w.dumps(document)}"
    profile_of(tomllib.loads(text), out)
    return text


def _derive_for_film(document: dict[str, Any], calibration: Calibration, film: Material) -> None:
    """Note in a recipe the film that its coupons were cut from, if they measured its seam."""
    if not any(place.endswith(("kerf_mm", "seam_width_mm")) for place in calibration.fitted):
        return
    known = document.get("derived_for")
    if known is None or DerivedFor.model_validate(known).is_other(film):
        # Energies that were estimated for another film are left out.
        document["derived_for"] = {"film_mm": round(film.film_mm, 6)}


def _table(document: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the table of a recipe file that holds an operation's settings, or other numbers."""
    if name in _OWN_TABLES:
        found: dict[str, Any] = document.setdefault(name, {})
        return found
    operations: dict[str, Any] = document.get("operations", {})
    by_hand = {"weld": ("sealer", "hot_tip"), "cut": ("knife",)}
    tables = (document[one] for one in (name, *by_hand.get(name, ())) if one in document)
    table: dict[str, Any] = operations[name] if name in operations else next(tables)
    return table
