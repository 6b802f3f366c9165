import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage
from shapely import MultiLineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.maps.cleanup.raster import (
    CORNER_CUT,
    LEAST_GAP,
    GridPlacement,
    Mask,
    boundary_loops,
    corners_between,
    raster_map,
    straighten,
)
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.poses import draw_poses
from vinefab.model.map import Map, Pose

MASKS = arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def exact(loop: Floats) -> Floats:
    return corners_between(loop, np.roll(loop, -1, axis=0))


def signed_area(ring: Floats) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def test_free_cells_touching_at_a_corner_are_apart_and_solid_ones_joined() -> None:
    assert len(boundary_loops(np.eye(3, dtype=bool))) == 3
    wall = np.ones((6, 6), dtype=bool)
    wall[range(1, 5), range(1, 5)] = False
    assert len(boundary_loops(wall)) == 2


@settings(max_examples=50, deadline=None)
@given(MASKS)
def test_loops_are_simple_apart_and_enclose_what_the_cells_do(mask: np.ndarray) -> None:
    loops = boundary_loops(mask)
    assert sum(signed_area(exact(loop)) for loop in loops) == pytest.approx(mask.sum())
    lines = np.array([shapely.LinearRing(loop) for loop in loops], dtype=object)
    assert all(line.is_simple for line in lines)
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=0.7)
    assert (one == two).all()
    outer = sum(signed_area(loop) > 0 for loop in loops)
    assert outer == ndimage.label(mask)[1]
    solid = ndimage.label(np.pad(~mask, 1, constant_values=True), np.ones((3, 3)))[1]
    assert len(loops) - outer == solid - 1


@settings(max_examples=25, deadline=None)
@given(MASKS)
def test_midpoints_stay_near_the_exact_boundary(mask: np.ndarray) -> None:
    for loop in boundary_loops(mask):
        corners, line = shapely.points(exact(loop)), Polygon(loop).exterior
        assert shapely.distance(corners, line).max() <= CORNER_CUT + 1e-12


TOLERANCES = (0.75, 1.0, 1.5, 3.0)


def largest_region(mask: Mask) -> Mask:
    labels, _ = ndimage.label(mask)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray(labels == sizes.argmax())


def cells_in(shape: BaseGeometry, rows: int, columns: int) -> Mask:
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    return np.asarray(shapely.contains_xy(shape, x.ravel(), y.ravel())).reshape(rows, columns)


def pixel_boundary(mask: Mask) -> MultiLineString:
    rings = [corners_between(loop, np.roll(loop, -1, axis=0)) for loop in boundary_loops(mask)]
    return MultiLineString([np.vstack([ring, ring[:1]]) for ring in rings])


def hausdorff(one: BaseGeometry, two: BaseGeometry) -> float:
    def directed(first: BaseGeometry, second: BaseGeometry) -> float:
        points = shapely.points(shapely.get_coordinates(shapely.segmentize(first, 0.1)))
        return float(shapely.distance(points, second).max())

    return max(directed(one, two), directed(two, one))


