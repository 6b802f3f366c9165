"""The compiled kernel against its readable twin, on maps made to be nasty."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from vinefab.growth import kernel
from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop

MAPS = 60
GROWTHS_PER_MAP = 4


@pytest.mark.parametrize("kind", ["convex", "star", "needles", "lattice"])
def test_twins_agree(random_map, random_pose, random_tree, kind):
    for number in range(MAPS):
        rng = np.random.default_rng([5, number])
        terrain = Terrain.of(random_map(rng, kind))
        for _ in range(GROWTHS_PER_MAP):
            robot, pose = random_tree(rng), random_pose(rng, terrain)
            options = GrowthOptions(
                head_on_half_angle_rad=math.radians(rng.choice([0.0, 1.0, 15.0])),
                children_of_stuck=str(rng.choice(["stop", "deploy"])),
            )
            fast = grow(robot, terrain, pose, options, "kernel")
            plain = grow(robot, terrain, pose, options, "reference")
            assert fast.stop.tolist() == plain.stop.tolist(), number
            assert fast.first_point.tolist() == plain.first_point.tolist(), number
            assert_allclose(fast.points_mm, plain.points_mm, atol=1e-6)
            assert_allclose(fast.grown_mm, plain.grown_mm, atol=1e-6)
            assert_allclose(fast.contact_turn_rad, plain.contact_turn_rad, atol=1e-6)
            assert fast.tight_exit.tolist() == plain.tight_exit.tolist()


@pytest.mark.parametrize("kind", ["convex", "star"])
def test_twins_agree_on_inflated_bodies(random_map, random_pose, random_tree, kind):
    options = GrowthOptions(body="inflated")
    deployed = 0
    for number in range(12):
        rng = np.random.default_rng([6, number])
        terrain = Terrain.of(random_map(rng, kind))
        robot, pose = random_tree(rng), random_pose(rng, terrain)
        fast = grow(robot, terrain, pose, options, "kernel")
        plain = grow(robot, terrain, pose, options, "reference")
        assert fast.stop.tolist() == plain.stop.tolist(), number
        assert_allclose(fast.points_mm, plain.points_mm, atol=1e-6)
        deployed += int(fast.deployed.sum())
    assert deployed > 5


def test_stop_codes_are_those_of_the_model():
    codes = [kernel.FULL_LENGTH, kernel.HEAD_ON, kernel.CORNER, kernel.NOT_DEPLOYED]
    assert codes == [Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.CORNER, Stop.NOT_DEPLOYED]
