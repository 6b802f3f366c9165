"""What the page says must be cut, while an angle is dragged and once it rests."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.core.progress import heard_by
from vinefab.inflation import compensation, pattern, solving
from vinefab.inflation.compensation import FlatJoint
from vinefab.inflation.robot import with_short_tail
from vinefab.model.design import Build, Design, Level, design_content
from vinefab.outline.body_outline import body_outline
from vinefab.studio.executors import answer_of
from vinefab.studio.pattern_answers import cut_notes
from vinefab.studio.state import StudioState

ANGLE = "level.0.angle_deg"


def state_of(angle_deg=80.0, branches=2, choice="inflation"):
    level = Level.of(branches=branches, length_mm=60.0, angle_deg=angle_deg)
    build = Build.standard(2).changed(compensation=choice)
    design = Design(name="pair", trunk_length_mm=80.0, levels=(level,), build=build)
    return {"design": design_content(design)}


def asked(panel, state, told=None):
    with heard_by((told or []).append if told is None else told.append):
        answer = answer_of(panel, state, {})
    json.dumps(answer, allow_nan=False)
    return answer


def number(text):
    return float(re.search(r"(?:cut|deploys at|nearest|about) ([\d.]+)°", text)[1])


@pytest.fixture
def nothing_simulated(monkeypatch, tmp_path):
    """No joint is simulated, and none was before."""

    def never(joint):
        pytest.fail(f"simulates {joint}")

    monkeypatch.setenv("VINEFAB_CACHE_DIR", str(tmp_path))
    for name in ("simulated_flat_joint", "simulated_deployed_joint"):
        monkeypatch.setattr(compensation, name, never)
    solving._joint.cache_clear()
    yield
    solving._joint.cache_clear()


@pytest.mark.parametrize("angle_deg", [160.0, 80.0, 50.0, 25.0])
@pytest.mark.usefixtures("nothing_simulated")
def test_the_table_answers_without_any_simulation(angle_deg):
    answer = asked("cut", state_of(angle_deg))
    note = answer["cut"][ANGLE]
    assert note["kind"] == "known"
    assert re.fullmatch(r"cut [\d.]+°, x[\d.]+ sensitive", note["text"])
    assert "from the table" in note["about"]
    assert "unverified" in note["about"]
    assert answer["outline_svg"].startswith('<path class="outline"')


@pytest.mark.parametrize("angle_deg", [80.0, 40.0])
def test_the_rules_say_exactly_what_the_table_said_nearly(angle_deg):
    state = state_of(angle_deg)
    quick, exact = (asked(panel, state)["cut"][ANGLE] for panel in ("cut", "rules"))
    assert "simulated joint" in exact["about"]
    assert number(quick["text"]) == pytest.approx(number(exact["text"]), abs=3.0)
    assert number(exact["text"]) > angle_deg


@pytest.mark.usefixtures("nothing_simulated")
def test_a_joint_beyond_the_table_waits_for_a_pause():
    note = asked("cut", state_of(160.0, branches=6))["cut"][ANGLE]
    assert (note["kind"], note["text"]) == ("pending", "simulated when you pause")


def test_siblings_that_cannot_be_held_apart_are_said_in_red():
    state = state_of(20.0, branches=4)
    exact = asked("rules", state)["cut"][ANGLE]
    assert exact["kind"] == "bad"
    assert exact["text"].startswith("✕ not possible: nearest about ")
    nearest = number(exact["text"])
    assert 22.0 < nearest < 100.0
    assert asked("cut", state_of(nearest + 2.0, branches=4))["cut"][ANGLE]["kind"] != "bad"
    assert "no flat joint deploys at" in exact["about"]


def test_the_nearest_reachable_angle_is_named():
    state = StudioState.of(state_of(30.0))
    made = pattern.pattern_of(state.design, state.profile)
    (joint,) = made.joints
    assert isinstance(joint.found, FlatJoint)
    failed = replace(joint, problem="level 2: no flat joint deploys so")
    note = cut_notes(replace(made, joints=(failed,)), state.profile)[ANGLE]
    assert (note["kind"], number(note["text"])) == ("bad", pytest.approx(30.0, abs=3.0))


@pytest.mark.usefixtures("nothing_simulated")
def test_a_design_cut_as_it_is_grows_as_it_deploys():
    state = state_of(80.0, choice="none")
    note = asked("cut", state)["cut"][ANGLE]
    assert 70.0 < number(note["text"]) < 79.5
    grown = StudioState.of(state).grown_now
    turned = np.degrees(np.ptp(grown.tree.offset_rad[1:]))
    assert f"{turned:.1f}" in note["text"]


def test_the_inflated_body_comes_with_progress_and_words():
    told = []
    answer = asked("inflated", state_of(), told)
    assert told[0].phase == "joints"
    assert told[-1].count.startswith("whole body under pressure, Newton steps ")
    assert "largest force" in told[-1].words
    assert answer["blocks"][0]["kind"] == "answer"
    assert "tips end" in answer["blocks"][0]["text"]
    x0, _, x1, _ = answer["box"]
    assert x1 - x0 > 80.0
    for name in ("outline", "inflated", "designed"):
        assert f'class="{name}"' in answer["svg"]
    body = shapely.Polygon(points(re.search(r'class="inflated" d="([^"]+)"', answer["svg"])[1]))
    assert body.is_valid
    # Tubes are narrower than the flat film that they are made of.
    with_tail = body_outline(with_short_tail(StudioState.of(state_of()).design))
    flat_mm2 = with_tail.contour.signed_area_mm2
    assert 0.3 * flat_mm2 < body.area < 0.8 * flat_mm2


def points(path):
    """Return the corners of a path of relative lines."""
    start, steps = re.fullmatch(r"M([-\d.]+ [-\d.]+)l(.*)Z", path).groups()
    at = [float(one) for one in start.split()]
    found = [tuple(at)]
    numbers = [float(one) for one in steps.split()]
    for dx, dy in zip(numbers[::2], numbers[1::2], strict=True):
        at = [at[0] + dx, at[1] + dy]
        found.append(tuple(at))
    return found
