"""The page's types are those of the declared tables, and of what the server answers."""

import json
import math
from dataclasses import replace

import pytest

from tests.studio.page.state_types import STATE, state_types
from vinefab.maps import generate
from vinefab.model.design import Build, Design, Level, design_text
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.map import map_text
from vinefab.model.target import Target
from vinefab.studio.executors import PANELS, answer_of
from vinefab.studio.file_store import FILE_REQUESTS
from vinefab.studio.searches import SEARCH_REQUESTS
from vinefab.studio.server import LaunchOptions, StudioWorkspace

PAGE = STATE.parent
KEY = "abcdef012345"


def test_the_types_of_the_state_are_those_of_the_tables():
    command = "python tests/studio/page/state_types.py"
    assert STATE.read_text(encoding="utf-8") == state_types(), f"state.d.ts is old: {command}"


def test_the_development_packages_are_pinned_without_an_address():
    text = (PAGE / "package-lock.json").read_text(encoding="utf-8")
    assert "://" not in text
    root = json.loads(text)["packages"][""]
    wanted = json.loads((PAGE / "package.json").read_text(encoding="utf-8"))["devDependencies"]
    assert root["devDependencies"] == wanted
    assert all(version[0].isdecimal() for version in wanted.values())


PANEL_ASKS = {
    "live": [{"obstacle": 0}, {"ground": False, "scores": False}, {"branch": "0.1"}],
    "front": [{"front_mm": 120.0}],
    "tip": [{"branch": "0.1", "to": [150.0, 150.0]}],
    "edit": [{"do": "free", "branch": "0.1"}],
    "export": [
        {"what": "command", "exports": {"package": {"out": "made", "options": {}}}},
        {"what": "picture", "out": "grown.svg", "options": {}},
        {"what": "package", "out": "made", "options": {}},
    ],
}
"""What the panels ask; the others ask nothing."""

RUNS = {"search_start", "search_stop", "search_resume", "search_load", "search_front"}
"""Questions about a run: `test_searches` asks them."""


def request_asks(state):
    other = {**state["design"], "name": "other"}
    return {
        "open_design": [{"design": "mine.toml"}],
        "open_map": [{"path": "pegs.geojson"}],
        "open_recipe": [{"recipe": DEFAULT_RECIPE}],
        "save_design": [
            {"path": "mine.toml", "design": other, "stamp": "of another version"},
            {"path": "other.toml", "design": other},
        ],
        "save_map": [
            {"path": "pegs.geojson", "map": state["map"], "stamp": "of another version"},
            {"path": "saved.geojson", "map": state["map"], "pose": None},
        ],
        "keep_autosave": [{"key": KEY, "state": state, "file": {"path": "mine.toml"}}],
        "open_autosave": [{"key": KEY}],
        "drop_autosave": [{"key": "fedcba543210"}],
    }


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """A design that cannot be cut as it is, and a map with a target."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VINEFAB_PROFILES", str(tmp_path / "own"))
    fork = Level(branches=2, length_mm=80.0, fan_rad=math.radians(90.0))
    build = Build(widths_mm=(30.0, 20.0), fillet_mm=(0.1,))
    design = Design(name="mine", trunk_length_mm=150.0, levels=(fork,), build=build)
    (tmp_path / "mine.toml").write_text(design_text(design))
    world = replace(generate("pegs", 1), targets=(Target(name="A", point_mm=(100.0, 100.0)),))
    (tmp_path / "pegs.geojson").write_text(map_text(world))
    return StudioWorkspace(LaunchOptions(design="mine.toml", map_file=tmp_path / "pegs.geojson"))


def answers(workspace):
    """Yield what the server gives, with the type that the page takes it for."""
    yield "Hello", workspace.hello()
    state = {**workspace.state, "family": {"environment": "pegs", "count": 4, "seed": 20}}
    for panel in PANELS:
        for ask in PANEL_ASKS.get(panel, [{}]):
            yield f'Answers["{panel}"]', answer_of(panel, state, ask)
    asks = request_asks(state)
    for name in [*FILE_REQUESTS, *SEARCH_REQUESTS]:
        for ask in [] if name in RUNS else asks.get(name, [{}]):
            yield f'RequestAnswers["{name}"]', workspace.answer(name, state, ask)


def test_the_answers_of_the_server_are_those_that_the_page_takes(workspace, page_types):
    page_types(answers(workspace))
