"""From maps to walls: orientation, overlaps, touching, starts, index."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import Polygon, box

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import MARGIN, MOST_RADII, Terrain
from vinefab.model.map import Map, Pose

ROOM = box(0.0, 0.0, 100.0, 100.0)


def _loops(link: np.ndarray) -> list[int]:
    """Lengths of the closed chains that the walls form."""
    left, loops = set(range(len(link))), []
    while left:
        first = wall = left.pop()
        length = 1
        while (wall := int(link[wall, 1])) != first:
            left.remove(wall)
            length += 1
        loops.append(length)
    return sorted(loops)


def test_free_space_is_on_the_left_of_every_wall(terrain):
    ground = terrain(ROOM, box(20.0, 20.0, 40.0, 40.0))
    wall = ground.walls().wall
    middle = wall[:, :2] + 0.5 * wall[:, 4:5] * wall[:, 2:4]
    normal = np.column_stack([-wall[:, 3], wall[:, 2]])
    assert all(ground.contains(*point) for point in middle + 0.1 * normal)
    assert not any(ground.contains(*point) for point in middle - 0.1 * normal)
    assert _loops(ground.walls().link) == [4, 4]


def test_only_the_obstacle_corners_can_be_wrapped(terrain):
    walls = terrain(ROOM, box(20.0, 20.0, 40.0, 40.0)).walls()
    assert sorted(map(tuple, walls.vertex)) == [(20, 20), (20, 40), (40, 20), (40, 40)]
    inward = [30.0, 30.0] - walls.vertex
    assert_allclose(walls.solid, inward / np.hypot(*inward.T)[:, None])


@pytest.mark.parametrize(
    ("obstacles", "walls", "vertices"),
    [
        ([box(20, 20, 50, 50), box(40, 40, 70, 70)], 4 + 8, 6),
        ([box(20, 20, 50, 50), box(50, 20, 70, 50)], 4 + 4, 4),
        ([box(20, 20, 50, 50), box(30, 30, 40, 40)], 4 + 4, 4),
        ([box(-20, 20, 30, 40)], 4 + 4, 2),
        ([box(-20, -20, 30, 120)], 4, 0),
        ([box(20, 0, 30, 100)], 8, 0),
        ([box(200, 200, 300, 300)], 4, 0),
    ],
    ids=["overlap", "shared side", "inside", "over the edge", "over a side", "split", "outside"],
)
def test_only_walls_of_the_free_space_are_kept(terrain, obstacles, walls, vertices):
    arrays = terrain(ROOM, *obstacles).walls()
    assert (len(arrays.wall), len(arrays.vertex)) == (walls, vertices)


def test_corners_that_are_none_are_dropped(terrain):
    dense = shapely.segmentize(box(20.1, 20.2, 40.3, 40.4), 0.7)
    turned = shapely.affinity.rotate(dense, 17.0)
    assert len(terrain(ROOM, turned).walls().wall) == 8


def test_a_needle_keeps_its_three_walls(terrain):
    # As thin as the grid of coordinates allows: its third corner is flat.
    thickness_mm = Terrain.of(Map(name="test", bounds=ROOM)).grid_mm
    needle = Polygon([(20.0, 20.0), (70.0, 20.0), (45.0, 20.0 + thickness_mm)])
    assert _loops(terrain(ROOM, needle).walls().link) == [3, 4]


def test_touching_corners_share_free_space_wedge_by_wedge(terrain):
    arrays = terrain(ROOM, box(20, 20, 50, 50), box(50, 50, 80, 80)).walls()
    # Round the pinch the walls go from one square to the other: one loop instead of two.
    assert _loops(arrays.link) == [4, 8]
    assert len(arrays.vertex) == 6


def test_chains_of_walls_close_on_any_map(random_map):
    for number in range(60):
        rng = np.random.default_rng([9, number])
        kind = ("convex", "star", "needles", "lattice")[number % 4]
        link = Terrain.of(random_map(rng, kind)).walls().link
        assert sorted(link[:, 1]) == list(range(len(link)))
        assert (link[link[:, 1], 0] == np.arange(len(link))).all()
        assert (link[link[:, 1], 2] == link[:, 3]).all()


@pytest.mark.parametrize(("steps", "marked"), [(4.0, True), (12.0, False)])
def test_walls_that_all_but_touch_another_are_marked(terrain, steps, marked):
    right = 50.0 + steps * terrain(ROOM).grid_mm
    arrays = terrain(ROOM, box(20, 20, 50, 50), box(right, 20, 80, 50)).walls()
    beside = (np.abs(arrays.wall[:, 0] - 50.0) < 1.0) & (arrays.wall[:, 3] != 0.0)
    assert beside.sum() == 2
    assert (arrays.link[beside, 4] == marked).all()


def test_arrays_never_change_and_are_made_once(terrain):
    ground = terrain(ROOM)
    assert ground.walls() is ground.walls()
    assert ground.walls(3.0) is ground.walls(3.0)
    assert_allclose(ground.walls(3.0).wall[:, :2].min(axis=0), [3.0, 3.0], atol=1e-9)
    with pytest.raises(ValueError, match="read-only"):
        ground.walls().wall[0, 0] = 1.0


def test_walls_are_kept_for_a_bounded_number_of_radii(terrain):
    ground = terrain(ROOM)
    bare = ground.walls()
    for step in range(3 * MOST_RADII):
        ground.walls(1.0 + 0.1 * step)
    assert ground.walls() is bare
    assert len(ground._walls) <= MOST_RADII
    assert len(ground._free) <= MOST_RADII
    assert_allclose(ground.walls(1.0).wall[:, :2].min(), 1.0, atol=1e-9)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["star", "lattice"]))
def test_index_lists_every_wall_in_every_cell_that_it_touches(random_map, seed, kind):
    rng = np.random.default_rng(seed)
    arrays = Terrain.of(random_map(rng, kind)).walls()
    x, y, cell, _ = arrays.box
    columns, rows = arrays.shape
    lines = shapely.linestrings(np.stack([arrays.wall[:, :2], arrays.end], axis=1))
    for number in rng.integers(0, columns * rows, 15):
        row, column = divmod(int(number), int(columns))
        left, low = x + column * cell, y + row * cell
        # A little more than the cell: a ray along its edge must find what it touches.
        square = box(left, low, left + cell, low + cell).buffer(0.5 * MARGIN * cell)
        touched = np.flatnonzero(shapely.intersects(lines, square))
        span = slice(arrays.wall_first[number], arrays.wall_first[number + 1])
        assert set(touched) <= set(arrays.wall_item[span])


def test_index_lists_a_wall_on_the_edge_between_cells_in_both(terrain):
    # The grid depends on the room and the number of walls only.
    arrays = terrain(ROOM, box(10.0, 10.0, 30.0, 30.0)).walls()
    column_edge = float(arrays.box[0] + 2.0 * arrays.box[2])
    arrays = terrain(ROOM, box(column_edge, 10.0, 90.0, 30.0)).walls()
    upright = np.flatnonzero((arrays.wall[:, 0] == arrays.end[:, 0]) & (arrays.wall[:, 0] < 90.0))
    (number,) = [wall for wall in upright if arrays.wall[wall, 0] > 10.0]
    cells = [
        cell
        for cell in range(int(arrays.shape.prod()))
        if number in arrays.wall_item[arrays.wall_first[cell] : arrays.wall_first[cell + 1]]
    ]
    assert {cell % arrays.shape[0] for cell in cells} == {1, 2}


@pytest.mark.parametrize(
    ("x", "y", "words"),
    [(30.0, 30.0, "inside an obstacle"), (150.0, 50.0, "outside the bounds")],
)
def test_a_start_in_solid_is_refused(terrain, vine, x, y, words):
    ground = terrain(ROOM, box(20.0, 20.0, 40.0, 40.0))
    pose = Pose(x_mm=x, y_mm=y, heading_rad=0.0)
    assert not ground.is_free(pose)
    with pytest.raises(BadInputError, match=words):
        grow_on(vine(10.0), ground, pose)


def test_a_map_without_free_space_refuses_every_start(terrain):
    ground = terrain(ROOM, box(-10.0, -10.0, 110.0, 110.0))
    assert len(ground.walls().wall) == 0
    with pytest.raises(BadInputError, match="inside an obstacle"):
        ground.start_mm(Pose(x_mm=50.0, y_mm=50.0, heading_rad=0.0))


def test_a_start_on_a_wall_is_allowed_and_one_a_trifle_outside_is_put_on_it(terrain):
    ground = terrain(ROOM)
    on = Pose(x_mm=100.0, y_mm=50.0, heading_rad=0.0)
    assert ground.start_mm(on) == (100.0, 50.0)
    trifle = Pose(x_mm=100.0 + 5e-8, y_mm=50.0, heading_rad=0.0)
    assert ground.start_mm(trifle) == (100.0, 50.0)
    assert not ground.is_free(Pose(x_mm=100.0 + 1e-5, y_mm=50.0, heading_rad=0.0))


def test_holes_in_the_bounds_and_obstacles_with_courtyards():
    bounds = ROOM.difference(box(60.0, 60.0, 80.0, 80.0))
    ring = box(10.0, 10.0, 50.0, 50.0).difference(box(20.0, 20.0, 40.0, 40.0))
    ground = Terrain.of(Map(name="test", bounds=bounds, obstacles=(ring,)))
    assert not ground.contains(70.0, 70.0)
    assert not ground.contains(15.0, 15.0)
    assert ground.contains(30.0, 30.0)
    assert _loops(ground.walls().link) == [4, 4, 4, 4]


def test_walls_of_other_radii_are_dropped_and_built_again(terrain):
    ground = terrain(ROOM, box(20.0, 20.0, 40.0, 40.0))
    bare, thin, thick = (ground.walls(radius_mm) for radius_mm in (0.0, 1.0, 5.0))
    ground.keep_only([1.0])
    assert ground.walls(1.0) is thin
    assert ground.walls(5.0) is not thick
    assert_allclose(ground.walls(5.0).wall, thick.wall)
    assert ground.free_space() is not None
    assert len(ground.walls().wall) == len(bare.wall)


def test_unknown_engine_is_refused(terrain, vine):
    with pytest.raises(UnknownNameError, match="interpreted"):
        grow_on(
            vine(1.0), terrain(ROOM), Pose(x_mm=1.0, y_mm=1.0, heading_rad=0.0), engine="kernal"
        )


@pytest.mark.parametrize(
    "choice",
    [
        {"head_on_half_angle_rad": -0.1},
        {"head_on_half_angle_rad": math.nan},
        {"head_on_half_angle_rad": 2.0},
        {"children_of_stuck": "grow"},
        {"body": "fat"},
    ],
)
def test_options_are_checked(choice):
    with pytest.raises(BadInputError, match=next(iter(choice)).removesuffix("_rad")):
        GrowthOptions.published(**choice)
