"""Fans, lengths, stuck parents and inflated levels; both engines."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon, box

from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose

WIDE = box(-1000.0, -1000.0, 1000.0, 1000.0)
UNDER_CEILING = box(-1000.0, -1000.0, 1000.0, 100.0)


def test_every_parent_sprouts_the_same_fan(launch, tree, terrain):
    grown = launch(
        tree(100.0, (2, 50.0, 90.0, 1.0), (2, 20.0, 60.0, 0.5)), terrain(WIDE), (0, 0, 0)
    )
    assert grown.tree.ids == ("0", "0.0", "0.1", "0.0.0", "0.0.1", "0.1.0", "0.1.1")
    for branch, heading_deg, length_mm in [
        (1, -45, 50),
        (2, 45, 50),
        (3, -75, 20),
        (4, -15, 10),
        (5, 15, 20),
        (6, 75, 10),
    ]:
        base, tip = grown.chain_mm(branch)
        u = np.array([math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))])
        assert_allclose(base, grown.chain_mm(int(grown.tree.parent[branch]))[-1])
        assert_allclose(tip - base, length_mm * u, atol=1e-9)


def test_children_start_at_the_final_heading_of_their_parent(launch, tree, terrain):
    # The trunk ends pressed against the ceiling at 30 degrees; its only child leaves 40 right.
    grown = launch(tree(200.0, (2, 50.0, 80.0, 1.0)), terrain(UNDER_CEILING), (0, 0, 60))
    base, tip = grown.chain_mm(1)
    u = np.array([math.cos(math.radians(-10)), math.sin(math.radians(-10))])
    assert_allclose(tip - base, 50.0 * u, atol=1e-9)


@pytest.mark.parametrize(
    ("place", "half_angle_deg", "stop"), [((0, 0, 90), 5.0, "HEAD_ON"), ((0, 0, 60), 0.0, "CORNER")]
)
def test_stuck_parents_keep_all_descendants_inside(
    launch, tree, terrain, place, half_angle_deg, stop
):
    robot = tree(5000.0, (2, 50.0, 90.0, 1.0), (2, 50.0, 90.0, 1.0))
    options = {"head_on_half_angle_rad": math.radians(half_angle_deg)}
    grown = launch(robot, terrain(UNDER_CEILING), place, **options)
    assert grown.stop.tolist() == [Stop[stop]] + [Stop.NOT_DEPLOYED] * 6
    assert grown.deployed.tolist() == [True] + [False] * 6
    assert len(grown.tips_mm) == 1
    assert grown.chain_mm(3).shape == (0, 2)
    assert grown.grown_mm[1:].tolist() == [0.0] * 6


def test_children_of_stuck_may_deploy(launch, tree, terrain):
    robot = tree(5000.0, (3, 50.0, 180.0, 1.0), (1, 30.0, 0.0, 1.0))
    grown = launch(
        robot,
        terrain(UNDER_CEILING),
        (0, 0, 90),
        head_on_half_angle_rad=math.radians(5.0),
        children_of_stuck="deploy",
    )
    assert grown.stop[0] == Stop.HEAD_ON
    # Two leave along the ceiling; the middle one is head on again, and its child with it.
    assert grown.stop[1:4].tolist() == [Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.FULL_LENGTH]
    assert_allclose(grown.tips_mm[1], [50.0, 100.0], atol=1e-9)
    assert_allclose(grown.tips_mm[3], [-50.0, 100.0], atol=1e-9)
    assert grown.stop[5] == Stop.HEAD_ON
    assert grown.grown_mm[5] == 0.0


def test_inflated_bodies_keep_their_radius_from_walls(launch, tree, terrain):
    robot = tree(200.0, (1, 50.0, 0.0, 1.0))
    grown = launch(robot, terrain(UNDER_CEILING), (0, 0, 60), body="inflated")
    trunk_mm, child_mm = (width / math.pi for width in robot.build.widths_mm)
    height_mm = 100.0 - trunk_mm
    assert_allclose(grown.tips_mm[0], [math.sqrt(200.0**2 - height_mm**2), height_mm], atol=1e-6)
    assert_allclose(grown.tips_mm[1][1], 100.0 - child_mm, atol=1e-6)


def test_inflated_body_goes_round_a_corner_at_its_radius(launch, vine, terrain):
    ground = terrain(WIDE, box(-50.0, 100.0, 50.0, 200.0))
    grown = launch(vine(300.0), ground, (0, 0, 70), body="inflated")
    (corner,) = [np.array([50.0, 100.0])]
    radius_mm = 40.0 / math.pi
    chain = grown.chain_mm(0)
    steps = np.linspace(0.0, 1.0, 2001)[:, None]
    nearest = np.hypot(*(chain[0] + steps * (chain[-1] - chain[0]) - corner).T).min()
    assert radius_mm * 0.998 <= nearest <= radius_mm * 1.001


def test_start_too_narrow_for_the_body_is_a_result(launch, tree, terrain):
    grown = launch(tree(50.0, (2, 20.0, 90.0, 1.0)), terrain(WIDE), (0, -999, 90), body="inflated")
    assert grown.stop.tolist() == [Stop.NOT_DEPLOYED] * 3
    assert grown.tips_mm.shape == (0, 2)


def test_wider_child_without_room_is_a_result(engine):
    design = Design(
        name="club",
        trunk_length_mm=150.0,
        levels=(Level(branches=1, length_mm=20.0, fan_rad=0.0),),
        build=Build(widths_mm=(10.0, 60.0), fillet_mm=(2.0,)),
    )
    ground = Terrain.of(Map(name="test", bounds=UNDER_CEILING))
    options = GrowthOptions.published(body="inflated", head_on_half_angle_rad=0.0)
    up = Pose(x_mm=0.0, y_mm=0.0, heading_rad=1.2)
    assert engine.grow(design, ground, up, options).stop.tolist() == [0, Stop.NOT_DEPLOYED]
    down = Pose(x_mm=0.0, y_mm=0.0, heading_rad=-1.2)
    assert engine.grow(design, ground, down, options).stop.tolist() == [0, 0]


def test_trees_of_any_size_find_room_for_their_points(launch, tree, terrain):
    # Round posts have many corners: far more chain points than the room made at first.
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    post = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    ground = terrain(box(-60.0, -30.0, 60.0, 30.0), Polygon(post))
    robot = tree(250.0, (5, 150.0, 200.0, 1.0))
    grown = launch(robot, ground, (-50.0, -1.0, 10.0), children_of_stuck="deploy")
    assert len(grown.points_mm) > 6 * 6 + 16
    assert grown.first_point[-1] == len(grown.points_mm)
