"""Options of the growth model."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.core.units import deg, rad
from vinefab.core.validation import Floats, number
from vinefab.physics.growth_pressure import FITTED_DIAMETER_MM

DEFAULT_HEAD_ON_HALF_ANGLE_RAD = math.radians(1.0)


HALF_ANGLE_DEG = "head_on_half_angle_deg"


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthOptions:
    """Options of the growth model; recorded with every result, because results depend on them.

    Parameters
    ----------
    head_on_half_angle_rad
        A tip that meets a wall with its heading within this angle of the wall's inward normal
        stops there; 0 to pi/2. Real robots slid at up to 75 degrees from the wall's tangent, so
        the true value is at most about 15 degrees. A range (low, high) gives every evaluation a
        value of its own: the same for all designs that are compared.
    children_of_stuck
        Whether children of a branch that stopped early stay inside (``stop``: a tip that cannot
        move cannot evert them) or grow from where it stopped (``deploy``).
    body
        ``centerline``: the body is a line (the published model). ``inflated``: every level sees
        the free space shrunk by its inflated radius, lay-flat width / pi.
    pressure_stop
        Whether growth stops where the design's working pressure no longer everts the film (see
        `vinefab.physics.growth_pressure`); the published model has no pressure.
    storage_kpa
        Tension of the film as it leaves its store, as a pressure: 0 for film that lies loosely,
        8.32 for a tight spool (published fit).
    fitted_diameter_mm
        Inflated diameter of the tube that the constants of the growth pressure were fitted to; it
        was not published (assumed).
    """

    head_on_half_angle_rad: float | tuple[float, float] = DEFAULT_HEAD_ON_HALF_ANGLE_RAD
    children_of_stuck: Literal["stop", "deploy"] = "stop"
    body: Literal["centerline", "inflated"] = "centerline"
    pressure_stop: bool = False
    storage_kpa: float = 0.0
    fitted_diameter_mm: float = FITTED_DIAMETER_MM.value

    def __post_init__(self) -> None:
        low_rad, high_rad = self.half_angle_range_rad
        number("head_on_half_angle_deg", deg(high_rad), 0.0, 90.0, "deg")
        number("head_on_half_angle_deg", deg(low_rad), 0.0, deg(high_rad), "deg")
        if self.children_of_stuck not in ("stop", "deploy"):
            raise BadInputError("children_of_stuck", self.children_of_stuck, "'stop' or 'deploy'")
        if self.body not in ("centerline", "inflated"):
            raise BadInputError("body", self.body, "'centerline' or 'inflated'")
        number("storage_kpa", self.storage_kpa, 0.0, 1000.0, "kPa")
        number("fitted_diameter_mm", self.fitted_diameter_mm, 1.0, 1000.0, "mm")

    @classmethod
    def published(cls, **changes: Any) -> "GrowthOptions":  # noqa: ANN401  as the class
        """Return the published model: the body is a line, and no pressure stops it."""
        return cls(**{"body": "centerline", "pressure_stop": False, **changes})

    @classmethod
    def of(
        cls, given: Mapping[str, object], base: "GrowthOptions | None" = None
    ) -> "GrowthOptions":
        """Return options from names and values as files have them, angles in degrees.

        Parameters
        ----------
        given
            Any of the names in `content`; the head-on half-angle is a number or ``[low, high]``.
        base
            What the other options are; the defaults if None.

        Raises
        ------
        BadInputError
            If a value cannot be used.
        UnknownNameError
            If there is no such option.
        """
        base = base or cls()
        for name in given:
            if name not in base.content:
                raise UnknownNameError("growth option", name, base.content)
        values: dict[str, Any] = dict(given)
        if HALF_ANGLE_DEG in values:
            values["head_on_half_angle_rad"] = _half_angle_rad(values.pop(HALF_ANGLE_DEG))
        if not isinstance(values.get("pressure_stop", True), bool):
            raise BadInputError("pressure_stop", values["pressure_stop"], "true or false")
        return replace(base, **values)

    @property
    def content(self) -> dict[str, object]:
        """All options as files, records and pages have them."""
        plain = {f.name: getattr(self, f.name) for f in fields(self)[1:]}
        return {HALF_ANGLE_DEG: self.half_angle_deg, **plain}

    @property
    def half_angle_range_rad(self) -> tuple[float, float]:
        """Least and greatest head-on half-angle."""
        angle = self.head_on_half_angle_rad
        return angle if isinstance(angle, tuple) else (angle, angle)

    @property
    def draws_half_angle(self) -> bool:
        """Whether every evaluation has a head-on half-angle of its own."""
        low_rad, high_rad = self.half_angle_range_rad
        return low_rad < high_rad

    def half_angles_rad(self, count: int) -> Floats:
        """Return one head-on half-angle for each of some launches, shape (count,).

        Of a range, they are spread evenly and in no order that a map or a pose could share: steps
        of the golden section. The same count gives the same angles.
        """
        low_rad, high_rad = self.half_angle_range_rad
        share = np.mod(0.5 + np.arange(count) * (math.sqrt(5.0) - 1.0) / 2.0, 1.0)
        return np.asarray(low_rad + (high_rad - low_rad) * share)

    @property
    def only_half_angle_rad(self) -> float:
        """The head-on half-angle of a single growth.

        Raises
        ------
        BadInputError
            If there is a range of them.
        """
        low_rad, high_rad = self.half_angle_range_rad
        if low_rad < high_rad:
            allowed = "one number: a range is for scores over many deployments"
            raise BadInputError("head_on_half_angle_deg", self.half_angle_deg, allowed)
        return low_rad

    @property
    def half_angle_deg(self) -> float | list[float]:
        """The head-on half-angle in degrees, or its range, as files and reports have it."""
        low, high = (deg(angle_rad) for angle_rad in self.half_angle_range_rad)
        return low if low == high else [low, high]

    @property
    def half_angle_text(self) -> str:
        """The head-on half-angle as it is shown: ``1 deg``, or ``1 to 15 deg``."""
        low_rad, high_rad = self.half_angle_range_rad
        low, high = f"{deg(low_rad):g}", f"{deg(high_rad):g}"
        return f"{low} deg" if low == high else f"{low} to {high} deg"

    @property
    def deploys_stuck(self) -> bool:
        """Whether children of a stuck branch grow from where it stopped."""
        return self.children_of_stuck == "deploy"


def _half_angle_rad(given: object) -> float | tuple[float, float]:
    """Return a head-on half-angle, or its range, from degrees."""
    ends: list[Any] = list(given) if isinstance(given, list | tuple) else [given, given]
    if len(ends) != 2:
        raise BadInputError(HALF_ANGLE_DEG, given, "a number, or a range [low, high]")
    low_rad, high_rad = (rad(number(HALF_ANGLE_DEG, end, 0.0, 90.0, "deg")) for end in ends)
    return low_rad if low_rad == high_rad else (low_rad, high_rad)
