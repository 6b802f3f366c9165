import math

import pytest

from vinefab.physics import seam as beam


def test_energy_grows_with_power_and_passes_and_falls_with_speed() -> None:
    once = beam.line_energy_mj_mm(12.0, 60.0)
    assert once == pytest.approx(200.0)
    assert beam.line_energy_mj_mm(12.0, 60.0, 3) == pytest.approx(3 * once)
    assert beam.line_energy_mj_mm(12.0, 120.0) == pytest.approx(once / 2)


def test_fluence_converts_mj_per_mm2_to_j_per_cm2() -> None:
    # 46 mJ along 1 mm, 0.2 mm wide: 230 mJ/mm^2 = 23 J/cm^2
    assert beam.fluence_j_cm2(46.0, 0.2) == pytest.approx(23.0)


def test_spot_is_root_two_wider_one_rayleigh_length_away() -> None:
    assert beam.spot_at_mm(0.2, 3.0, 3.0) == pytest.approx(0.2 * math.sqrt(2))
    assert beam.spot_at_mm(0.2, -3.0, 3.0) == beam.spot_at_mm(0.2, 3.0, 3.0)
