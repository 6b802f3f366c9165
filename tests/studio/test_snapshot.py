"""Snapshots: one file that shows a state without a server, and gives it back."""

import json
import re
from pathlib import Path

import pytest

from tests.studio.conftest import TabSession
from vinefab.core.errors import VinefabError
from vinefab.model.design import Design, design_content
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate
from vinefab.model.map import map_text
from vinefab.studio.executors import answer_of
from vinefab.studio.file_exports import (
    SnapshotOptions,
    snapshot_html,
    stored_state,
    write_snapshot,
)
from vinefab.studio.state import StudioState, world_of

HOSTILE = "</script><!-- \u2028 & \"quoted\" 'x' <script>"


@pytest.fixture(autouse=True)
def other_tests_grow_as_before(monkeypatch):
    monkeypatch.setattr("vinefab.studio.live_answers._ENGINE", ["interpreted"])


@pytest.fixture
def state():
    source = {"environment": "grid", "seed": 3}
    return {
        "design": design_content(Design.read("three_level_tree")),
        "map": {"source": source, "edits": [["remove", 0]]},
        "pose": None,
        "recipe": None,
        "task": "coverage",
        "family": {"environment": "grid", "count": 40, "seed": 1000},
        "growth": {},
        "locks": ["level.0.angle_deg"],
    }


@pytest.fixture
def answers(state):
    return {"live": answer_of("live", state, {})}


def test_the_same_state_gives_the_same_bytes_and_no_address(state, answers):
    answers["live"]["problems"] = [HOSTILE]
    page = snapshot_html(state, answers)
    assert page == snapshot_html(json.loads(json.dumps(state)), answers)
    text = page.decode()
    outside = [a for a in re.findall(r'(?:src|href)="([^"]*)"', text) if a[:1] not in "#d"]
    assert outside == []
    assert not re.search(r"@import|url\((?!data:)", text)
    assert text.count("</script>") == text.count("<script")
    assert "<!-- modules -->" not in text
    modules = json.loads(re.search(r'<script type="importmap">(.*?)</script>', text)[1])["imports"]
    assert "studio/app.js" in modules


def test_a_snapshot_gives_its_state_back(state, answers, tmp_path):
    path = tmp_path / "sent.html"
    path.write_bytes(snapshot_html(state, answers))
    assert stored_state(path) == state
    again = snapshot_html(stored_state(path), answers, SnapshotOptions(file="sent.html"))
    assert again == path.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["sent.html"]


def test_maps_travel_and_paths_stay_at_home(state, answers, tmp_path):
    lab = tmp_path / "home" / "lab.geojson"
    lab.parent.mkdir()
    lab.write_text(map_text(world_of({"source": {"environment": "pegs", "seed": 2}})))
    state["map"]["source"] = {"file": str(lab)}
    state["family"] = {"files": [str(lab)]}
    recipe = locate("recipe", DEFAULT_RECIPE).read_text()
    for folder in (lab.parent, tmp_path):  # at home, and next to the snapshot
        (folder / "laser.toml").write_text(recipe.replace(f'"{DEFAULT_RECIPE}"', '"laser"', 1))
    state["recipe"] = str(lab.parent / "laser.toml")
    before = map_text(StudioState.of(state).world)
    path = tmp_path / "sent.html"
    options = SnapshotOptions(file=str(tmp_path / "home" / "mine.toml"))
    path.write_bytes(snapshot_html(state, answers, options))
    assert str(tmp_path) not in path.read_text()
    lab.unlink()
    found = stored_state(path)
    assert map_text(StudioState.of(found).world) == before
    assert Path(found["map"]["source"]["file"]) == tmp_path / "sent.map.geojson"
    assert Path(found["recipe"]) == tmp_path / "laser.toml"
    (tmp_path / "sent.map.geojson").write_text("mine now")
    found = stored_state(path)
    assert Path(found["map"]["source"]["file"]) == tmp_path / "sent.map-2.geojson"
    assert (tmp_path / "sent.map.geojson").read_text() == "mine now"
    assert stored_state(path) == found


