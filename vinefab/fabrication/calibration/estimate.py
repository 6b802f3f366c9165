"""Numbers fitted to readings, with their uncertainties."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats

_LEAST_SINGULAR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A fitted number."""

    value: float
    uncertainty: float  # one standard deviation, in the same unit
    readings: int  # number of readings


@dataclass(frozen=True, slots=True, kw_only=True)
class Equation:
    """One reading as an equation: the unknowns, times factors, add up to it."""

    factors: dict[str, float]  # factor of each unknown, by name
    value: float  # the reading
    sigma: float | None = None  # its standard uncertainty


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
    return solve_equations(rows, key)[key]


def solve_equations(equations: Sequence[Equation], key: str) -> dict[str, Estimate]:
    """Return unknowns by linear least squares.

    Readings with stated uncertainties are weighted by them, and the result's uncertainty is never
    less than that of the scatter (Birge's ratio). Without stated ones it follows from the scatter.
    """
    names = sorted({name for equation in equations for name in equation.factors})
    weights = stated_weights([e.sigma for e in equations], len(names), key)
    matrix = np.array([[e.factors.get(name, 0.0) for name in names] for e in equations])
    target = np.array([equation.value for equation in equations])
    rows, goal = matrix * weights[:, None], target * weights
    singular = np.linalg.svd(rows, compute_uv=False)
    if len(equations) < len(names) or singular[-1] < _LEAST_SINGULAR * singular[0]:
        given = counted(len(equations), "reading")
        allowed = f"readings that tell {' and '.join(names)} apart"
        raise BadInputError(key, given, allowed)
    found, *_ = np.linalg.lstsq(rows, goal, rcond=None)
    stated = equations[0].sigma is not None
    spread = scatter(rows @ found - goal, len(names), stated=stated)
    deviations = spread * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    counts = np.count_nonzero(matrix, axis=0)
    return {
        name: Estimate(value=float(v), uncertainty=float(u), readings=int(count))
        for name, v, u, count in zip(names, found, deviations, counts, strict=True)
    }


def stated_weights(sigmas: Sequence[float | None], unknowns: int, key: str) -> Floats:
    """Return one over each reading's uncertainty, or ones where none is stated."""
    stated = [sigma for sigma in sigmas if sigma is not None]
    if stated and len(stated) < len(sigmas):
        allowed = "an uncertainty for every reading of this kind, or for none"
        raise BadInputError(f"{key} uncertainty", f"{len(stated)} of {len(sigmas)}", allowed)
    if not stated and len(sigmas) <= unknowns:
        allowed = f"at least {unknowns + 1} for {counted(unknowns, 'unknown')}"
        raise BadInputError(
            key, f"{len(sigmas)} without uncertainty", f"{allowed}, or uncertainties"
        )
    if any(sigma <= 0.0 for sigma in stated):
        raise BadInputError(f"{key} uncertainty", min(stated), "above 0")
    return 1.0 / np.array(stated) if stated else np.ones(len(sigmas))


def scatter(residuals: Floats, unknowns: int, *, stated: bool) -> float:
    """Return the standard deviation of weighted residuals; at least 1 where sigmas are stated."""
    free = len(residuals) - unknowns
    found = math.sqrt(float(residuals @ residuals) / free) if free > 0 else 1.0
    return max(1.0, found) if stated else found


_NAMES = ("yield_kpa", "drag_kpa_m", "storage_kpa", "friction")
"""Y, f, T and mu, as in `vinefab.physics.growth_pressure.GrowthConstants`."""

_MOST = (1000.0, 1000.0, 1000.0, 5.0)
_LEAST_SINGULAR_OF_FIT = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class GrownPath:
    """A path along which a tube was grown, and the pressure that it took."""

    lengths_mm: tuple[float, ...]  # straight pieces, base first
    turns_rad: tuple[float, ...]  # the turns between them
    pressure_kpa: float  # pressure at which it just grew at the end
    sigma_kpa: float | None = None  # standard uncertainty of that, or None


def fit_growth(paths: Sequence[GrownPath]) -> dict[str, Estimate]:
    """Return Y, f, T and mu with their uncertainties, by name.

    For a given mu the pressure is linear in Y, f and T; all four are fitted together, none below
    zero.
    """
    weights = stated_weights([path.sigma_kpa for path in paths], len(_NAMES), "growth")
    if len(paths) < len(_NAMES):
        allowed = "at least 4 paths for 4 unknowns (Y, f, T, mu)"
        raise BadInputError("growth", counted(len(paths), "path"), allowed)
    measured = np.array([path.pressure_kpa for path in paths])

    def residuals(constants: Floats) -> Floats:
        away: Floats = (_pressures_kpa(paths, constants) - measured) * weights
        return away

    start = np.array([0.3 * measured.min(), 0.5, 0.6 * measured.min(), 0.25])
    solved = least_squares(
        residuals,
        start,
        bounds=(np.zeros(len(_NAMES)), _MOST),
        x_scale="jac",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    jacobian = np.asarray(solved.jac)
    scaled = jacobian * np.maximum(np.abs(solved.x), 1e-3)
    singular = np.linalg.svd(scaled, compute_uv=False)
    if singular[-1] < _LEAST_SINGULAR_OF_FIT * singular[0]:
        allowed = "paths that differ in length and in their turns, some without turns"
        raise BadInputError("growth", f"{counted(len(paths), 'path')} of too few kinds", allowed)
    stated = paths[0].sigma_kpa is not None
    spread = scatter(np.asarray(solved.fun), len(_NAMES), stated=stated)
    deviations = spread * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return {
        name: Estimate(value=float(value), uncertainty=float(u), readings=len(paths))
        for name, value, u in zip(_NAMES, solved.x, deviations, strict=True)
    }


def _pressures_kpa(paths: Sequence[GrownPath], constants: Floats) -> Floats:
    """Return P = Y + tau + f l of every path; tau grows by e^(mu theta) at each turn."""
    yield_kpa, drag_kpa_m, storage_kpa, friction = constants.tolist()
    found = []
    for path in paths:
        tension = storage_kpa
        for length, turn in zip(path.lengths_mm, path.turns_rad, strict=False):
            tension = (tension + drag_kpa_m * length / 1000.0) * math.exp(friction * abs(turn))
        found.append(yield_kpa + tension + drag_kpa_m * path.lengths_mm[-1] / 1000.0)
    return np.array(found)
