"""What the page sends becomes nouns, or one line that names the key; forms of declared tables."""

import copy
import json
from contextlib import suppress
from pathlib import Path
from pkgutil import resolve_name

import pytest

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.table import declared_keys, inner_table
from vinefab.maps import grid
from vinefab.model.design import Design, design_content
from vinefab.model.map import map_text
from vinefab.studio.executors import PANELS, answer_of
from vinefab.studio.file_store import FileStore
from vinefab.studio.state import PAGE, StudioState, design_form, world_of

GRID = {"source": {"environment": "grid", "seed": 3}, "edits": []}


def state(**changes):
    design = json.loads(json.dumps(design_content(Design.read("grid_explorer_levels"))))
    return {"design": design, "map": copy.deepcopy(GRID), **changes}


def test_a_state_gives_the_design_and_the_map_that_it_names():
    read = StudioState.of(state())
    assert read.design == Design.read("grid_explorer_levels")
    assert map_text(read.world) == map_text(grid(3))
    assert read.start == grid(3).starts[0].pose


def test_edits_are_applied_in_order():
    square = [[0, 0], [10, 0], [10, 10], [0, 10]]
    edits = [["add", square], ["move", 36, 5, -2], ["remove", 0]]
    world = world_of({**GRID, "edits": edits})
    before = grid(3).obstacles
    assert len(world.obstacles) == len(before)
    assert world.obstacles[0].equals(before[1])
    assert world.obstacles[-1].bounds == (5.0, -2.0, 15.0, 8.0)


def test_a_map_file_is_read_anew_when_it_changes(tmp_path):
    path = tmp_path / "m.geojson"
    content = {"source": {"file": str(path)}, "edits": []}
    for seed in (1, 2):
        path.write_text(map_text(grid(seed)))
        assert map_text(world_of(content)) == map_text(grid(seed))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"design": None}, "design"),
        ({"design": [1]}, "design"),
        ({"design": {}}, "schema"),
        ({"map": {"source": {"environment": "moon"}}}, "moon"),
        ({"map": {"source": {"environment": [1]}}}, "map.environment"),
        ({"map": {**GRID, "edits": [["remove", 1e9]]}}, "map.edits.0"),
        ({"map": {"source": {"environment": "grid", "seed": -1}}}, "map.seed"),
        ({"map": {"source": {"environment": "grid", "options": {"size": 1}}}}, "grid.size"),
        ({"map": {**GRID, "edits": [["move", 99, 1, 1]]}}, "map.edits.0"),
        ({"map": {**GRID, "edits": [["add", [[0, 0], [1, 1], [1, 0], [0, 1]]]]}}, "map.edits.0"),
        ({"map": {**GRID, "edits": [["move", 0, float("nan"), 1]]}}, "map.edits.0"),
        ({"map": {**GRID, "edits": [["turn", 0, 1]]}}, "map.edits.0"),
        ({"map": {**GRID, "edits": [["add", [[0, 0], [9, 9, 9], [9, 0]]]]}}, "map.edits.0"),
        ({"map": {**GRID, "edits": "none"}}, "map.edits"),
        ({"pose": {"x_mm": 1}}, "pose"),
        ({"pose": {"x_mm": "1", "y_mm": 1, "heading_deg": 0}}, "pose.x_mm"),
        ({"recipe": "moon"}, "moon"),
        ({"recipe": 3}, "recipe"),
        ({"family": {"count": 1000}}, "family.count"),
        ({"family": {"files": "a"}}, "family.files"),
        ({"growth": {"gravity": 1}}, "gravity"),
    ],
)
def test_what_cannot_be_used_is_named(changes, words):
    with pytest.raises(VinefabError, match=words.replace(".", r"\.")):
        StudioState.of(state(**changes))


@pytest.mark.parametrize(
    ("edits", "words"),
    [
        ([["remove", 0]] * 10_001, "'10001 edits'; allowed: at most 10000"),
        ({"remove": 0}, "{'remove': 0}; allowed: a list of edits"),
    ],
)
def test_edits_that_are_too_many_or_no_list_are_refused_in_one_sentence(edits, words):
    with pytest.raises(BadInputError) as caught:
        StudioState.of(state(map={**GRID, "edits": edits}))
    assert str(caught.value) == f"{PAGE}: map.edits is {words}"


ODD = (
    None,
    True,
    5,
    -1.5,
    float("inf"),
    float("nan"),
    "",
    "x",
    "\0",
    "\ud800",
    [],
    [5],
    {},
    {"a": 5},
)
WHOLE = state(
    pose={"x_mm": 20.0, "y_mm": 150.0, "heading_deg": 0.0},
    recipe=None,
    task="coverage",
    family={"environment": "grid", "count": 40, "seed": 1000, "files": []},
    growth={"body": "inflated", "contacts": None},
    locks=[],
)


def places(content, above=()):
    for name, value in content.items():
        yield (*above, name)
        yield from places(value, (*above, name)) if isinstance(value, dict) else ()


@pytest.mark.parametrize("place", list(places(WHOLE)), ids=".".join)
def test_an_odd_value_anywhere_is_one_line_or_works(place):
    for odd in ODD:
        content = copy.deepcopy(WHOLE)
        at = content
        for name in place[:-1]:
            at = at[name]
        at[place[-1]] = odd
        with suppress(VinefabError):
            FileStore(Path()).check_paths(content)
            StudioState.of(content)


def test_a_wrong_value_of_the_design_is_named_by_its_key():
    broken = state()
    broken["design"]["level"][1]["length"] = -3
    with pytest.raises(BadInputError, match=r"level\.2\.length|level\.1\.length|level\[2\]"):
        StudioState.of(broken)


def test_every_panel_has_its_function_and_others_are_refused():
    for place, _ in PANELS.values():
        assert callable(resolve_name(f"vinefab.studio.{place}"))
    with pytest.raises(BadInputError, match="moon"):
        answer_of("moon", state(), {})


def keys_with_sliders(table, prefix=""):
    for key in declared_keys(table):
        inner = inner_table(key.annotation)
        if inner is not None:
            yield from keys_with_sliders(inner, f"{prefix}{key.name}.")
        elif key.slider is not None:
            yield f"{prefix}{key.name}"


def rows_of(rows, prefix=""):
    for row in rows:
        if "rows" in row:
            yield from rows_of(row["rows"], f"{prefix}{row['key']}.")
        elif "slider" in row:
            yield f"{prefix}{row['key']}", row


def test_every_key_with_a_slider_is_a_row_with_its_unit_range_and_meaning():
    rows = dict(rows_of(design_form()["rows"]))
    assert set(rows) == set(keys_with_sliders(Design))
    for row in rows.values():
        low, high = row["slider"]
        assert row["least"] <= low < high <= row["most"]
        assert row["about"]
    fan = rows["level.angle_deg"]
    assert (fan["label"], fan["unit"], fan["default"], fan["whole"]) == ("Fan", "°", 0.0, False)
    assert rows["build.pressure_kpa"]["label"] == "Pressure"
    assert (rows["build.taper"]["first"], rows["build.taper"]["absent"]) == (1, 1.0)
    assert rows["build.pieces.most"]["whole"]
