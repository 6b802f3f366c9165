"""What every task does alike: scores above its lowest, blocks as single growths, bad parameters."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.tasks import TASKS, make_task
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import HeadOnPenalty, Task, one_by_one


@pytest.mark.parametrize("name", list(TASKS))
def test_every_task_scores_a_final_state_above_its_lowest(
    name: str, fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    task = make_task(name)
    end = ended(fork, [[(0, 0), (500, 500)], [(500, 500), (600, 600)], None])
    score, terms = task.evaluate(end, room_context)
    assert task.name == name
    assert score >= task.lowest
    assert terms
    assert all(isinstance(value, float) for value in terms.values())


@pytest.fixture(scope="module", params=["centerline", "inflated"])
def grown(request: pytest.FixtureRequest) -> tuple[Batch, list[MapContext]]:
    """Three designs on two maps, many of their branches head-on."""
    fan = Level(branches=3, length_mm=80.0, fan_rad=1.5)
    designs = [
        Design(name="a", trunk_length_mm=120.0, levels=(fan, fan), build=Build.standard(3)),
        Design(name="b", trunk_length_mm=150.0, levels=(fan,), build=Build.standard(2)),
        Design(name="c", trunk_length_mm=90.0, build=Build.standard(1)),
    ]
    options = GrowthOptions.published(body=request.param, head_on_half_angle_rad=0.3)
    sites = [PreparedMap.of(grid_map(seed, GridOptions(columns=4, rows=4))) for seed in (1, 2)]
    poses = [draw_poses(site.world, 3, 5, clearance_mm=14.0) for site in sites]
    launches = Launches.of(TerrainSet([site.terrain for site in sites]), poses)
    return Batch(Plans.of(designs, options), launches, options), [site.context for site in sites]


AIMED = {
    "targets": [
        {"point_mm": (x, y), "tolerance_mm": 60.0}
        for x in (100.0, 250.0)
        for y in (60.0, 200.0, 420.0)
    ],
    "falloff_mm": 50.0,
}


@pytest.mark.parametrize(
    "task",
    [
        Coverage(area="fast"),
        Coverage(area="fast", clip="sight"),
        Coverage(),
        Reach(area="fast"),
        Reach(area="fast", buffer_mm=0.1),  # too fine for a raster
        Reach(),
        Reach(**AIMED),
        Reach(**AIMED, reached_by="tip"),
        HeadOnPenalty(task=Coverage(area="fast"), weight=0.4),
        Anchoring(
            pouch_length_mm=20.0,
            pouch_width_mm=150.0,
            count_joint_angles=True,
            film_n_mm=0.0,
            seam_n_mm=0.0,
        ),
    ],
)
def test_blocks_score_as_single_deployments_do(
    task: Task, grown: tuple[Batch, list[MapContext]]
) -> None:
    batch, contexts = grown
    found = set()
    for size in (1, 7, 100):
        for together, alone in batch.each(
            lambda b: (task.evaluate_block(b, contexts), one_by_one(task, b, contexts)), size=size
        ):
            np.testing.assert_allclose(together.score, alone.score, rtol=1e-12, atol=1e-14)
            assert tuple(together.terms) == tuple(alone.terms)
            # What a pouch presses with is the design's pressure, which a deployment lacks.
            for name in together.terms.keys() - {"force_n"}:
                np.testing.assert_allclose(
                    together.terms[name], alone.terms[name], rtol=1e-12, atol=1e-12
                )
            found |= set(together.score.tolist())
    assert len(found) > 2


def test_whole_numbers_do_for_lengths() -> None:
    assert make_task("reach", {"buffer_mm": 30}) == make_task("reach", {"buffer_mm": 30.0})


def test_an_unknown_task_is_named_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'coverage'"):
        make_task("coverge")


@pytest.mark.parametrize(
    ("name", "parameters", "key", "words"),
    [
        ("coverage", {"radius": 5.0}, "radius", "did you mean 'radius_mm'"),
        ("coverage", {"radius_mm": "5"}, "radius_mm", "a valid number"),
        ("coverage", {"radius_mm": True}, "radius_mm", "a valid number"),
        ("coverage", {"radius_mm": 0.0}, "radius_mm", "0.000001"),
        ("coverage", {"weight_area": math.nan}, "weight_area", "finite"),
        ("coverage", {"most_branches": 2.5}, "most_branches", "a valid integer"),
        ("coverage", {"most_branches": 0}, "most_branches", "1"),
        ("coverage", {"clip": "walls"}, "clip", "'free', 'none' or 'sight'"),
        ("coverage", {"area": "quick"}, "area", "'fast'"),
        ("reach", {"area": "quick"}, "area", "'fast'"),
        ("reach", {"buffer_mm": 0.0}, "buffer_mm", "0.000001"),
        ("anchoring", {"friction": math.nan}, "friction", "friction"),
        ("anchoring", {"friction": 0.1}, "friction_low", "friction_low"),
        ("anchoring", {"friction_high": 0.2}, "friction_high", "friction_high"),
        ("anchoring", {"pouch_width_mm": 30.0}, "pouch_length_mm", "pouch_length_mm"),
        ("anchoring", {"pouch_length_mm": 30.0}, "pouch_width_mm", "pouch_width_mm"),
        ("anchoring", {"seam_n_mm": -1.0}, "seam_n_mm", "seam_n_mm"),
    ],
)
def test_wrong_parameters_are_named(
    name: str, parameters: dict[str, object], key: str, words: str
) -> None:
    with pytest.raises(BadInputError, match=words) as caught:
        make_task(name, parameters)
    assert caught.value.key == f"task.{key}"
