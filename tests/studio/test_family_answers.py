import base64
import math
from threading import Event, Thread

import numpy as np
import pytest
import shapely

import vinefab as vf
from vinefab.core.errors import BadInputError, BrokenPluginError, UnreadableFileError
from vinefab.core.progress import heard_by
from vinefab.core.statistics import PAIRED_TAILS, mean_interval
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.maps import generate
from vinefab.model.design import Design, design_content
from vinefab.model.map import Map, Pose, Start
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.studio import family_answers as panel
from vinefab.studio.family_answers import family_answer
from vinefab.studio.state import StudioState

GRID = {"environment": "grid", "count": 4, "seed": 1000}
TWICE = {**GRID, "poses": 2}


def state_of(design="grid_explorer_levels", trunk_scale=1.0, width_scale=1.0, **more):
    content = design_content(Design.read(design))
    content["trunk"]["length"] *= trunk_scale
    content["build"]["widths_mm"][0] *= width_scale
    return StudioState.of({"design": content, "map": None, "family": GRID, **more})


def heat_share(heat):
    """The share of the maps for each cell, rows from below."""
    share = np.frombuffer(base64.b64decode(heat["share"]), dtype=np.uint8) / 255.0
    return share.reshape(heat["rows"], heat["columns"])


def answered(state, **ask):
    """The answer once the simulator is compiled, which is waited for unless asked for soon."""
    while (answer := family_answer(state, ask))["compiling"]:
        panel._COMPILER.threads[state.task].join()
    return answer


@pytest.fixture(scope="module")
def answer():
    return answered(state_of(family=TWICE))


@pytest.fixture(scope="module")
def worlds():
    return [generate("grid", 1000 + index) for index in range(4)]


def test_scores_are_those_of_the_library(answer, worlds):
    expected = vf.score("grid_explorer_levels", maps=worlds, poses=2)
    scores = [score for entry in answer["maps"] for score in entry["scores"]]
    assert scores == expected.scores.tolist()
    assert answer["distribution"]["mean"] == pytest.approx(expected.composite["mean"], abs=1e-15)
    means = expected.scores.reshape(4, 2).mean(axis=1)
    spread = answer["distribution"]
    assert (spread["low"], spread["high"]) == mean_interval(means)
    assert spread["quantiles"]["50"] == pytest.approx(np.median(means))
    assert [entry["name"] for entry in answer["maps"]] == [world.name for world in worlds]


def test_interpreted_answers_come_first_and_are_the_same(answer, monkeypatch):
    monkeypatch.setattr(panel, "_COMPILER", panel._Compiler())
    ask = {"soon": True, "compiled": False}
    first = family_answer(state_of(family=TWICE), ask)
    assert first["compiling"] == "compiling the simulator, once on this computer"
    told = [entry["scores"] for entry in first["maps"][: first["evaluated"]]]
    assert told == [entry["scores"] for entry in answer["maps"]]
    assert not panel._COMPILER.threads
    family_answer(state_of(family=TWICE), {"soon": True})
    panel._COMPILER.threads["coverage"].join()
    assert family_answer(state_of(), {"soon": True})["compiling"] is None


def test_who_does_not_ask_for_it_soon_gets_every_map(monkeypatch):
    monkeypatch.setattr(panel, "_COMPILER", panel._Compiler())
    monkeypatch.setattr(panel, "MOST_FAMILY_INTERPRETED", 0)
    family = {"environment": "pegs", "count": 6, "seed": 1}
    told, announced = [], Event()

    class CompiledWhenAnnounced(Thread):
        def run(self):
            assert announced.wait(20.0)
            super().run()

    def hear(progress):
        told.append(progress.phase)
        if progress.phase == panel.COMPILING:
            announced.set()

    monkeypatch.setattr(panel, "Thread", CompiledWhenAnnounced)
    with heard_by(hear):
        whole = family_answer(state_of("plain_vine", family=family), {})
    assert (whole["evaluated"], whole["compiling"]) == (6, None)
    assert "compiling the simulator, once on this computer" in told
    monkeypatch.setattr(panel, "_COMPILER", panel._Compiler())
    soon = family_answer(state_of("plain_vine", family=family), {"soon": True})
    assert soon["evaluated"] == panel.LEAST_MAPS


