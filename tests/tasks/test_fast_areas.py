"""Fast areas on strips, cells and lines of free space, held against exact ones."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.cave import cave_map
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map
from vinefab.tasks import areas
from vinefab.tasks.areas import (
    LINES_PER_RADIUS,
    FreeArea,
    SightLines,
    WallCells,
    free_disc_areas_mm2,
    seen_areas,
)
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap, score_design
from vinefab.tasks.map_context import MapContext

# --- Strips: discs ---------------------------------------------------------------------------

FAST = Coverage(area="fast")


def exact_mm2(context: MapContext, tips: np.ndarray, radius: float) -> float:
    step = math.pi / 512
    discs = shapely.buffer(
        shapely.points(tips), radius * math.sqrt(step / math.sin(step)), quad_segs=256
    )
    return shapely.intersection(shapely.union_all(discs), context.free).area


def covered(context: MapContext, tips: np.ndarray, radius: float) -> tuple[float, float]:
    raster = context.raster(radius)
    assert raster is not None
    seen, summed = raster.covered_mm2(tips, np.array([0, len(tips)]))
    return float(seen[0]), float(summed[0])


def test_strips_hold_the_free_area(pillar_room: Map) -> None:
    for world in (pillar_room, grid_map(3)):
        context = MapContext.of(world)
        for radius in (7.0, 50.0, 3000.0):
            raster = context.raster(radius)
            assert raster.free_mm2[:, -1].sum() == pytest.approx(context.area_mm2, rel=1e-12)
            assert (np.diff(raster.free_mm2, axis=1) > -1e-9).all()


def test_discs_in_the_open_are_exact_however_they_lie(room_context: MapContext) -> None:
    rng = np.random.default_rng(1)
    for radius in (13.0, 50.0):
        for centre in rng.uniform(60.0, 940.0, (20, 2)):
            seen, summed = covered(room_context, centre[None], radius)
            assert seen == summed == pytest.approx(math.pi * radius**2, rel=1e-9)


@pytest.mark.parametrize("radius", [20.0, 50.0, 100.0])
def test_trees_on_grid_maps_are_within_the_stated_error(radius: float) -> None:
    errors = []
    fan = Level(branches=5, length_mm=90.0, fan_rad=2.0, growth=0.8)
    tree = Design(name="t", trunk_length_mm=200.0, levels=(fan, fan), build=Build.standard(3))
    for seed in range(3):
        site = PreparedMap.of(grid_map(seed))
        options = GrowthOptions.published(children_of_stuck="deploy")
        launches = Launches.of(TerrainSet([site.terrain]), [draw_poses(site.world, 4, seed)])
        for grown in Batch(Plans.of([tree], options), launches, options).deployments():
            seen, summed = covered(site.context, grown.tips_mm, radius)
            each = free_disc_areas_mm2(grown.tips_mm, radius, site.context.edges_mm)
            assert summed == pytest.approx(each.sum(), rel=5e-3)
            errors.append(seen / exact_mm2(site.context, grown.tips_mm, radius) - 1.0)
    assert np.abs(errors).max() < 3e-3
    assert np.sqrt(np.mean(np.square(errors))) < 2e-3


def test_the_worst_case_bound_holds_for_any_discs(pillar_room: Map) -> None:
    rng = np.random.default_rng(2)
    context = MapContext.of(pillar_room)
    for radius in (3.0, 40.0, 150.0):
        for count in (1, 3, 60):
            tips = rng.uniform((-20, -20), (420, 320), (count, 2))
            if count == 3:
                # One on the other, and beside walls.
                tips = np.array([[150.0, 100.0], [150.0, 100.0], [150.0, 100.0 - radius]])
            seen, summed = covered(context, tips, radius)
            assert seen <= summed * (1.0 + 1e-12)
            bound = 0.08 * count * math.pi * radius**2
            assert abs(seen - exact_mm2(context, tips, radius)) < bound


@pytest.mark.parametrize(("kind", "right_mm"), [("raster", 400), ("sight_lines", 150)])
def test_sets_of_places_do_not_depend_on_each_other(
    pillar_room: Map, kind: str, right_mm: float
) -> None:
    rng = np.random.default_rng(4)
    areas = getattr(MapContext.of(pillar_room), kind)(30.0)
    sets = [rng.uniform((0, 0), (right_mm, 300), (count, 2)) for count in (4, 0, 1, 25)]
    before = np.concatenate(sets)
    tips = before.copy()
    seen, summed = areas.covered_mm2(tips, np.cumsum([0, *map(len, sets)]))
    assert np.array_equal(tips, before)
    assert seen[1] == summed[1] == 0.0
    for index, own in enumerate(sets):
        alone = areas.covered_mm2(own, np.array([0, len(own)]))
        assert (seen[index], summed[index]) == (alone[0][0], alone[1][0])


def test_a_raster_that_would_be_too_large_is_not_made(room_context: MapContext) -> None:
    assert FreeArea.of(room_context.edges_mm, 0.5) is None
    assert room_context.raster(50.0) is room_context.raster(50.0)


def test_fast_scores_are_those_of_blocks_and_near_the_exact_ones(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    end = ended(fork, [[(0, 0), (200, 200)], [(200, 200), (230, 200)], None])
    score, terms = FAST.evaluate(end, room_context)
    exact, exact_terms = Coverage().evaluate(end, room_context)
    assert score == pytest.approx(exact, abs=1e-4)
    assert terms == pytest.approx(exact_terms, abs=5e-3)
    # Too fine for a raster: measured exactly after all.
    fine = FAST.changed(radius_mm=0.5)
    assert fine.evaluate(end, room_context) == fine.changed(area="exact").evaluate(
        end, room_context
    )


def test_scores_for_reports_are_exact() -> None:
    site = PreparedMap.of(grid_map(1))
    poses = (draw_poses(site.world, 1, 1),)
    fan = Level(branches=9, length_mm=90.0, fan_rad=2.0)
    tree = Design(name="t", trunk_length_mm=200.0, levels=(fan,), build=Build.standard(2))
    exact, fast = (
        score_design(tree, [site], poses, task, GrowthOptions.published())
        for task in (Coverage(), FAST)
    )
    assert exact.scores[0] != fast.scores[0]
    assert exact.scores[0] == pytest.approx(fast.scores[0], abs=2e-3)


# --- Walls by cells --------------------------------------------------------------------------


def listed(index: WallCells, place: np.ndarray) -> set[int]:
    """The walls of a place's cell, counted out by hand."""
    low, side, (columns, rows) = index.grid[:2], index.grid[2], index.grid[3:]
    column, row = np.clip(np.floor((place - low) / side), 0, (columns - 1, rows - 1))
    cell = int(row * columns + column)
    return set(index.item[index.first[cell] : index.first[cell + 1]].tolist())


