"""Growth-pressure constants from measured pressures, by least squares on the nested capstan."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from vinefab.core.errors import BadInputError
from vinefab.model.checked import Floats
from vinefab.physics.estimate import Estimate, scatter, stated_weights

NAMES = ("yield_kpa", "drag_kpa_m", "storage_kpa", "friction")
"""Y, f, T and mu, as in `vinefab.physics.growth_pressure.GrowthConstants`."""

_MOST = (1000.0, 1000.0, 1000.0, 5.0)
_LEAST_SINGULAR = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class GrownPath:
    """A path along which a tube was grown, and the pressure that it took.

    Parameters
    ----------
    lengths_mm
        Straight pieces, base first.
    turns_rad
        The turns between them.
    pressure_kpa
        Pressure at which it just grew at the end.
    sigma_kpa
        Standard uncertainty of that, or None.
    """

    lengths_mm: tuple[float, ...]
    turns_rad: tuple[float, ...]
    pressure_kpa: float
    sigma_kpa: float | None = None


def fit_growth(paths: Sequence[GrownPath]) -> dict[str, Estimate]:
    """Return Y, f, T and mu with their uncertainties, by name.

    For a given mu the pressure is linear in Y, f and T; all four are fitted together, none below
    zero.

    Parameters
    ----------
    paths
        At least four that differ in length and in turns; five where no uncertainties are stated.

    Raises
    ------
    BadInputError
        If the paths cannot tell the four constants apart.
    """
    weights = stated_weights([path.sigma_kpa for path in paths], len(NAMES), "growth")
    if len(paths) < len(NAMES):
        words = "at least 4 paths for 4 unknowns (Y, f, T, mu)"
        raise BadInputError("growth", f"{len(paths)} paths", words)
    measured = np.array([path.pressure_kpa for path in paths])

    def residuals(constants: Floats) -> Floats:
        away: Floats = (_pressures_kpa(paths, constants) - measured) * weights
        return away

    start = np.array([0.3 * measured.min(), 0.5, 0.6 * measured.min(), 0.25])
    solved = least_squares(
        residuals,
        start,
        bounds=(np.zeros(len(NAMES)), _MOST),
        x_scale="jac",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    jacobian = np.asarray(solved.jac)
    scaled = jacobian * np.maximum(np.abs(solved.x), 1e-3)
    singular = np.linalg.svd(scaled, compute_uv=False)
    if singular[-1] < _LEAST_SINGULAR * singular[0]:
        words = "paths that differ in length and in their turns, some without turns"
        raise BadInputError("growth", f"{len(paths)} paths of too few kinds", words)
    stated = paths[0].sigma_kpa is not None
    spread = scatter(np.asarray(solved.fun), len(NAMES), stated=stated)
    deviations = spread * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return {
        name: Estimate(value=float(value), uncertainty=float(u), readings=len(paths))
        for name, value, u in zip(NAMES, solved.x, deviations, strict=True)
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