def test_grounds_are_sent_once_and_robots_where_they_are_seen(answer):
    keys = [entry["key"] for entry in answer["maps"]]
    assert all(entry["ground_svg"].startswith("<g") for entry in answer["maps"])
    again = answered(state_of(), have=keys[1:], draw=keys[:1])
    assert [entry["ground_svg"] is None for entry in again["maps"]] == [False, True, True, True]
    assert [entry["robot_svg"] is None for entry in again["maps"]] == [False, True, True, True]


def test_a_version_is_compared_map_by_map(answer):
    before = {entry["key"]: entry["score"] for entry in answer["maps"]}
    after = answered(state_of(trunk_scale=0.4, family=TWICE), before={**before, "another:map": 0.9})
    scores = [entry["score"] for entry in after["maps"]]
    gains = np.subtract(scores, list(before.values()))
    difference = after["difference"]
    assert difference["maps"] == 4
    assert difference["mean"] == pytest.approx(gains.sum() / 4)
    assert (difference["low"], difference["high"]) == mean_interval(gains, tails=PAIRED_TAILS)
    assert difference["better"] == sum(gain > 0 for gain in gains)
    assert difference["worse"] == sum(gain < 0 for gain in gains) > 0
    same = answered(state_of(family=TWICE), before=before)["difference"]
    assert (same["mean"], same["better"], same["worse"]) == (0.0, 0, 0)
    assert answer["difference"] is None


def test_bins_hold_every_score_of_both_versions(answer):
    bins = answered(state_of(), before={"another:map": -3.0})["distribution"]["bins"]
    assert (sum(bins["counts"]), sum(bins["before"])) == (4, 1)
    scores = [entry["score"] for entry in answer["maps"]]
    bins = answer["distribution"]["bins"]
    edges = bins["low"] + bins["step"] * np.arange(len(bins["counts"]) + 1)
    assert np.histogram(scores, edges)[0].tolist() == bins["counts"]


def test_quick_scores_are_near_and_unchanged_robots_count_as_equal(answer):
    before = {entry["key"]: entry["score"] for entry in answer["maps"]}
    quick = answered(state_of(family=TWICE), quick=True, heat=False, before=before)
    assert quick["heat"] is None
    assert quick["distribution"]["mean"] == pytest.approx(answer["distribution"]["mean"], abs=1e-3)
    assert (quick["difference"]["better"], quick["difference"]["worse"]) == (0, 0)


def test_new_widths_are_tried_on_as_many_maps_as_there_is_time_for(monkeypatch):
    family = {"environment": "pegs", "count": 6, "seed": 1}
    answered(state_of("plain_vine", family=family))
    monkeypatch.setattr(panel, "QUICK_S", 0.0)
    quick = family_answer(state_of("plain_vine", width_scale=1.1, family=family), {"quick": True})
    assert quick["evaluated"] == quick["distribution"]["maps"] == panel.LEAST_MAPS
    assert [entry["score"] is None for entry in quick["maps"]] == [False] * 4 + [True] * 2
    full = family_answer(state_of("plain_vine", width_scale=1.1, family=family), {})
    assert full["evaluated"] == 6


def test_walls_of_former_widths_are_forgotten(monkeypatch):
    monkeypatch.setattr(panel, "_CACHE", panel._Cache())
    monkeypatch.setattr(panel, "MOST_WALLS", 10)
    for scale in (1.0, 1.1, 1.2, 1.3):
        answer = answered(state_of("plain_vine", width_scale=scale))
        assert len(panel._CACHE.walls) <= 10 + 4
    monkeypatch.setattr(panel, "_CACHE", panel._Cache())
    anew = answered(state_of("plain_vine", width_scale=1.3))
    assert [entry["scores"] for entry in anew["maps"]] == [e["scores"] for e in answer["maps"]]


