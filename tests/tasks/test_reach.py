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
from vinefab.tasks import map_context
from vinefab.tasks.areas import STRIPS_PER_RADIUS, Chains
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.reach import NEAR_MM, NEAR_SHARE, QUARTER_SEGMENTS, Reach, near_chains


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
            chains = Chains(
                points, ends, np.array([0, 1]), ends, np.zeros(len(points), dtype=np.bool_)
            )
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


def test_hundreds_of_crossing_branches_take_no_minutes() -> None:
    """Lines taken one by one give the area of all together; as one shape this took minutes."""
    rng = np.random.default_rng(3)
    few = rng.uniform(0.0, 500.0, (12, 3, 2)).tolist()
    together = shapely.buffer(shapely.MultiLineString(few), 30.0, quad_segs=QUARTER_SEGMENTS)
    assert near_chains(few, 30.0).symmetric_difference(together).area < 1e-6 * together.area
    many = rng.uniform(0.0, 500.0, (400, 3, 2)).tolist()
    assert near_chains(many, 30.0).area > 500.0**2


def test_a_target_is_reached_within_the_tolerance_of_body_or_tips(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    end = ended(fork, [[(100, 100), (500, 100)], [(500, 100), (500, 100), (500, 400)], None])
    targets = [[300, 119], [300, 121], [500, 430], [520, 400], [80, 100]]
    score, terms = Reach(targets=targets, falloff_mm=0.0).evaluate(end, room_context)
    assert score == 3 / 5  # the first, the fourth and the last, at the base
    assert terms == {"targets": 5.0, "targets_reached": 3.0, "farthest_mm": 30.0, "grown_mm": 700.0}
    parts = Reach(targets=targets, falloff_mm=0.0).parts(score, terms)
    assert parts == {"targets touched": score, "nearness to the others": 0.0}
    by_tip, _ = Reach(targets=targets, falloff_mm=0.0, reached_by="tip").evaluate(end, room_context)
    assert by_tip == 1 / 5
    wide, _ = Reach(
        targets=[{"point_mm": point, "tolerance_mm": 30.0} for point in targets]
    ).evaluate(end, room_context)
    assert wide == 1.0
    partly, terms = Reach(targets=targets, falloff_mm=20.0).evaluate(end, room_context)
    assert partly == pytest.approx((1 + 19 / 20 + 10 / 20 + 1 + 1) / 5)
    assert terms["targets_reached"] == 3.0


def test_targets_reward_nearness_unless_it_counts_nothing(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    end = ended(fork, [[(100, 100), (500, 100)], [(500, 100), (500, 100), (500, 400)], None])
    points = [[300, 110], [300, 160], [200, 400]]  # touched, 40 mm beyond the tolerance, far
    score, terms = Reach(targets=points).evaluate(end, room_context)
    assert score == pytest.approx((1.0 + NEAR_SHARE * (1.0 - 40.0 / NEAR_MM)) / 3)
    parts = Reach(targets=points).parts(score, terms)
    assert parts["targets touched"] == pytest.approx(1 / 3)
    assert sum(parts.values()) == pytest.approx(score)
    assert Reach(targets=points, falloff_mm=0.0).evaluate(end, room_context)[0] == 1 / 3
    # Three near misses are worth less than two targets that are touched.
    near = Reach(targets=[[300, 121], [400, 121], [200, 121]]).evaluate(end, room_context)[0]
    assert near < 2 / 3


def test_targets_of_the_map_count_unless_the_task_has_its_own(
    fork: Design, ended: Callable[..., Deployment], room: Map
) -> None:
    end = ended(fork, [[(100, 100), (500, 100)], [(500, 100), (500, 400)], None])
    context = MapContext.of(room.with_targets((300, 110), (300, 400), (60, 100)))
    assert Reach().evaluate(end, context)[1]["targets_reached"] == 1.0
    assert Reach(targets=[[300, 110]]).evaluate(end, context)[1]["targets"] == 1.0
    assert "reached_mm2" in Reach().evaluate(end, context.without_targets)[1]


def test_an_area_is_touched_where_a_body_enters_it(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    end = ended(fork, [[(100, 100), (500, 100)], [(500, 100), (500, 400)], None])
    left, beside = ([[x, 90], [x + 20, 90], [x + 20, 110], [x, 110]] for x in (200, 530))
    task = Reach(targets=[{"area_mm": left}, {"area_mm": beside}])
    assert task.evaluate(end, room_context)[1]["targets_reached"] == 1.0
    assert task.evaluate(end, room_context)[1]["farthest_mm"] == pytest.approx(30.0)


def test_a_robot_that_stayed_inside_reaches_no_target(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    for by in ("body", "tip"):
        task = Reach(targets=((5.0, 5.0),), falloff_mm=0.0, reached_by=by)
        score, terms = task.evaluate(ended(fork, [None, None, None]), room_context)
        assert score == 0.0
        assert terms["farthest_mm"] == pytest.approx(room_context.diagonal_mm)


@pytest.mark.parametrize(
    ("parameters", "key", "words"),
    [
        ({"targets": [[1, 2, 3]]}, "targets[1].point_mm", "at most 2"),
        ({"targets": [[True, 2]]}, "targets[1].point_mm[1]", "a valid number"),
        ({"targets": [[1, 2], [3, "a"]]}, "targets[2].point_mm[2]", "a valid number"),
        ({"targets": [[1, float("nan")]]}, "targets[1].point_mm[2]", "a finite number"),
        ({"targets": [[1, 2]] * 1001}, "targets", "at most 1000"),
        ({"targets": 3}, "targets", "at most 1000"),
        ({"targets": [[1, 2], [3]]}, "targets[2].point_mm[2]", "is missing; give it"),
        (
            {"targets": [{"name": "B", "point_mm": [1, 2]}] * 2},
            "targets[1].name",
            "another target is called",
        ),
        (
            {"targets": [{"area_mm": [[0, 0], [1, 1]]}]},
            "targets[1].area_mm",
            "enclose no area; give 3",
        ),
        ({"targets": [{"point_mm": [0, 0], "radius": 3}]}, "targets[1].radius", "no such key"),
        ({"falloff_mm": -1.0}, "falloff_mm", "greater than or equal to 0"),
        ({"reached_by": "base"}, "reached_by", "'body' or 'tip'"),
    ],
)
def test_targets_that_are_none_are_refused(
    parameters: dict[str, object], key: str, words: str
) -> None:
    with pytest.raises(BadInputError, match=words) as caught:
        Reach(**parameters)
    assert caught.value.key == key


def test_a_target_must_be_free_on_every_map(pillar_room: Map, room: Map) -> None:
    task = Reach(targets=[[50, 50], [200, 150], [500, 50]])
    task.check_map(room, MapContext.of(room))
    with pytest.raises(BadInputError, match="inside an obstacle of map 'pillars'") as caught:
        task.check_map(pillar_room, MapContext.of(pillar_room))
    assert caught.value.key == "task.targets[2]"
    with pytest.raises(BadInputError, match="outside the bounds of map 'pillars'"):
        Reach(targets=[[500, 50]]).check_map(pillar_room, MapContext.of(pillar_room))


def test_areas_measured_by_tiles_are_those_measured_at_once(monkeypatch):
    context = MapContext.of(grid_map(seed=3, options=GridOptions()))
    shapes = [shapely.Point(x, 250.0).buffer(90.0) for x in (60.0, 250.0, 470.0, 900.0)]
    at_once = [context.free_area_mm2(shape) for shape in shapes]
    monkeypatch.setattr(map_context, "MOST_EDGES_AT_ONCE", 10)
    monkeypatch.setattr(map_context, "EDGES_PER_TILE", 20)
    assert [context.free_area_mm2(shape) for shape in shapes] == pytest.approx(at_once, abs=1e-6)
    tiles = map_context._tiles(context.free)
    assert len(tiles) > 10
    assert max(shapely.get_num_coordinates(tiles)) <= 20
    assert sum(tile.area for tile in tiles) == pytest.approx(context.area_mm2, rel=1e-12)
