"""Which growth options a command takes, and how they are named beside a score."""

import math

import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.growth.options import GrowthChoice, GrowthOptions, growth_text, trained_growth
from vinefab.model.design import Build, Design, design_text

VINE = Design(name="vine", trunk_length_mm=100.0, build=Build.standard(1))


def trained(table: object) -> Design:
    """A design whose origin says how it was grown."""
    return VINE.changed(origin={"growth": table})


def test_users_make_robots_not_threads() -> None:
    assert GrowthOptions() == GrowthOptions(body="inflated", pressure_stop=True)
    assert GrowthChoice.of([VINE]).options == GrowthOptions()
    assert GrowthOptions.published() == GrowthOptions(body="centerline", pressure_stop=False)


def test_what_the_user_gives_comes_before_the_origin_and_that_before_the_default() -> None:
    robot = trained({"body": "centerline", "storage_kpa": 8.32})
    options = GrowthChoice.of([robot], {"storage_kpa": 2.0}).options
    assert options == GrowthOptions(body="centerline", storage_kpa=2.0)


def test_an_origin_survives_a_file_and_gives_the_same_options(tmp_path) -> None:
    options = GrowthOptions(
        head_on_half_angle_rad=(math.radians(1.0), math.radians(15.0)), children_of_stuck="deploy"
    )
    path = tmp_path / "robot.toml"
    path.write_text(design_text(trained(options.content)))
    assert trained_growth(Design.read(path)) == options


def test_designs_trained_differently_are_grown_with_the_defaults_and_that_is_said() -> None:
    line, robot = trained({"body": "centerline"}), trained({"pressure_stop": False})
    choice = GrowthChoice.of([line, robot])
    assert choice.options == GrowthOptions()
    assert "trained with different growth options" in choice.notes[0]
    assert GrowthChoice.of([line, line]) == GrowthChoice(options=GrowthOptions(body="centerline"))
    given = {"body": "inflated", "pressure_stop": True}
    assert GrowthChoice.of([line, robot], given).notes == ()


def test_a_single_growth_takes_the_low_end_of_a_range_and_says_so() -> None:
    choice = GrowthChoice.of([trained({"head_on_half_angle_deg": [2, 15]})])
    assert choice.options.draws_half_angle
    assert choice.single.options.half_angle_deg == pytest.approx(2.0)
    assert choice.single.notes == (
        "head-on half-angle 2 deg: the low end of its range, 2 to 15 deg",
    )
    assert GrowthChoice.of([VINE]).single.notes == ()


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ("inflated", "origin.growth"),
        ({"body": "fat"}, "origin.growth.body"),
        ({"bodi": "inflated"}, "origin.growth.bodi"),
        ({"pressure_stop": "no"}, "origin.growth.pressure_stop"),
        ({"storage_kpa": True}, "origin.growth.storage_kpa"),
        ({"fitted_diameter_mm": "wide"}, "origin.growth.fitted_diameter_mm"),
        ({"head_on_half_angle_deg": [15, 1]}, "origin.growth.head_on_half_angle_deg"),
        ({"head_on_half_angle_deg": {}}, "origin.growth.head_on_half_angle_deg"),
    ],
)
def test_a_broken_origin_is_one_line_with_the_key(table: object, key: str) -> None:
    with pytest.raises(BadInputError) as caught:
        GrowthChoice.of([trained(table)])
    assert str(caught.value).startswith((f"design vine: {key} is ", f"design vine: {key}: "))
    assert "\n" not in str(caught.value)


def test_an_unknown_option_of_the_user_is_named() -> None:
    with pytest.raises(UnknownNameError, match="pressure_stop"):
        GrowthChoice.of([VINE], {"presure_stop": False})


def test_body_half_angle_and_pressure_stand_in_one_line() -> None:
    assert growth_text(GrowthOptions(), [VINE]) == (
        "inflated body, head-on half-angle 1 deg (assumed), "
        "stops at 20 kPa (film stored loosely, assumed)"
    )
    soft = VINE.changed(build=VINE.build.changed(pressure_kpa=0.0))
    assert growth_text(GrowthOptions(), [soft]).endswith(", no pressure stops it")
    assert "stops at each design's pressure" in growth_text(GrowthOptions(), [VINE, soft])
    tight = GrowthOptions(storage_kpa=8.32, children_of_stuck="deploy")
    assert growth_text(tight, [VINE]).endswith(
        "stops at 20 kPa (film held back by 8.32 kPa, assumed), "
        "children of a stuck branch grow all the same"
    )
    assert growth_text(GrowthOptions.published(), [VINE]) == (
        "centerline body, head-on half-angle 1 deg (assumed), no pressure stops it"
    )
