import math

import pytest

from tests.oracles.tube_mechanics import (
    axial_buckling_n,
    bending_stiffness_n_mm2,
    growth_push_n,
)
from vinefab.physics import tube


def test_inflating_keeps_the_circumference() -> None:
    assert math.pi * tube.inflated_diameter_mm(37.0) == pytest.approx(2 * 37.0)


def test_radius_and_area_belong_to_the_diameter() -> None:
    radius = tube.inflated_radius_mm(24.0)
    assert 2 * radius == pytest.approx(tube.inflated_diameter_mm(24.0))
    assert tube.lumen_area_mm2(24.0) == pytest.approx(math.pi * radius**2)


TPU = {"ply_mm": 0.0375, "modulus_mpa": 30.0, "shear_mpa": 10.0}


@pytest.mark.parametrize(
    ("width_mm", "span_mm"), [(6.6, 32.9), (10.0, 39.7), (20.0, 53.2), (40.0, 69.8)]
)
def test_spans_fold_from_the_lengths_of_the_specification(width_mm, span_mm):
    push_n = growth_push_n(30.0, 10.5, width_mm)
    assert axial_buckling_n(span_mm + 0.2, 30.0, width_mm, **TPU) < push_n
    assert axial_buckling_n(span_mm - 0.2, 30.0, width_mm, **TPU) > push_n


def test_axial_buckling_of_long_and_of_short_spans():
    """Long: Euler's load pi^2 E I / L^2. Short: shear alone, P pi R^2 + G pi R t."""
    bending = bending_stiffness_n_mm2(20.0, 0.0375, 30.0)
    long_n = axial_buckling_n(5000.0, 30.0, 20.0, **TPU)
    assert long_n == pytest.approx(math.pi**2 * bending / 5000.0**2, rel=1e-4)
    radius_mm = tube.inflated_radius_mm(20.0)
    shear_n = 0.03 * math.pi * radius_mm**2 + 10.0 * math.pi * radius_mm * 0.0375
    assert axial_buckling_n(1e-3, 30.0, 20.0, **TPU) == pytest.approx(shear_n, rel=1e-6)


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


def test_without_pressure_to_spare_a_tip_does_not_push():
    assert growth_push_n(30.0, 10.5, 20.0) == pytest.approx(2.4828, abs=1e-4)
    assert growth_push_n(10.0, 10.5, 20.0) == 0.0
