"""Exact ties, flush bodies, touched vertices, starts on walls and in corners; both engines."""

import math

import pytest
from numpy.testing import assert_allclose
from shapely import Polygon, box
from shapely.affinity import rotate

from vinefab.model.deployment import Stop

ROOM = box(0.0, 0.0, 100.0, 100.0)
WIDE = box(-1000.0, -1000.0, 1000.0, 1000.0)


@pytest.mark.parametrize("body", ["centerline", "inflated"])
@pytest.mark.parametrize("turn_deg", range(0, 180, 13))
def test_a_wall_met_at_right_angles_stops_whichever_way_it_lies(
    launch, tree, terrain, turn_deg, body
):
    # Rounding makes such walls lean to either side by up to 1e-11.
    ground = terrain(rotate(box(-90.0, -90.0, 90.0, 90.0), turn_deg))
    robot = tree(300.0, (2, 300.0, 180.0, 1.0))
    grown = launch(robot, ground, (3, 2, turn_deg), body=body, children_of_stuck="deploy")
    assert grown.stop.tolist() == [Stop.HEAD_ON] * 3


@pytest.mark.parametrize("turn_deg", range(0, 180, 13))
def test_a_length_used_up_at_the_wall_is_full_length(launch, tree, terrain, turn_deg):
    ground = terrain(rotate(box(-90.0, -90.0, 90.0, 90.0), turn_deg))
    robot = tree(90.0, (1, 90.0, 0.0, 1.0), (1, 90.0, 0.0, 1.0))
    grown = launch(robot, ground, (0, 0, turn_deg), children_of_stuck="deploy")
    assert grown.stop.tolist() == [Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.HEAD_ON]
    assert_allclose(grown.grown_mm, [90.0, 0.0, 0.0], atol=1e-9)


def test_body_flush_with_a_wall_goes_along_it(launch, vine, terrain):
    grown = launch(vine(60.0), terrain(ROOM), (20.0, 0.0, 0.0))
    assert_allclose(grown.chain_mm(0), [[20.0, 0.0], [80.0, 0.0]], atol=1e-9)
    assert grown.stop[0] == Stop.FULL_LENGTH


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0])
def test_body_flush_with_a_wall_does_not_slip_through_the_corner(
    launch, vine, terrain, heading_deg
):
    # The sine of a right angle's multiple is 1e-16 off: outside, for two of the four.
    start = {0.0: (20.0, 0.0), 90.0: (100.0, 20.0), 180.0: (80.0, 100.0), 270.0: (0.0, 80.0)}
    end = {0.0: (100.0, 0.0), 90.0: (100.0, 100.0), 180.0: (0.0, 100.0), 270.0: (0.0, 0.0)}
    grown = launch(
        vine(500.0), terrain(ROOM), (*start[heading_deg], heading_deg), head_on_half_angle_rad=0.01
    )
    assert grown.stop[0] == Stop.HEAD_ON
    assert_allclose(grown.tips_mm, [end[heading_deg]], atol=1e-9)


def test_grazing_a_vertex_exactly_is_free_growth(launch, vine, terrain):
    ground = terrain(WIDE, Polygon([(50, 50), (90, 10), (90, 45)]))
    grown = launch(vine(300.0), ground, (0.0, 0.0, 45.0))
    assert_allclose(grown.chain_mm(0), [[0, 0], [300 / math.sqrt(2)] * 2], atol=1e-9)


def test_body_flush_with_an_obstacle_passes_both_its_corners(launch, vine, terrain):
    grown = launch(vine(300.0), terrain(WIDE, box(50.0, -40.0, 90.0, 0.0)), (0.0, 0.0, 0.0))
    assert_allclose(grown.chain_mm(0), [[0.0, 0.0], [300.0, 0.0]], atol=1e-9)


def test_vertex_hit_exactly_from_outside_is_met(launch, vine, terrain):
    # A needle pointing at the base: the gentler wall is taken, here the lower one.
    needle = Polygon([(100.0, 0.0), (200.0, -5.0), (200.0, 20.0)])
    grown = launch(vine(120.0), terrain(WIDE, needle), (0.0, 0.0, 0.0))
    assert grown.stop[0] == Stop.FULL_LENGTH
    x, y = grown.tips_mm[0]
    assert_allclose(y, -0.05 * (x - 100.0), atol=1e-9)
    assert_allclose(math.hypot(x, y), 120.0)