def changed(page, change):
    stored = re.search(rb'id="stored">(.*?)</script>', page, re.DOTALL)
    document = json.loads(stored[1])
    change(document)
    text = json.dumps(document).replace("<", "\\u003c")
    return page[: stored.start(1)] + text.encode() + page[stored.end(1) :]


def with_map(document, text):
    document["hello"]["state"]["map"]["source"] = {"file": "lab.geojson"}
    document["map"] = text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(schema="vinefab/snapshot-9"), "schema is 'vinefab/snapshot-9'"),
        (lambda d: d["hello"].update(state=[]), "state is []"),
        (lambda d: d["hello"]["state"]["design"].pop("trunk"), "trunk"),
        (lambda d: d["hello"]["state"]["map"]["edits"].append(["burn"]), "map.edits.1"),
        (lambda d: d["hello"]["state"]["map"].update(source={"file": "/etc/passwd"}), "map is mis"),
        (lambda d: with_map(d, "{}"), "map.type is missing"),
        (lambda d: with_map(d, "{"), "its map is not JSON"),
        (lambda d: d["hello"]["state"].update(growth={"body": "fat"}), "'inflated' or"),
    ],
)
def test_a_damaged_snapshot_is_one_line_that_names_it(state, answers, tmp_path, change, words):
    path = tmp_path / "sent.html"
    path.write_bytes(changed(snapshot_html(state, answers), change))
    with pytest.raises(VinefabError) as raised:
        stored_state(path)
    assert str(path) in str(raised.value)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("content", [b"<html>", b"\xff\xfe", b'id="stored">{</script>', b""])
def test_another_file_is_no_snapshot(tmp_path, content):
    path = tmp_path / "other.html"
    path.write_bytes(content)
    with pytest.raises(VinefabError, match=re.escape(str(path))):
        stored_state(path)


def test_a_snapshot_replaces_a_snapshot_and_nothing_else(state, tmp_path, monkeypatch):
    monkeypatch.setattr("vinefab.studio.file_exports.answer_of", lambda *_: {})
    path = write_snapshot(state, tmp_path / "sent.html")
    first = path.read_bytes()
    assert write_snapshot(state, path).read_bytes() == first
    path.write_text("<!doctype html> by hand")
    with pytest.raises(VinefabError, match="was not written by vinefab"):
        write_snapshot(state, path)


def test_a_snapshot_shows_the_state_from_a_file(state, tmp_path, browser):
    path = tmp_path / "sent.html"
    state["design"]["build"]["widths_mm"][-1] = 2.0  # which a rule forbids
    reference = design_content(Design.read("plain_vine"))
    write_snapshot(state, path, SnapshotOptions(date="1 May", reference=reference))
    tab = TabSession(browser.new_page(viewport={"width": 1280, "height": 800}))
    page = tab.open(path.as_uri()).page
    value = page.locator("#value-level-0-length")
    assert float(value.input_value()) == state["design"]["level"][0]["length"]
    assert value.is_disabled()
    assert page.locator("#map .robot-layer path[data-branch]").count() >= 13
    assert page.locator("#map .ghost-layer path[data-branch]").count() >= 1
    assert "worse" in page.locator("#compare [data-measure=errors]").inner_text()
    page.locator("#findings [data-rule=VF-W01] button").click()
    assert "5 mm" in page.locator("#findings .detail").inner_text()
    hidden = page.locator("#map .robot-layer .unborn")
    assert hidden.count() == 0
    page.locator("#front").fill("200")
    assert hidden.count() > 0
    assert "snapshot of 1 May" in page.locator("#status").inner_text()
    assert "vinefab studio sent.html" in page.locator("#status").inner_text()
    assert page.locator("#export > button").is_disabled()
    assert tab.problems == []
    page.close()
