"""The fast measure of what sensors see past walls, held against exact polygons."""

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
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map
from vinefab.tasks import line_of_sight as sight_lines
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.line_of_sight import LINES_PER_RADIUS, SightLines, seen_areas
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import one_by_one

FAST = Coverage(clip="sight", area="fast")

TOUCHING = Map(
    name="touching",
    bounds=shapely.box(0, 0, 200, 200),
    obstacles=(shapely.box(40, 40, 100, 100), shapely.box(100, 100, 160, 160)),
)


def covered(lines: SightLines, sensors: np.ndarray) -> tuple[float, float]:
    seen, summed = lines.covered_mm2(sensors, np.array([0, len(sensors)]))
    return float(seen[0]), float(summed[0])


def hold_the_bound(ground: MapContext, lines: SightLines, sensors: np.ndarray) -> None:
    """Union and sum are off by less than half a strip times the exact outlines."""
    radius = lines.radius_mm
    half_strip = 0.5 * radius / LINES_PER_RADIUS
    # The exact outlines' arcs are chords: within 2e-3 of the arcs.
    rounding = 1e-6 * math.pi * radius**2
    _, union = seen_areas(sensors, radius, ground.edges_mm)
    alone = [seen_areas(sensor[None], radius, ground.edges_mm) for sensor in sensors]
    outline = 1.002 * sum(region.length for _, region in alone)
    seen, summed = covered(lines, sensors)
    assert seen <= summed * (1.0 + 1e-12)
    assert abs(seen - union.area) <= half_strip * 1.002 * union.length + len(sensors) * rounding
    assert abs(summed - sum(float(area[0]) for area, _ in alone)) <= half_strip * outline + rounding


def nasty_sensors(ground: MapContext) -> np.ndarray:
    """Inside, twice in one place, on, behind and beside walls, on corners, outside by rounding."""
    rng = np.random.default_rng(5)
    x_min, y_min, x_max, y_max = ground.free.bounds
    inside = rng.uniform((x_min, y_min), (x_max, y_max), (60, 2))
    inside = inside[shapely.contains_xy(ground.free, inside[:, 0], inside[:, 1])][:8]
    edges = ground.edges_mm[rng.choice(len(ground.edges_mm), 6)]
    on_walls = edges[:, 0] + rng.random((6, 1)) * (edges[:, 1] - edges[:, 0])
    along = (edges[:, 1] - edges[:, 0]) / np.hypot(*(edges[:, 1] - edges[:, 0]).T)[:, None]
    edge_on = edges[:, 1] + rng.choice([1e-7, 1e-3, 5.0], (6, 1)) * along
    beside = on_walls + rng.choice([1e-13, 1e-9, 1e-7, 1e-6, 1e-5], (6, 1)) * along[:, ::-1]
    rounded_out = np.array([[x_min - 1e-10, 0.5 * (y_min + y_max)], [x_min, y_min - 1e-10]])
    places = np.concatenate(
        [inside, inside[:2], on_walls, edges[:, 0], edge_on, beside, rounded_out]
    )
    return places[shapely.distance(shapely.points(places), ground.free) < 1e-9]


@pytest.mark.parametrize("radius", [4.0, 45.0, 1500.0])
def test_the_bound_holds_for_any_sensors_on_any_map(pillar_room: Map, radius: float) -> None:
    for world in (pillar_room, TOUCHING, cave_map(1), grid_map(3)):
        ground = MapContext.of(world)
        sensors = nasty_sensors(ground)
        lines = ground.sight_lines(radius)
        assert lines is not None
        hold_the_bound(ground, lines, sensors)
        for sensor in sensors:
            hold_the_bound(ground, lines, sensor[None])


