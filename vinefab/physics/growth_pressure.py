"""The pressure that a vine robot needs to grow along a path with turns.

Undeployed film rides inside the body to the tip. Every stretch of path adds friction and every
turn multiplies the tension that has built up behind it (the capstan effect), so the same turns
cost more the later they come.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from vinefab.core.errors import BadInputError
from vinefab.model.laser import Quantity, Standing


def capstan_factor(friction: float, turn_rad: float) -> float:
    """Return e^(mu |gamma|), by which the tension grows around a turn (Eq. 2 of the paper).

    Parameters
    ----------
    friction
        Coefficient of friction mu, 0 or more.
    turn_rad
        Total turn gamma; its sign does not matter.

    Examples
    --------
    >>> capstan_factor(0.3, 0.0)
    1.0
    """
    return math.exp(friction * abs(turn_rad))


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthConstants:
    """The four constants of the growth-pressure model, each with its standing.

    Parameters
    ----------
    yield_kpa
        Y: pressure below which film does not evert at all.
    drag_kpa_m
        f: friction per metre of path.
    storage_kpa
        T: tension of the film as it leaves its store, as a pressure. The fitted value is for a
        spool; crumpled storage is unknown, 0 to 8 kPa.
    friction
        mu: friction of film on film, per radian of turn.
    """

    yield_kpa: Quantity
    drag_kpa_m: Quantity
    storage_kpa: Quantity
    friction: Quantity

    def at_diameter(self, diameter_mm: float, fitted_diameter_mm: float) -> "GrowthConstants":
        """Return the constants for another tube of the same film.

        Y, f and T are taken as inverse to the diameter (assumed: a 3 mm tube burst before it
        grew, 4 to 7 mm worked); mu stays.

        Parameters
        ----------
        diameter_mm
            Inflated diameter of the tube asked about.
        fitted_diameter_mm
            Inflated diameter of the tube that these constants were fitted to.
        """
        factor = fitted_diameter_mm / diameter_mm
        scaled = [
            Quantity(
                value=quantity.value * factor,
                standing=Standing.ASSUMED,
                source=f"{quantity.source}; times {factor:.4g}, inverse to the diameter",
            )
            for quantity in (self.yield_kpa, self.drag_kpa_m, self.storage_kpa)
        ]
        return GrowthConstants(
            yield_kpa=scaled[0],
            drag_kpa_m=scaled[1],
            storage_kpa=scaled[2],
            friction=self.friction,
        )

    def with_storage(self, storage_kpa: Quantity) -> "GrowthConstants":
        """Return the constants for film that leaves another kind of store, of the same tube."""
        return replace(self, storage_kpa=storage_kpa)

    @property
    def standing(self) -> Standing:
        """How far a pressure worked out from these constants may be trusted: as its weakest."""
        numbers = (self.yield_kpa, self.drag_kpa_m, self.storage_kpa, self.friction)
        assumed = any(number.standing is Standing.ASSUMED for number in numbers)
        return Standing.ASSUMED if assumed else Standing.COMPUTED


def _fitted(value: float) -> Quantity:
    source = "fit to one tube of a published everting vine robot"
    return Quantity(value=value, standing=Standing.PUBLISHED, source=source)


FITTED = GrowthConstants(
    yield_kpa=_fitted(1.92),
    drag_kpa_m=_fitted(0.771),
    storage_kpa=_fitted(8.32),
    friction=_fitted(0.234),
)
"""The published fit. It holds for one tube; treat it as an order of magnitude for any other."""

FITTED_DIAMETER_MM = Quantity(
    value=25.0,
    standing=Standing.ASSUMED,
    source="the fit is quoted without its tube's diameter; tubes of about an inch are usual",
)
"""Inflated diameter of the tube that `FITTED` belongs to."""

NO_TENSION = Quantity(
    value=0.0, standing=Standing.ASSUMED, source="film crumpled loosely behind the base"
)
"""Least tension of film that leaves its store: nothing holds it back."""


def growth_pressure_kpa(
    lengths_mm: Sequence[float],
    turns_rad: Sequence[float],
    constants: GrowthConstants = FITTED,
    *,
    riding_mm: float = 0.0,
) -> float:
    """Return the pressure that growth to the end of a path takes.

    tau_0 = T + f l_r; tau_i = (tau_{i-1} + f l_i) e^(mu |theta_i|); P_grow = Y + tau_{n-1} + f l_n.

    Parameters
    ----------
    lengths_mm
        Lengths of the n straight segments, base first.
    turns_rad
        The n - 1 turns between them (contacts, base hinge, joints); signs do not matter.
    constants
        Y, f, T and mu.
    riding_mm
        Film of undeployed descendants that is drawn along behind, l_r: their length times their
        width over that of the growing branch. It is taken to hang on at the store, behind every
        turn: no less than its true share.

    Raises
    ------
    BadInputError
        If there is not exactly one turn between each two segments.

    Notes
    -----
    Fitted on paths under 2 m with up to six right angles. Standing of the result: that of the
    weakest constant.

    Examples
    --------
    >>> round(growth_pressure_kpa([300.0], []), 1)
    10.5
    """
    if len(turns_rad) != len(lengths_mm) - 1:
        raise BadInputError("turns_rad", len(turns_rad), f"{len(lengths_mm) - 1} turns")
    drag_kpa_mm = constants.drag_kpa_m.value / 1000.0
    tension_kpa = constants.storage_kpa.value + drag_kpa_mm * riding_mm
    for length_mm, turn_rad in zip(lengths_mm, turns_rad, strict=False):
        factor = capstan_factor(constants.friction.value, turn_rad)
        tension_kpa = (tension_kpa + drag_kpa_mm * length_mm) * factor
    return constants.yield_kpa.value + tension_kpa + drag_kpa_mm * lengths_mm[-1]


def growth_pressure_bound_kpa(
    length_mm: float, turn_rad: float, constants: GrowthConstants = FITTED
) -> float:
    """Return the upper bound Y + (f L + T) e^(mu sum |theta|) of the pressure that growth takes.

    Parameters
    ----------
    length_mm
        Whole length of the path.
    turn_rad
        Sum of its absolute turns.
    constants
        Y, f, T and mu.

    Notes
    -----
    The bound is what the path would need if every turn came at its very end.
    """
    drag_kpa = constants.drag_kpa_m.value * length_mm / 1000.0
    factor = capstan_factor(constants.friction.value, turn_rad)
    return constants.yield_kpa.value + (drag_kpa + constants.storage_kpa.value) * factor
