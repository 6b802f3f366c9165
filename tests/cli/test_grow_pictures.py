import json

import pytest


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
