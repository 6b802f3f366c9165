"""Where to put a base: the estimates that are reported, the words, the JSON, the page."""

import json
import math
import re
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from shapely import Point

import vinefab as vf
from tests.prediction.test_pose_search import OPTIONS, ROOM, TREE
from vinefab.core.errors import BadInputError, BrokenPluginError
from vinefab.core.rng import child
from vinefab.core.view import Origin
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.contacts import contacts_of
from vinefab.model.map import Pose, Start
from vinefab.prediction.aimed_robot import AimPlan, PoseEstimate, ScoreGain
from vinefab.prediction.aiming import (
    FRESH_DRAWS,
    aim_growth,
    aim_robots,
    held_against,
    plain_vine_of,
)
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.reach import Reach

ORIGIN = Origin(command="vinefab aim tree --map room", inputs={}, versions={})
TASK = Reach(area="fast")
PLAN = AimPlan(deployments=5000, options=OPTIONS, robots=2)


@pytest.fixture(scope="module")
def found():
    return aim_robots(held_against(TREE), ROOM, TASK, PLAN, workers=1)


def test_the_reported_score_is_that_of_growths_at_fresh_draws(found):
    """Grown one by one, at draws that the search never saw, from the pose as it is printed."""
    draws = PLAN.errors.drawn(FRESH_DRAWS, child(PLAN.seed, 2001))
    terrain, context = Terrain.of(ROOM), PreparedMap.of(ROOM).context
    x, y, degrees = (float(part) for part in found.pose.text.split(","))
    room = terrain.free_space(OPTIONS.radius_mm(TREE.build.widths_mm[0]))
    checked = 0
    for index in range(40):
        dx, dy = draws.offset_mm[index].tolist()
        pose = Pose(
            x_mm=x + dx,
            y_mm=y + dy,
            heading_rad=math.radians(degrees) + float(draws.turn_rad[index]),
        )
        if not room.covers(Point(pose.x_mm, pose.y_mm)):
            continue  # beside a wall: moved, see the tests of placing
        options = OPTIONS.changed(head_on_half_angle_rad=float(draws.half_angle_rad[index]))
        score, _ = TASK.evaluate(grow_on(TREE, terrain, pose, options), context)
        assert found.first.best.scores[index] == pytest.approx(score, abs=1e-9)
        checked += 1
    assert checked > 5
    assert found.mean == pytest.approx(found.first.best.scores.mean())


def test_estimates_of_a_pose_have_closed_forms():
    pose = Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0)
    estimate = PoseEstimate(pose=pose, scores=np.arange(100.0))
    other = PoseEstimate(pose=pose, scores=np.arange(100.0) - 2.0)
    assert estimate.mean == 49.5
    assert estimate.worst_tenth == 4.5
    assert estimate.above(other) == ScoreGain(mean=2.0, low=2.0, high=2.0)
    low, high = estimate.interval
    # 1.96 standard errors of an even spread
    assert (high - low) / 2.0 == pytest.approx(1.96 * 28.87 / 10.0, rel=0.1)


def test_the_aimed_pose_beats_the_start_and_every_first_look_is_counted(found):
    first = found.first
    assert first.gain.low > 0.0
    assert first.best.mean > first.start.mean
    assert 4500 <= first.search.deployments <= 9000
    landscape = first.search.landscape
    assert landscape.scores.shape == (len(landscape.places_mm), 36)
    assert np.nanmax(landscape.best_scores) <= 1.0
    assert found.poses[0] != found.poses[1]


def test_the_plain_vine_has_the_same_length_film_and_rules():
    vine = plain_vine_of(TREE)
    assert vine.tree.total_length_mm == pytest.approx(200.0)
    assert (vine.branch_count, vine.build.widths_mm) == (1, TREE.build.widths_mm[:1])
    trained = TREE.changed(origin={"growth": {"pressure_stop": False}, "seed": 3})
    assert not aim_growth(held_against(trained), None).options.pressure_stop
    assert held_against(vine) == [vine]
    assert held_against(TREE, vine) == [TREE, vine]
    assert held_against(TREE, alone=True) == [TREE]
    with pytest.raises(BadInputError, match="--alone"):
        held_against(TREE, vine, alone=True)


def test_contacts_are_all_that_they_may_be_unless_the_user_says():
    low, high = aim_growth([TREE], None).options.half_angle_range_rad
    assert np.degrees([low, high]) == pytest.approx([1.0, 30.0])
    given = aim_growth([TREE], {"head_on_half_angle_deg": 4.0}).options
    assert np.degrees(given.half_angle_range_rad) == pytest.approx([4.0, 4.0])


def test_measured_contacts_narrow_the_range_and_are_called_measured():
    number = {
        "value": 5.0,
        "low": 3.0,
        "high": 7.0,
        "side": "both",
        "count": 12,
        "photos": 4,
        "source": "4 photos",
        "standing": "measured",
    }
    contacts = contacts_of({"head_on_half_angle_deg": number})
    options = aim_growth([TREE], {"contacts": contacts}).options
    assert np.degrees(options.half_angle_range_rad) == pytest.approx([3.0, 7.0])
    assert options.contact_angles_standing.startswith("measured")


