"""Where a straight side meets a disc that bulges out of it: at a joint, or at a pouch."""

import math
from dataclasses import dataclass

from vinefab.geometry.stroke import LEAST_SEGMENT_MM


@dataclass(frozen=True, slots=True)
class Neck:
    """Where a straight side meets a disc that bulges out of it.

    Parameters
    ----------
    used_mm
        Distance along the side from the disc's centre to where the side ends.
    angle_rad
        Angle, from the strip's axis, at which the disc begins.
    radius_mm
        Fillet radius, 0 for a bare corner or where side and disc are tangent.
    """

    used_mm: float
    angle_rad: float
    radius_mm: float

    @property
    def turn_rad(self) -> float:
        """Angle through which the fillet turns, not negative."""
        return math.pi / 2 - self.angle_rad


def neck(half_mm: float, disc_mm: float, radius_mm: float) -> Neck:
    """Return how a side at ``half_mm`` from the axis meets a disc, with a fillet.

    A fillet shorter than the shortest segment becomes a corner.
    """
    # The product keeps its zero exact when side and disc are tangent; a difference of squares
    # would leave 1e-7 mm of fillet behind.
    used = math.sqrt(max(0.0, (disc_mm - half_mm) * (disc_mm + half_mm + 2.0 * radius_mm)))
    found = Neck(used, math.atan2(half_mm + radius_mm, used), radius_mm)
    if radius_mm > 0.0 and radius_mm * found.turn_rad < LEAST_SEGMENT_MM:
        return neck(half_mm, disc_mm, 0.0)
    return found
