"""What tasks find, put together."""

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.tasks.task import TaskOutcomes, concatenated_outcomes


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
