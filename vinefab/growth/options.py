"""Options of the growth model."""

import math
from dataclasses import dataclass
from typing import Literal

from vinefab.core.errors import BadInputError
from vinefab.core.units import deg
from vinefab.core.validation import number
from vinefab.physics.growth_pressure import FITTED_DIAMETER_MM

DEFAULT_HEAD_ON_HALF_ANGLE_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthOptions:
    """Options of the growth model; recorded with every result, because results depend on them.

    Parameters
    ----------
    head_on_half_angle_rad
        A tip that meets a wall with its heading within this angle of the wall's inward normal
        stops there; 0 to pi/2. Real robots slid at up to 75 degrees from the wall's tangent, so
        the true value is at most about 15 degrees.
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

    head_on_half_angle_rad: float = DEFAULT_HEAD_ON_HALF_ANGLE_RAD
    children_of_stuck: Literal["stop", "deploy"] = "stop"
    body: Literal["centerline", "inflated"] = "centerline"
    pressure_stop: bool = False
    storage_kpa: float = 0.0
    fitted_diameter_mm: float = FITTED_DIAMETER_MM.value

    def __post_init__(self) -> None:
        number("head_on_half_angle_deg", deg(self.head_on_half_angle_rad), 0.0, 90.0, "deg")
        if self.children_of_stuck not in ("stop", "deploy"):
            raise BadInputError("children_of_stuck", self.children_of_stuck, "'stop' or 'deploy'")
        if self.body not in ("centerline", "inflated"):
            raise BadInputError("body", self.body, "'centerline' or 'inflated'")
        number("storage_kpa", self.storage_kpa, 0.0, 1000.0, "kPa")
        number("fitted_diameter_mm", self.fitted_diameter_mm, 1.0, 1000.0, "mm")

    @property
    def deploys_stuck(self) -> bool:
        """Whether children of a stuck branch grow from where it stopped."""
        return self.children_of_stuck == "deploy"
