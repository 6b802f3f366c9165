"""Seams under pressure, and the spot that welds them."""

import math

import pytest

from vinefab.physics import seam

# --- Pressure --------------------------------------------------------------------------------


@pytest.mark.parametrize(("width", "stress"), [(10, 5.9), (20, 11.9), (40, 23.8), (60, 35.7)])
def test_membrane_stress_at_70_kpa(width: float, stress: float) -> None:
    assert seam.membrane_stress_mpa(70.0, width, 0.0375) == pytest.approx(stress, abs=0.05)


@pytest.mark.parametrize(("width", "limit"), [(10, 140), (20, 70), (40, 35), (60, 23)])
def test_burst_pressure_falls_with_the_width(width: float, limit: float) -> None:
    allowed = seam.allowed_line_load_n_mm(70.0, 20.0)
    assert seam.burst_pressure_kpa(width, allowed) == pytest.approx(limit, abs=0.5)


def test_a_60_mm_trunk_fails_at_50_kpa() -> None:
    allowed = seam.allowed_line_load_n_mm(70.0, 20.0)
    assert seam.burst_pressure_kpa(60.0, allowed) < 50.0


def test_line_load_at_the_burst_pressure_is_the_allowed_one() -> None:
    limit = seam.burst_pressure_kpa(33.0, 0.4)
    assert seam.line_load_n_mm(limit, 33.0) == pytest.approx(0.4)


def test_thin_tpu_stretches_by_forty_percent() -> None:
    assert seam.hoop_strain(70.0, 20.0, 0.0375, 30.0) == pytest.approx(0.396, abs=0.001)


# --- Beam ------------------------------------------------------------------------------------


def test_spot_is_root_two_wider_one_rayleigh_length_away() -> None:
    assert seam.spot_at_mm(0.2, 3.0, 3.0) == pytest.approx(0.2 * math.sqrt(2))
    assert seam.spot_at_mm(0.2, -3.0, 3.0) == seam.spot_at_mm(0.2, 3.0, 3.0)