def test_walls_and_sensors_may_lie_on_the_lines(
    pillar_room: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lines along x at whole multiples of 2 mm, where a wall and sensors lie too."""
    monkeypatch.setattr(sight_lines, "_direction", lambda *_: (1.0, 0.0))
    ground = MapContext.of(pillar_room)
    lines = SightLines.of(ground.edges_mm, 80.0)
    lines = replace(lines, line=np.array([-1.0, 2.0]))
    for x, y in ((200.0, 60.0), (100.0, 100.0), (120.0, 200.0), (200.0, 100.0), (150.0, 100.0)):
        hold_the_bound(ground, lines, np.array([[x, y]]))
    # A wall on a line leaves its strip to one side or the other, none of them to both.
    before, _ = covered(lines, np.array([[200.0, 60.0]]))
    behind, _ = covered(
        replace(lines, line=np.array([-1.0 - 1e-9, 2.0])), np.array([[200.0, 60.0]])
    )
    assert abs(before - behind) < 2.0 * 110.0


def test_sensors_that_no_wall_is_near_see_their_discs(room_ground: MapContext) -> None:
    lines = room_ground.sight_lines(50.0)
    rng = np.random.default_rng(1)
    for centre in rng.uniform(60.0, 940.0, (20, 2)):
        seen, summed = covered(lines, centre[None])
        assert seen == summed == pytest.approx(math.pi * 50.0**2, rel=2e-3)
    assert covered(lines, np.array([[500.0, 500.0]] * 7))[1] == pytest.approx(
        7.0 * covered(lines, np.array([[500.0, 500.0]]))[0]
    )


def test_a_sensor_that_sees_further_than_the_room_sees_all_of_it(room_ground: MapContext) -> None:
    lines = room_ground.sight_lines(1500.0)
    for place in ((500.0, 500.0), (0.0, 0.0), (1000.0, 300.0), (3.0, 999.0)):
        seen, _ = covered(lines, np.array([place]))
        assert seen == pytest.approx(1e6, rel=2e-3)


@pytest.mark.parametrize("world", [grid_map(1), cave_map(1)], ids=["grid", "cave"])
@pytest.mark.parametrize("radius", [1e3, 1e4, 1e6])
def test_what_walls_hide_is_as_fine_as_the_map_however_far_sensors_see(
    world: Map, radius: float
) -> None:
    ground = MapContext.of(world)
    inside = np.random.default_rng(3).uniform(*np.reshape(ground.free.bounds, (2, 2)), (60, 2))
    sensors = inside[shapely.contains_xy(ground.free, inside[:, 0], inside[:, 1])][:6]
    lines = ground.sight_lines(radius)
    for count in (1, 6):
        _, union = seen_areas(sensors[:count], radius, ground.edges_mm)
        seen, _ = covered(lines, sensors[:count])
        assert seen == pytest.approx(union.area, rel=0.01)


def test_nothing_is_seen_behind_a_wall_that_fills_the_disc() -> None:
    wall = shapely.box(100, 0, 101, 200)
    ground = MapContext.of(Map(name="wall", bounds=shapely.box(0, 0, 200, 200), obstacles=(wall,)))
    lines = ground.sight_lines(40.0)
    half, _ = covered(lines, np.array([[100.0, 100.0]]))
    assert half == pytest.approx(0.5 * math.pi * 40.0**2, rel=5e-3)
    both, summed = covered(lines, np.array([[100.0, 100.0], [101.0, 100.0]]))
    assert both == summed == pytest.approx(2.0 * half, rel=5e-3)


def test_where_two_obstacles_touch_one_side_is_seen_and_nothing_solid() -> None:
    ground = MapContext.of(TOUCHING)
    place = np.array([[100.0, 100.0]])
    quarter = 0.25 * math.pi * 30.0**2
    assert seen_areas(place, 30.0, ground.edges_mm)[0][0] == pytest.approx(quarter, rel=1e-5)
    assert covered(ground.sight_lines(30.0), place)[0] == pytest.approx(quarter, rel=5e-3)


def test_sets_of_sensors_do_not_depend_on_each_other(pillar_room: Map) -> None:
    rng = np.random.default_rng(4)
    lines = MapContext.of(pillar_room).sight_lines(30.0)
    sets = [rng.uniform((0, 0), (150, 300), (count, 2)) for count in (4, 0, 1, 25)]
    first = np.cumsum([0, *map(len, sets)])
    before = np.concatenate(sets)
    tips = before.copy()
    seen, summed = lines.covered_mm2(tips, first)
    assert np.array_equal(tips, before)
    assert seen[1] == summed[1] == 0.0
    for index, own in enumerate(sets):
        alone = lines.covered_mm2(own, np.array([0, len(own)]))
        assert (seen[index], summed[index]) == (alone[0][0], alone[1][0])


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
    fork: Design, ended: Callable[..., Deployment], room_ground: MapContext
) -> None:
    assert room_ground.sight_lines(50.0) is room_ground.sight_lines(50.0)
    assert room_ground.sight_lines(0.01) is None
    end = ended(fork, [[(0, 0), (200, 200)], [(200, 200), (230, 200)], None])
    fine = replace(FAST, radius_mm=0.01)
    assert fine.evaluate(end, room_ground) == replace(fine, area="exact").evaluate(end, room_ground)


def test_blocks_score_as_single_deployments_do(same: Callable[..., bool]) -> None:
    fan = Level(branches=3, length_mm=80.0, fan_rad=1.5)
    designs = [
        Design(name="a", trunk_length_mm=120.0, levels=(fan, fan), build=Build.standard(3)),
        Design(name="b", trunk_length_mm=90.0, build=Build.standard(1)),
    ]
    options = GrowthOptions()
    sites = [PreparedMap.of(grid_map(seed, GridOptions(columns=4, rows=4))) for seed in (1, 2)]
    poses = [draw_poses(site.world, 3, 5) for site in sites]
    launches = Launches.of(TerrainSet([site.terrain for site in sites]), poses)
    batch = Batch(Plans.of(designs, options), launches, options)
    grounds = [site.ground for site in sites]
    for size in (1, 5, 100):
        pairs = batch.each(
            lambda b: (FAST.evaluate_block(b, grounds), one_by_one(FAST, b, grounds)), size=size
        )
        for together, alone in pairs:
            assert same(together, alone)
