"""Numbers fitted to readings, with their uncertainties."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats

_LEAST_SINGULAR = 1e-9


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
    if len(equations) < len(names) or singular[-1] < _LEAST_SINGULAR * singular[0]:
        given = counted(len(equations), "reading")
        allowed = f"readings that tell {' and '.join(names)} apart"
        raise BadInputError(key, given, allowed)
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
_LEAST_SINGULAR_OF_FIT = 1e-6
_USUAL_DOUBT = 0.5
"""Standard uncertainty of a constant that another tube had, over its value (assumed)."""

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
    while len(kept) < len(GROWTH_CONSTANTS):
        found = _fit_some(paths, {name: one.value for name, one in kept.items()})
        doubt = {name: one.half_width() / usual[name] for name, one in found.items()}
        worst = max(doubt, key=lambda name: doubt[name])
        if doubt[worst] <= 1.0:
            break
        kept[worst] = Estimate(
            value=usual[worst], uncertainty=_USUAL_DOUBT * usual[worst], readings=0
        )
    else:
        allowed = "paths that differ in length and in their turns, some without turns"
        raise BadInputError("growth", f"{counted(len(paths), 'path')} of too few kinds", allowed)
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
        allowed = "at least 4 paths for 4 unknowns (Y, f, T, mu)"
        raise BadInputError("growth", counted(len(paths), "path"), allowed)
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
    if singular[-1] <= _LEAST_SINGULAR_OF_FIT * singular[0]:
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