@pytest.mark.parametrize(("side", "reach"), [(7.0, 0.0), (30.0, 12.0), (5.0, 40.0), (500.0, 1.0)])
def test_no_wall_near_a_place_is_missing_and_few_far_ones_are_listed(
    side: float, reach: float
) -> None:
    rng = np.random.default_rng(6)
    walls = rng.uniform(0.0, 200.0, (60, 4))
    walls[:10, 3], walls[10:20, 2] = walls[:10, 1], walls[10:20, 0]
    index = WallCells.of(walls, side, reach)
    lines = shapely.linestrings(walls.reshape(-1, 2, 2))
    places = rng.uniform(0.0, 200.0, (200, 2))
    numbers = index.numbers_at(places)
    for place, number in zip(places, numbers.tolist(), strict=True):
        away = shapely.distance(lines, shapely.Point(place))
        here = listed(index, place)
        assert len(here) == number
        assert set(np.flatnonzero(away <= reach).tolist()) <= here
        # A cell is so wide across, and its rows and columns are tested one after the other.
        assert away[list(here)].max(initial=0.0) < 2.0 * (side + reach) + reach


def test_places_outside_count_to_the_nearest_cell() -> None:
    index = WallCells.of(np.array([[0.0, 0.0, 10.0, 0.0], [90.0, 100.0, 100.0, 100.0]]), 10.0, 1.0)
    numbers = index.numbers_at(np.array([[-5.0, -5.0], [105.0, 101.0], [50.0, 50.0]]))
    assert numbers.tolist() == [1, 1, 0]


def test_an_index_that_would_be_too_large_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    walls = np.array([[0.0, 0.0, 100.0, 100.0], [0.0, 100.0, 40.0, 60.0]])
    assert WallCells.of(walls, 0.01, 0.0) is None
    monkeypatch.setattr(areas, "MOST_ENTRIES", 5)
    assert WallCells.of(walls, 10.0, 0.0) is None
    # A map context takes larger cells then, at last one with everything.
    context = MapContext.of(grid_map(1))
    assert len(context.cells.item) == len(context.edges_mm)


