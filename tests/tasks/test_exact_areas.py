"""Exact areas of discs and lines of sight, held against fine polygons and many rays."""

import math

import numpy as np
import pytest
import shapely

from vinefab.maps.generators.cave import cave_map
from vinefab.maps.generators.grid import grid_map
from vinefab.model.map import Map
from vinefab.tasks.areas import disc_union, free_disc_areas_mm2, seen_areas
from vinefab.tasks.map_context import MapContext

# --- Discs -----------------------------------------------------------------------------------


def fine_discs(centres: np.ndarray, radius: float) -> np.ndarray:
    """Discs as polygons of 4096 sides of the same area: right to 1e-6."""
    step = math.pi / 2048
    scale = math.sqrt(step / math.sin(step))
    return shapely.buffer(shapely.points(centres), radius * scale, quad_segs=1024)


def test_a_disc_in_the_open_has_its_own_area(room_context: MapContext) -> None:
    areas = free_disc_areas_mm2(np.array([[500.0, 500.0]]), 80.0, room_context.edges_mm)
    assert areas == pytest.approx(math.pi * 80.0**2, rel=1e-14)


@pytest.mark.parametrize(
    ("centre", "share"), [((0, 500), 0.5), ((0, 0), 0.25), ((1000, 1000), 0.25)]
)
def test_a_disc_on_a_wall_or_in_a_corner(
    room_context: MapContext, centre: tuple[float, float], share: float
) -> None:
    areas = free_disc_areas_mm2(np.array([centre], dtype=float), 80.0, room_context.edges_mm)
    assert areas == pytest.approx(share * math.pi * 80.0**2, rel=1e-13)


def test_a_disc_larger_than_the_map_sees_the_map(room_context: MapContext) -> None:
    areas = free_disc_areas_mm2(np.array([[300.0, 10.0]]), 3000.0, room_context.edges_mm)
    assert areas == pytest.approx(1e6, rel=1e-12)


def test_discs_among_obstacles_agree_with_polygons(pillar_room: Map) -> None:
    context = MapContext.of(pillar_room)
    centres = np.random.default_rng(3).uniform((0, 0), (400, 300), (200, 2))
    corners = shapely.get_coordinates(context.free)
    centres = np.concatenate([centres, corners, 0.5 * (corners[1:] + corners[:-1])])
    for radius in (5.0, 50.0, 120.0):
        areas = free_disc_areas_mm2(centres, radius, context.edges_mm)
        expected = shapely.area(shapely.intersection(fine_discs(centres, radius), context.free))
        np.testing.assert_allclose(areas, expected, atol=3e-6 * math.pi * radius**2)


def test_the_union_is_off_by_no_more_than_stated(pillar_room: Map) -> None:
    rng = np.random.default_rng(5)
    free = pillar_room.free_space
    for count in (1, 5, 40):
        centres = rng.uniform((0, 0), (400, 300), (count, 2))
        exact = shapely.intersection(shapely.union_all(fine_discs(centres, 50.0)), free).area
        fast = shapely.intersection(disc_union(centres, 50.0), free).area
        assert abs(fast - exact) <= 0.0007 * count * math.pi * 50.0**2
        assert abs(fast - exact) <= 2e-4 * exact


def test_a_polygon_and_its_disc_differ_on_less_than_stated() -> None:
    polygon = disc_union(np.zeros((1, 2)), 1.0)
    disc = fine_discs(np.zeros((1, 2)), 1.0)[0]
    assert polygon.symmetric_difference(disc).area < 0.0007 * math.pi
    assert polygon.area == pytest.approx(math.pi, rel=1e-12)


# --- Lines of sight --------------------------------------------------------------------------

DISC = math.pi * 80.0**2


def area(context: MapContext, x: float, y: float, radius: float = 80.0) -> float:
    areas, union = seen_areas(np.array([[x, y]]), radius, context.edges_mm)
    assert union.area == pytest.approx(areas[0], rel=1e-6)
    return float(areas[0])


@pytest.mark.parametrize(
    ("place", "share"), [((500, 500), 1.0), ((0, 500), 0.5), ((0, 0), 0.25), ((1000, 1000), 0.25)]
)
def test_open_rooms_walls_and_corners(
    room_context: MapContext, place: tuple[float, float], share: float
) -> None:
    assert area(room_context, *place) == pytest.approx(share * DISC, rel=1e-5)


