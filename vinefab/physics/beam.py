"""What a laser's settings put into the film; computed from a recipe, never read from one."""


def line_energy_mj_mm(power_w: float, speed_mm_s: float, passes: int = 1) -> float:
    """Return the energy per length of path, all passes together.

    Parameters
    ----------
    power_w
        Power that the tube gives, rated power times the setting.
    speed_mm_s
        Speed of the head.
    passes
        How often the path is traced.

    Examples
    --------
    >>> line_energy_mj_mm(6.0, 60.0)
    100.0
    """
    return 1000.0 * passes * power_w / speed_mm_s


def fluence_j_cm2(energy_mj_mm: float, spot_mm: float) -> float:
    """Return the energy per area of the track that the beam sweeps, spot wide.

    Standing of what it is compared with (computed): two plies of 0.0375 mm TPU take about
    2.8 J/cm^2 to melt and 23 J/cm^2 to cut.

    Examples
    --------
    >>> fluence_j_cm2(100.0, 0.5)
    20.0
    """
    return 0.1 * energy_mj_mm / spot_mm


def spot_at_mm(focus_spot_mm: float, focus_offset_mm: float, rayleigh_mm: float) -> float:
    """Return the beam's diameter away from focus: d sqrt(1 + (z / z_R)^2), Gaussian beam.

    Examples
    --------
    >>> spot_at_mm(0.2, 0.0, 2.5)
    0.2
    """
    return float(focus_spot_mm * (1.0 + (focus_offset_mm / rayleigh_mm) ** 2) ** 0.5)