def test_the_cells_of_a_map_hold_every_edge_and_not_all_of_them_everywhere() -> None:
    context = MapContext.of(grid_map(1))
    assert context.cells is context.cells
    assert set(context.cells.item.tolist()) == set(range(len(context.edges_mm)))
    assert np.diff(context.cells.first).max() < 0.1 * len(context.edges_mm)


# --- Lines of sight --------------------------------------------------------------------------

FAST_SIGHT = Coverage(clip="sight", area="fast")

TOUCHING = Map(
    name="touching",
    bounds=shapely.box(0, 0, 200, 200),
    obstacles=(shapely.box(40, 40, 100, 100), shapely.box(100, 100, 160, 160)),
)


def sight_covered(lines: SightLines, sensors: np.ndarray) -> tuple[float, float]:
    seen, summed = lines.covered_mm2(sensors, np.array([0, len(sensors)]))
    return float(seen[0]), float(summed[0])


def hold_the_bound(context: MapContext, lines: SightLines, sensors: np.ndarray) -> None:
    """Union and sum are off by less than half a strip times the exact outlines."""
    radius = lines.radius_mm
    half_strip = 0.5 * radius / LINES_PER_RADIUS
    # The exact outlines' arcs are chords: within 2e-3 of the arcs.
    rounding = 1e-6 * math.pi * radius**2
    _, union = seen_areas(sensors, radius, context.edges_mm)
    alone = [seen_areas(sensor[None], radius, context.edges_mm) for sensor in sensors]
    outline = 1.002 * sum(region.length for _, region in alone)
    seen, summed = sight_covered(lines, sensors)
    assert seen <= summed * (1.0 + 1e-12)
    assert abs(seen - union.area) <= half_strip * 1.002 * union.length + len(sensors) * rounding
    assert abs(summed - sum(float(area[0]) for area, _ in alone)) <= half_strip * outline + rounding


def nasty_sensors(context: MapContext) -> np.ndarray:
    """Inside, twice in one place, on, behind and beside walls, on corners, outside by rounding."""
    rng = np.random.default_rng(5)
    x_min, y_min, x_max, y_max = context.free.bounds
    inside = rng.uniform((x_min, y_min), (x_max, y_max), (60, 2))
    inside = inside[shapely.contains_xy(context.free, inside[:, 0], inside[:, 1])][:8]
    edges = context.edges_mm[rng.choice(len(context.edges_mm), 6)]
    on_walls = edges[:, 0] + rng.random((6, 1)) * (edges[:, 1] - edges[:, 0])
    along = (edges[:, 1] - edges[:, 0]) / np.hypot(*(edges[:, 1] - edges[:, 0]).T)[:, None]
    edge_on = edges[:, 1] + rng.choice([1e-7, 1e-3, 5.0], (6, 1)) * along
    beside = on_walls + rng.choice([1e-13, 1e-9, 1e-7, 1e-6, 1e-5], (6, 1)) * along[:, ::-1]
    rounded_out = np.array([[x_min - 1e-10, 0.5 * (y_min + y_max)], [x_min, y_min - 1e-10]])
    places = np.concatenate(
        [inside, inside[:2], on_walls, edges[:, 0], edge_on, beside, rounded_out]
    )
    return places[shapely.distance(shapely.points(places), context.free) < 1e-9]


@pytest.mark.parametrize("radius", [4.0, 45.0, 1500.0])
def test_the_bound_holds_for_any_sensors_on_any_map(pillar_room: Map, radius: float) -> None:
    for world in (pillar_room, TOUCHING, cave_map(1), grid_map(3)):
        context = MapContext.of(world)
        sensors = nasty_sensors(context)
        lines = context.sight_lines(radius)
        assert lines is not None
        hold_the_bound(context, lines, sensors)
        for sensor in sensors[::3]:
            hold_the_bound(context, lines, sensor[None])