def test_lines_are_labelled_and_give_a_pose_to_type(found):
    lines = found.summary
    assert re.search(r" at -?[\d.]+,-?[\d.]+,-?[\d.]+: ", lines[0])
    text = "\n".join(lines)
    for words in (
        "(simulated)",
        "placed within 5 mm and 3 deg (assumed)",
        "head-on half-angle 1 to 15 deg (assumed)",
        "the search's own estimate",
        "worst tenth",
        "from 20.00,100.00,0.00",
        "over tree_as_plain_vine",
        "1 - 1/e",
        "2 robots tree_as_plain_vine",
    ):
        assert words in text


def test_the_headline_answers_for_as_many_robots_as_were_asked_for(found):
    """Every base stands in it; the best of one robot comes after it."""
    headline = found.summary[0]
    bases = "; ".join(pose.text for pose in found.poses)
    assert len(found.poses) == PLAN.robots
    assert headline.startswith(
        f"Best found for {PLAN.robots} robots tree together: bases at {bases}: "
    )
    share = found.first.team.fresh.mean(axis=1)[-1]
    assert f"of a body {100.0 * share:.1f} [" in headline.split(bases)[1]
    assert f"The best of one robot: put the base of tree at {found.pose.text}: " in headline


def test_json_holds_the_map_of_scores_and_no_nan(found):
    content = json.loads(replace(found, origin=ORIGIN).json_text())
    assert content["schema"] == "vinefab/aim-1"
    assert content["standing"] == {
        "scores": "simulated",
        "placing": "assumed",
        "contacts": "assumed",
    }
    tree, vine = content["robots"]
    assert content["pose"] == tree["best"]["pose"]
    assert len(tree["landscape"]["mean"]) == len(tree["landscape"]["places_mm"])
    assert tree["first_minus_this"] is None
    gain = vine["first_minus_this"]
    assert gain["mean"] == pytest.approx(tree["best"]["mean"] - vine["best"]["mean"], abs=2e-5)
    shares = [row["share"] for row in tree["together"]["robots"]]
    assert shares == sorted(shares)
    for row in tree["together"]["robots"]:
        assert row["search_share"] <= row["search_bound"] + 1e-9


def test_the_page_says_what_is_simulated_and_what_is_assumed(found):
    page = replace(found, origin=ORIGIN).page()
    assert "http" not in re.sub(r'"data:[^"]*"|http://www.w3.org/\S*', "", page)
    for words in (
        "Where to put tree",
        "Several robots",
        "How it was found",
        "fresh",
        "assumed",
    ):
        assert words in page
    assert page.count("data:image/svg+xml") == 8
    assert page.count("(simulated)") > 10


@pytest.mark.thorough
def test_a_picture_of_two_designs(found):
    assert b"<svg" in found.picture(".SVG")


def test_a_map_without_a_start_says_so():
    bare = replace(ROOM, starts=())
    result = aim_robots([TREE], bare, TASK, AimPlan(deployments=5000, options=OPTIONS))
    assert (result.first.start, result.first.gain) == (None, None)
    assert "no start to compare with" in "\n".join(result.summary)


def test_a_start_without_room_is_said():
    tight = replace(ROOM, starts=(Start(pose=Pose(x_mm=1.0, y_mm=100.0, heading_rad=0.0)),))
    result = aim_robots([TREE], tight, TASK, AimPlan(deployments=5000, options=OPTIONS))
    (note,) = result.notes
    assert "has no room at the map's start: there it begins 4.1 mm aside" in note


@dataclass(frozen=True)
class Broken:
    name: ClassVar[str] = "broken"
    lowest: ClassVar[float] = 0.0

    def evaluate(self, deployment, _context):
        return math.nan, {"grown": float(deployment.grown_mm.sum())}


def test_a_task_that_gives_no_number_is_refused():
    with pytest.raises(BrokenPluginError, match=r"task 'broken' .*its score is nan"):
        aim_robots([TREE], ROOM, Broken(), AimPlan(deployments=5000, options=OPTIONS))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("robots", 51),
        ("placing_mm", -1.0),
        ("placing_deg", math.nan),
        ("where", 3),
    ],
)
def test_the_front_door_refuses_in_python_words(key, value):
    with pytest.raises(BadInputError, match=key):
        vf.aim(TREE, ROOM, **{"deployments": 5000, "alone": True, key: value})


def test_the_front_door_writes_a_page_and_returns_poses(tmp_path):
    seen = SimpleNamespace(told=[])
    result = vf.aim(
        TREE,
        ROOM,
        "reach",
        alone=True,
        deployments=5000,
        out=tmp_path / "aim.svg",
        progress=lambda now: seen.told.append(str(now)),
        buffer_mm=30,
        area="fast",
    )
    assert result.task.buffer_mm == 30.0
    assert (tmp_path / "aim.svg").read_bytes().startswith(b"<?xml")
    assert result.poses == (result.pose,)
    trials = [one for one in seen.told if "trial deployments " in one and "walls" not in one]
    assert trials[0] == "robots 0 of 1, trial deployments 0 of 5,000"
    assert trials[-1] == "robots 0 of 1, trial deployments 5,000 of 5,000"
    assert repr(result).startswith("<AimResult>\nBest found: put the base of tree at ")
