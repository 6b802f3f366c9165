"""The fast area of discs in free space, held against exact polygons."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map
from vinefab.tasks.coverage import Coverage, free_disc_areas_mm2
from vinefab.tasks.evaluate import PreparedMap, score_design
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.raster_areas import Raster
from vinefab.tasks.task import one_by_one

FAST = Coverage(area="fast")


def exact_mm2(ground: MapContext, tips: np.ndarray, radius: float) -> float:
    step = math.pi / 512
    discs = shapely.buffer(
        shapely.points(tips), radius * math.sqrt(step / math.sin(step)), quad_segs=256
    )
    return shapely.intersection(shapely.union_all(discs), ground.free).area


def covered(ground: MapContext, tips: np.ndarray, radius: float) -> tuple[float, float]:
    raster = ground.raster(radius)
    assert raster is not None
    seen, summed = raster.covered_mm2(tips, np.array([0, len(tips)]))
    return float(seen[0]), float(summed[0])


def test_strips_hold_the_free_area(pillar_room: Map) -> None:
    for world in (pillar_room, grid_map(3)):
        ground = MapContext.of(world)
        for radius in (7.0, 50.0, 3000.0):
            raster = ground.raster(radius)
            assert raster.free_mm2[:, -1].sum() == pytest.approx(ground.area_mm2, rel=1e-12)
            assert (np.diff(raster.free_mm2, axis=1) > -1e-9).all()


def test_discs_in_the_open_are_exact_however_they_lie(room_ground: MapContext) -> None:
    rng = np.random.default_rng(1)
    for radius in (13.0, 50.0):
        for centre in rng.uniform(60.0, 940.0, (20, 2)):
            seen, summed = covered(room_ground, centre[None], radius)
            assert seen == summed == pytest.approx(math.pi * radius**2, rel=1e-9)


@pytest.mark.parametrize("radius", [20.0, 50.0, 100.0])
def test_trees_on_grid_maps_are_within_the_stated_error(radius: float) -> None:
    errors = []
    fan = Level(branches=5, length_mm=90.0, fan_rad=2.0, growth=0.8)
    tree = Design(name="t", trunk_length_mm=200.0, levels=(fan, fan), build=Build.standard(3))
    for seed in range(6):
        site = PreparedMap.of(grid_map(seed))
        options = GrowthOptions(children_of_stuck="deploy")
        launches = Launches.of(TerrainSet([site.terrain]), [draw_poses(site.world, 4, seed)])
        for grown in Batch(Plans.of([tree], options), launches, options).deployments():
            seen, summed = covered(site.ground, grown.tips_mm, radius)
            each = free_disc_areas_mm2(grown.tips_mm, radius, site.ground.edges_mm)
            assert summed == pytest.approx(each.sum(), rel=5e-3)
            errors.append(seen / exact_mm2(site.ground, grown.tips_mm, radius) - 1.0)
    assert np.abs(errors).max() < 3e-3
    assert np.sqrt(np.mean(np.square(errors))) < 2e-3


def test_the_worst_case_bound_holds_for_any_discs(pillar_room: Map) -> None:
    rng = np.random.default_rng(2)
    ground = MapContext.of(pillar_room)
    for radius in (3.0, 40.0, 150.0):
        for count in (1, 3, 60):
            tips = rng.uniform((-20, -20), (420, 320), (count, 2))
            if count == 3:
                # One on the other, and beside walls.
                tips = np.array([[150.0, 100.0], [150.0, 100.0], [150.0, 100.0 - radius]])
            seen, summed = covered(ground, tips, radius)
            assert seen <= summed * (1.0 + 1e-12)
            bound = 0.08 * count * math.pi * radius**2
            assert abs(seen - exact_mm2(ground, tips, radius)) < bound


def test_sets_of_discs_do_not_depend_on_each_other(pillar_room: Map) -> None:
    rng = np.random.default_rng(4)
    raster = MapContext.of(pillar_room).raster(30.0)
    sets = [rng.uniform((0, 0), (400, 300), (count, 2)) for count in (4, 0, 1, 25)]
    first = np.cumsum([0, *map(len, sets)])
    seen, summed = raster.covered_mm2(np.concatenate(sets), first)
    assert seen[1] == summed[1] == 0.0
    for index, tips in enumerate(sets):
        alone = raster.covered_mm2(tips, np.array([0, len(tips)]))
        assert (seen[index], summed[index]) == (alone[0][0], alone[1][0])


def test_a_raster_that_would_be_too_large_is_not_made(room_ground: MapContext) -> None:
    assert Raster.of(room_ground.edges_mm, 0.5) is None
    assert room_ground.raster(50.0) is room_ground.raster(50.0)


def test_fast_scores_are_those_of_blocks_and_near_the_exact_ones(
    fork: Design, ended: Callable[..., Deployment], room_ground: MapContext
) -> None:
    end = ended(fork, [[(0, 0), (200, 200)], [(200, 200), (230, 200)], None])
    score, terms = FAST.evaluate(end, room_ground)
    exact, exact_terms = Coverage().evaluate(end, room_ground)
    assert score == pytest.approx(exact, abs=1e-4)
    assert terms == pytest.approx(exact_terms, abs=5e-3)
    # Too fine for a raster: measured exactly after all.
    fine = replace(FAST, radius_mm=0.5)
    assert fine.evaluate(end, room_ground) == replace(fine, area="exact").evaluate(end, room_ground)


@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_blocks_score_as_single_deployments_do(body: str, same: Callable[..., bool]) -> None:
    fan = Level(branches=3, length_mm=80.0, fan_rad=1.5)
    plans = [
        Design(name="a", trunk_length_mm=120.0, levels=(fan, fan), build=Build.standard(3)),
        Design(name="b", trunk_length_mm=150.0, levels=(fan,), build=Build.standard(2)),
        Design(name="c", trunk_length_mm=90.0, build=Build.standard(1)),
    ]
    options = GrowthOptions(body=body)
    sites = [PreparedMap.of(grid_map(seed, GridOptions(columns=4, rows=4))) for seed in (1, 2)]
    poses = [draw_poses(site.world, 3, 5, clearance_mm=14.0) for site in sites]
    launches = Launches.of(TerrainSet([site.terrain for site in sites]), poses)
    batch = Batch(Plans.of(plans, options), launches, options)
    grounds = [site.ground for site in sites]
    for size in (1, 4, 7, 100):
        pairs = batch.each(
            lambda b: (FAST.evaluate_block(b, grounds), one_by_one(FAST, b, grounds)), size=size
        )
        for together, alone in pairs:
            assert same(together, alone)


def test_an_unknown_way_to_measure_is_refused() -> None:
    with pytest.raises(ValueError, match="area"):
        Coverage(area="quick")


def test_scores_for_reports_are_exact() -> None:
    site = PreparedMap.of(grid_map(1))
    poses = (draw_poses(site.world, 1, 1),)
    fan = Level(branches=9, length_mm=90.0, fan_rad=2.0)
    tree = Design(name="t", trunk_length_mm=200.0, levels=(fan,), build=Build.standard(2))
    exact, fast = (score_design(tree, [site], poses, task) for task in (Coverage(), FAST))
    assert exact.scores[0] != fast.scores[0]
    assert exact.scores[0] == pytest.approx(fast.scores[0], abs=2e-3)
