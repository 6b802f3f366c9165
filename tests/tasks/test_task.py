"""Outcomes of tasks put together, and the head-on penalty around any task."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import HeadOnPenalty, TaskOutcomes, concatenated_outcomes, one_by_one

# --- Outcomes --------------------------------------------------------------------------------


def found(*names: str) -> TaskOutcomes:
    return TaskOutcomes(np.zeros(2), {name: np.full(2, float(ord(name))) for name in names})


def test_blocks_are_joined_by_the_names_of_their_terms() -> None:
    both = concatenated_outcomes([found("a", "b"), found("b", "a")])
    assert {name: set(values) for name, values in both.terms.items()} == {"a": {97.0}, "b": {98.0}}
    assert both.score.shape == (4,)


@pytest.mark.parametrize("other", [("a",), ("a", "c"), ("a", "b", "c")])
def test_blocks_with_other_terms_are_a_fault_of_the_task(other: tuple[str, ...]) -> None:
    with pytest.raises(BadInputError, match="a task's terms"):
        concatenated_outcomes([found("a", "b"), found(*other)])


# --- Head-on penalty -------------------------------------------------------------------------

TASK = HeadOnPenalty(task=Coverage(area="fast"), weight=0.4)


def test_the_share_of_deployed_branches_that_stopped_head_on_costs(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    end = ended(fork, [[(0, 0), (200, 200)], [(200, 200), (300, 200)], None])
    stop = np.array([Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.NOT_DEPLOYED])
    end = replace(end, stop=stop)
    score, terms = TASK.evaluate(end, room_context)
    free, _ = TASK.task.evaluate(end, room_context)
    assert terms["head_on"] == 0.5
    assert score == pytest.approx(free - 0.2)
    assert TASK.name == "coverage"
    assert TASK.lowest == pytest.approx(Coverage().lowest - 0.4)


def test_a_robot_that_never_came_out_did_not_stop_head_on(
    fork: Design, ended: Callable[..., Deployment], room_context: MapContext
) -> None:
    assert TASK.evaluate(ended(fork, [None] * 3), room_context)[1]["head_on"] == 0.0


def test_blocks_score_as_single_deployments_do(same: Callable[..., bool]) -> None:
    fan = Level(branches=3, length_mm=120.0, fan_rad=2.5)
    tree = Design(name="a", trunk_length_mm=120.0, levels=(fan, fan), build=Build.standard(3))
    options = GrowthOptions.published(head_on_half_angle_rad=0.3)
    site = PreparedMap.of(grid_map(1))
    launches = Launches.of(TerrainSet([site.terrain]), [draw_poses(site.world, 9, 5)])
    batch = Batch(Plans.of([tree], options), launches, options)
    seen = set()
    for block in batch.each(
        lambda b: (TASK.evaluate_block(b, [site.context]), one_by_one(TASK, b, [site.context])),
        size=4,
    ):
        assert same(*block)
        seen |= set(block[0].terms["head_on"].tolist())
    assert len(seen) > 2
