"""Commands that predict: growth in pictures, growth options, reports."""

import json
import re

import pytest

from vinefab.app.predicting import grow
from vinefab.cli.main import main
from vinefab.core.verbs import options_of
from vinefab.growth.options import GrowthOptions


@pytest.fixture
def tree(grid):
    published = ("--growth", "body=centerline", "--growth", "pressure_stop=false")
    return ("grow", "three_level_tree", "--map", grid, *published)


def test_history_is_in_the_json_only_when_asked_for(vinefab, tree):
    _, plain, _ = vinefab(*tree, "--json", "-")
    code, text, _ = vinefab(*tree, "--json", "-", "--history", "100,250.5")
    document = json.loads(text)
    history = document.pop("history")
    assert code == 0
    assert document == json.loads(plain)
    assert [entry["front_mm"] for entry in history] == [100.0, 250.5]
    assert [len(entry["branches"]) for entry in history] == [1, 4]
    assert history[0]["branches"][0]["grown_mm"] == pytest.approx(100.0)
    steps = json.loads(vinefab(*tree, "--json", "-", "--history", "5")[1])["history"]
    assert len(steps) == 5
    final = {
        branch["id"]: branch["points_mm"]
        for branch in document["branches"]
        if branch["stop"] != "not_deployed"
    }
    assert {branch["id"]: branch["points_mm"] for branch in steps[-1]["branches"]} == final


@pytest.mark.parametrize(("name", "start"), [("a.svg", b"<svg"), ("a.GIF", b"GIF89a")])
def test_animation_is_written_and_may_be_written_again(vinefab, tree, tmp_path, name, start):
    path = tmp_path / name
    for _ in range(2):
        code, words, complaint = vinefab(*tree, "--animate", path, "--frames", 5)
        assert (code, complaint) == (0, "")
        assert str(path) in words
    assert path.read_bytes().startswith(start)


def test_labels_are_drawn_on_request(vinefab, tree, tmp_path):
    plain, named = tmp_path / "plain.svg", tmp_path / "named.svg"
    vinefab(*tree, "--svg", plain)
    vinefab(*tree, "--svg", named, "--label")
    assert named.stat().st_size > plain.stat().st_size


# --- ``--growth`` and what a design was trained with, the same in every command that grows --------


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


# --- Reports and comparisons ----------------------------------------------------------------------


SMALL = ("--set", "columns=3", "--set", "rows=3", "--set", "size_mm=300")


def test_report_over_an_environment_repeats_itself(vinefab, tmp_path):
    pages = []
    for name in ("one", "two"):
        out, numbers = tmp_path / f"{name}.html", tmp_path / f"{name}.json"
        code, words, complaint = vinefab(
            "report", "plain_vine", "--environment", "grid", "--count", 3, *SMALL, "--poses", 2,
            "--out", out, "--json", numbers,
        )  # fmt: skip
        assert (code, complaint) == (0, "")
        assert "; 3 maps]" in words
        document = json.loads(numbers.read_text())
        assert len(document["fields"][0]["deployments"]) == 6
        # the digest in its mark is that of the page with its path
        pages.append(re.sub(r" \[[0-9a-f]{16}\]", "", out.read_text().replace(str(out), "OUT")))
    assert pages[0] == pages[1]


def test_an_interrupted_report_leaves_nothing(monkeypatch, grid, tmp_path):
    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("vinefab.prediction.predict.tolerance", interrupted)
    before = sorted(tmp_path.iterdir())
    out = tmp_path / "report.html"
    code = main(
        ["report", "plain_vine", "--maps", str(grid), "--out", str(out), "--json", "x.json"]
    )
    assert code == 130
    assert sorted(tmp_path.iterdir()) == before


def test_compare_says_who_is_better(vinefab, tmp_path):
    page, numbers = tmp_path / "compare.html", tmp_path / "compare.json"
    arguments = (
        "compare", "three_level_tree", "plain_vine", "--environment", "grid", "--count", 2,
        *SMALL, "--poses", 1, "--out", page, "--json", numbers,
    )  # fmt: skip
    code, words, complaint = vinefab(*arguments, "--measure", "seen")
    assert (code, complaint) == (0, "")
    assert "three_level_tree minus plain_vine" in words
    assert json.loads(numbers.read_text())["measure"] == "seen_percent"
    assert "Paired differences" in page.read_text()
    code, _, complaint = vinefab(*arguments, "--measure", "growth_pressure")
    assert code == 2
    assert "growth_pressure_loose_kpa" in complaint
    assert vinefab("compare", "plain_vine", "--environment", "grid")[0] == 2
