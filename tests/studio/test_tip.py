"""A tip that is dragged lies where it was dragged to, once its level has the values."""

import json
import math

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.growth.simulator import grow_on
from vinefab.model.design import Build, Design, Level, design_of
from vinefab.model.files.design_toml import design_content
from vinefab.studio.live_answers import live_answer, prepared_map, tip_answer
from vinefab.studio.state import StudioState

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
    part = content["trunk"] if found["level"] < 0 else content["level"][found["level"]]
    part |= found["values"]
    return state_of(design_of(content, "test"))


@pytest.mark.parametrize("branch", ["0", "0.0", "0.2"])
def test_the_tip_follows(branch):
    state = state_of(design())
    # The trunk goes straight on, so its tip can only be pulled along it.
    by_mm = np.array([0.0, 12.0]) if branch == "0" else np.array([7.0, 9.0])
    to = tip_of(state, branch) + by_mm
    after = pulled(state, tip_answer(state, {"branch": branch, "to": to.tolist()}))
    assert tip_of(after, branch) == pytest.approx(to, abs=1e-6)


def test_the_middle_child_turns_nothing():
    state = state_of(design())
    found = tip_answer(state, {"branch": "0.1", "to": [280.0, 260.0]})
    assert set(found["values"]) == {"length"}


def test_locked_values_stay():
    state = state_of(design(), ["level.0.angle_deg"])
    found = tip_answer(state, {"branch": "0.0", "to": [300.0, 200.0]})
    assert set(found["values"]) == {"length"}


def test_a_tip_on_its_base_leaves_a_length():
    state = state_of(design())
    base = tip_of(state, "0").tolist()
    found = tip_answer(state, {"branch": "0.0", "to": base})
    assert found["values"]["length"] >= 1.0


@pytest.mark.parametrize("ask", [{}, {"branch": "0.9", "to": [1, 2]}, {"branch": "0", "to": [1]}])
def test_what_cannot_be_pulled_is_refused(ask):
    with pytest.raises(BadInputError):
        tip_answer(state_of(design()), ask)


def test_the_live_answer_is_the_growth_of_the_library():
    state = state_of(design())
    found = live_answer(state, {}, lambda *_: None)
    assert found["facts"]["deployed"] == 4
    assert found["facts"]["grown_mm"] == pytest.approx(80.0 + 60.0 * (1.0 + 0.85 + 0.7))
    assert found["front_full_mm"] == pytest.approx(140.0)
    assert found["ground_svg"]
    assert found["scores"]["coverage"] > 0.0
    again = live_answer(state, {"have": found["ground_key"]}, lambda *_: None)
    assert again["ground_svg"] is None
    assert again["robot_svg"] == found["robot_svg"]
