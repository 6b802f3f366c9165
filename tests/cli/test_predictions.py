"""Commands that predict: growth in pictures, growth options, reports."""

import json

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


# --- ``--growth`` and what a design was trained with, the same in every command that grows --------


TRAINED = '[origin.growth]\nbody = "centerline"\nhead_on_half_angle_deg = [3.0, 9.0]\n'
DEFAULT = "inflated body, head-on half-angle 1 deg (assumed), stops at 20 kPa"


@pytest.fixture
def trained(plain):
    """A plain vine that was trained as a line over a range of half-angles."""
    plain.write_text(plain.read_text() + TRAINED)
    return plain


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
    assert DEFAULT.replace("1 deg", "15.5 deg") in words


def test_a_design_of_no_run_is_compared_as_the_other_was_trained(vinefab, grid, trained):
    code, words, _ = vinefab("compare", trained, "plain_vine", "--map", grid, "--poses", 2)
    assert code == 0
    assert words.startswith("growth options of the design's origin")
    assert "centerline body" in words
    assert "plain minus plain_vine" in words


def test_winners_of_one_name_are_told_apart_by_the_folders_of_their_runs(vinefab, grid, plain):
    paths = []
    for run in ("first", "second"):
        folder = plain.parent / "runs" / run
        folder.mkdir(parents=True)
        paths.append(folder / "best.toml")
        paths[-1].write_bytes(plain.read_bytes())
    code, words, _ = vinefab("compare", *paths, "--map", grid, "--poses", 2)
    assert code == 0
    assert "plain (first) minus plain (second)" in words
    code, words, _ = vinefab("compare", paths[0], paths[0], "--map", grid, "--poses", 2)
    assert code == 0
    assert "plain (1) minus plain (2)" in words


def test_the_repeat_line_gives_the_same_options():
    given = {"head_on_half_angle_deg": [1, 15], "pressure_stop": False, "storage_kpa": 8.32}
    (option,) = [one for one in options_of(grow) if one.name == "growth"]
    words = option.words(given)
    assert words[::2] == ["--growth"] * len(given)
    assert option.value(words[1::2]) == given
    assert GrowthOptions.of(option.value(words[1::2])) == GrowthOptions.of(given)


# --- Reports and comparisons ----------------------------------------------------------------------


SMALL = ("--set", "columns=3", "--set", "rows=3", "--set", "size_mm=300")


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