def test_a_pillar_hides_what_is_behind_it(pillar_room: Map) -> None:
    context = MapContext.of(pillar_room)
    # On the corner of the pillar: three quarters of the disc. In front of it: the disc, less what
    # is beyond the pillar's lower side.
    assert area(context, 150.0, 100.0) == pytest.approx(0.75 * DISC, rel=1e-5)
    depth = 100.0 - 60.0
    segment = 80.0**2 * math.acos(depth / 80.0) - depth * math.sqrt(80.0**2 - depth**2)
    below = 20.0
    floor = 80.0**2 * math.acos((80.0 - below) / 80.0) - (80.0 - below) * math.sqrt(
        80.0**2 - (80.0 - below) ** 2
    )
    # The pillar is 100 wide: at 40 mm from it the disc is 138 wide, 19 more on either side. What
    # is there is seen up to the lines from the sensor past the pillar's corners.
    expected = DISC - segment - floor
    past = 2.0 * sum_past_corner(50.0, 40.0, 80.0)
    assert area(context, 200.0, 60.0) == pytest.approx(expected + past, rel=1e-6)


def sum_past_corner(across: float, ahead: float, radius: float) -> float:
    """Area of the disc beyond a wall's line and outside the line past its corner."""
    begin = math.atan2(ahead, across)
    end = math.asin(ahead / radius)
    sector = 0.5 * radius**2 * (begin - end)
    on_line = math.sqrt(radius**2 - ahead**2)
    return sector - 0.5 * ahead * (on_line - across)


def by_rays(free, x: float, y: float, radius: float, count: int = 1200) -> float:
    """Area seen, from the first meeting of many rays with the border: a second way."""
    border = free.boundary
    total = 0.0
    for angle in (np.arange(count) + 0.5) * 2.0 * math.pi / count:
        end = (x + radius * math.cos(angle), y + radius * math.sin(angle))
        hits = shapely.get_coordinates(
            shapely.intersection(border, shapely.LineString([(x, y), end]))
        )
        depth = np.hypot(*(hits - (x, y)).T).min(initial=radius)
        total += 0.5 * depth**2 * 2.0 * math.pi / count
    return total


def test_generated_maps_agree_with_many_rays() -> None:
    for world in (grid_map(2), cave_map(2)):
        context = MapContext.of(world)
        rng = np.random.default_rng(1)
        places = rng.uniform(0.0, 500.0, (400, 2))
        inside = shapely.contains_xy(context.free.buffer(-1.0), places[:, 0], places[:, 1])
        for x, y in places[inside][:3].tolist():
            expected = by_rays(context.free, x, y, 50.0)
            assert area(context, x, y, 50.0) == pytest.approx(expected, rel=5e-3)


def test_what_is_seen_lies_in_free_space_and_overlaps_once() -> None:
    context = MapContext.of(grid_map(4))
    rng = np.random.default_rng(3)
    places = rng.uniform(0.0, 500.0, (300, 2))
    places = places[shapely.contains_xy(context.free, places[:, 0], places[:, 1])][:30]
    areas, union = seen_areas(places, 60.0, context.edges_mm)
    assert union.is_valid
    assert union.area < areas.sum()
    assert union.difference(context.free).area < 1e-3 * union.area
    discs = shapely.union_all(shapely.buffer(shapely.points(places), 60.0, quad_segs=64))
    assert union.difference(discs.buffer(0.1)).area < 1e-6


def test_walls_seen_edge_on_hide_nothing_and_stop_nothing() -> None:
    """Tips slide along walls: sensors lie on lines of walls, to the last digit or nearly."""
    hole = shapely.box(400, 400, 600, 600)
    context = MapContext.of(
        Map(name="edge", bounds=shapely.box(0, 0, 1000, 1000), obstacles=(hole,))
    )
    for below in (0.0, 1e-13, 1e-9, 3e-6):
        for x, away in ((350.0, 50.0), (400.0, 0.0), (600.0, 0.0), (620.0, 20.0)):
            segment = 80.0**2 * math.acos(away / 80.0) - away * math.sqrt(80.0**2 - away**2)
            expected = DISC - 0.5 * segment
            assert area(context, x, 400.0 - below) == pytest.approx(expected, rel=1e-5)
        assert area(context, 450.0, 400.0 - below) == pytest.approx(0.5 * DISC, rel=1e-5)
