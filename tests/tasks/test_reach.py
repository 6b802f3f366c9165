import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.cave import cave_map
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.fast_areas import STRIPS_PER_RADIUS, Chains
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.reach import QUARTER_SEGMENTS, Reach, near_chains
from vinefab.tasks.task import one_by_one


def test_a_straight_body_reaches_a_stadium(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    end = ended(fork, [[(300, 500), (700, 500)], None, None])
    share, terms = Reach(buffer_mm=40.0).evaluate(end, room_context)
    stadium = 400.0 * 80.0 + math.pi * 40.0**2
    assert share * 1e6 == pytest.approx(stadium, rel=2e-3)
    assert terms["grown_mm"] == 400.0


def test_solid_places_are_not_reached(
    fork: Design, ended: Callable[..., Deployment], pillar_room: Map
) -> None:
    context = MapContext.of(pillar_room)
    end = ended(fork, [[(0, 50), (400, 50)], None, None])
    # A band from y = 0 to 110 over the whole width, less the pillar's lower 10 mm.
    share, terms = Reach(buffer_mm=60.0).evaluate(end, context)
    assert terms["reached_mm2"] == pytest.approx(400 * 110 - 100 * 10)
    assert share == pytest.approx(terms["reached_mm2"] / (400 * 300 - 100**2 - 5000))


def test_a_buffer_without_width_is_refused() -> None:
    with pytest.raises(BadInputError, match="buffer_mm"):
        Reach(buffer_mm=0.0)


def test_cells_stay_within_the_band_that_is_proven(pillar_room: Map) -> None:
    """Fast lies between the exact areas for buffers half a cell's diagonal smaller and larger."""
    context = MapContext.of(pillar_room)
    rng = np.random.default_rng(6)
    for buffer_mm in (5.0, 40.0, 90.0):
        half = buffer_mm / STRIPS_PER_RADIUS / math.sqrt(2.0)
        raster = context.raster(buffer_mm)
        for count in (1, 4, 12):
            points = rng.uniform((0, 0), (400, 300), (count + 1, 2))
            ends = np.array([0, count + 1])
            chains = Chains(points, ends, np.array([0, 1]), ends)
            (fast,) = raster.reached_mm2(chains).tolist()
            line = shapely.LineString(points)
            least, most = (
                shapely.intersection(line.buffer(buffer_mm + d, quad_segs=64), context.free).area
                for d in (-half, half)
            )
            assert least - 1e-6 * most < fast < most * (1.0 + 1e-3)
            exact = shapely.intersection(line.buffer(buffer_mm, quad_segs=64), context.free).area
            assert fast == pytest.approx(exact, rel=1e-2)


def test_the_bound_holds_for_robots_with_branches() -> None:
    fan = Level(branches=3, length_mm=90.0, fan_rad=2.0, growth=0.7)
    tree = Design(name="t", trunk_length_mm=150.0, levels=(fan, fan), build=Build.standard(3))
    options = GrowthOptions.published(children_of_stuck="deploy")
    for world in (grid_map(2), cave_map(1)):
        site = PreparedMap.of(world)
        launches = Launches.of(TerrainSet([site.terrain]), [draw_poses(world, 3, 5)])
        for end in Batch(Plans.of([tree], options), launches, options).deployments():
            chains = [end.chain_mm(k).tolist() for k in np.flatnonzero(end.deployed)]
            for buffer_mm in (8.0, 40.0):
                task = Reach(buffer_mm=buffer_mm, area="fast")
                fast = task.evaluate(end, site.context)[1]["reached_mm2"]
                half = buffer_mm / STRIPS_PER_RADIUS / math.sqrt(2.0)
                least, most = (
                    shapely.intersection(near_chains(chains, buffer_mm + d), site.context.free).area
                    for d in (-half, half)
                )
                # The exact shape's round ends are polygons of 0.04 % less area.
                assert 0.9995 * least < fast < 1.0005 * most


def test_a_body_that_reaches_everything_reaches_the_free_area(
    fork: Design, ended: Callable[..., Deployment], pillar_room: Map
) -> None:
    context = MapContext.of(pillar_room)
    end = ended(fork, [[(0, 50), (400, 50)], None, None])
    share, terms = Reach(buffer_mm=1000.0, area="fast").evaluate(end, context)
    assert share == pytest.approx(1.0)
    assert terms["grown_mm"] == 400.0


@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_blocks_score_as_single_deployments_do(body: str, same: Callable[..., bool]) -> None:
    fan = Level(branches=3, length_mm=80.0, fan_rad=1.5)
    designs = [
        Design(name="a", trunk_length_mm=120.0, levels=(fan, fan), build=Build.standard(3)),
        Design(name="c", trunk_length_mm=90.0, build=Build.standard(1)),
    ]
    options = GrowthOptions.published(body=body)
    sites = [PreparedMap.of(grid_map(seed, GridOptions(columns=4, rows=4))) for seed in (1, 2)]
    poses = [draw_poses(site.world, 3, 5, clearance_mm=14.0) for site in sites]
    launches = Launches.of(TerrainSet([site.terrain for site in sites]), poses)
    batch = Batch(Plans.of(designs, options), launches, options)
    contexts = [site.context for site in sites]
    for task in (Reach(area="fast"), Reach(area="fast", buffer_mm=0.1), Reach()):
        for size in (1, 5, 100):
            pairs = batch.each(
                lambda b, t=task: (t.evaluate_block(b, contexts), one_by_one(t, b, contexts)),
                size=size,
            )
            for together, alone in pairs:
                assert same(together, alone)


def test_an_unknown_way_to_measure_is_refused() -> None:
    with pytest.raises(BadInputError, match="area"):
        Reach(area="quick")


def test_hundreds_of_crossing_branches_take_no_minutes() -> None:
    """Lines taken one by one give the area of all together; as one shape this took minutes."""
    rng = np.random.default_rng(3)
    few = rng.uniform(0.0, 500.0, (12, 3, 2)).tolist()
    together = shapely.buffer(shapely.MultiLineString(few), 30.0, quad_segs=QUARTER_SEGMENTS)
    assert near_chains(few, 30.0).symmetric_difference(together).area < 1e-6 * together.area
    many = rng.uniform(0.0, 500.0, (400, 3, 2)).tolist()
    assert near_chains(many, 30.0).area > 500.0**2
