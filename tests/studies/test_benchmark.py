"""The benchmark: its reference is right, and its numbers are what they are said to be."""

import json
import math

import numpy as np
import pytest

from tests.oracles.shapely_reference import ReferenceWorld, grow_tree, tips_mm
from vinefab.core.progress import heard_by
from vinefab.core.view import lines
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.maps.poses import draw_poses
from vinefab.studies import benchmark as bench_module
from vinefab.studies.benchmark import (
    BENCH_GROWTH,
    batch_on,
    bench_blocks,
    events,
    floor_on,
    free_poses,
    run_benchmark,
    square_map,
    tree_of_40,
)

pytestmark = pytest.mark.thorough

WORLD = square_map(300)
GROUND = Terrain.of(WORLD)


@pytest.mark.parametrize("children", ["stop", "deploy"])
@pytest.mark.parametrize("half_angle_deg", [1.0, 15.0])
def test_the_reference_ends_where_the_kernel_does(children, half_angle_deg):
    options = GrowthOptions.published(
        children_of_stuck=children, head_on_half_angle_rad=math.radians(half_angle_deg)
    )
    course, design = ReferenceWorld(GROUND.free_space()), tree_of_40()
    for pose in (*draw_poses(WORLD, 6, 1), *free_poses(GROUND, 12)):
        branches = grow_tree(course, design.tree, pose, options)
        grown = grow_on(design, GROUND, pose, options)
        assert [branch.stop for branch in branches] == grown.stop.tolist()
        np.testing.assert_allclose(tips_mm(branches), grown.tips_mm, atol=1e-9)


def test_the_case_is_a_tree_of_40_on_about_300_walls_at_any_size():
    assert len(tree_of_40().tree) == 40
    assert 250 <= WORLD.wall_count <= 350
    larger = square_map(3000)
    densities = [world.wall_count / world.bounds.area for world in (WORLD, larger)]
    assert densities[1] == pytest.approx(densities[0], rel=0.05)


def test_the_floor_counts_the_tests_of_real_growths():
    poses = draw_poses(WORLD, 2, 1)
    floor = floor_on(GROUND, poses)
    assert 1.0 < floor.wall_tests < 10.0
    assert 0.2 < floor.corner_tests < 10.0
    assert floor.ns_per_event == pytest.approx(
        floor.wall_tests * floor.wall_ns + floor.corner_tests * floor.corner_ns
    )
    assert events(batch_on(GROUND, poses)) > 100


@pytest.fixture
def quick(monkeypatch):
    for name, value in {
        "SIZES": (300, 3000),
        "GROWTHS": 10,
        "FLOOR_GROWTHS": 1,
        "MEMORY_AFTER": (10, 20),
        "BENCH_GENERATIONS": 2,
        "FIRST_GROWTHS": {"interpreted": ""},
    }.items():
        monkeypatch.setattr(bench_module, name, value)


@pytest.mark.usefixtures("quick")
def test_the_result_has_the_agreed_form_and_words():
    seen = []
    with heard_by(lambda progress: seen.append(progress.phase)):
        result = run_benchmark()
    read = json.loads(result.text())
    assert read["schema"] == "vinefab/bench-2"
    assert read["branches_per_s"] > 10.0 * read["interpreted_branches_per_s"]
    assert read["edges"] == [size.walls for size in result.sizes]
    assert read["edges"][1] > 5 * read["edges"][0]
    assert len(read["ns_per_event"]) == 2
    assert read["evaluations_per_s"] < read["branches_per_s"] / 40.0
    assert read["search"]["trees_per_s"] > 100.0
    assert 0.0 < read["search"]["scoring_us"] < 1e6 / read["search"]["trees_per_s"]
    assert 0.0 < read["penalty"]["at_once_us"] < read["penalty"]["alone_us"]
    assert 0.0 < read["first_grow_s"]["interpreted"] < 60.0
    assert seen[0] == "memory"
    assert len(set(seen)) > 3
    words = "\n".join(lines(bench_blocks(result)))
    slower = result.branches_per_s / result.interpreted_branches_per_s
    assert f"{slower:,.0f} times slower" in words
    assert "floor" in words
    assert read["searches"]["manufacturable"]["workers"] == 2
    shares = read["searches"]["particleswarm"]["shares"]
    assert 0.0 < shares["evaluating"] < 1.0
    assert words.count("use of 2 workers while evaluating") == 3


def test_memory_does_not_grow_with_the_number_of_evaluations():
    import gc  # noqa: PLC0415  only here
    import tracemalloc  # noqa: PLC0415

    batch = batch_on(GROUND, draw_poses(WORLD, 200, 1))
    events(batch)
    tracemalloc.start()
    try:
        sizes = []
        for _ in range(6):
            for _ in range(5):
                events(batch)
            gc.collect()  # garbage of earlier tests is not of these evaluations
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    # The interpreter's own lists of free objects fill up first.
    assert sizes[-1] - sizes[-2] < 10_000
    assert BENCH_GROWTH.deploys_stuck
