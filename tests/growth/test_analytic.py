"""Growths whose result follows from a line of geometry; both engines."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon, box

from vinefab.model.deployment import Stop

WIDE = box(-1000.0, -1000.0, 1000.0, 1000.0)
UNDER_CEILING = box(-1000.0, -1000.0, 1000.0, 100.0)


def test_no_obstacles_gives_straight_branches(launch, tree, terrain):
    robot = tree(100.0, (3, 50.0, 120.0, 2.0))
    grown = launch(robot, terrain(WIDE), (10.0, 20.0, 30.0))
    start = np.array([10.0, 20.0])
    tip = start + 100.0 * np.array([math.cos(math.radians(30)), math.sin(math.radians(30))])
    assert_allclose(grown.chain_mm(0), [start, tip], atol=1e-9)
    for branch, (heading_deg, length_mm) in enumerate([(-30, 50), (30, 75), (90, 100)], start=1):
        u = np.array([math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))])
        assert_allclose(grown.chain_mm(branch), [tip, tip + length_mm * u], atol=1e-9)
    assert grown.stop.tolist() == [Stop.FULL_LENGTH] * 4
    assert_allclose(grown.contact_turn_rad, 0.0, atol=1e-12)


@pytest.mark.parametrize(("heading_deg", "side"), [(60.0, 1.0), (120.0, -1.0)])
def test_one_long_wall_slides_to_the_closed_form_point(launch, vine, terrain, heading_deg, side):
    grown = launch(vine(200.0), terrain(UNDER_CEILING), (0.0, 0.0, heading_deg))
    reach = math.sqrt(200.0**2 - 100.0**2)
    assert_allclose(grown.chain_mm(0), [[0.0, 0.0], [side * reach, 100.0]], atol=1e-9)
    assert grown.stop[0] == Stop.FULL_LENGTH
    assert grown.grown_mm[0] == 200.0
    assert_allclose(grown.contact_turn_rad[0], math.radians(60.0) - math.asin(0.5), atol=1e-12)


def test_length_used_up_on_arrival_is_full_length(launch, vine, terrain):
    grown = launch(
        vine(100.0), terrain(UNDER_CEILING), (0.0, 0.0, 90.0), head_on_half_angle_rad=0.1
    )
    assert grown.stop[0] == Stop.FULL_LENGTH
    assert_allclose(grown.tips_mm, [[0.0, 100.0]], atol=1e-9)


def test_leaves_a_convex_corner_that_it_does_not_press_on(launch, vine, terrain):
    ground = terrain(WIDE, box(-50.0, 100.0, 50.0, 200.0))
    grown = launch(vine(300.0), ground, (0.0, 0.0, 80.0))
    u = np.array([50.0, 100.0]) / math.hypot(50.0, 100.0)
    assert_allclose(grown.chain_mm(0), [[0.0, 0.0], 300.0 * u], atol=1e-9)
    assert grown.stop[0] == Stop.FULL_LENGTH


def test_slides_on_around_a_convex_corner_that_it_presses_on(launch, vine, terrain):
    ground = terrain(WIDE, Polygon([(-50, 100), (50, 100), (150, 150), (150, 300), (-50, 300)]))
    grown = launch(vine(150.0), ground, (0.0, 0.0, 80.0))
    assert_allclose(grown.chain_mm(0), [[0.0, 0.0], [90.0, 120.0]], atol=1e-9)


def test_corner_of_a_room_stops_the_tip(launch, vine, terrain):
    grown = launch(vine(500.0), terrain(box(0.0, 0.0, 100.0, 100.0)), (10.0, 10.0, 30.0))
    assert grown.stop[0] == Stop.CORNER
    assert_allclose(grown.tips_mm, [[100.0, 100.0]], atol=1e-9)
    assert_allclose(grown.grown_mm, [math.hypot(90.0, 90.0)])


def test_slides_on_through_a_wide_concave_corner(launch, vine, terrain):
    room = Polygon([(-300, 100), (-300, -300), (650, -300), (650, -200), (50, 100)])
    grown = launch(vine(math.hypot(90.0, 90.0)), terrain(room), (-20.0, 0.0, 70.0))
    assert grown.stop[0] == Stop.FULL_LENGTH
    assert_allclose(grown.tips_mm, [[70.0, 90.0]], atol=1e-9)


def test_second_wall_across_the_way_takes_over(launch, vine, terrain):
    # The wedge hangs from the ceiling: its end is no corner of the wall that the tip slides on.
    ramp = Polygon([(40.0, 120.0), (300.0, 120.0), (300.0, -10.0)])
    grown = launch(vine(math.hypot(90.0, 95.0)), terrain(UNDER_CEILING, ramp), (0.0, 0.0, 70.0))
    assert grown.stop[0] == Stop.FULL_LENGTH
    assert_allclose(grown.tips_mm, [[90.0, 95.0]], atol=1e-9)


def test_wraps_a_vertex_and_turns_about_it(launch, vine, terrain):
    ground = terrain(UNDER_CEILING, Polygon([(50, 60), (90, 20), (90, 60)]))
    length_mm = math.hypot(50.0, 60.0) + math.hypot(42.0, 40.0)
    grown = launch(vine(length_mm), ground, (0.0, 0.0, 60.0))
    assert_allclose(grown.chain_mm(0), [[0, 0], [50, 60], [92, 100]], atol=1e-9)
    turn = math.radians(60.0) - math.atan2(40.0, 42.0)
    assert_allclose(grown.contact_turn_rad, [turn], atol=1e-12)


def test_wedge_that_the_body_does_not_press_on_is_a_corner(launch, vine, terrain):
    # After the wrap the body lies along the lower wall of the wedge: u.n' = 0.
    lip = Polygon([(50, 60), (150, 60), (150, 100), (110, 100)])
    grown = launch(vine(1000.0), terrain(UNDER_CEILING, lip), (0.0, 0.0, 60.0))
    assert grown.stop[0] == Stop.CORNER
    assert_allclose(grown.chain_mm(0), [[0, 0], [50, 60], [110, 100]], atol=1e-9)


@pytest.mark.parametrize("half_angle_deg", [0.0, 5.0, 15.0])
@pytest.mark.parametrize("off_deg", [0.0, 0.01, 4.99, 5.01, 14.99, 15.01, 30.0])
def test_head_on_within_the_half_angle_only(launch, vine, terrain, half_angle_deg, off_deg):
    options = {"head_on_half_angle_rad": math.radians(half_angle_deg)}
    grown = launch(vine(500.0), terrain(UNDER_CEILING), (0.0, 0.0, 90.0 - off_deg), **options)
    assert grown.stop[0] == (Stop.HEAD_ON if off_deg <= half_angle_deg else Stop.FULL_LENGTH)
    if off_deg <= half_angle_deg:
        tip = [100.0 * math.tan(math.radians(off_deg)), 100.0]
        assert_allclose(grown.tips_mm, [tip], atol=1e-9)


def test_head_on_counts_for_a_wall_met_while_sliding(launch, vine, terrain):
    # Sliding flat under the ceiling towards a wall that stands across: 10 degrees off at the end.
    ground, base_y = terrain(box(-1000.0, -1000.0, 50.0, 100.0)), 100.0 - 50.0 * math.tan(0.17)
    assert launch(vine(900.0), ground, (0.0, base_y, 20.0)).stop[0] == Stop.CORNER
    grown = launch(vine(900.0), ground, (0.0, base_y, 20.0), head_on_half_angle_rad=0.18)
    assert grown.stop[0] == Stop.HEAD_ON
    assert_allclose(grown.tips_mm, [[50.0, 100.0]], atol=1e-9)
