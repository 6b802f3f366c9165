import math

import pytest

from vinefab.physics import buckling


def test_a_tube_of_20_mm_at_30_kpa() -> None:
    assert buckling.crush_load_n(30.0, 20.0) == pytest.approx(3.82, abs=0.01)
    assert buckling.axial_load_n(30.0, 20.0, 300.0, 0.0375, 30.0) == pytest.approx(0.0991, abs=1e-3)


def test_wrinkles_come_at_half_the_moment_that_folds() -> None:
    radius = 20.0 / math.pi
    assert buckling.collapse_moment_n_mm(30.0, 20.0) == pytest.approx(math.pi * 0.03 * radius**3)
    assert buckling.wrinkle_moment_n_mm(30.0, 20.0) * 2 == buckling.collapse_moment_n_mm(30.0, 20.0)
    assert buckling.side_load_n(30.0, 20.0, 100.0) * 100 == pytest.approx(
        buckling.collapse_moment_n_mm(30.0, 20.0)
    )


def test_a_short_tube_carries_shear_and_pressure_and_no_more() -> None:
    # L -> 0: F -> pi (R^2 P + G R t), the shear limit of the formula
    radius = 20.0 / math.pi
    limit = math.pi * (radius**2 * 0.03 + 10.0 * radius * 0.0375)
    assert buckling.axial_load_n(30.0, 20.0, 1e-6, 0.0375, 30.0) == pytest.approx(limit)


def test_without_shear_compliance_a_long_tube_is_eulers_column() -> None:
    # Very high pressure stands for infinite shear stiffness: F -> E I pi^2 / L^2, I = pi R^3 t
    radius = 20.0 / math.pi
    euler = 30.0 * math.pi * radius**3 * 0.0375 * math.pi**2 / 1000.0**2
    assert buckling.axial_load_n(1e9, 20.0, 1000.0, 0.0375, 30.0) == pytest.approx(euler, rel=1e-4)