def test_walls_and_sensors_may_lie_on_the_lines(
    pillar_room: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lines along x at whole multiples of 2 mm, where a wall and sensors lie too."""
    monkeypatch.setattr(areas, "_direction", lambda *_: (1.0, 0.0))
    context = MapContext.of(pillar_room)
    lines = SightLines.of(context.edges_mm, 80.0)
    lines = replace(lines, line=np.array([-1.0, 2.0]))
    for x, y in ((200.0, 60.0), (100.0, 100.0), (120.0, 200.0), (200.0, 100.0), (150.0, 100.0)):
        hold_the_bound(context, lines, np.array([[x, y]]))
    # A wall on a line leaves its strip to one side or the other, none of them to both.
    before, _ = sight_covered(lines, np.array([[200.0, 60.0]]))
    behind, _ = sight_covered(
        replace(lines, line=np.array([-1.0 - 1e-9, 2.0])), np.array([[200.0, 60.0]])
    )
    assert abs(before - behind) < 2.0 * 110.0


def test_sensors_that_no_wall_is_near_see_their_discs(room_context: MapContext) -> None:
    lines = room_context.sight_lines(50.0)
    rng = np.random.default_rng(1)
    for centre in rng.uniform(60.0, 940.0, (20, 2)):
        seen, summed = sight_covered(lines, centre[None])
        assert seen == summed == pytest.approx(math.pi * 50.0**2, rel=2e-3)
    assert sight_covered(lines, np.array([[500.0, 500.0]] * 7))[1] == pytest.approx(
        7.0 * sight_covered(lines, np.array([[500.0, 500.0]]))[0]
    )


def test_a_sensor_that_sees_further_than_the_room_sees_all_of_it(room_context: MapContext) -> None:
    lines = room_context.sight_lines(1500.0)
    for place in ((500.0, 500.0), (0.0, 0.0), (1000.0, 300.0), (3.0, 999.0)):
        seen, _ = sight_covered(lines, np.array([place]))
        assert seen == pytest.approx(1e6, rel=2e-3)


@pytest.mark.parametrize("world", [grid_map(1), cave_map(1)], ids=["grid", "cave"])
@pytest.mark.parametrize("radius", [1e3, 1e4, 1e6])
def test_what_walls_hide_is_as_fine_as_the_map_however_far_sensors_see(
    world: Map, radius: float
) -> None:
    context = MapContext.of(world)
    inside = np.random.default_rng(3).uniform(*np.reshape(context.free.bounds, (2, 2)), (60, 2))
    sensors = inside[shapely.contains_xy(context.free, inside[:, 0], inside[:, 1])][:6]
    lines = context.sight_lines(radius)
    for count in (1, 6):
        _, union = seen_areas(sensors[:count], radius, context.edges_mm)
        seen, _ = sight_covered(lines, sensors[:count])
        assert seen == pytest.approx(union.area, rel=0.01)


def test_nothing_is_seen_behind_a_wall_that_fills_the_disc() -> None:
    wall = shapely.box(100, 0, 101, 200)
    context = MapContext.of(Map(name="wall", bounds=shapely.box(0, 0, 200, 200), obstacles=(wall,)))
    lines = context.sight_lines(40.0)
    half, _ = sight_covered(lines, np.array([[100.0, 100.0]]))
    assert half == pytest.approx(0.5 * math.pi * 40.0**2, rel=5e-3)
    both, summed = sight_covered(lines, np.array([[100.0, 100.0], [101.0, 100.0]]))
    assert both == summed == pytest.approx(2.0 * half, rel=5e-3)


def test_where_two_obstacles_touch_one_side_is_seen_and_nothing_solid() -> None:
    context = MapContext.of(TOUCHING)
    place = np.array([[100.0, 100.0]])
    quarter = 0.25 * math.pi * 30.0**2
    assert seen_areas(place, 30.0, context.edges_mm)[0][0] == pytest.approx(quarter, rel=1e-5)
    assert sight_covered(context.sight_lines(30.0), place)[0] == pytest.approx(quarter, rel=5e-3)


def test_lines_keep_away_from_the_directions_of_walls() -> None:
    square = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
    for turn in (0.0, 0.3, 1.0):
        c, s = math.cos(turn), math.sin(turn)
        ring = square @ np.array([[c, s], [-s, c]])
        edges = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        lines = SightLines.of(edges, 20.0)
        angle = math.atan2(*lines.direction[::-1]) - turn
        assert abs(math.sin(2.0 * angle)) > 0.9


def test_lines_that_would_be_too_many_are_not_made(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    assert room_context.sight_lines(50.0) is room_context.sight_lines(50.0)
    assert room_context.sight_lines(0.01) is None
    end = ended(fork, [[(0, 0), (200, 200)], [(200, 200), (230, 200)], None])
    fine = FAST_SIGHT.changed(radius_mm=0.01)
    assert fine.evaluate(end, room_context) == fine.changed(area="exact").evaluate(
        end, room_context
    )
