"""What follows the pointer: growth near the robot, a dragged tip, the robot while it grows."""

import json
import math
import re

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.growth.batch import grow_on
from vinefab.model.design import Build, Design, Level, design_content, design_of
from vinefab.prediction.deploy import deploy
from vinefab.studio import live_answers
from vinefab.studio.branch_edits import tip_answer
from vinefab.studio.live_answers import (
    MOST_LIVE_INTERPRETED,
    front_answer,
    grown,
    live_answer,
    prepared_map,
)
from vinefab.studio.state import Frame, StudioState

SOURCE = {
    "environment": "grid",
    "seed": 3,
    "options": {"columns": 23, "rows": 22, "size_mm": 2000.0},
}


def opened(name, pose, edits=()):
    x_mm, y_mm, heading_deg = pose
    return StudioState.of(
        {
            "design": design_content(Design.read(name)),
            "map": {"source": SOURCE, "edits": list(edits)},
            "pose": {"x_mm": x_mm, "y_mm": y_mm, "heading_deg": heading_deg},
        }
    )


@pytest.mark.parametrize("name", ["grid_explorer_levels", "three_level_tree", "plain_vine"])
@pytest.mark.parametrize(
    "pose", [(1000.0, 15.0, 90.0), (18.0, 956.5, 10.0), (1980.0, 1890.0, 220.0)]
)
def test_a_robot_grows_as_on_the_whole_map(name, pose):
    state = opened(name, pose)
    whole = prepared_map(state)
    deployment, terrain = grown(state, state.start)
    wanted = grow_on(state.grown_now, whole.terrain, state.start, state.growth)
    assert np.array_equal(deployment.points_mm, wanted.points_mm)
    assert np.array_equal(deployment.stop, wanted.stop)
    assert len(state.world.obstacles) == 506
    assert len(terrain.world.obstacles) < 300


def test_a_far_obstacle_that_is_moved_costs_no_walls():
    state = opened("grid_explorer_levels", (1000.0, 15.0, 90.0))
    _, terrain = grown(state, state.start)
    moved = opened("grid_explorer_levels", (1000.0, 15.0, 90.0), [["move", 505, 4.0, 3.0]])
    assert moved.world.obstacles[505] != state.world.obstacles[505]
    assert grown(moved, moved.start)[1] is terrain
    near = opened("grid_explorer_levels", (1000.0, 15.0, 90.0), [["move", 11, 4.0, 3.0]])
    assert grown(near, near.start)[1] is not terrain


def test_an_obstacle_is_placed_by_its_frame():
    state = opened("plain_vine", (1000.0, 15.0, 90.0))
    first = state.ground.frame(7)
    placed = Frame(x_mm=300.0, y_mm=400.0, width_mm=50.0, height_mm=20.0, turn_deg=70.0)
    edits = [["place", 7, placed.content], ["move", 7, 10.0, 0.0], ["remove", 3]]
    ground = opened("plain_vine", (1000.0, 15.0, 90.0), edits).ground
    shape, frame = ground.world.obstacles[6], ground.frame(6)
    assert frame == placed.moved(10.0, 0.0)
    share = placed.width_mm * placed.height_mm / (first.width_mm * first.height_mm)
    assert shape.area == pytest.approx(state.world.obstacles[7].area * share)
    assert Frame.around(shape).content == pytest.approx(
        {**frame.content, "width_mm": 20.0, "height_mm": 50.0, "turn_deg": -20.0}
    )


# A map without anything in the way.
MAP = {"source": {"environment": "grid", "seed": 3}, "edits": [["remove", 0]] * 36}
POSE = {"x_mm": 250.0, "y_mm": 100.0, "heading_deg": 90.0}


def design(branches=3, growth=0.7):
    level = Level(branches=branches, length_mm=60.0, fan_rad=math.radians(100.0), growth=growth)
    build = Build.standard(2, trunk_width_mm=10.0).changed(pressure_kpa=0.0)
    return Design(name="fork", trunk_length_mm=80.0, levels=(level,), build=build)


def state_of(robot, locks=()):
    content = json.loads(json.dumps(design_content(robot)))
    return StudioState.of({"design": content, "map": MAP, "pose": POSE, "locks": list(locks)})


def tip_of(state, branch):
    terrain = prepared_map(state).terrain
    grown = grow_on(state.design, terrain, state.start, state.growth, engine="interpreted")
    return grown.chain_mm(grown.tree.ids.index(branch))[-1]


def pulled(state, found):
    content = design_content(state.design)
    table, _, place = found["key"].partition(".")
    part = content[table][int(place)] if place else content[table]
    part |= found["values"]
    return state_of(design_of(content, "test"))


