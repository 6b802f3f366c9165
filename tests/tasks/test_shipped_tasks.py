from collections.abc import Callable

import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.tasks import TASKS, make_task
from vinefab.tasks.map_context import MapContext


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


def test_whole_numbers_do_for_lengths() -> None:
    assert make_task("reach", {"buffer_mm": 30}) == make_task("reach", {"buffer_mm": 30.0})


def test_an_unknown_task_is_named_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'coverage'"):
        make_task("coverge")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("radius", 5.0, "did you mean 'radius_mm'"),
        ("radius_mm", "5", "a valid number"),
        ("radius_mm", True, "a valid number"),
        ("most_branches", 2.5, "a valid integer"),
        ("clip", 3, "'free', 'none' or 'sight'"),
    ],
)
def test_wrong_parameters_are_named(key: str, value: object, words: str) -> None:
    with pytest.raises(BadInputError, match=words) as caught:
        make_task("coverage", {key: value})
    assert caught.value.key == f"task.{key}"
