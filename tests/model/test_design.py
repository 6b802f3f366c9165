import math

import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.design import Build, Design, Level, Pouch, default_fillets_mm


def level(**changes) -> Level:
    return Level(**({"branches": 3, "length_mm": 90.0, "fan_rad": 1.0} | changes))


@pytest.mark.parametrize(
    "changes", [{"branches": 0}, {"length_mm": 0.0}, {"fan_rad": -0.1}, {"growth": 0.0}]
)
def test_a_level_refuses_what_cannot_be_built(changes):
    with pytest.raises(BadInputError):
        level(**changes)


def test_standard_build_scales_widths_and_keeps_the_documented_ratio():
    build = Build.standard(3)
    assert build.widths_mm == pytest.approx((40.0, 24.0, 14.4))
    assert build.fillet_mm == pytest.approx((6.0, 3.6))
    assert default_fillets_mm((40.0, 5.0)) == (2.0,)


def test_a_build_needs_one_width_per_level():
    with pytest.raises(BadInputError, match="2 widths"):
        Design(name="x", trunk_length_mm=1.0, levels=(level(),), build=Build.standard(3))


@pytest.mark.parametrize("name", ["", "a/b", "../up", "a b", ".hidden", "x" * 101])
def test_a_name_must_do_as_a_file_name(name):
    with pytest.raises(BadInputError):
        Design(name=name, trunk_length_mm=1.0, build=Build.standard(1))


def test_a_tree_too_large_to_grow_is_refused_at_once():
    levels = tuple(level(branches=1000) for _ in range(3))
    with pytest.raises(BadInputError, match="at most 100000 in all"):
        Design(name="x", trunk_length_mm=1.0, levels=levels, build=Build.standard(4))


def test_a_pouch_has_just_the_sizes_of_its_shape():
    assert Pouch(shape="round", radius_mm=12.0).flat_width_mm == 24.0
    assert Pouch(shape="rectangle", length_mm=30.0, width_mm=20.0).flat_width_mm == 20.0
    with pytest.raises(BadInputError, match=r"radius_mm is missing"):
        Pouch(shape="round")
    with pytest.raises(BadInputError, match=r"radius_mm is 3\.0"):
        Pouch(shape="rectangle", length_mm=30.0, width_mm=20.0, radius_mm=3.0)


def test_origin_cannot_be_changed_afterwards():
    design = Design(name="x", trunk_length_mm=1.0, build=Build.standard(1), origin={"run": "a"})
    with pytest.raises(TypeError):
        design.origin["run"] = "b"


def test_a_level_takes_radians_and_shares_in_python_only():
    level_ = Level(branches=3, length_mm=90.0, fan_rad=math.radians(60.0), growth=0.8)
    assert level_ == Level(branches=3, length_mm=90.0, angle_deg=60.0, growth_percent=80.0)
    assert level_.changed(fan_rad=1.0).fan_rad == 1.0
    with pytest.raises(BadInputError, match="angle_deg is 'x'"):
        level(fan_rad="x")


def test_a_build_without_widths_follows_the_number_of_levels():
    design = Design(
        name="x",
        trunk_length_mm=9.0,
        levels=[level()],
        build=Build(pressure_kpa=30, taper=(1, 0.5)),
    )
    assert design.build == Build.standard(2).changed(pressure_kpa=30.0, taper=(1.0, 0.5))
    with pytest.raises(BadInputError, match=r"build\.taper is \[0\.5\]; allowed: 2 numbers"):
        design.changed(build=Build(taper=(0.5,)))


@pytest.mark.parametrize("name", ["width_mm", "taper", "fillet_mm", "length_mm"])
def test_an_error_about_a_level_names_what_was_given(name):
    design = Design(
        name="t",
        trunk_length_mm=100.0,
        levels=(Level(branches=2, length_mm=50.0),),
        build=Build.standard(2),
    )
    with pytest.raises(BadInputError) as raised:
        design.with_level(2, **{name: "3"})
    assert raised.value.key in (name, name.removesuffix("_mm"))
