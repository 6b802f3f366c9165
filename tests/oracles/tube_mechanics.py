"""Stiffness and push of an inflated tube, for the independent models of growth."""

import math

from vinefab.physics.seam import N_MM2_PER_KPA
from vinefab.physics.tube import inflated_radius_mm, lumen_area_mm2


def bending_stiffness_n_mm2(width_mm: float, ply_mm: float, modulus_mpa: float) -> float:
    """Return E I = E pi R^3 t of an inflated tube that does not wrinkle (published, thin wall)."""
    return modulus_mpa * math.pi * inflated_radius_mm(width_mm) ** 3 * ply_mm


def axial_buckling_n(
    length_mm: float,
    pressure_kpa: float,
    width_mm: float,
    ply_mm: float,
    modulus_mpa: float,
    shear_mpa: float,
) -> float:
    """Return the axial load that buckles a free span with pinned ends (Fichter, published).

    F = (E pi^3 R^4 t P + E G pi^3 R^3 t^2) / (E pi^2 R^2 t + R L^2 P + G t L^2).

    Parameters
    ----------
    length_mm
        Free length L.
    pressure_kpa, width_mm, ply_mm
        Gauge pressure, lay-flat lumen width and film thickness.
    modulus_mpa, shear_mpa
        Young's modulus E and shear modulus G of the film.

    Examples
    --------
    >>> round(axial_buckling_n(300.0, 30.0, 20.0, 0.0375, 30.0, 10.0), 2)
    0.1
    """
    radius_mm, pressure = inflated_radius_mm(width_mm), pressure_kpa * N_MM2_PER_KPA
    shear_n_mm = pressure * radius_mm + shear_mpa * ply_mm
    bending_n_mm = modulus_mpa * math.pi**2 * radius_mm**2 * ply_mm
    return (
        math.pi * radius_mm * bending_n_mm * shear_n_mm / (bending_n_mm + length_mm**2 * shear_n_mm)
    )


def growth_push_n(pressure_kpa: float, path_kpa: float, width_mm: float) -> float:
    """Return the force F = (P - P_path) pi R^2 with which a tip that cannot advance pushes.

    Parameters
    ----------
    pressure_kpa, path_kpa
        Gauge pressure, and the pressure that growth to the tip needs.
    width_mm
        Lay-flat lumen width.
    """
    over_kpa = max(0.0, pressure_kpa - path_kpa)
    return over_kpa * N_MM2_PER_KPA * lumen_area_mm2(width_mm)
