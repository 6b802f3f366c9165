import math

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon

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
    with pytest.raises(BadInputError, match="it has no start"):
        draw_poses(world_with(), 1, 0)
    buried = world_with(start_at(50, 50), obstacles=(shapely.box(30, 30, 70, 70),))
    with pytest.raises(BadInputError, match=r"starts\[1\]: no free space .*50, 50"):
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


def test_poses_of_a_generated_map_are_those_of_earlier_versions() -> None:
    poses = draw_poses(grid_map(5), 2, 7)
    assert [(p.x_mm, p.y_mm, p.heading_rad) for p in poses] == [
        (250.32422504827196, 15.0, 2.017737180143027),
        (252.81117500939192, 15.0, 1.9092901939347064),
    ]


def chi_square(counts: np.ndarray, expected: np.ndarray) -> float:
    return float(((counts - expected) ** 2 / expected).sum())


DRAWS = 3000


def test_places_on_a_line_are_even_over_its_free_length() -> None:
    block = shapely.box(0, 40, 30, 60)
    start = Start(
        pose=Pose.of((10, 10, 0)),
        area=LineString([(10, 0), (10, 100)]),
        clearance_mm=5.0,
        spread_heading_rad=0.4,
    )
    poses = draw_poses(world_with(start, obstacles=(block,)), DRAWS, 11)
    y = np.array([p.y_mm for p in poses])
    assert {p.x_mm for p in poses} == {10.0}
    assert ((y >= 5 - 1e-5) & (y <= 35 + 1e-5) | (y >= 65 - 1e-5) & (y <= 95 + 1e-5)).all()
    counts = np.histogram(y, [5, 15, 25, 35.1, 65, 75, 85, 95.1])[0]
    assert counts[3] == 0
    even = np.full(6, DRAWS / 6)
    assert chi_square(np.delete(counts, 3), even) < 20.5  # 5 degrees of freedom, p = 0.001
    headings = np.histogram([p.heading_rad for p in poses], np.linspace(-0.4, 0.4, 9))[0]
    assert chi_square(headings, np.full(8, DRAWS / 8)) < 24.3
    assert headings.sum() == DRAWS


def test_places_in_an_area_are_even_over_its_free_part() -> None:
    # A wedge with a hole, half outside the bounds, around an obstacle.
    area = Polygon([(-40, 10), (90, 10), (90, 90)], [[(70, 15), (85, 15), (85, 30), (70, 30)]])
    block = shapely.box(40, 20, 60, 40)
    start = Start(pose=Pose.of((30, 20, 0)), area=area, clearance_mm=2.0)
    world = world_with(start, obstacles=(block,))
    poses = draw_poses(world, DRAWS, 3)
    x, y = np.array([(p.x_mm, p.y_mm) for p in poses]).T
    part = area & (BOX - block).buffer(-2.0, quad_segs=32)
    assert shapely.dwithin(part, shapely.points(x, y), 1e-3).all()
    edges = np.arange(0, 101, 10)
    cells = [shapely.box(a, b, a + 10, b + 10) for a in edges[:-1] for b in edges[:-1]]
    share = np.array([part.intersection(cell).area for cell in cells]) / part.area
    counts = np.histogram2d(x, y, [edges, edges])[0].ravel()
    many = share * DRAWS > 5
    assert counts[share == 0.0].sum() == 0
    # 34 cells: p = 0.001
    assert many.sum() > 20
    assert chi_square(counts[many], DRAWS * share[many]) < 2.0 * many.sum()


def test_a_thin_area_is_drawn_from_as_fast_as_a_wide_one() -> None:
    thin = Polygon([(1, 1), (99, 98), (99, 98.01)])
    start = Start(pose=Pose.of((50, 50, 0)), area=thin, clearance_mm=0.0)
    poses = draw_poses(world_with(start), 200, 1)
    assert len({(p.x_mm, p.y_mm) for p in poses}) == 200
    assert shapely.dwithin(thin, [shapely.Point(p.x_mm, p.y_mm) for p in poses], 1e-9).all()


def test_longer_draws_from_areas_begin_with_shorter_ones_and_starts_take_turns() -> None:
    line = Start(pose=Pose.of((20, 50, 0)), area=LineString([(20, 20), (20, 80)]))
    world = world_with(line, start_at(70, 50, spread_x_mm=5))
    poses = draw_poses(world, 6, 4)
    assert draw_poses(world, 3, 4) == poses[:3]
    assert [p.x_mm == 20.0 for p in poses] == [True, False] * 3
    assert draw_poses(world, 6, 5) != poses
    others = world_with(start_at(30, 50), start_at(70, 50, spread_x_mm=5))
    assert draw_poses(others, 6, 4, repeats=True)[1::2] == poses[1::2]


def test_an_area_without_free_space_names_the_start() -> None:
    line = Start(pose=Pose.of((20, 50, 0)), area=LineString([(45, 50), (55, 50)]))
    world = world_with(start_at(5, 5), line, obstacles=(shapely.box(30, 30, 70, 70),))
    with pytest.raises(BadInputError, match=r"starts\[2\].*line 45,50 55,50 meets no free space"):
        draw_poses(world, 2, 1)
    assert len(draw_poses(world, 1, 1)) == 1