def test_heat_of_one_map_is_where_the_body_lies():
    family = {"environment": "grid", "count": 1, "seed": 1003}
    answer = answered(state_of(family=family))
    heat, (entry,) = answer["heat"], answer["maps"]
    share = heat_share(heat)
    design, world = Design.read("grid_explorer_levels"), generate("grid", 1003)
    pose = Pose.of(tuple(entry["pose"].values()))
    deployment = grow_on(design, Terrain.of(world), pose)
    body = shapely.union_all(
        [
            shapely.LineString(deployment.chain_mm(branch)).buffer(
                inflated_diameter_mm(design.build.widths_mm[deployment.tree.level[branch] - 1]) / 2
            )
            for branch in np.flatnonzero(deployment.deployed).tolist()
        ]
    )
    assert share.sum() * heat["cell_mm"] ** 2 == pytest.approx(body.area, rel=0.05)
    rows, columns = np.nonzero(share)
    start = world.starts[0].pose
    x_mm = start.x_mm + heat["low_mm"][0] + (columns + 0.5) * heat["cell_mm"]
    y_mm = start.y_mm + heat["low_mm"][1] + (rows + 0.5) * heat["cell_mm"]
    away_mm = shapely.distance(body, shapely.points(x_mm, y_mm))
    assert away_mm.max() < 1.5 * heat["cell_mm"]
    assert (heat["maps"], heat["same_size"], heat["most"]) == (1, True, 1.0)


def test_heat_turns_maps_so_that_all_starts_launch_upwards(tmp_path):
    """A room and the same room turned by 90 degrees: their bodies lie on each other."""
    files = []
    for name, box, start in (
        ("up", (0, 0, 400, 600), (200, 20, 90)),
        ("left", (0, 0, 600, 400), (580, 200, 180)),
    ):
        pose = Pose.of(start)
        room = Map(name=name, bounds=shapely.box(*box), starts=(Start(pose=pose),))
        files.append(str(room.write(tmp_path / f"{name}.geojson")))
    heat = answered(state_of("plain_vine", family={"files": files}))["heat"]
    share = heat_share(heat)
    # Cells at the edge may be covered by one of two.
    assert (share == 1.0).sum() > 0.8 * (share > 0).sum() > 0
    assert heat["low_mm"] == pytest.approx([-200.0, -20.0])
    assert not heat["same_size"]


def test_maps_are_known_by_their_files_and_what_is_in_them(tmp_path):
    world = generate("pegs", 1, columns=5, rows=5)
    paths = [str(world.write(tmp_path / f"{name}.geojson")) for name in ("room", "copy")]
    state = state_of("plain_vine", family={"files": [*paths, paths[0]]})
    first = answered(state)["maps"]
    assert [entry["source"]["file"] for entry in first] == paths
    keys = {entry["key"] for entry in first}
    assert len(keys) == 2
    generate("pegs", 2, columns=5, rows=5).write(tmp_path / "room.geojson", force=True)
    changed, same = answered(state, have=list(keys))["maps"]
    assert changed["key"] not in keys
    assert changed["ground_svg"] is not None
    assert same["key"] in keys


def test_a_task_that_gives_no_number_is_named(monkeypatch):
    class Empty:
        name, lowest = "empty", 0.0

        def evaluate(self, _deployment, _context):
            return math.nan, {}

    monkeypatch.setattr(panel, "make_task", lambda _: Empty())
    with pytest.raises(BrokenPluginError, match=r"task 'empty' of module .*its score is nan"):
        family_answer(state_of(), {})


def test_what_cannot_be_used_is_named(tmp_path):
    with pytest.raises(BadInputError, match="have"):
        family_answer(state_of(), {"have": 5})
    with pytest.raises(BadInputError, match="draw"):
        family_answer(state_of(), {"draw": "grid"})
    with pytest.raises(BadInputError, match=r"family\.poses.*less than or equal to 5"):
        state_of(family={**GRID, "poses": 6})
    with pytest.raises(BadInputError, match=r"family\.files.*at most 200"):
        state_of(family={"files": ["a.geojson"] * 201})
    with pytest.raises(BadInputError, match="before"):
        family_answer(state_of(), {"before": [1.0]})
    gone = state_of(family={"files": [str(tmp_path / "gone.geojson")]})
    with pytest.raises(UnreadableFileError, match=r"gone\.geojson"):
        family_answer(gone, {})
