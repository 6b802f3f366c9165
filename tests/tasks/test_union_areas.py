"""Areas of many growths by compiled code, held against polygons."""

import numpy as np
import pytest
import shapely

import vinefab as vf
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap, poses_on
from vinefab.tasks.map_context import FreeRows, MapContext
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import one_by_one


@pytest.mark.parametrize("task", [Reach(), Reach(buffer_mm=7.0), Coverage()])
@pytest.mark.parametrize("kind", ["grid", "cave", "rubble"])
def test_a_block_has_the_areas_of_its_growths(kind: str, task: Reach | Coverage) -> None:
    place = PreparedMap.of(getattr(vf.maps, kind)(seed=3))
    poses = poses_on([place], 8, [5])
    options = GrowthOptions()
    plans = Plans.of(
        [vf.Design.read("three_level_tree"), vf.Design.read("grid_explorer_levels")], options
    )
    batch = Batch(plans, Launches.of(TerrainSet([place.terrain]), poses), options)
    for found, wanted in batch.each(
        lambda block: (
            task.evaluate_block(block, [place.context]),
            one_by_one(task, block, [place.context]),
        )
    ):
        np.testing.assert_allclose(found.score, wanted.score, rtol=2e-12, atol=1e-14)
        for name, values in wanted.terms.items():
            np.testing.assert_allclose(found.terms[name], values, rtol=2e-12, atol=1e-14)


@pytest.mark.compiler
@pytest.mark.parametrize("rows", ["one row", "many rows"])
def test_polygons_that_coincide_count_once(pillar_room: vf.Map, rows: str) -> None:
    """Lines from one point at 45 degrees to each other have the same corners around it, twice."""
    context = MapContext.of(pillar_room if rows == "one row" else vf.maps.grid(seed=1))
    assert (len(FreeRows.of(context.edges_mm).first) > 2) == (rows == "many rows")
    rng, lines = np.random.default_rng(7), []
    for corner in rng.uniform((60.0, 60.0), (340.0, 240.0), (60, 2)):
        angles = np.pi / 4.0 * rng.integers(0, 8, 5)
        ends = corner + 50.0 * np.column_stack([np.cos(angles), np.sin(angles)])
        lines.append(np.stack([np.broadcast_to(corner, ends.shape), ends], axis=1))
    corners = np.concatenate(lines)
    near = shapely.buffer(shapely.linestrings(corners), 20.0, quad_segs=32)
    begins = np.arange(0, len(near) + 1, 5)
    found = FreeRows.of(context.edges_mm).areas_mm2(
        near, begins, corners.reshape(-1, 2), 2 * np.arange(len(near) + 1), 20.0
    )
    unions = [shapely.union_all(part) for part in np.split(near, begins[1:-1])]
    wanted = shapely.area(shapely.intersection(unions, context.free))
    assert np.isfinite(found).mean() > 0.9
    np.testing.assert_allclose(
        found[np.isfinite(found)], wanted[np.isfinite(found)], rtol=2e-12, atol=1e-14
    )
