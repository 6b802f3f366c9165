"""What a user is told where a robot does not fit."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from shapely import box

from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.deploy import deploy, deploy_from_starts
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
)

INFLATED = GrowthOptions.published(body="inflated").content
WIDTH_MM = Build.standard(1).widths_mm[0]
# A room with a passage of 5 mm between two blocks.
WORLD = Map(
    name="passage",
    bounds=box(0.0, 0.0, 400.0, 200.0),
    obstacles=(box(200.0, 0.0, 300.0, 97.5), box(200.0, 102.5, 300.0, 200.0)),
)


def vine(length_mm: float) -> Design:
    return Design(name="vine", trunk_length_mm=length_mm, build=Build.standard(1))


def test_a_start_too_narrow_for_the_trunk_is_a_result():
    grown = deploy(vine(50.0), WORLD, Pose(x_mm=250.0, y_mm=100.0, heading_rad=0.0), INFLATED)
    assert grown.stops["not_deployed"] == 1
    (place,) = grown.without_room
    assert (place.branch, place.x_mm, place.y_mm) == ("0", 250.0, 100.0)
    assert place.radius_mm == pytest.approx(WIDTH_MM / math.pi)
    stays = "the trunk never leaves its start: no room for its inflated body of 25 mm"
    assert stays in grown.summary
    assert "no room to start: branch 0 at (250.0, 100.0) mm" in grown.summary
    metrics = json.loads(grown.json_text())["metrics"]
    assert metrics["without_room"] == [place.content]


def test_a_gap_too_narrow_stops_the_inflated_body_and_not_the_centreline():
    pose = Pose(x_mm=50.0, y_mm=100.0, heading_rad=0.0)
    assert (
        deploy(vine(200.0), WORLD, pose, GrowthOptions.published().content).stops["full_length"]
        == 1
    )
    grown = deploy(vine(200.0), WORLD, pose, INFLATED)
    assert grown.stops["full_length"] == grown.stops["not_deployed"] == 0
    # Where its round end touches both blocks.
    radius_mm = WIDTH_MM / math.pi
    short_mm = math.sqrt(radius_mm**2 - 2.5**2)
    assert grown.deployment.points_mm[-1] == pytest.approx((200.0 - short_mm, 100.0), abs=0.1)


def test_a_wedged_branch_is_named_with_its_place():
    # 45 degrees into the corner of floor and block: the tip slides along the floor into it.
    pose = Pose(x_mm=120.0, y_mm=60.0, heading_rad=math.radians(-44.0))
    grown = deploy(vine(300.0), WORLD, pose, GrowthOptions.published().content)
    assert grown.stops["corner"] == 1
    assert "stopped in a corner: branch 0 at (200.0, 0.0) mm" in grown.summary
    assert json.loads(grown.json_text())["metrics"]["wedged"][0]["branch"] == "0"
    assert grown.without_room == ()


def test_children_wider_than_their_parent_may_lack_room_at_its_tip():
    build = Build.standard(2)
    wide = Build(
        widths_mm=(build.widths_mm[0] / 8.0, build.widths_mm[0]), fillet_mm=build.fillet_mm
    )
    fork = Level(branches=2, length_mm=30.0, fan_rad=1.0)
    robot = Design(name="fork", trunk_length_mm=200.0, levels=(fork,), build=wide)
    pose = Pose(x_mm=50.0, y_mm=100.0, heading_rad=0.0)
    grown = deploy(robot, WORLD, pose, INFLATED)
    assert [place.branch for place in grown.without_room] == ["0.0", "0.1"]
    assert grown.without_room[0].x_mm == pytest.approx(250.0)


def test_summary_and_metrics_show_the_numbers_of_a_straight_vine():
    pose = Pose(x_mm=50.0, y_mm=150.0, heading_rad=0.0)
    fork = Level(branches=2, length_mm=60.0, fan_rad=math.pi)
    robot = Design(name="t", trunk_length_mm=80.0, levels=(fork,), build=Build.standard(2))
    options = GrowthOptions.published(head_on_half_angle_rad=math.radians(5.0)).content
    grown = deploy(robot, WORLD, pose, options)
    # One child upwards meets the wall of the room head-on after 50 of 60 mm.
    assert grown.summary == (
        "t on passage from 50.00,150.00,0.00: 3 branches, 2 full_length, 1 head_on (simulated)",
        "grown: 190.0 mm (of 200.0 mm planned)",
        "growth: centerline body, head-on half-angle 5 deg (assumed), no pressure stops it, "
        "bodies pass through each other (assumed)",
    )
    metrics = json.loads(grown.json_text())["metrics"]
    assert (metrics["branches"], metrics["planned_mm"]) == (3, 200.0)
    assert metrics["grown_mm"] == pytest.approx(190.0)
    assert metrics["stops"] == {
        "full_length": 2, "head_on": 1, "corner": 0, "not_deployed": 0, "pressure": 0
    }  # fmt: skip
    assert {name: metrics[name] for name in options} == options
    assert metrics["head_on_half_angle_deg"] == pytest.approx(5.0)
    assert grown.history.full_mm == pytest.approx(140.0)
    assert grown.history.base_mm == pytest.approx(np.array([0.0, 80.0, 80.0]))


def test_rules_on_maps_see_growth_that_no_pressure_stops():
    world = replace(WORLD, starts=(Start(pose=Pose(x_mm=50.0, y_mm=50.0, heading_rad=0.0)),))
    build = Build.standard(1, trunk_width_mm=6.0).changed(pressure_kpa=5.0)
    weak = Design(name="weak", trunk_length_mm=100.0, build=build)
    assert deploy(weak, world).stops["pressure"] == 1
    ((_, deployment),) = deploy_from_starts(weak, [world])
    assert deployment.stops["full_length"] == 1
    plan = PredictionPlan(poses=1)
    prepared = PreparedFamily.of(MapFamily(label="m", worlds=(world,)), plan)
    family = deploy_family(weak, prepared, plan)
    assert [d.stops["pressure"] for d in family.deployments] == [1]
    assert [d.stops["full_length"] for d in family.unpressed] == [1]
