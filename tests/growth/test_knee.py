"""The knee experiment: its geometry in closed form, and why it cannot leave a square corner."""

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import pytest
from numpy.testing import assert_allclose
from shapely import LineString, Polygon, box

from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose
from vinefab.physics.tube import inflated_radius_mm

WIDTH_MM = 20.0
RADIUS_MM = inflated_radius_mm(WIDTH_MM)
ROOM = Terrain.of(Map(name="room", bounds=box(0.0, 0.0, 400.0, 400.0)))
CORNER_MM = 400.0 - RADIUS_MM
POSE = Pose(x_mm=100.0, y_mm=250.0, heading_rad=math.radians(40.0))
SPAN_MM = math.hypot(CORNER_MM - 100.0, CORNER_MM - 250.0)


@pytest.fixture(scope="module")
def knee() -> ModuleType:
    spec = importlib.util.spec_from_file_location("knee", Path(__file__).with_name("knee.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules["knee"] = module
    spec.loader.exec_module(module)
    return module


def test_spans_fold_from_53_mm_on_or_earlier_where_the_push_is_across(knee):
    push = knee.Push(WIDTH_MM)
    assert not push.folds(53.0, 0.0)
    assert push.folds(53.5, 0.0)
    assert push.folds(9.9, math.pi / 2)
    assert not push.folds(9.7, math.pi / 2)


def test_without_push_the_experiment_is_the_growth_model(knee):
    vine = Design(name="vine", trunk_length_mm=600.0, build=Build.standard(1, WIDTH_MM))
    grown = grow_on(vine, ROOM, POSE, GrowthOptions(body="inflated"))
    for rule in (knee.KneeBranch, knee.TurningBranch):
        still = knee.Push(WIDTH_MM, path_kpa=30.0)
        branch = knee.grow_with_rule(rule, ROOM, POSE, 600.0, still, 1)
        assert branch.stop is Stop.CORNER
        assert branch.stop == grown.stop[0]
        assert_allclose([branch.tip.real, branch.tip.imag], grown.points_mm[-1])


@pytest.mark.parametrize("side", [1, -1])
def test_a_knee_lies_where_two_circles_meet(knee, side):
    """Ten millimetres more than the straight span, before the knee meets anything."""
    branch = knee.grow_with_rule(
        knee.KneeBranch, ROOM, POSE, SPAN_MM + 10.0, knee.Push(WIDTH_MM), side
    )
    pivot, hinge, tip = *branch.pivots, branch.tip
    assert branch.stop is Stop.FULL_LENGTH
    assert_allclose(abs(hinge - pivot), 0.5 * SPAN_MM)
    assert_allclose(abs(tip - hinge), 0.5 * SPAN_MM + 10.0)
    assert side * ((tip - pivot).conjugate() * (hinge - pivot)).imag > 0.0
    assert_allclose([tip.real, tip.imag], CORNER_MM)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("length_mm", [450.0, 600.0, 900.0])
def test_a_straight_far_link_never_leaves_a_square_corner(knee, side, length_mm):
    """The directions from its tip into free space are those that hold it: the tip stays."""
    branch = knee.grow_with_rule(knee.KneeBranch, ROOM, POSE, length_mm, knee.Push(WIDTH_MM), side)
    assert branch.folds > 0
    assert_allclose([branch.tip.real, branch.tip.imag], CORNER_MM)
    body = LineString([(p.real, p.imag) for p in (*branch.pivots, branch.tip)])
    assert ROOM.free_space(RADIUS_MM).buffer(1e-6).covers(body)


def test_a_far_link_leaves_an_obtuse_corner(knee):
    """A floor that rises by 30 degrees: the knee goes right, the tip slides back to the left."""
    valley = Polygon(
        [(0.0, 0.0), (200.0, 0.0), (500.0, 300.0 / math.sqrt(3.0)), (500.0, 600.0), (0.0, 600.0)]
    )
    terrain = Terrain.of(Map(name="valley", bounds=valley))
    pose = Pose(x_mm=190.0, y_mm=400.0, heading_rad=math.radians(-88.8))
    stopped = knee.grow_with_rule(
        knee.KneeBranch, terrain, pose, 500.0, knee.Push(WIDTH_MM, path_kpa=30.0), 1
    )
    assert stopped.stop is Stop.CORNER
    branch = knee.grow_with_rule(knee.KneeBranch, terrain, pose, 420.0, knee.Push(WIDTH_MM), 1)
    assert branch.folds == 1
    hinge = branch.pivots[-1]
    assert hinge.real > branch.pivots[0].real
    assert_allclose(abs(branch.tip - hinge), 420.0 - abs(hinge - branch.pivots[0]))
    assert branch.tip.real < stopped.tip.real - 50.0


def test_a_tip_that_turns_over_goes_on_along_the_wall_that_it_met(knee):
    branch = knee.grow_with_rule(
        knee.TurningBranch, ROOM, POSE, SPAN_MM + 120.0, knee.Push(WIDTH_MM), 1
    )
    assert branch.stop is Stop.FULL_LENGTH
    # It came along the ceiling and met the right side: down.
    assert_allclose([branch.tip.real, branch.tip.imag], [CORNER_MM, CORNER_MM - 120.0])
