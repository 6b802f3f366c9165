"""Free space on large maps: holes made directly are those that subtracting would make."""

import numpy as np
import pytest
import shapely
from shapely import Polygon, affinity, box

from vinefab.growth import free_space as freespace
from vinefab.growth.free_space import free_space
from vinefab.growth.terrain import Terrain
from vinefab.model.map import Map


def subtracted(world, grid_mm):
    return shapely.difference(world.bounds, shapely.union_all(world.obstacles), grid_size=grid_mm)


def same(one, other):
    return shapely.equals_exact(shapely.normalize(one), shapely.normalize(other))


@pytest.mark.parametrize("kind", ["convex", "star", "needles", "lattice"])
def test_free_space_is_bounds_minus_obstacles(random_map, kind):
    direct = 0
    for number in range(25):
        world = random_map(np.random.default_rng([21, number]), kind)
        grid_mm = Terrain.of(world).grid_mm
        assert same(free_space(world, grid_mm), subtracted(world, grid_mm)), number
        shapes = np.array(world.obstacles, dtype=object)
        direct += np.count_nonzero(freespace._stand_alone(world, shapes, 8.0 * grid_mm))
    assert direct > 20 or kind == "lattice"


def test_coarse_rounding_where_shapes_nearly_touch():
    # At this grid the gaps of 0.3 close, and the obstacle with a neck of 0.2 falls apart.
    neck = Polygon([(40, 40), (50, 44.9), (60, 40), (60, 50), (50, 45.1), (40, 50)])
    close = (box(10, 10, 20, 20), box(20.3, 10, 30, 20), box(70.2, 0.3, 80, 5))
    alone = (box(70.3, 70.4, 80.4, 80.3), affinity.rotate(box(20, 70, 30, 80), 31))
    for grid_mm in (2.0**-20, 0.25, 0.5):
        world = Map(name="test", bounds=box(0, 0, 100, 100), obstacles=(neck, *close, *alone))
        assert same(free_space(world, grid_mm), subtracted(world, grid_mm)), grid_mm


def test_obstacles_in_courtyards_become_holes_of_the_courtyard():
    ring = box(10, 10, 60, 60).difference(box(20, 20, 50, 50))
    world = Map(
        name="test",
        bounds=box(0, 0, 100, 100),
        obstacles=(ring, box(30, 30, 40, 40), box(70, 70, 80, 80)),
    )
    free = free_space(world, 2.0**-30)
    assert same(free, subtracted(world, 2.0**-30))
    assert sorted(len(part.interiors) for part in free.geoms) == [1, 2]


def test_holes_in_the_bounds_and_no_obstacles():
    bounds = box(0, 0, 100, 100).difference(box(40, 40, 60, 60))
    for obstacles in ((), (box(10, 10, 20, 20),), (box(45, 45, 50, 50),)):
        world = Map(name="test", bounds=bounds, obstacles=obstacles)
        assert same(free_space(world, 2.0**-30), subtracted(world, 2.0**-30))
