"""Growth that the working pressure ends: closed forms, the twin, and the growth-pressure model."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from shapely import box

from tests.oracles.growth_spans import grow_reference
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Map, Pose
from vinefab.physics.growth_pressure import (
    FITTED,
    growth_pressure_kpa,
    growth_pressures_kpa,
)
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.prediction.deploy import DeployedDesign
from vinefab.prediction.measures import LOOSE

PRESSED = GrowthOptions.published(pressure_stop=True)
OPEN = Terrain.of(Map(name="open", bounds=box(-4000.0, -4000.0, 4000.0, 4000.0)))
ORIGIN = Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.3)


def at_pressure(design, pressure_kpa, widths_mm=None):
    build = design.build
    widths_mm = build.widths_mm if widths_mm is None else widths_mm
    return design.changed(build=build.changed(pressure_kpa=pressure_kpa, widths_mm=widths_mm))


def fitted(pressure_kpa, width_mm):
    """The working pressure in terms of the tube that the constants belong to."""
    return pressure_kpa * inflated_diameter_mm(width_mm) / PRESSED.fitted_diameter_mm


def test_a_straight_vine_ends_where_drag_has_used_up_the_pressure(engine, vine):
    robot = at_pressure(vine(3000.0), 4.0, (20.0,))
    grown = engine.grow(robot, OPEN, ORIGIN, PRESSED)
    expected_mm = 1000.0 * (fitted(4.0, 20.0) - FITTED.yield_kpa.value) / FITTED.drag_kpa_m.value
    assert 100.0 < expected_mm < 2900.0
    assert grown.stop[0] == Stop.PRESSURE
    assert_allclose(grown.grown_mm[0], expected_mm, rtol=1e-12)
    assert_allclose(grown.tips_mm[0], expected_mm * np.array([math.cos(0.3), math.sin(0.3)]))


def test_film_on_a_spool_and_too_little_pressure_stop_it_at_once(engine, vine):
    spool = PRESSED.changed(storage_kpa=FITTED.storage_kpa.value)
    for options, pressure_kpa in ((spool, 5.0), (PRESSED, 0.5)):
        grown = engine.grow(at_pressure(vine(300.0), pressure_kpa, (20.0,)), OPEN, ORIGIN, options)
        assert (grown.stop[0], grown.grown_mm[0]) == (Stop.PRESSURE, 0.0)
        assert grown.deployed[0]


def test_just_enough_pressure_is_enough(engine, tree):
    """A child of the same width has left what the trunk's film needed for what rode inside."""
    for length_mm in (50.0, 100.0, 123.0):
        robot = at_pressure(tree(3000.0, (1, length_mm, 0.0, 1.0)), 4.0, (20.0, 20.0))
        options = PRESSED.changed(children_of_stuck="deploy")
        grown = engine.grow(robot, OPEN, ORIGIN, options)
        assert grown.stop.tolist() == [Stop.PRESSURE, Stop.FULL_LENGTH]


def test_a_turn_at_the_base_that_the_pressure_does_not_make_keeps_the_heading(engine, tree):
    room = Terrain.of(Map(name="room", bounds=box(-4000.0, -4000.0, 100.0, 4000.0)))
    robot = tree(50.0, (1, 60.0, 0.0, 1.0), (2, 1000.0, 180.0, 1.0))
    options = PRESSED.changed(children_of_stuck="deploy")
    pose = Pose(x_mm=60.0, y_mm=0.0, heading_rad=0.3)  # the trunk slides up the wall x = 100
    held = list[Deployment]()
    for pressure_kpa in np.linspace(1.0, 10.0, 400).tolist():
        grown = engine.grow(at_pressure(robot, pressure_kpa, (20.0,) * 3), room, pose, options)
        if grown.stop[0] == Stop.FULL_LENGTH and grown.grown_mm[1] < 1e-6:
            held.append(grown)
    assert len(held) > 3
    for grown in held:
        assert (grown.stop[1], grown.grown_mm[1]) == (Stop.PRESSURE, 0.0)
        trunk, left = (np.diff(grown.chain_mm(branch), axis=0)[-1] for branch in (0, 3))
        assert grown.grown_mm[3] > 10.0
        assert trunk @ left == pytest.approx(0.0, abs=1e-6)