def test_touched_vertex_blocks_the_turn_towards_its_solid(launch, vine, terrain):
    # Past the corner (50, 100) of the block the tip climbs a wall: the body turns left, into it.
    block = box(-50.0, 100.0, 50.0, 150.0)
    ground = terrain(box(-1000.0, -1000.0, 100.0, 1000.0), block)
    length_mm = math.hypot(50.0, 100.0) + math.hypot(50.0, 170.0)
    grown = launch(vine(length_mm), ground, (0.0, 0.0, 70.0))
    assert_allclose(grown.chain_mm(0), [[0, 0], [50, 100], [100, 270]], atol=1e-9)


def test_touched_vertex_does_not_block_the_turn_away_from_it(launch, vine, terrain):
    # Here it meets a roof behind the corner and slides right: the body turns off the corner.
    block = box(-50.0, 100.0, 50.0, 150.0)
    ground = terrain(box(-1000.0, -1000.0, 1000.0, 200.0), block)
    grown = launch(vine(250.0), ground, (0.0, 0.0, 70.0))
    assert_allclose(grown.chain_mm(0), [[0, 0], [150, 200]], atol=1e-9)


def test_of_several_touched_vertices_the_farthest_is_the_pivot(launch, vine, terrain):
    # The body lies flush with the block's upper side and is turned down into it.
    block = box(50.0, -40.0, 90.0, 0.0)
    slope = Polygon([(200.0, 20.0), (140.0, 20.0), (200.0, -100.0)])
    grown = launch(vine(170.0), terrain(WIDE, block, slope), (0.0, 0.0, 0.0))
    chain = grown.chain_mm(0)
    assert_allclose(chain[:-1], [[0.0, 0.0], [90.0, 0.0]], atol=1e-9)
    assert chain[-1][1] < -1.0


def test_child_on_a_wall_slides_from_length_zero(launch, tree, terrain):
    ground = terrain(box(-1000.0, -1000.0, 1000.0, 100.0))
    grown = launch(tree(200.0, (1, 50.0, 0.0, 1.0)), ground, (0.0, 0.0, 60.0))
    reach = math.sqrt(200.0**2 - 100.0**2)
    assert_allclose(grown.chain_mm(1), [[reach, 100.0], [reach + 50.0, 100.0]], atol=1e-9)
    assert_allclose(grown.contact_turn_rad[1], math.asin(0.5), atol=1e-9)


def test_child_on_a_wall_may_stop_head_on_at_once(launch, tree, terrain):
    ground = terrain(box(-1000.0, -1000.0, 1000.0, 100.0))
    robot = tree(100.0, (2, 50.0, 180.0, 1.0))
    grown = launch(robot, ground, (0.0, 0.0, 0.0))
    assert grown.stop.tolist() == [Stop.FULL_LENGTH] * 3
    grown = launch(robot, ground, (0.0, 100.0, 0.0), head_on_half_angle_rad=0.02)
    assert grown.stop.tolist() == [Stop.FULL_LENGTH, Stop.FULL_LENGTH, Stop.HEAD_ON]
    assert_allclose(grown.chain_mm(2), [[100.0, 100.0], [100.0, 100.0]], atol=1e-9)
    assert grown.grown_mm[2] == 0.0


@pytest.mark.parametrize(
    ("heading_deg", "tip", "stop"),
    [
        (-135.0, (0.0, 0.0), Stop.CORNER),
        (45.0, (20.0, 20.0), Stop.FULL_LENGTH),
        (-10.0, (math.sqrt(800.0), 0.0), Stop.FULL_LENGTH),
        (100.0, (0.0, math.sqrt(800.0)), Stop.FULL_LENGTH),
    ],
)
def test_start_exactly_in_a_corner(launch, vine, terrain, heading_deg, tip, stop):
    grown = launch(vine(math.sqrt(800.0)), terrain(ROOM), (0.0, 0.0, heading_deg))
    assert grown.stop[0] == stop
    assert_allclose(grown.tips_mm, [tip], atol=1e-9)


@pytest.mark.parametrize(
    ("heading_deg", "tip"),
    [(45.0, (100.0, 0.0)), (30.0, (110.0, 0.0)), (90.0, (100.0, 10.0)), (225.0, None)],
)
def test_start_exactly_at_a_convex_vertex(launch, vine, terrain, heading_deg, tip):
    # The block fills the quadrant right of and above (100, 0).
    ground = terrain(WIDE, box(100.0, 0.0, 200.0, 100.0))
    grown = launch(vine(10.0), ground, (100.0, 0.0, heading_deg))
    u = (math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg)))
    free = (100.0 + 10.0 * u[0], 10.0 * u[1])
    # Only in a dead tie between the two walls no way is better than the other.
    assert grown.stop[0] == (Stop.HEAD_ON if heading_deg == 45.0 else Stop.FULL_LENGTH)
    assert_allclose(grown.tips_mm, [tip or free], atol=1e-9)


