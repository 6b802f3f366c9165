"""Outcomes of tasks put together, and the head-on penalty around any task."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import HeadOnPenalty, TaskOutcomes, concatenated_outcomes

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
