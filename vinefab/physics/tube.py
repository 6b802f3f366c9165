"""Flat tubes under pressure: diameter, radius and cross-section.

All functions treat film as inextensible: the flat circumference 2 w keeps its length. Standing of
the formulas: published, standard results. They hold while the hoop strain
(`vinefab.physics.seam.hoop_strain`) is small; thin TPU balloons beyond that.
"""

import math
from typing import TypeVar

from vinefab.core.validation import Floats

Widths = TypeVar("Widths", float, Floats)
"""A width in mm, or an array of widths, shape (n,)."""


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
