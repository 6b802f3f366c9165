import math

import numpy as np
import pytest
import shapely

from vinefab.model.map import Map
from vinefab.tasks.coverage import disc_union, free_disc_areas_mm2
from vinefab.tasks.map_context import MapContext


def fine_discs(centres: np.ndarray, radius: float) -> np.ndarray:
    """Discs as polygons of 4096 sides of the same area: right to 1e-6."""
    step = math.pi / 2048
    scale = math.sqrt(step / math.sin(step))
    return shapely.buffer(shapely.points(centres), radius * scale, quad_segs=1024)


def test_a_disc_in_the_open_has_its_own_area(room_ground: MapContext) -> None:
    areas = free_disc_areas_mm2(np.array([[500.0, 500.0]]), 80.0, room_ground.edges_mm)
    assert areas == pytest.approx(math.pi * 80.0**2, rel=1e-14)


@pytest.mark.parametrize(
    ("centre", "share"), [((0, 500), 0.5), ((0, 0), 0.25), ((1000, 1000), 0.25)]
)
def test_a_disc_on_a_wall_or_in_a_corner(
    room_ground: MapContext, centre: tuple[float, float], share: float
) -> None:
    areas = free_disc_areas_mm2(np.array([centre], dtype=float), 80.0, room_ground.edges_mm)
    assert areas == pytest.approx(share * math.pi * 80.0**2, rel=1e-13)


def test_a_disc_larger_than_the_map_sees_the_map(room_ground: MapContext) -> None:
    areas = free_disc_areas_mm2(np.array([[300.0, 10.0]]), 3000.0, room_ground.edges_mm)
    assert areas == pytest.approx(1e6, rel=1e-12)


def test_discs_among_obstacles_agree_with_polygons(pillar_room: Map) -> None:
    ground = MapContext.of(pillar_room)
    centres = np.random.default_rng(3).uniform((0, 0), (400, 300), (200, 2))
    corners = shapely.get_coordinates(ground.free)
    centres = np.concatenate([centres, corners, 0.5 * (corners[1:] + corners[:-1])])
    for radius in (5.0, 50.0, 120.0):
        areas = free_disc_areas_mm2(centres, radius, ground.edges_mm)
        expected = shapely.area(shapely.intersection(fine_discs(centres, radius), ground.free))
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
