"""Flat tubes under pressure: diameter, radius and cross-section.

All functions treat film as inextensible: the flat circumference 2 w keeps its length. Standing of
the formulas: published, standard results. They hold while the hoop strain
(`vinefab.physics.seam.hoop_strain`) is small; thin TPU balloons beyond that.
"""

import math
from typing import TypeVar

from vinefab.core.limits import STANDARD_GRAVITY_M_S2
from vinefab.core.validation import Floats
from vinefab.model.laser import Quantity, Standing
from vinefab.physics.seam import N_MM2_PER_KPA

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


# --- A free span under load -----------------------------------------------------------------------


EVERTED_SHARE = Quantity(
    value=0.83,
    standing=Standing.PUBLISHED,
    source="arXiv 2107.05748, abstract: everted tubes buckle at 0.83 of the theory, straight ones "
    "at 1.09",
)
"""Collapse moment of a tube that was everted, over the theory's."""


def collapse_moment_n_mm(
    pressure_kpa: float, width_mm: float, share: float = EVERTED_SHARE.value
) -> float:
    """Return the moment s pi P R^3 that folds an inflated tube (published).

    A transverse load at the tip of a free span of length L folds it at this moment over L.

    Parameters
    ----------
    share
        What was measured over the theory: 0.83 for everted tubes, 1.09 for straight ones.
    """
    moment_n_mm = math.pi * pressure_kpa * N_MM2_PER_KPA * inflated_radius_mm(width_mm) ** 3
    return share * moment_n_mm


def self_weight_span_mm(
    pressure_kpa: float, width_mm: float, ply_mm: float, density_kg_m3: float
) -> float:
    """Return the free span, held at one end, that folds under its own weight (computed).

    About D sqrt(P / (8 rho g t)): the weight is that of the tube and of as much film inside it,
    which still has to evert; the moment is that of everted tubes.

    Parameters
    ----------
    pressure_kpa, width_mm, ply_mm
        Gauge pressure, lay-flat lumen width and film thickness.
    density_kg_m3
        Density rho of the film.

    Examples
    --------
    >>> round(self_weight_span_mm(30.0, 20.0, 0.0375, 1200.0))
    1069
    """
    film_mm2 = 2.0 * 2.0 * width_mm * ply_mm
    weight_n_mm = film_mm2 * density_kg_m3 * 1e-9 * STANDARD_GRAVITY_M_S2
    return math.sqrt(2.0 * collapse_moment_n_mm(pressure_kpa, width_mm) / weight_n_mm)
