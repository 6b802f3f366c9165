import math

import pytest

from vinefab.physics import tube


def test_inflating_keeps_the_circumference() -> None:
    assert math.pi * tube.inflated_diameter_mm(37.0) == pytest.approx(2 * 37.0)


def test_radius_and_area_belong_to_the_diameter() -> None:
    radius = tube.inflated_radius_mm(24.0)
    assert 2 * radius == pytest.approx(tube.inflated_diameter_mm(24.0))
    assert tube.lumen_area_mm2(24.0) == pytest.approx(math.pi * radius**2)
