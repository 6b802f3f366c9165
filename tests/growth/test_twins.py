"""The compiled kernel against its readable twin, on maps made to be nasty."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import box

from tests.oracles.growth_spans import grow_reference
from vinefab.core.compiling import interpreted
from vinefab.growth.batch import CONTACT_KERNEL, KERNEL, grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.map import Pose

kernel = interpreted(KERNEL)
GROWTHS_PER_MAP = 4


@pytest.mark.parametrize("maps", [12, pytest.param(60, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("kind", ["convex", "star", "needles", "lattice"])
def test_twins_agree(random_map, random_pose, random_tree, kind, maps):
    for number in range(maps):
        rng = np.random.default_rng([5, number])
        terrain = Terrain.of(random_map(rng, kind))
        for _ in range(GROWTHS_PER_MAP):
            robot, pose = random_tree(rng), random_pose(rng, terrain)
            options = GrowthOptions.published(
                head_on_half_angle_rad=math.radians(rng.choice([0.0, 1.0, 15.0])),
                children_of_stuck=str(rng.choice(["stop", "deploy"])),
            )
            fast = grow_on(robot, terrain, pose, options, "kernel")
            plain = grow_reference(robot, terrain, pose, options)
            assert fast.stop.tolist() == plain.stop.tolist(), number
            assert fast.first_point.tolist() == plain.first_point.tolist(), number
            assert_allclose(fast.points_mm, plain.points_mm, atol=1e-6)
            assert_allclose(fast.grown_mm, plain.grown_mm, atol=1e-6)
            assert_allclose(fast.contact_turn_rad, plain.contact_turn_rad, atol=1e-6)


@pytest.mark.parametrize("kind", ["convex", "star"])
def test_twins_agree_on_inflated_bodies(random_map, random_pose, random_tree, kind):
    options = GrowthOptions.published(body="inflated")
    deployed = 0
    for number in range(8):
        rng = np.random.default_rng([6, number])
        terrain = Terrain.of(random_map(rng, kind))
        robot, pose = random_tree(rng), random_pose(rng, terrain)
        fast = grow_on(robot, terrain, pose, options, "kernel")
        plain = grow_reference(robot, terrain, pose, options)
        assert fast.stop.tolist() == plain.stop.tolist(), number
        assert_allclose(fast.points_mm, plain.points_mm, atol=1e-6)
        deployed += int(fast.deployed.sum())
    assert deployed > 5


@pytest.mark.parametrize("kind", ["convex", "star", "needles", "lattice"])
def test_the_interpreter_gives_what_compiled_code_does_to_the_last_bit(
    random_map, random_pose, random_tree, kind
):
    stops = set()
    for number in range(6):
        rng = np.random.default_rng([8, number])
        terrain = Terrain.of(random_map(rng, kind))
        robot, pose = random_tree(rng), random_pose(rng, terrain)
        options = GrowthOptions.published(
            head_on_half_angle_rad=math.radians(rng.choice([0.0, 1.0, 15.0])),
            children_of_stuck=str(rng.choice(["stop", "deploy"])),
            body=str(rng.choice(["centerline", "inflated"])),
            pressure_stop=number % 2 == 0,
        )
        build = robot.build.changed(pressure_kpa=float(rng.uniform(0.2, 2.0)))
        robot = robot.changed(build=build)
        fast = grow_on(robot, terrain, pose, options, "kernel")
        plain = grow_on(robot, terrain, pose, options, "interpreted")
        for name in ("points_mm", "first_point", "stop", "grown_mm", "contact_turn_rad"):
            assert getattr(fast, name).tobytes() == getattr(plain, name).tobytes(), (number, name)
        stops |= set(fast.stop.tolist())
    assert Stop.PRESSURE in stops
    assert len(stops) > 2


def test_stop_codes_are_those_of_the_model():
    names = ("FULL_LENGTH", "HEAD_ON", "CORNER", "NOT_DEPLOYED", "PRESSURE")
    found = {name: getattr(kernel, name) for name in names}
    contact = interpreted(CONTACT_KERNEL)
    later = ("FULL_LENGTH", "NOT_DEPLOYED", "BRANCH", "NOT_EVERTED")
    found |= {name: getattr(contact, name) for name in later}
    assert found == {s.name: s.value for s in Stop}
    assert all(getattr(contact, name) == Stop[name] for name in later)


@pytest.mark.parametrize("x_mm", [-115.7, -114.7, -112.7])
def test_twins_agree_where_pressure_holds_a_body_that_begins_at_a_wall(tree, terrain, x_mm):
    """Turned along the wall or not, it sends its children to the wall at 90 degrees or along it."""
    ground = terrain(box(-2000.0, -2000.0, 2000.0, 2000.0))
    robot = tree(3000.0, (3, 2000.0, 60.0, 0.8), (1, 400.0, 90.0, 1.0), (3, 1000.0, 180.0, 1.0))
    build = robot.build.changed(widths_mm=(40.0,) * 4, pressure_kpa=6.5574184435189595)
    options = GrowthOptions(
        head_on_half_angle_rad=0.0, body_width_ratio=1.3, children_of_stuck="deploy"
    )
    pose = Pose(x_mm=x_mm, y_mm=-386.7, heading_rad=-math.pi / 2.0)
    fast, plain = (
        grow(robot.changed(build=build), ground, pose, options)
        for grow in (grow_on, grow_reference)
    )
    assert {Stop.PRESSURE, Stop.HEAD_ON} < set(fast.stop.tolist())
    assert fast.stop.tolist() == plain.stop.tolist()
    assert_allclose(fast.grown_mm, plain.grown_mm, atol=1e-6)
