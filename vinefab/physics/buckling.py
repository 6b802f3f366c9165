"""What an inflated tube carries before it wrinkles, folds, buckles or crushes.

Standing of every formula: published; thin inextensible film, small deflections. A free body of a
vine robot always buckles long before its tip pushes with P A, as the growth model assumes.
"""

import math

from vinefab.physics.lumen import inflated_radius_mm, lumen_area_mm2
from vinefab.physics.pressure import N_MM2_PER_KPA


def wrinkle_moment_n_mm(pressure_kpa: float, width_mm: float) -> float:
    """Return the bending moment (pi/2) P R^3 at which a tube begins to wrinkle.

    Parameters
    ----------
    pressure_kpa
        Gauge pressure.
    width_mm
        Lay-flat lumen width; R = w / pi.
    """
    return 0.5 * collapse_moment_n_mm(pressure_kpa, width_mm)


def collapse_moment_n_mm(pressure_kpa: float, width_mm: float) -> float:
    """Return the bending moment pi P R^3 at which a tube folds; parameters as before."""
    return math.pi * pressure_kpa * N_MM2_PER_KPA * inflated_radius_mm(width_mm) ** 3


def side_load_n(pressure_kpa: float, width_mm: float, free_mm: float) -> float:
    """Return the sideways load pi P R^3 / L on a tip that folds a free length L."""
    return collapse_moment_n_mm(pressure_kpa, width_mm) / free_mm


def crush_load_n(pressure_kpa: float, width_mm: float) -> float:
    """Return the load P A along a tube that crushes it, whatever its length.

    Examples
    --------
    >>> round(crush_load_n(30.0, 20.0), 1)
    3.8
    """
    return pressure_kpa * N_MM2_PER_KPA * lumen_area_mm2(width_mm)


def axial_load_n(
    pressure_kpa: float, width_mm: float, free_mm: float, ply_mm: float, modulus_mpa: float
) -> float:
    """Return the load along a tube of a free length that buckles it (Fichter).

    F = (E pi^3 R^4 t P + E G pi^3 R^3 t^2) / (E pi^2 R^2 t + R L^2 P + G t L^2)

    Parameters
    ----------
    pressure_kpa, width_mm
        As before.
    free_mm
        Free length L, more than 0.
    ply_mm
        Thickness t of the wall.
    modulus_mpa
        Young's modulus E; the shear modulus G is taken as E / 3, an incompressible film
        [assumed].

    Examples
    --------
    >>> round(axial_load_n(30.0, 20.0, 300.0, 0.0375, 30.0), 1)
    0.1
    """
    radius, pressure = inflated_radius_mm(width_mm), pressure_kpa * N_MM2_PER_KPA
    shear_mpa = modulus_mpa / 3.0
    bending = modulus_mpa * math.pi**2 * radius**2 * ply_mm
    shearing = radius * free_mm**2 * pressure + shear_mpa * ply_mm * free_mm**2
    return (
        math.pi
        * bending
        * (radius**2 * pressure + shear_mpa * radius * ply_mm)
        / (bending + shearing)
    )
