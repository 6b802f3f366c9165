import math

import pytest

from vinefab.physics import tube


def test_inflating_keeps_the_circumference() -> None:
    assert math.pi * tube.inflated_diameter_mm(37.0) == pytest.approx(2 * 37.0)


def test_radius_and_area_belong_to_the_diameter() -> None:
    radius = tube.inflated_radius_mm(24.0)
    assert 2 * radius == pytest.approx(tube.inflated_diameter_mm(24.0))
    assert tube.lumen_area_mm2(24.0) == pytest.approx(math.pi * radius**2)


def test_moments_grow_with_pressure_and_with_the_cube_of_the_radius():
    assert tube.collapse_moment_n_mm(30.0, 20.0, 1.0) == pytest.approx(24.317, abs=1e-3)
    assert tube.collapse_moment_n_mm(60.0, 40.0, 1.0) == pytest.approx(16.0 * 24.317, abs=0.02)
    assert tube.collapse_moment_n_mm(30.0, 20.0) == pytest.approx(0.83 * 24.317, abs=1e-3)


def test_a_cantilever_folds_where_its_weight_bends_it_to_the_collapse_moment():
    span_mm = tube.self_weight_span_mm(30.0, 20.0, 0.0375, 1200.0)
    # Tube of circumference 40 mm and as much film inside, over half the span.
    weight_n = 2.0 * 40.0 * 0.0375 * span_mm * 1200e-9 * 9.80665
    assert weight_n * span_mm / 2.0 == pytest.approx(tube.collapse_moment_n_mm(30.0, 20.0))
    simple_mm = 2.0 * 20.0 / math.pi * math.sqrt(30e3 / (8.0 * 1200.0 * 9.80665 * 37.5e-6))
    assert span_mm == pytest.approx(math.sqrt(0.83) * simple_mm)


# --- Pressure --------------------------------------------------------------------------------


@pytest.mark.parametrize(("width", "stress"), [(10, 5.9), (20, 11.9), (40, 23.8), (60, 35.7)])
def test_membrane_stress_at_70_kpa(width: float, stress: float) -> None:
    assert tube.membrane_stress_mpa(70.0, width, 0.0375) == pytest.approx(stress, abs=0.05)


@pytest.mark.parametrize(("width", "limit"), [(10, 140), (20, 70), (40, 35), (60, 23)])
def test_burst_pressure_falls_with_the_width(width: float, limit: float) -> None:
    allowed = tube.allowed_line_load_n_mm(70.0, 20.0)
    assert tube.burst_pressure_kpa(width, allowed) == pytest.approx(limit, abs=0.5)


def test_a_60_mm_trunk_fails_at_50_kpa() -> None:
    allowed = tube.allowed_line_load_n_mm(70.0, 20.0)
    assert tube.burst_pressure_kpa(60.0, allowed) < 50.0


def test_line_load_at_the_burst_pressure_is_the_allowed_one() -> None:
    limit = tube.burst_pressure_kpa(33.0, 0.4)
    assert tube.line_load_n_mm(limit, 33.0) == pytest.approx(0.4)


def test_thin_tpu_stretches_by_forty_percent() -> None:
    assert tube.hoop_strain(70.0, 20.0, 0.0375, 30.0) == pytest.approx(0.396, abs=0.001)


# --- Beam ------------------------------------------------------------------------------------


def test_spot_is_root_two_wider_one_rayleigh_length_away() -> None:
    assert tube.spot_at_mm(0.2, 3.0, 3.0) == pytest.approx(0.2 * math.sqrt(2))
    assert tube.spot_at_mm(0.2, -3.0, 3.0) == tube.spot_at_mm(0.2, 3.0, 3.0)
