"""``--growth`` and what a design was trained with, the same in every command that grows."""

import json

import pytest

from vinefab.app.predicting import grow
from vinefab.core.verbs import options_of
from vinefab.growth.options import GrowthOptions

TRAINED = '[origin.growth]\nbody = "centerline"\nhead_on_half_angle_deg = [3.0, 9.0]\n'
DEFAULT = "inflated body, head-on half-angle 1 deg (assumed), stops at 20 kPa"


@pytest.fixture
def trained(plain):
    """A plain vine that was trained as a line over a range of half-angles."""
    plain.write_text(plain.read_text() + TRAINED)
    return plain


def test_commands_grow_a_robot_unless_told_otherwise(vinefab, grid, plain):
    for command in ("grow", "score"):
        code, words, _ = vinefab(command, plain, "--map", grid)
        assert code == 0
        assert DEFAULT in words
    line = ("--growth", "body=centerline", "--growth", "pressure_stop=false")
    words = vinefab("score", plain, "--map", grid, *line)[1]
    assert "centerline body, head-on half-angle 1 deg (assumed), no pressure stops it" in words


def test_a_design_is_grown_as_it_was_trained_and_the_user_comes_first(vinefab, grid, trained):
    _, words, _ = vinefab("grow", trained, "--map", grid)
    assert "centerline body, head-on half-angle 3 deg (assumed)" in words
    assert "head-on half-angle 3 deg: the low end of its range, 3 to 9 deg" in words
    document = json.loads(vinefab("score", trained, "--map", grid, "--json", "-")[1])
    assert document["growth"]["head_on_half_angle_deg"] == pytest.approx([3.0, 9.0])
    angles = {e["terms"]["head_on_half_angle_deg"] for e in document["evaluations"]}
    assert len(angles) == len(document["evaluations"]) == 3
    given = ("--body", "inflated", "--growth", "head_on_half_angle_deg=2")
    document = json.loads(vinefab("grow", trained, "--map", grid, *given, "--json", "-")[1])
    metrics = document["metrics"]
    assert (metrics["body"], metrics["head_on_half_angle_deg"]) == ("inflated", pytest.approx(2.0))
    assert metrics["pressure_stop"] is True
    assert {*GrowthOptions().content} <= {*metrics}


def test_designs_trained_differently_are_compared_with_the_defaults(vinefab, grid, trained):
    other = trained.with_name("other.toml")
    other.write_text(trained.read_text().replace("centerline", "inflated"))
    code, words, _ = vinefab("compare", trained, other, "--map", grid, "--poses", 2)
    assert code == 0
    assert "trained with different growth options: all are grown with the defaults" in words
    assert DEFAULT in words


def test_a_design_of_no_run_is_compared_as_the_other_was_trained(vinefab, grid, trained):
    code, words, _ = vinefab("compare", trained, "plain_vine", "--map", grid, "--poses", 2)
    assert code == 0
    assert words.startswith("growth options of the design's origin")
    assert "centerline body" in words
    assert "plain minus plain_vine" in words


def test_a_check_has_growth_options_only_on_a_map(vinefab, grid, plain):
    code, _, complaint = vinefab("check", plain, "--growth", "body=inflated")
    assert code == 2
    assert "--map" in complaint
    code, words, _ = vinefab("check", plain, "--map", grid, "--growth", "body=centerline")
    assert code in (0, 1)
    # What growth to every tip would take is asked: no pressure stops it.
    assert "growth: centerline body, head-on half-angle 1 deg (assumed), no pressure" in words


def test_the_repeat_line_gives_the_same_options():
    given = {"head_on_half_angle_deg": [1, 15], "pressure_stop": False, "storage_kpa": 8.32}
    (option,) = [one for one in options_of(grow) if one.name == "growth"]
    words = option.words(given)
    assert words[::2] == ["--growth"] * len(given)
    assert option.value(words[1::2]) == given
    assert GrowthOptions.of(option.value(words[1::2])) == GrowthOptions.of(given)
