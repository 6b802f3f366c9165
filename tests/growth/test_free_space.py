"""Free space on large maps: holes made directly are those that subtracting would make."""

import math

import numpy as np
import pytest
import shapely
from shapely import Polygon, affinity, box

from vinefab.growth import terrain as freespace
from vinefab.growth.terrain import Terrain, free_space
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.passages import without_notches
from vinefab.model.map import Map


def subtracted(world, grid_mm):
    return shapely.difference(world.bounds, shapely.union_all(world.obstacles), grid_size=grid_mm)


def same(one, other):
    return shapely.equals_exact(shapely.normalize(one), shapely.normalize(other))


@pytest.mark.parametrize("kind", ["convex", "star", "needles", "lattice"])
def test_free_space_is_bounds_minus_obstacles(random_map, kind):
    direct = 0
    for number in range(10):
        world = random_map(np.random.default_rng([21, number]), kind)
        grid_mm = Terrain.of(world).grid_mm
        assert same(free_space(world, grid_mm), subtracted(world, grid_mm)), number
        shapes = np.array(world.obstacles, dtype=object)
        direct += np.count_nonzero(freespace._stand_alone(world.bounds, shapes, 8.0 * grid_mm))
    assert direct > 8 or kind == "lattice"


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


@pytest.mark.parametrize("radius_mm", [2.0, 9.0, 30.0])
def test_a_free_space_shrunk_piece_by_piece_is_that_shrunk_at_once(monkeypatch, radius_mm):
    waves = [polar(100.0 + 4.0 * math.sin(7.3 * turn), turn) for turn in np.arange(200) * 0.0314159]
    holed = box(20, 20, 130, 130) - box(60, 60, 90, 90)
    posts = [box(x, 300, x + 12, 312) for x in range(30, 330, 33)]
    star = affinity.translate(Polygon(waves), 320, 160)
    world = Map(name="w", bounds=box(0, 0, 500, 400), obstacles=(holed, star, *posts))
    at_once = Terrain.of(world).free_space(radius_mm)
    monkeypatch.setattr(freespace, "MOST_AT_ONCE", 10)
    piecewise = Terrain.of(world).free_space(radius_mm)
    assert piecewise.is_valid
    assert not shapely.equals_exact(piecewise, at_once), "large maps take hours at once"
    # Both draw arcs as polygons, within 0.0012 radii of the true ones.
    assert shapely.hausdorff_distance(piecewise, at_once) < 0.005 * radius_mm
    assert shapely.symmetric_difference(piecewise, at_once).area < 2e-4 * at_once.area


def test_what_is_beside_a_ring_is_found_piece_by_piece_too(monkeypatch):
    ring = shapely.get_exterior_ring(shapely.Point(0, 0).buffer(100.0, quad_segs=40))
    at_once = freespace.beside_walls(np.array([ring]), 12.0)
    monkeypatch.setattr(freespace, "MOST_AT_ONCE", 10)
    piecewise = freespace.beside_walls(np.array([ring]), 12.0)
    assert not shapely.equals_exact(piecewise, at_once), "long rings take hours at once"
    assert shapely.hausdorff_distance(piecewise, at_once) < 0.01 * 12.0


def polar(radius, turn):
    return radius * math.cos(turn), radius * math.sin(turn)


def jagged_star(corners):
    angle = np.arange(corners) * 2.0 * np.pi / corners
    radius = np.where(np.arange(corners) % 2, 90.0, 130.0)[:, None]
    return Polygon([300, 200] + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def test_a_jagged_star_shrinks_to_its_hull():
    """Its slots are 0.1 mm wide at the mouth: a body of 10 mm sees the polygon of its tips."""
    world = Map(name="star", bounds=box(0, 0, 600, 400), obstacles=(jagged_star(2_000),))
    terrain = Terrain.of(world)
    hull = world.obstacles[0].convex_hull
    closed_form_mm2 = 580.0 * 380.0 - (hull.area + 10.0 * hull.length + 100.0 * math.pi)
    assert terrain.free_space(10.0).area == pytest.approx(closed_form_mm2, rel=1e-4)


@pytest.mark.parametrize(
    ("peg", "filled"),
    [(None, True), (box(49.99, 15, 50.01, 16), False), (box(49, 40, 51, 41), True)],
)
def test_notches_are_filled_where_nothing_stands_in_them(peg, filled):
    slit = Polygon([(0, 0), (100, 0), (100, 30), (50.1, 30), (50, 10), (49.9, 30), (0, 30)])
    free = box(-20, -20, 120, 80) - slit - (peg or Polygon())
    assert without_notches(free, 0.1) is free  # its mouth is wider
    closed = without_notches(free, 0.3)
    assert closed.is_valid
    assert (free.area - closed.area) == pytest.approx(2.0 if filled else 0.0, abs=1e-9)


def test_walls_of_jagged_obstacles_are_told_apart_as_of_others(random_map, monkeypatch):
    shapes = [
        shape
        for kind in ("convex", "star", "needles")
        for number in range(20)
        for shape in random_map(np.random.default_rng([5, number]), kind).obstacles
    ]
    obstacles = np.array(shapes, dtype=object)
    clearance_mm = shapely.minimum_clearance(obstacles)
    monkeypatch.setattr(freespace, "FEW_CORNERS", 0)
    for apart_mm in np.quantile(clearance_mm, [0.1, 0.5, 0.9]):
        wide = freespace._are_wide(obstacles, 1.0001 * apart_mm)
        assert (wide == (clearance_mm > 1.0001 * apart_mm)).all()


def snap_rounded(free, radius_mm, grid_mm):
    shrunk = shapely.buffer(free, -radius_mm, quad_segs=freespace.ARC_SEGMENTS_PER_QUARTER)
    return shapely.set_precision(shrunk, grid_mm)


@pytest.mark.parametrize("gap_mm", [40.0, 24.0 + 1e-10, 24.0, 24.0 - 1e-10, 23.0])
def test_corners_are_moved_onto_the_grid_as_by_snap_rounding(gap_mm):
    grid_mm = 2.0**-31
    posts = shapely.union_all([box(40, 0, 60, 70), box(60 + gap_mm, 0, 190, 100)])
    for free in (box(0, 0, 200, 200).difference(posts), grid_map(3, GridOptions()).free_space):
        found, _ = freespace.shrunk_free_space(free, 12.0, grid_mm)
        assert shapely.equals_exact(found, snap_rounded(free, 12.0, grid_mm), 0.0)
