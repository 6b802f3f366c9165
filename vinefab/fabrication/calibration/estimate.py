"""Numbers fitted to readings, with their uncertainties.

A trunk of lay-flat width W has the hoop strain c p W / (pi t), with c = 1 / E. Its girth at some
pressure over that at another one tells c: a rim that stands off, or a paper strip's thickness,
adds alike to both. Angles hardly depend on the strain, so they tell the gain g alone:
deployed = flat + g (simulated - flat).
"""

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import agreeing, counted
from vinefab.core.validation import Floats
from vinefab.fabrication.calibration.coupons import Reading, Results, joint_designs
from vinefab.inflation.compensation import deployed_joint
from vinefab.inflation.mesh import tube_stretch
from vinefab.inflation.robot import joints_of
from vinefab.model.laser import CLOSING_GAIN, LaserProfile
from vinefab.physics.tube import hoop_strain


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A fitted number."""

    value: float
    uncertainty: float  # one standard deviation, in the same unit
    readings: int  # number of readings; 0 for a number that was kept from elsewhere
    # Degrees of freedom of the uncertainty; infinite where the readings' own are stated.
    degrees: float = math.inf

    @property
    def words(self) -> str:
        """The number with half of its 95 % interval and its standing."""
        if self.readings == 0:
            return f"{self.value:.4g}  assumed"
        half = f" +- {self.half_width():.2g} (95 %)" if self.uncertainty > 0.0 else ""
        return f"{self.value:.4g}{half}  measured, {counted(self.readings, 'reading')}"

    def half_width(self, level: float = 0.95) -> float:
        """Return half of the interval by Student's t that holds the truth so often."""
        return float(scipy.special.stdtrit(self.degrees, 0.5 * (1.0 + level))) * self.uncertainty

    def times(self, factor: float) -> "Estimate":
        """Return the number in another unit."""
        return replace(self, value=self.value * factor, uncertainty=self.uncertainty * abs(factor))

    def widened(self, uncertainty: float, degrees: float) -> "Estimate":
        """Return the number with an independent uncertainty added (Welch and Satterthwaite)."""
        parts = (self.uncertainty, self.degrees), (uncertainty, degrees)
        total = math.hypot(self.uncertainty, uncertainty)
        lost = sum((u / total) ** 4 / free for u, free in parts) if total > 0.0 else 0.0
        return replace(self, uncertainty=total, degrees=1.0 / lost if lost > 0.0 else math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Equation:
    """One reading as an equation: the unknowns, times factors, add up to it."""

    factors: Mapping[str, float]  # factor of each unknown, by name
    value: float  # the reading
    sigma: float | None = None  # its standard uncertainty

    def knowing(self, name: str, value: float) -> "Equation":
        """Return the equation with one of its unknowns known."""
        others = {other: f for other, f in self.factors.items() if other != name}
        return replace(self, factors=others, value=self.value - value * self.factors.get(name, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingScatter:
    """How far readings without stated uncertainties lie from their fit."""

    deviation: float
    degrees: float


def mean_estimate(values: Sequence[float], sigmas: Sequence[float | None], key: str) -> Estimate:
    """Return the mean of readings of one number.

    Examples
    --------
    >>> mean_estimate([1.0, 2.0, 3.0], [None, None, None], "x").value
    2.0
    """
    rows = [
        Equation(factors={key: 1.0}, value=value, sigma=sigma)
        for value, sigma in zip(values, sigmas, strict=True)
    ]
    return solve_equations(rows, key)[0][key]


def solve_equations(
    equations: Sequence[Equation], key: str, like: ReadingScatter | None = None
) -> tuple[dict[str, Estimate], ReadingScatter]:
    """Return unknowns by linear least squares, and the scatter that their uncertainties rest on.

    Readings with stated uncertainties are weighted by them, and the result's uncertainty is never
    less than that of the scatter (Birge's ratio). Without stated ones it follows from the scatter,
    or from that of other readings ``like`` them where as many unknowns as readings leave none.
    """
    names = sorted({name for equation in equations for name in equation.factors})
    sigmas = [equation.sigma for equation in equations]
    weights = stated_weights(sigmas, len(names) - (like is not None), key)
    matrix = np.array([[e.factors.get(name, 0.0) for name in names] for e in equations])
    target = np.array([equation.value for equation in equations])
    rows, goal = matrix * weights[:, None], target * weights
    singular = np.linalg.svd(rows, compute_uv=False)
    least_singular = 1e-9
    if len(equations) < len(names) or singular[-1] < least_singular * singular[0]:
        problem = f"{counted(len(equations), 'reading')} do not tell {' and '.join(names)} apart"
        raise UnfitInputError(key, problem, "add readings of other pieces")
    found, *_ = np.linalg.lstsq(rows, goal, rcond=None)
    stated = sigmas[0] is not None
    spread = like
    if spread is None or stated or len(equations) > len(names):
        spread = scatter(rows @ found - goal, len(names), stated=stated)
    deviations = spread.deviation * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    counts = np.count_nonzero(matrix, axis=0)
    estimates = {
        name: Estimate(
            value=float(v), uncertainty=float(u), readings=int(count), degrees=spread.degrees
        )
        for name, v, u, count in zip(names, found, deviations, counts, strict=True)
    }
    return estimates, spread


def stated_weights(sigmas: Sequence[float | None], unknowns: int, key: str) -> Floats:
    """Return one over each reading's uncertainty, or ones where none is stated."""
    stated = [sigma for sigma in sigmas if sigma is not None]
    if stated and len(stated) < len(sigmas):
        problem = f"{len(stated)} of {len(sigmas)} readings have one"
        raise UnfitInputError(f"{key} uncertainty", problem, "give all of them one, or none")
    if not stated and len(sigmas) <= unknowns:
        sure = f"how sure {counted(unknowns, 'unknown')} {agreeing(unknowns, 'is', 'are')}"
        problem = f"{counted(len(sigmas), 'reading')} cannot tell {sure}"
        raise UnfitInputError(key, problem, f"give {unknowns + 1} or more, or their uncertainty")
    if any(sigma <= 0.0 for sigma in stated):
        raise BadInputError(f"{key} uncertainty", min(stated), "above 0")
    return 1.0 / np.array(stated) if stated else np.ones(len(sigmas))


def scatter(residuals: Floats, unknowns: int, *, stated: bool) -> ReadingScatter:
    """Return the scatter of weighted residuals; at least 1 where sigmas are stated."""
    free = len(residuals) - unknowns
    found = math.sqrt(float(residuals @ residuals) / free) if free > 0 else 1.0
    if stated and found <= 1.0:
        return ReadingScatter(deviation=1.0, degrees=math.inf)
    return ReadingScatter(deviation=found, degrees=max(free, 1))


GROWTH_CONSTANTS = ("yield_kpa", "drag_kpa_m", "storage_kpa", "friction")
"""Y, f, T and mu, as in `vinefab.physics.growth_pressure.GrowthConstants`."""

_MOST = (1000.0, 1000.0, 1000.0, 5.0)

_GAUGE_KPA, _GAUGE_SHARE = 0.2, 0.03
"""Noise of pressures without stated uncertainty (assumed): their scatter sets its size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GrownPath:
    """A path along which a tube was grown, and the pressure that it took."""

    lengths_mm: tuple[float, ...]  # straight pieces, base first
    turns_rad: tuple[float, ...]  # the turns between them
    pressure_kpa: float  # pressure at which it just grew at the end
    sigma_kpa: float | None = None  # standard uncertainty of that, or None
    # Whether the film's end has left its store: nothing holds it back, so that T is 0.
    is_free: bool = False


def fit_growth(paths: Sequence[GrownPath], usual: Mapping[str, float]) -> dict[str, Estimate]:
    """Return Y, f, T and mu with their uncertainties, by name.

    A constant of which the readings say less than its usual value does keeps that value, as one
    that was not measured: the interval of its fit is wider. The others are fitted again, and the
    doubt of the kept values is added to theirs.

    Parameters
    ----------
    usual
        Values of the four in tubes of others.
    """
    kept: dict[str, Estimate] = {}
    # Standard uncertainty of a constant that another tube had, over its value (assumed).
    usual_doubt = 0.5
    while len(kept) < len(GROWTH_CONSTANTS):
        found = _fit_some(paths, {name: one.value for name, one in kept.items()})
        doubt = {name: one.half_width() / usual[name] for name, one in found.items()}
        worst = max(doubt, key=lambda name: doubt[name])
        if doubt[worst] <= 1.0:
            break
        kept[worst] = Estimate(
            value=usual[worst], uncertainty=usual_doubt * usual[worst], readings=0
        )
    else:
        problem = f"{counted(len(paths), 'path')} are too alike"
        remedy = "add paths that differ in length and in their turns, some without turns"
        raise UnfitInputError("growth", problem, remedy)
    centre = {name: one.value for name, one in found.items()}
    for name, one in kept.items():
        values = {other: constant.value for other, constant in kept.items()}
        moved = _fit_some(paths, {**values, name: one.value + one.uncertainty})
        for fitted, away in moved.items():
            by = abs(away.value - centre[fitted])
            found[fitted] = found[fitted].widened(by, math.inf)
    return {name: kept.get(name) or found[name] for name in GROWTH_CONSTANTS}


def _fit_some(paths: Sequence[GrownPath], known: Mapping[str, float]) -> dict[str, Estimate]:
    """Return the constants that are not known, fitted together, none below zero.

    For a given mu the pressure is linear in Y, f and T.
    """
    names = [name for name in GROWTH_CONSTANTS if name not in known]
    weights = stated_weights([path.sigma_kpa for path in paths], len(GROWTH_CONSTANTS), "growth")
    if len(paths) < len(GROWTH_CONSTANTS):
        problem = f"{counted(len(paths), 'path')} cannot tell 4 unknowns (Y, f, T, mu)"
        raise UnfitInputError("growth", problem, "measure at least 4 paths")
    measured = np.array([path.pressure_kpa for path in paths])
    stated = paths[0].sigma_kpa is not None
    if not stated:
        weights = 1.0 / np.hypot(_GAUGE_KPA, _GAUGE_SHARE * measured)

    def residuals(fitted: Floats) -> Floats:
        values = {**known, **dict(zip(names, fitted.tolist(), strict=True))}
        yield_kpa, drag_kpa_m, storage_kpa, friction = (values[name] for name in GROWTH_CONSTANTS)
        found = []
        for path in paths:
            tension = 0.0 if path.is_free else storage_kpa
            for length, turn in zip(path.lengths_mm, path.turns_rad, strict=False):
                tension = (tension + drag_kpa_m * length / 1000.0) * math.exp(friction * abs(turn))
            found.append(yield_kpa + tension + drag_kpa_m * path.lengths_mm[-1] / 1000.0)
        away: Floats = (np.array(found) - measured) * weights
        return away

    start = dict(
        zip(GROWTH_CONSTANTS, (0.3 * measured.min(), 0.5, 0.6 * measured.min(), 0.25), strict=True)
    )
    solved = scipy.optimize.least_squares(
        residuals,
        [start[name] for name in names],
        bounds=(
            0.0,
            [most for name, most in zip(GROWTH_CONSTANTS, _MOST, strict=True) if name in names],
        ),
        x_scale="jac",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    jacobian = np.asarray(solved.jac)
    spread = scatter(np.asarray(solved.fun), len(names), stated=stated)
    scale = np.maximum(np.abs(solved.x), 1e-3)
    _, singular, directions = np.linalg.svd(jacobian * scale)
    least_singular_of_fit = 1e-6
    if singular[-1] <= least_singular_of_fit * singular[0]:
        # Nothing tells the constants along one direction: the one that moves most there is unknown.
        deviations = np.where(np.abs(directions[-1]).argmax() == np.arange(len(names)), np.inf, 0.0)
    else:
        deviations = spread.deviation * scale * np.linalg.norm(directions.T / singular, axis=1)
    return {
        name: Estimate(
            value=float(value), uncertainty=float(u), readings=len(paths), degrees=spread.degrees
        )
        for name, value, u in zip(names, solved.x, deviations, strict=True)
    }


_STRAINS = (0.002, 0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.14, 0.2, 0.3, 0.5, 0.7)
"""Strains at which joints are simulated; between them angles are interpolated, beyond them kept."""


_COMPLIANCE = "stretch"


def fit_modulus(results: Results, profile: LaserProfile) -> dict[str, Estimate]:
    """Return the film's modulus from girths of trunks at two or more pressures.

    Raises
    ------
    BadInputError
        If the girths grow by too little to tell it, which gives a lower bound, or by more than is
        simulated.
    """
    stretched = _compliance(results, profile)
    if stretched is None:
        return {}
    found, most_load = stretched
    strain = found.value * most_load
    if strain > _STRAINS[-1]:
        allowed = f"at most {_STRAINS[-1]:g}: measure girths at less pressure"
        raise BadInputError("hoop strain", f"{strain:.2g}", allowed)
    half = found.half_width()
    # Half of the 95 % interval of a modulus, over its value: with more it is not told. Of intervals
    # as wide as 0.5 that are told, one in seven does not hold the truth: those told are those too
    # large.
    most_doubt = 0.35
    if half > most_doubt * found.value:
        least = 1.0 / max(found.value + half, 1e-9)
        problem = (
            f"girths stretch by {found.value:.2g} +- {half:.2g} per MPa (95 %), no more than they "
            f"scatter: the modulus is above {least:.2g} MPa"
        )
        raise UnfitInputError(
            "modulus_mpa", problem, "take the highest pressure that the seam bears"
        )
    modulus = 1.0 / found.value
    return {
        "measured.modulus_mpa": replace(
            found, value=modulus, uncertainty=found.uncertainty * modulus**2
        )
    }


def _compliance(results: Results, profile: LaserProfile) -> tuple[Estimate, float] | None:
    """Return one over the modulus by the girths, and the largest strain times the modulus.

    It may be negative, or far beyond what is simulated: girths tell a range even so.
    """
    readings = results.of("joint_girth")
    if not readings:
        return None
    loads = [_girth_load(reading, profile) for reading in readings]
    most_load = max(load for _, load in loads)
    compliance = 1.0 / profile.material.modulus_mpa.value
    iterations = 30
    most_solved = 1.5  # largest strain that the fit tries
    for _ in range(iterations):
        equations = [
            _girth_equation(reading, width_mm, load, compliance)
            for reading, (width_mm, load) in zip(readings, loads, strict=True)
        ]
        found = solve_equations(equations, "joint_girth")[0][_COMPLIANCE]
        # The logarithm of a girth bends downwards: halved steps keep the first ones in range.
        new = max(found.value, compliance / 2.0, 1e-9)
        new = min(new, compliance * 2.0, most_solved / most_load)
        if abs(new - compliance) <= 1e-9 * compliance:
            break
        compliance = new
    return found, most_load


def _girth_load(reading: Reading, profile: LaserProfile) -> tuple[float, float]:
    """Return the width of a trunk and its hoop strain times the modulus, in MPa."""
    try:
        width_mm, kpa = (float(word) for word in reading.setting.split())
    except ValueError as error:
        allowed = "width of the trunk in mm and pressure in kPa, such as 20 2, as setting"
        raise reading.wrong(reading.setting, allowed) from error
    if not (0.0 < width_mm <= 1e3 and 0.0 < kpa <= 1e3):
        raise reading.wrong(reading.setting, "width and pressure above 0, at most 1000")
    if not 1.5 * width_mm < reading.value < 4.0 * width_mm:
        raise reading.wrong(f"{reading.value:g} mm", f"near the flat girth, {2.0 * width_mm:g} mm")
    return width_mm, hoop_strain(kpa, width_mm, profile.material.ply_mm.value, 1.0)


def _girth_equation(reading: Reading, width_mm: float, load: float, compliance: float) -> Equation:
    """Return a girth as a linear equation near some compliance."""
    here, there = (math.log(tube_stretch(c * load)[0]) for c in (compliance, 1.001 * compliance))
    slope = (there - here) / (0.001 * compliance)
    return Equation(
        factors={f"girth of {width_mm:g} mm": 1.0, _COMPLIANCE: slope},
        value=math.log(reading.value) - here + slope * compliance,
        sigma=None if reading.sigma is None else reading.sigma / reading.value,
    )


@dataclass(frozen=True, slots=True)
class _Bend:
    """A measured angle, and its simulated values."""

    name: str
    flat_deg: float
    deployed_deg: float
    load: float  # hoop strain times the modulus, MPa
    sigma_deg: float | None

    def simulated_deg(self, modulus_mpa: float) -> float:
        """Return the deployed angle."""
        strain = min(max(self.load / modulus_mpa, _STRAINS[0]), _STRAINS[-1])
        above = max(1, bisect_left(_STRAINS, strain))
        ends = _STRAINS[above - 1], _STRAINS[above]
        return float(np.interp(strain, ends, [_opened_deg(self.name, one) for one in ends]))


def fit_closing(
    results: Results, profile: LaserProfile, modulus: Estimate | None
) -> tuple[dict[str, Estimate], list[str]]:
    """Return the closing gain from deployed angles, and remarks.

    Parameters
    ----------
    modulus
        As measured; None: the material's, whose uncertainty widens that of the gain.
    """
    bends = [_bend(reading, profile) for reading in results.of("joint_angle")]
    if not bends:
        return {}, []
    remarks = []

    def solved(modulus_mpa: float) -> Estimate:
        simulated_deg = 0.4  # by how much simulated angles differ with the mesh
        equations = [
            Equation(
                factors={"gain": bend.simulated_deg(modulus_mpa) - bend.flat_deg},
                value=bend.deployed_deg - bend.flat_deg,
                sigma=None if bend.sigma_deg is None else math.hypot(bend.sigma_deg, simulated_deg),
            )
            for bend in bends
        ]
        return solve_equations(equations, "joint_angle")[0]["gain"]

    if modulus is not None:
        known_mpa, ends_mpa, degrees = (
            modulus.value,
            (modulus.value - modulus.uncertainty, modulus.value + modulus.uncertainty),
            modulus.degrees,
        )
    else:
        known_mpa, ends_mpa, remark = _unmeasured(results, profile)
        degrees = math.inf
        remarks.append(remark)
    gain = solved(known_mpa)
    # The gain bends with the modulus: the end that moves it farther counts.
    moved = max(abs(solved(end).value - gain.value) for end in ends_mpa)
    gain = gain.widened(moved, degrees)
    low, high = CLOSING_GAIN
    if not low <= gain.value <= high:
        allowed = f"{low:g} to {high:g}: look for angles of the wrong coupon or between other axes"
        raise BadInputError("closing_gain", f"{gain.value:.3g}", allowed)
    off = [
        bend.deployed_deg
        - bend.flat_deg
        - gain.value * (bend.simulated_deg(known_mpa) - bend.flat_deg)
        for bend in bends
    ]
    worst = max(range(len(off)), key=lambda place: abs(off[place]))
    remarks.append(
        f"joint angles lie {math.sqrt(float(np.mean(np.square(off)))):.1f} deg (rms) from simulated"
        f" ones with this gain; {bends[worst].name} the furthest, {off[worst]:+.1f} deg"
    )
    return {"measured.closing_gain": gain}, remarks


def _unmeasured(results: Results, profile: LaserProfile) -> tuple[float, tuple[float, float], str]:
    """Return a modulus that was not measured, what one standard deviation leaves, and a remark.

    Girths that do not tell the modulus still bound it: the assumed one counts within their range.
    """
    given = profile.material.modulus_mpa
    assumed_doubt = 0.5  # standard uncertainty of an assumed modulus over its value (assumed)
    doubt = given.uncertainty or assumed_doubt * given.value
    ends = max(given.value - doubt, 0.1 * given.value), given.value + doubt
    stretched = None
    with suppress(BadInputError):  # too few girths: `fit_modulus` says so
        stretched = _compliance(results, profile)
    if stretched is None:
        return (
            given.value,
            ends,
            f"closing gain: for a modulus of {given.value:g} MPa ({given.standing}); measure girths"
            " too (rows joint_girth)",
        )
    found, most_load = stretched
    # Largest strain, over the largest simulated, at which angles still count as those there.
    most_kept = 1.1
    if found.value * most_load > most_kept * _STRAINS[-1]:
        allowed = f"at most {_STRAINS[-1]:g}: measure girths and angles at less pressure"
        raise BadInputError("hoop strain", f"{found.value * most_load:.2g}", allowed)
    # Angles are kept beyond the strains that are simulated: no modulus farther out matters.
    stiff, soft = (most_load / end for end in (_STRAINS[0] / 2.0, 2.0 * _STRAINS[-1]))
    half = found.half_width()
    low = min(max(1.0 / max(found.value + half, 1e-9), soft), stiff)
    high = min(max(1.0 / max(found.value - half, 1e-9), soft), stiff)
    # Strains count by their logarithm. All of the range is about as likely: its ends are 1.5
    # deviations away.
    middle = min(max(given.value, low), high) if low < given.value < high else math.sqrt(low * high)
    even = 2.0 / 3.0
    return (
        middle,
        (middle * (low / middle) ** even, middle * (high / middle) ** even),
        f"closing gain: girths tell only that the modulus is {low:.2g} to {high:.2g} MPa",
    )


def _bend(reading: Reading, profile: LaserProfile) -> _Bend:
    known = {joint.name: joint for joint in joint_designs()}
    try:
        name, pressure = reading.setting.split()
        joint, kpa = known[name], float(pressure)
    except (KeyError, ValueError) as error:
        allowed = f"one of {', '.join(known)}, and the pressure in kPa, as setting"
        raise reading.wrong(reading.setting, allowed) from error
    if not 0.0 < kpa <= 1e3:
        raise reading.wrong(reading.setting, "a pressure above 0, at most 1000 kPa")
    deployed_deg = math.degrees(reading.value)
    if deployed_deg > 360.0:
        raise reading.wrong(f"{deployed_deg:g} deg", "0 to 360 deg")
    width_mm = joint.build.widths_mm[0]
    return _Bend(
        name=name,
        flat_deg=_between(np.degrees(joint.tree.offset_rad[1:]).tolist()),
        deployed_deg=deployed_deg,
        load=hoop_strain(kpa, width_mm, profile.material.ply_mm.value, 1.0),
        sigma_deg=None if reading.sigma is None else math.degrees(reading.sigma),
    )


@cache
def _opened_deg(name: str, strain: float) -> float:
    """Return the simulated angle of a coupon at the hoop strain of its trunk."""
    design = next(joint for joint in joint_designs() if joint.name == name)
    (joint,) = joints_of(design)
    rounded = replace(
        joint,
        fillets=tuple(round(fillet, 6) for fillet in joint.fillets),
        widths=tuple(round(width, 6) for width in joint.widths),
        angles_deg=tuple(round(angle, 6) for angle in joint.angles_deg),
        hoop_strain=strain,
    )
    return _between(deployed_joint(rounded, exact=True).deployed_deg)


def _between(angles_deg: Sequence[float]) -> float:
    """Return the angle of a pair between its children, of a single child from the trunk."""
    return angles_deg[-1] - angles_deg[0] if len(angles_deg) > 1 else angles_deg[0]
