"""What a flat tube and a flat pouch become when they are inflated.

Every function takes the film as inextensible: a circumference that was flat stays as long.
Standing of the formulas: published, standard results. They hold while the hoop strain (see
`vinefab.physics.seam.hoop_strain`) is small; thin TPU balloons beyond that.
"""

import math
from typing import TypeVar

from vinefab.core.validation import Floats

Widths = TypeVar("Widths", float, Floats)
"""One, or many at once."""

POUCH_RADIUS = 0.763
"""Equatorial radius of an inflated round pouch over its flat radius (published, mylar balloon)."""

POUCH_THICKNESS = 0.914
"""Thickness of an inflated round pouch, pole to pole, over its flat radius (published)."""

POUCH_VOLUME = 1.2185
"""Volume of an inflated round pouch over its flat radius cubed (published, mylar balloon)."""


def inflated_diameter_mm(width_mm: Widths) -> Widths:
    """Return the diameter D = 2 w / pi of an inflated tube of lay-flat lumen width w.

    Examples
    --------
    >>> round(inflated_diameter_mm(20.0), 2)
    12.73
    """
    return 2.0 * width_mm / math.pi


def inflated_radius_mm(width_mm: float) -> float:
    """Return the radius w / pi of an inflated tube of lay-flat lumen width w."""
    return width_mm / math.pi


def lumen_area_mm2(width_mm: float) -> float:
    """Return the cross-section w^2 / pi of an inflated tube of lay-flat lumen width w."""
    return width_mm * width_mm / math.pi


def pouch_radius_mm(flat_radius_mm: float) -> float:
    """Return the equatorial radius of an inflated round pouch."""
    return POUCH_RADIUS * flat_radius_mm


def pouch_thickness_mm(flat_radius_mm: float) -> float:
    """Return the thickness of an inflated round pouch from pole to pole."""
    return POUCH_THICKNESS * flat_radius_mm


def pouch_volume_mm3(flat_radius_mm: float) -> float:
    """Return the volume of an inflated round pouch."""
    return POUCH_VOLUME * flat_radius_mm**3