def smallest_gap(polygon: Polygon) -> float:
    """Return the least distance between two walls that do not share a corner or a short wall."""
    rings = [np.array(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
    lines = [list(shapely.linestrings(np.stack([r[:-1], r[1:]], axis=1))) for r in rings]
    least = math.inf
    for index, ring in enumerate(lines):
        for other in lines[index + 1 :]:
            least = min(least, shapely.distance(np.array(ring)[:, None], np.array(other)).min())
        for k, line in enumerate(ring):
            far = [
                other
                for j, other in enumerate(ring)
                if min((j - k) % len(ring), (k - j) % len(ring)) > 2
            ]
            if far:
                least = min(least, shapely.distance(line, far).min())
    return float(least)


def assert_faithful(mask: Mask, tolerance: float) -> Polygon:
    loops = boundary_loops(mask)
    result = straighten(loops, tolerance)
    polygon = result.polygon
    assert polygon.is_valid, shapely.is_valid_reason(polygon)
    assert len(polygon.interiors) == len(loops) - 1
    deviation = hausdorff(pixel_boundary(mask), polygon.boundary)
    assert deviation <= result.deviation + 1e-9
    assert deviation <= tolerance + 1e-9
    assert smallest_gap(polygon) >= LEAST_GAP - 1e-9
    return polygon


@st.composite
def regions(draw: st.DrawFn) -> Mask:
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    size = draw(st.integers(6, 36))
    kind = draw(st.sampled_from(["noise", "blobs", "lines", "discs", "walk"]))
    free = np.ones((size, size), dtype=np.bool_)
    if kind == "noise":
        free = rng.random((size, size)) > rng.choice([0.05, 0.2, 0.35])
    elif kind == "blobs":
        field = ndimage.gaussian_filter(rng.random((size, size)), rng.uniform(0.5, 3.0))
        free = field > np.quantile(field, rng.uniform(0.2, 0.5))
    elif kind == "lines":
        for ends in rng.random((6, 2, 2)) * size:
            steps = ends[0] + np.linspace(0, 1, 150)[:, None] * (ends[1] - ends[0])
            free[tuple(steps.astype(int).T)] = False
    elif kind == "discs":
        row, column = np.mgrid[:size, :size]
        for x, y, radius in rng.random((5, 3)) * (size, size, size / 6) + (0, 0, 0.4):
            free &= np.hypot(row - y, column - x) > radius
    else:
        free[:] = False
        steps = np.array([(0, 1), (1, 0), (0, -1), (-1, 0)])[rng.integers(4, size=6 * size)]
        place = np.clip(size // 2 + np.cumsum(steps, axis=0), 0, size - 1)
        free[tuple(place.T)] = True
    free[size // 2, size // 2] = True
    return largest_region(free)


@settings(max_examples=40, deadline=None)
@given(regions(), st.sampled_from(TOLERANCES))
def test_any_region_keeps_its_topology_and_the_deviation_its_bound(
    mask: Mask, tolerance: float
) -> None:
    assert_faithful(mask, tolerance)


@pytest.mark.parametrize("angle_deg", [0, 3, 11, 26.6, 30, 37, 45, 62, 81])
def test_a_straight_wall_comes_back_straight_at_any_angle(angle_deg: float) -> None:
    room = shapely.affinity.rotate(shapely.box(20, 30, 120, 90), angle_deg)
    polygon = assert_faithful(cells_in(room, 140, 140), 1.0)
    assert len(polygon.exterior.coords) - 1 <= 6
    assert polygon.symmetric_difference(room).area < 0.02 * room.area
    corners = np.array(polygon.exterior.coords)
    steps = np.diff(corners, axis=0)
    long = np.hypot(*steps.T) > 20
    found = np.degrees(np.arctan2(steps[long, 1], steps[long, 0])) % 90
    error = (found - angle_deg + 45) % 90 - 45
    assert long.sum() == 4
    assert np.abs(error).max() < 0.6


def test_rooms_along_the_axes_come_back_exactly() -> None:
    mask = np.zeros((30, 40), dtype=bool)
    mask[2:20, 3:30] = True
    mask[10:28, 15:38] = True
    mask[5:8, 5:6] = False
    polygon = assert_faithful(mask, 1.0)
    cells = [shapely.box(x, y, x + 1, y + 1) for y, x in np.argwhere(mask)]
    assert polygon.symmetric_difference(shapely.union_all(cells)).area < 1e-9
    assert len(shapely.get_coordinates(polygon)) == 9 + 5


def test_a_single_solid_cell_stays_that_cell() -> None:
    mask = np.ones((9, 9), dtype=bool)
    mask[4, 5] = False
    polygon = assert_faithful(mask, 3.0)
    assert Polygon(polygon.interiors[0]).equals(shapely.box(5, 4, 6, 5))


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("angle_deg", [0, 20, 45, 70])
def test_a_wall_one_cell_thick_neither_vanishes_nor_opens(
    angle_deg: float, tolerance: float
) -> None:
    line = shapely.affinity.rotate(shapely.box(10, 29, 50, 30), angle_deg, origin=(30, 30))
    mask = ~cells_in(shapely.buffer(line, 0.3), 60, 60)
    polygon = assert_faithful(largest_region(mask), tolerance)
    (hole,) = polygon.interiors
    wall = Polygon(hole)
    assert wall.area == pytest.approx((~mask).sum(), rel=0.25)
    assert shapely.minimum_clearance(wall) > 0.25


@pytest.mark.parametrize("radius", [2.5, 4.0, 8.0])
def test_round_pillars_stay_round_and_keep_their_size(radius: float) -> None:
    row, column = np.mgrid[:40, :40]
    mask = np.hypot(row - 20.2, column - 19.7) > radius
    polygon = assert_faithful(mask, 1.0)
    pillar = Polygon(polygon.interiors[0])
    assert pillar.area == pytest.approx((~mask).sum(), rel=0.06)
    assert 4 * math.pi * pillar.area / pillar.length**2 > 0.88
    assert len(pillar.exterior.coords) - 1 >= 6
    small = straighten(boundary_loops(mask), 5.0).polygon
    assert Polygon(small.interiors[0]).area == pytest.approx((~mask).sum(), rel=0.12)


def test_a_speck_near_a_wall_is_not_swallowed_by_a_large_tolerance() -> None:
    mask = np.zeros((40, 60), dtype=bool)
    mask[3:37, 3:57] = True
    mask[3:6, 30:33] = False
    mask[7, 31] = False
    assert_faithful(mask, 5.0)


def test_a_higher_tolerance_never_needs_more_walls_on_a_noisy_wall() -> None:
    rng = np.random.default_rng(3)
    height = 20 + np.round(rng.normal(0, 0.7, 120)).astype(int)
    mask = np.arange(40)[:, None] < height
    counts = [
        len(assert_faithful(largest_region(mask), tolerance).exterior.coords)
        for tolerance in (0.75, 1.5, 3.0)
    ]
    assert counts[0] > counts[1] > counts[2]


def room() -> Mask:
    """Return a room of 20 x 10 cells with a pillar, and a small closet on its left."""
    free = np.zeros((14, 30), dtype=bool)
    free[2:12, 8:28] = True
    free[6:8, 16:19] = False
    free[3:6, 1:4] = True
    return free


def made(free: Mask, placement: GridPlacement | None = None, **options: object) -> Map:
    return raster_map(
        "room",
        free,
        placement or GridPlacement(cell_mm=10.0),
        ImportOptions(**options),  # type: ignore[arg-type]
        {"source": "test"},
    )


def test_the_largest_region_becomes_bounds_and_its_islands_obstacles() -> None:
    world = made(room())
    assert world.bounds.equals(shapely.box(80, 20, 280, 120))
    (pillar,) = world.obstacles
    assert pillar.equals(shapely.box(160, 60, 190, 80))
    assert world.facts["free_regions_left_out"] == 1
    assert world.facts["free_area_left_out_mm2"] == 900.0
    assert world.facts["source"] == "test"
    assert world.facts["deviation_mm"] == 0.0
    assert world.facts["walls"] == world.wall_count == 8


def test_the_start_chooses_the_region() -> None:
    pose = Pose(x_mm=25, y_mm=45, heading_rad=0)
    world = made(room(), start=pose)
    assert world.bounds.equals(shapely.box(10, 30, 40, 60))
    assert world.starts[0].pose == pose


def test_placement_scales_turns_and_moves() -> None:
    quarter = GridPlacement(cell_mm=10.0, x_mm=1000.0, y_mm=500.0, turn_rad=math.pi / 2)
    world = made(room(), quarter)
    assert world.bounds.equals(shapely.box(880, 580, 980, 780))
    inside = Pose(x_mm=955, y_mm=525, heading_rad=0)
    assert quarter.cell_at(inside) == (4, 2)
    assert made(room(), quarter, start=inside).bounds.equals(shapely.box(940, 510, 970, 540))


def test_the_offered_start_has_the_most_room_and_looks_along_the_longest_way() -> None:
    free = np.zeros((30, 60), dtype=bool)
    free[2:28, 2:28] = True
    free[13:17, 28:58] = True
    world = made(free)
    (start,) = world.starts
    assert math.hypot(start.pose.x_mm - 150, start.pose.y_mm - 150) < 30
    assert start.pose.heading_rad == pytest.approx(0.0, abs=0.18)
    clearance = world.bounds.exterior.distance(shapely.Point(start.pose.x_mm, start.pose.y_mm))
    assert clearance > 0.9 * 130
    assert len(draw_poses(world, 50, 0)) == 50


def test_small_obstacles_are_left_out_only_on_request_and_counted() -> None:
    free = room()
    free[4, 10] = False
    assert len(made(free).obstacles) == 2
    world = made(free, least_obstacle_mm2=150.0)
    assert len(world.obstacles) == 1
    assert world.facts["obstacles_left_out"] == 1
    assert world.facts["largest_obstacle_left_out_mm2"] == 100.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"simplify_mm": 7.0}, r"simplify_mm is 7.0; allowed: at least 7.5 mm"),
        ({"simplify_mm": math.nan}, "simplify_mm"),
        ({"least_obstacle_mm2": -1.0}, "least_obstacle_mm2"),
        (
            {"start": Pose(x_mm=5, y_mm=5, heading_rad=0)},
            r"start is '\(5, 5\) mm'; allowed: a free",
        ),
        ({"start": Pose(x_mm=-5, y_mm=900, heading_rad=0)}, r"start is '\(-5, 900\) mm'"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        made(room(), **options)


def test_nothing_free_is_refused() -> None:
    with pytest.raises(BadInputError, match="no free cell"):
        made(np.zeros((4, 4), dtype=bool))
