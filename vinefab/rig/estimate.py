"""How long a rig takes to print and what it takes of filament: estimates, from stated formulas."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vinefab.model.printer import Printer
from vinefab.rig.part import RigPart

BASIS = (
    "computed from assumed settings: plastic = min(V, A s + f (V - A s)) with volume V, surface A, "
    "shell s and infill f; time = plastic / flow + layers x the time per layer change"
)
"""The formulas, for whoever reads the numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What printing takes.

    Parameters
    ----------
    plastic_mm3
        Volume extruded.
    mass_g, filament_m
        The same as mass, and as length of filament.
    time_s
        Printing time of all beds, without heating and without clearing the bed.
    """

    plastic_mm3: float
    mass_g: float
    filament_m: float
    time_s: float

    def words(self) -> str:
        """Return the estimate as a few words."""
        minutes = round(self.time_s / 60.0)
        time = f"{minutes // 60} h {minutes % 60:02d} min"
        return f"{time}, {self.mass_g:.0f} g, {self.filament_m:.1f} m of filament"


def estimate(parts: Sequence[RigPart], printer: Printer) -> Estimate:
    """Return what it takes to print parts together on one bed.

    A skin of thickness s around a solid of volume V and surface A holds about A s; the rest is
    filled to the share f. Thin parts are all skin, hence the lesser of the two.

    Parameters
    ----------
    parts
        What lies on the bed.
    printer
        Its settings.
    """
    plastic_mm3 = 0.0
    for part in parts:
        skin_mm3 = part.area_mm2 * printer.shell_mm
        filled_mm3 = skin_mm3 + printer.infill * (part.volume_mm3 - skin_mm3)
        plastic_mm3 += min(part.volume_mm3, filled_mm3)
    layers = max((math.ceil(part.size_mm[2] / printer.layer_mm) for part in parts), default=0)
    return _made_of(
        plastic_mm3, plastic_mm3 / printer.flow_mm3_s + layers * printer.layer_change_s, printer
    )


def together(estimates: Sequence[Estimate]) -> Estimate:
    """Return the sum of estimates, bed after bed."""
    return Estimate(
        plastic_mm3=sum(one.plastic_mm3 for one in estimates),
        mass_g=sum(one.mass_g for one in estimates),
        filament_m=sum(one.filament_m for one in estimates),
        time_s=sum(one.time_s for one in estimates),
    )


def _made_of(plastic_mm3: float, time_s: float, printer: Printer) -> Estimate:
    across_mm2 = 0.25 * math.pi * printer.filament_mm**2
    return Estimate(
        plastic_mm3=plastic_mm3,
        mass_g=1e-3 * plastic_mm3 * printer.density_g_cm3,
        filament_m=1e-3 * plastic_mm3 / across_mm2,
        time_s=time_s,
    )