def test_a_design_without_pressure_is_not_stopped(engine, vine):
    assert engine.grow(at_pressure(vine(3e3), 0.0), OPEN, ORIGIN, PRESSED).stop[0] == 0


def test_a_child_pays_for_its_joint_and_for_what_rides_inside(engine, tree):
    robot = at_pressure(tree(400.0, (2, 300.0, 120.0, 1.0)), 6.5, (20.0, 15.0))
    grown = engine.grow(robot, OPEN, ORIGIN, PRESSED)
    constants = FITTED.changed(storage_kpa=LOOSE.storage_kpa)

    def missing(length_mm):
        needed = growth_pressure_kpa([400.0, length_mm], [math.radians(60.0)], constants)
        return needed - fitted(6.5, 15.0)

    expected_mm = brentq(missing, 0.0, 3000.0)
    assert 20.0 < expected_mm < 290.0
    assert grown.stop.tolist() == [Stop.FULL_LENGTH, Stop.PRESSURE, Stop.PRESSURE]
    assert_allclose(grown.grown_mm, [400.0, expected_mm, expected_mm], rtol=1e-9)
    # The children's film rides inside the trunk: with less of it, less pressure is enough.
    rides_mm = 2 * 300.0 * 15.0 / 20.0
    least_kpa = growth_pressure_kpa([400.0], [], constants, riding_mm=rides_mm)
    scale = PRESSED.fitted_diameter_mm / inflated_diameter_mm(20.0)
    for factor, stop in ((1.0001, Stop.FULL_LENGTH), (0.9999, Stop.PRESSURE)):
        tight = at_pressure(robot, factor * least_kpa * scale)
        assert engine.grow(tight, OPEN, ORIGIN, PRESSED).stop[0] == stop


def test_a_slide_ends_where_drag_and_turn_have_used_up_the_pressure(engine, vine):
    """Along a wall x = 100 the body turns about its base: length h / cos, turn from the launch."""
    room = Terrain.of(Map(name="room", bounds=box(-500.0, -500.0, 100.0, 3000.0)))
    robot = at_pressure(vine(2000.0), 6.28, (20.0,))
    grown = engine.grow(robot, room, ORIGIN, PRESSED.changed(storage_kpa=1.0))
    constants = FITTED.changed(storage_kpa=FITTED.storage_kpa.changed(value=1.0))

    def missing(angle_rad):
        lengths, turns = [0.0, 100.0 / math.cos(angle_rad)], [angle_rad - 0.3]
        return growth_pressure_kpa(lengths, turns, constants) - fitted(6.28, 20.0)

    angle_rad = brentq(missing, 0.3, 1.5)
    assert grown.stop[0] == Stop.PRESSURE
    assert_allclose(grown.tips_mm[0], [100.0, 100.0 * math.tan(angle_rad)], rtol=1e-9)


def pressures_kpa(deployment, constants):
    return growth_pressures_kpa([deployment], [constants])[0]


def some_pressure_kpa(robot, terrain, pose, options, constants, rng):
    """Return a pressure that some of the branches need, where any grew."""
    free = grow_on(robot, terrain, pose, options)
    needed_kpa = pressures_kpa(free, constants)
    known = needed_kpa[np.isfinite(needed_kpa)]
    return float(rng.uniform(0.98 * known.min(), known.max())) if len(known) else 10.0


