"""Flat tubes under pressure: size, free spans, and the seams that hold them.

All functions treat film as inextensible: the flat circumference 2 w keeps its length. Standing of
the formulas: published, standard results. They hold while `hoop_strain` is small; thin TPU balloons
beyond that. Pressures are gauge pressures.

The load per length of a tube's wall is proportional to pressure times width, so a seam that holds
in a narrow balloon fails in a wide trunk at a fraction of the pressure.
"""

import math
from typing import TypeVar

from vinefab.core.limits import STANDARD_GRAVITY_M_S2
from vinefab.core.validation import Floats
from vinefab.model.laser import SeamTest
from vinefab.model.quantity import Quantity, Standing

N_MM2_PER_KPA = 1e-3
"""1 kPa is 0.001 N/mm^2."""

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


# --- Seams ----------------------------------------------------------------------------------


def spot_at_mm(focus_spot_mm: float, focus_offset_mm: float, rayleigh_mm: float) -> float:
    """Return the beam's diameter away from focus: d sqrt(1 + (z / z_R)^2), Gaussian beam.

    Examples
    --------
    >>> spot_at_mm(0.2, 0.0, 2.5)
    0.2
    """
    return float(focus_spot_mm * (1.0 + (focus_offset_mm / rayleigh_mm) ** 2) ** 0.5)


def line_load_n_mm(pressure_kpa: float, width_mm: float) -> float:
    """Return the hoop load N = P w / pi on wall and seam of a tube, in N per mm of length.

    Parameters
    ----------
    pressure_kpa
        Gauge pressure.
    width_mm
        Lay-flat lumen width; the inflated diameter is 2 w / pi and N = P D / 2.

    Notes
    -----
    Standing: computed, thin-walled cylinder; film taken as inextensible. A stretched tube is
    wider and its load larger by the hoop strain.
    """
    return pressure_kpa * N_MM2_PER_KPA * width_mm / math.pi


def lap_load_n_mm(pressure_kpa: float, width_mm: float) -> float:
    """Return the axial load P w / (2 pi) on the lap of a sleeve joint, in N per mm of rim.

    The pressure pulls a tube apart with P pi D^2 / 4 around its circumference pi D, D = 2 w / pi:
    half the load on the side seam.

    Notes
    -----
    Standing: computed, as that of `line_load_n_mm`.

    Examples
    --------
    >>> round(lap_load_n_mm(30.0, 20.0), 4)
    0.0955
    """
    return line_load_n_mm(pressure_kpa, width_mm) / 2.0


def membrane_stress_mpa(pressure_kpa: float, width_mm: float, ply_mm: float) -> float:
    """Return the hoop stress N / t in the film of a tube.

    Examples
    --------
    >>> round(membrane_stress_mpa(70.0, 20.0, 0.0375), 1)
    11.9
    """
    return line_load_n_mm(pressure_kpa, width_mm) / ply_mm


def allowed_line_load_n_mm(burst_kpa: float, burst_width_mm: float) -> float:
    """Return the line load on the seam of a tube that was tested: N_allow = P_b w_b / pi.

    Parameters
    ----------
    burst_kpa
        Pressure at which the tube burst, or that it survived.
    burst_width_mm
        Its lay-flat width. Without it a pressure says nothing about other widths; the paper's
        70 kPa is quoted without one.
    """
    return line_load_n_mm(burst_kpa, burst_width_mm)


def seam_load_n_mm(seam: SeamTest) -> float:
    """Return the line load of a seam's test: at which it burst, or that it survived."""
    return allowed_line_load_n_mm(seam.pressure_kpa.value, seam.width_mm.value)


def burst_pressure_kpa(width_mm: float, allowed_n_mm: float) -> float:
    """Return P_max(w) = pi N_allow / w, the pressure at which a tube of a width bursts.

    Parameters
    ----------
    width_mm
        Lay-flat lumen width.
    allowed_n_mm
        Line load that the seam stands, from `allowed_line_load_n_mm`.

    Examples
    --------
    >>> round(burst_pressure_kpa(40.0, allowed_line_load_n_mm(70.0, 20.0)), 6)
    35.0
    """
    return math.pi * allowed_n_mm / (N_MM2_PER_KPA * width_mm)


def hoop_strain(pressure_kpa: float, width_mm: float, ply_mm: float, modulus_mpa: float) -> float:
    """Return the hoop strain N / (t E) of a tube's film, as a ratio.

    Valid as a first estimate only: linear film, load at the flat width. TPU softens, and the
    load grows with the diameter, so the real strain is larger.

    Examples
    --------
    >>> round(hoop_strain(70.0, 20.0, 0.0375, 30.0), 2)
    0.4
    """
    return membrane_stress_mpa(pressure_kpa, width_mm, ply_mm) / modulus_mpa