def test_a_step_as_short_as_rounding_turns_nothing(launch, vine, terrain):
    # Met, slid along and stopped in the corner: on 1e-10 mm, in a direction that rounding gives.
    grown = launch(vine(500.0), terrain(ROOM), (100.0 - 5e-11, 100.0 - 1e-10, 10.0))
    assert grown.stop[0] == Stop.CORNER
    assert grown.contact_turn_rad[0] == 0.0


def test_touching_obstacles_leave_no_way_through(launch, vine, terrain):
    # Two squares that touch in (0, 0); the tip slides along one into the pinch.
    ground = terrain(WIDE, box(0.0, 0.0, 100.0, 100.0), box(-100.0, -100.0, 0.0, 0.0))
    grown = launch(vine(500.0), ground, (80.0, -60.0, 120.0))
    assert grown.stop[0] == Stop.CORNER
    assert_allclose(grown.tips_mm, [[0.0, 0.0]], atol=1e-9)


def test_tip_leaves_a_point_where_obstacles_touch_on_its_own_side(launch, vine, terrain):
    # Two spikes touch in (0, 0). The tip comes along the upper side of one and flies off; the
    # wall of the other that faces it belongs to the narrow wedge between them.
    left = Polygon([(0.0, 0.0), (-100.0, 0.0), (-100.0, -58.0)])
    right = Polygon([(0.0, 0.0), (-58.0, -100.0), (0.0, -100.0)])
    grown = launch(vine(100.0), terrain(WIDE, left, right), (-50.0, 30.0, -50.0))
    u = (50.0 / math.hypot(50.0, 30.0), -30.0 / math.hypot(50.0, 30.0))
    assert_allclose(grown.tips_mm, [[-50.0 + 100.0 * u[0], 30.0 + 100.0 * u[1]]], atol=1e-9)


def test_a_tip_that_slides_meets_a_needle_in_a_sag_too_flat_for_corners(launch, vine, terrain):
    # The floor sags by three steps of the grid, too little for corners: its one wall runs over the
    # point of the needle, two steps above it.
    step = terrain(ROOM).grid_mm
    floor = [(0, 3 * step), (25, step), (50, 0), (75, step), (100, 3 * step)]
    needle = Polygon([(50, step), (55, 60), (45, 60)])
    ground = terrain(Polygon([*floor, (100, 100), (0, 100)]), needle)
    assert len(ground.walls().wall) == 4 + 3
    grown = launch(vine(90.0), ground, (10.0, 20.0, -60.0))
    assert grown.stop[0] == Stop.CORNER
    assert_allclose(grown.tips_mm, [[50.0, 0.0]], atol=1e-9)


def test_walls_that_touch_up_to_rounding_are_one(launch, vine, terrain):
    # Two bricks side by side, turned by 30 degrees: their gap is rounding, the tip slides over it.
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)

    def brick(x0: float, x1: float) -> Polygon:
        corners = [(x0, 100.0), (x1, 100.0), (x1, 150.0), (x0, 150.0)]
        return Polygon([(c * x - s * y, s * x + c * y) for x, y in corners])

    ground = terrain(WIDE, brick(-50.0, 7.3), brick(7.3, 31.7), brick(31.7, 120.0))
    assert len(ground.walls().wall) == 8
    grown = launch(vine(140.0), ground, (0.0, 0.0, 92.0 + 30.0 - 4.0))
    x = math.sqrt(140.0**2 - 100.0**2)
    assert_allclose(grown.tips_mm, [[c * x - s * 100.0, s * x + c * 100.0]], atol=1e-9)


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e4])
def test_coordinates_from_micrometres_to_kilometres(launch, vine, terrain, scale):
    room = box(-1000.0 * scale, -1000.0 * scale, 1000.0 * scale, 100.0 * scale)
    post = Polygon([(50 * scale, 60 * scale), (90 * scale, 20 * scale), (90 * scale, 60 * scale)])
    length_mm = (math.hypot(50.0, 60.0) + math.hypot(42.0, 40.0)) * scale
    grown = launch(vine(length_mm), terrain(room, post), (0.0, 0.0, 60.0))
    assert_allclose(grown.chain_mm(0) / scale, [[0, 0], [50, 60], [92, 100]], atol=1e-8)