@pytest.mark.parametrize("kind", ["convex", "star", "needles", "lattice"])
@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_twins_agree_and_pressure_is_used_up_where_it_stops(
    random_map, random_pose, random_tree, kind, body
):
    stopped = 0
    for number in range(8):
        rng = np.random.default_rng([31, number])
        terrain = Terrain.of(random_map(rng, kind))
        robot, pose = random_tree(rng), random_pose(rng, terrain)
        constants = FITTED.changed(
            storage_kpa=FITTED.storage_kpa.changed(value=float(rng.choice([0.0, 0.5])))
        )
        options = GrowthOptions.published(
            body=body,
            storage_kpa=constants.storage_kpa.value,
            children_of_stuck=str(rng.choice(["stop", "deploy"])),
        )
        robot = at_pressure(robot, some_pressure_kpa(robot, terrain, pose, options, constants, rng))
        options = options.changed(pressure_stop=True)
        fast = grow_on(robot, terrain, pose, options)
        plain = grow_reference(robot, terrain, pose, options)
        assert fast.stop.tolist() == plain.stop.tolist(), number
        assert_allclose(fast.points_mm, plain.points_mm, atol=1e-6)
        needed_kpa = pressures_kpa(fast, constants)
        working_kpa = robot.build.pressure_kpa
        ended = fast.stop == Stop.PRESSURE
        inside = fast.deployed & ~ended
        assert (needed_kpa[inside] <= working_kpa * (1.0 + 1e-9)).all(), number
        # A child that begins on a wall turns there at once, or not at all: then it keeps the
        # heading that it has pressure for.
        begun = ended & (fast.grown_mm > 1e-6)
        assert_allclose(needed_kpa[begun], working_kpa, rtol=1e-6)
        assert (fast.grown_mm[ended & ~begun] == 0.0).all()
        stopped += int(begun.sum())
    assert stopped >= 2


def test_enough_pressure_changes_nothing(engine, random_map, random_pose, random_tree):
    for number in range(8):
        rng = np.random.default_rng([32, number])
        terrain = Terrain.of(random_map(rng, "convex"))
        robot, pose = at_pressure(random_tree(rng), 9999.0), random_pose(rng, terrain)
        with_it = engine.grow(robot, terrain, pose, PRESSED)
        without = engine.grow(robot, terrain, pose, GrowthOptions.published())
        assert with_it.stop.tolist() == without.stop.tolist()
        assert with_it.points_mm.tolist() == without.points_mm.tolist()


def test_a_shape_on_the_way_is_part_of_the_final_one(random_map, random_pose, random_tree):
    """The film that rides inside is that of the whole robot at every length of the front."""
    stopped = 0
    for number in range(20):
        rng = np.random.default_rng([33, number])
        world = random_map(rng, "convex")
        terrain = Terrain.of(world)
        robot, pose = random_tree(rng), random_pose(rng, terrain)
        pressure_kpa = some_pressure_kpa(
            robot, terrain, pose, GrowthOptions.published(), LOOSE, rng
        )
        robot = at_pressure(robot, pressure_kpa)
        final = grow_on(robot, terrain, pose, PRESSED)
        history = DeployedDesign(
            design=robot, world=world, terrain=terrain, options=PRESSED, deployment=final
        ).history
        if history.full_mm <= 0.0:
            continue
        frame = history.at(0.999999 * history.full_mm)
        done = np.isin(final.tree.ids, frame.deployment.tree.ids)
        still = ~frame.is_growing
        reached = final.stop[done][still]
        assert frame.deployment.stop[still].tolist() == reached.tolist()
        stopped += int(np.count_nonzero(reached == Stop.PRESSURE))
    assert stopped > 0


def test_a_plan_that_is_cut_keeps_its_tension(tree):
    plan = Plan.of(tree(100.0, (3, 80.0, 60.0, 1.0), (2, 50.0, 40.0, 1.0)), PRESSED)
    part = plan.cut(np.array([0, 1, 2, 3]), np.full(4, 10.0), PRESSED)
    assert part.edges == (0, 4)
    assert part.store_kpa.tolist() == plan.store_kpa[:4].tolist()
    assert part.tree.length_mm.tolist() == [10.0] * 4
