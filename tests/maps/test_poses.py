import math

import numpy as np
import pytest
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.map import Map, Pose, Start

BOX = shapely.box(0, 0, 100, 100)


def world_with(*starts: Start, obstacles: tuple[Polygon, ...] = ()) -> Map:
    return Map(name="w", bounds=BOX, starts=starts, obstacles=obstacles)


def start_at(x: float, y: float, **spreads: float) -> Start:
    return Start(pose=Pose(x_mm=x, y_mm=y, heading_rad=1.0), **spreads)


def test_a_start_without_spread_gives_itself() -> None:
    start = start_at(30.0, 40.0)
    assert draw_poses(world_with(start), 1, 5) == (start.pose,)


def test_poses_fill_the_range_and_stay_in_it() -> None:
    start = start_at(50, 50, spread_x_mm=20, spread_y_mm=10, spread_heading_rad=0.5)
    poses = draw_poses(world_with(start), 400, 1)
    values = np.array([(p.x_mm, p.y_mm, p.heading_rad) for p in poses])
    low, high = np.array([30, 40, 0.5]), np.array([70, 60, 1.5])
    assert (values >= low).all()
    assert (values <= high).all()
    assert (values.min(axis=0) < low + 0.05 * (high - low)).all()
    assert (values.max(axis=0) > high - 0.05 * (high - low)).all()
    assert values.mean(axis=0) == pytest.approx((low + high) / 2, rel=0.05)


def test_no_pose_is_inside_an_obstacle() -> None:
    block = shapely.box(40, 0, 60, 100)
    world = world_with(start_at(50, 50, spread_x_mm=15), obstacles=(block,))
    poses = draw_poses(world, 100, 3)
    assert all(p.x_mm <= 40 or p.x_mm >= 60 for p in poses)
    assert {p.x_mm < 50 for p in poses} == {True, False}


def test_clearance_keeps_poses_off_the_walls() -> None:
    world = world_with(start_at(10, 50, spread_x_mm=10))
    assert min(p.x_mm for p in draw_poses(world, 200, 1)) < 3
    assert min(p.x_mm for p in draw_poses(world, 200, 1, clearance_mm=8)) >= 8


def test_a_start_on_a_wall_is_free() -> None:
    start = start_at(50.0, 0.0)
    assert draw_poses(world_with(start), 1, 0) == (start.pose,)


def test_starts_take_turns_and_longer_draws_begin_with_shorter_ones() -> None:
    starts = [start_at(x, 50.0, spread_heading_rad=1.0) for x in (20.0, 50.0, 80.0)]
    poses = draw_poses(world_with(*starts), 6, 9)
    assert [p.x_mm for p in poses] == [20.0, 50.0, 80.0] * 2
    assert draw_poses(world_with(*starts), 2, 9) == poses[:2]
    assert draw_poses(world_with(*starts), 6, 10) != poses


def test_no_start_and_no_free_pose_are_refused() -> None:
    with pytest.raises(BadInputError, match="starts is 'empty'"):
        draw_poses(world_with(), 1, 0)
    buried = world_with(start_at(50, 50), obstacles=(shapely.box(30, 30, 70, 70),))
    with pytest.raises(BadInputError, match=r"starts\[1\].*50, 50.*free space"):
        draw_poses(buried, 1, 0)
    with pytest.raises(BadInputError, match="poses"):
        draw_poses(buried, -1, 0)


def test_islands_in_holes_of_the_bounds_are_not_free() -> None:
    ring = Polygon(BOX.exterior, [shapely.box(40, 40, 60, 60).exterior])
    world = Map(name="w", bounds=ring, starts=(start_at(50, 50),))
    with pytest.raises(BadInputError):
        draw_poses(world, 1, 0)


def test_grid_poses_point_up_within_their_spread() -> None:
    poses = draw_poses(grid_map(4), 50, 2)
    assert all(abs(p.heading_rad - math.pi / 2) <= math.radians(30) for p in poses)