@pytest.mark.parametrize("branch", ["0", "0.0", "0.2"])
def test_the_tip_follows(branch):
    state = state_of(design())
    # The trunk goes straight on, so its tip can only be pulled along it.
    by_mm = np.array([0.0, 12.0]) if branch == "0" else np.array([7.0, 9.0])
    to = tip_of(state, branch) + by_mm
    after = pulled(state, tip_answer(state, {"branch": branch, "to": to.tolist()}))
    assert tip_of(after, branch) == pytest.approx(to, abs=0.02)  # values are in hundredths


@pytest.mark.parametrize(
    ("branch", "locks"), [("0.1", ()), ("0.0", ("level.0.angle_deg",))], ids=["middle", "locked"]
)
def test_what_cannot_turn_is_made_longer(branch, locks):
    ask = {"branch": branch, "to": [300.0, 200.0]}
    assert set(tip_answer(state_of(design(), locks), ask)["values"]) == {"length"}


def test_a_tip_on_its_base_leaves_a_length():
    state = state_of(design())
    found = tip_answer(state, {"branch": "0.0", "to": tip_of(state, "0").tolist()})
    assert found["values"]["length"] >= 1.0


@pytest.mark.parametrize("ask", [{}, {"branch": "0.9", "to": [1, 2]}, {"branch": "0", "to": [1]}])
def test_what_cannot_be_pulled_is_refused(ask):
    with pytest.raises(BadInputError):
        tip_answer(state_of(design()), ask)


def test_the_live_answer_is_the_growth_of_the_library():
    state = state_of(design())
    found = live_answer(state, {})
    assert found["facts"]["deployed"] == 4
    assert found["facts"]["grown_mm"] == pytest.approx(80.0 + 60.0 * (1.0 + 0.85 + 0.7))
    assert found["front_full_mm"] == pytest.approx(140.0)
    assert found["ground_svg"]
    assert found["scores"]["coverage"] > 0.0
    again = live_answer(state, {"have": found["ground_key"]})
    assert again["ground_svg"] is None
    assert again["robot_svg"] == found["robot_svg"]


def test_interpreted_growth_is_bounded(monkeypatch):
    monkeypatch.setattr(live_answers, "_ENGINE", ["interpreted"])
    levels = tuple(Level(branches=many, length_mm=20.0, fan_rad=2.8) for many in (13, 13, 10))
    many = Design(name="many", trunk_length_mm=80.0, levels=levels, build=Build.standard(4))
    found = live_answer(state_of(many), {})
    assert found["robot_svg"] == ""
    assert "compiled" in found["problems"][0]
    assert found["facts"]["branches"] == 1 + 13 + 13**2 + 13**2 * 10 > MOST_LIVE_INTERPRETED


DESIGN = Design.read("grid_explorer_levels")
CAVE = {"source": {"environment": "cave", "seed": 1}, "edits": []}


@pytest.fixture(scope="module")
def cave():
    return StudioState.of({"design": design_content(DESIGN), "map": CAVE})


def chains(text):
    """Return the points of every centreline, by branch."""
    lines = "".join(re.findall(r'<g class="line">(.*?)</g>', text))
    found = re.findall(r'data-branch="([\d.]+)"[^>]* d="M([^"]*)"', lines)
    return {name: np.array(re.findall(r"-?[\d.]+", path), float) for name, path in found}


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 1.0, 2.0])
def test_the_shape_is_that_of_the_history(cave, share):
    history = deploy(DESIGN, cave.world, cave.start, cave.growth.content).history
    answer = front_answer(cave, {"front_mm": share * history.full_mm})
    frame = history.at(share * history.full_mm)
    shown = chains(answer["robot_svg"])
    assert answer["front_mm"] == pytest.approx(min(1.0, share) * history.full_mm)
    assert answer["full_mm"] == history.full_mm
    out = [name for name, is_out in zip(frame.deployment.tree.ids, frame.deployment.deployed,
                                        strict=True) if is_out]  # fmt: skip
    assert sorted(shown) == sorted(out)
    for branch, name in enumerate(frame.deployment.tree.ids):
        if name in shown:
            wanted = (frame.deployment.chain_mm(branch) * [1.0, -1.0]).ravel()
            assert shown[name] == pytest.approx(wanted, abs=1e-3)
    assert answer["robot_svg"].count('class="mark') == len(out) - int(
        (frame.is_growing & frame.deployment.deployed).sum()
    )


@pytest.mark.parametrize("front_mm", [None, 0, -3.0, math.nan, "far", [1.0]])
def test_a_length_that_is_none_is_refused_by_name(cave, front_mm):
    with pytest.raises(BadInputError, match="front_mm"):
        front_answer(cave, {"front_mm": front_mm})
