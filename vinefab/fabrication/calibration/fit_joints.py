"""From joint coupons to the film's modulus and a closing gain.

A trunk of lay-flat width W has the hoop strain c p W / (pi t), with c = 1 / E. Its girth at some
pressure over that at another one tells c: a rim that stands off, or a paper strip's thickness,
adds alike to both. Angles hardly depend on the strain, so they tell the gain g alone:
deployed = flat + g (simulated - flat).
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.fabrication.calibration.coupon_results import Reading, Results
from vinefab.fabrication.calibration.coupons import joint_designs
from vinefab.fabrication.calibration.estimate import Equation, Estimate, solve_equations
from vinefab.inflation.compensation import deployed_joint
from vinefab.inflation.robot import joints_of
from vinefab.inflation.sheet import tube_stretch
from vinefab.model.laser import CLOSING_GAIN, LaserProfile
from vinefab.model.tree import fan_offsets_rad
from vinefab.physics.seam import hoop_strain

_STRAINS = (0.002, 0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.14, 0.2, 0.3, 0.5, 0.7)
"""Strains at which joints are simulated; between them angles are interpolated, beyond them kept."""

_SIMULATED_DEG = 0.4
"""By how much simulated angles differ with the mesh."""

_MOST_DOUBT = 0.35
"""Half of the 95 % interval of a modulus, over its value: with more it is not told. Of intervals as
wide as 0.5 that are told, one in seven does not hold the truth: those told are those too large."""

_ASSUMED_DOUBT = 0.5
"""Standard uncertainty of an assumed modulus over its value (assumed)."""

_MOST_SOLVED = 1.5
"""Largest strain that the fit tries."""

_MOST_KEPT = 1.1
"""Largest strain, over the largest simulated, at which angles still count as those there."""

_EVEN = 2.0 / 3.0

_COMPLIANCE = "stretch"
_ITERATIONS = 30


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
    if half > _MOST_DOUBT * found.value:
        least = 1.0 / max(found.value + half, 1e-9)
        raise BadInputError(
            "modulus_mpa",
            f"a stretch of {found.value:.2g} +- {half:.2g} per MPa (95 %)",
            "girths that grow by more than their scatter: take the highest pressure that the seam"
            f" bears. The modulus is above {least:.2g} MPa",
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
    for _ in range(_ITERATIONS):
        equations = [
            _girth_equation(reading, width_mm, load, compliance)
            for reading, (width_mm, load) in zip(readings, loads, strict=True)
        ]
        found = solve_equations(equations, "joint_girth")[0][_COMPLIANCE]
        # The logarithm of a girth bends downwards: halved steps keep the first ones in range.
        new = max(found.value, compliance / 2.0, 1e-9)
        new = min(new, compliance * 2.0, _MOST_SOLVED / most_load)
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
        equations = [_bend_equation(bend, modulus_mpa) for bend in bends]
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
    doubt = given.uncertainty or _ASSUMED_DOUBT * given.value
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
    if found.value * most_load > _MOST_KEPT * _STRAINS[-1]:
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
    return (
        middle,
        (middle * (low / middle) ** _EVEN, middle * (high / middle) ** _EVEN),
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
        flat_deg=_between(np.degrees(fan_offsets_rad(joint.levels[0])).tolist()),
        deployed_deg=deployed_deg,
        load=hoop_strain(kpa, width_mm, profile.material.ply_mm.value, 1.0),
        sigma_deg=None if reading.sigma is None else math.degrees(reading.sigma),
    )


def _bend_equation(bend: _Bend, modulus_mpa: float) -> Equation:
    return Equation(
        factors={"gain": bend.simulated_deg(modulus_mpa) - bend.flat_deg},
        value=bend.deployed_deg - bend.flat_deg,
        sigma=None if bend.sigma_deg is None else math.hypot(bend.sigma_deg, _SIMULATED_DEG),
    )


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
