import math

import pytest

from vinefab.physics import tube as lumen


def test_inflating_keeps_the_circumference() -> None:
    assert math.pi * lumen.inflated_diameter_mm(37.0) == pytest.approx(2 * 37.0)


def test_radius_and_area_belong_to_the_diameter() -> None:
    radius = lumen.inflated_radius_mm(24.0)
    assert 2 * radius == pytest.approx(lumen.inflated_diameter_mm(24.0))
    assert lumen.lumen_area_mm2(24.0) == pytest.approx(math.pi * radius**2)


def test_round_pouch_of_10_mm() -> None:
    assert lumen.pouch_radius_mm(10.0) == pytest.approx(7.63)
    assert lumen.pouch_thickness_mm(10.0) == pytest.approx(9.14)
    assert lumen.pouch_volume_mm3(10.0) == pytest.approx(1218.5)


def test_round_pouch_is_fuller_than_an_ellipsoid_and_slimmer_than_a_cylinder() -> None:
    radius, thickness = lumen.pouch_radius_mm(5.0), lumen.pouch_thickness_mm(5.0)
    disc = math.pi * radius**2 * thickness
    assert 2 / 3 * disc < lumen.pouch_volume_mm3(5.0) < disc
