"""What a task is: it looks at one final state and says what it is worth."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.growth.batch import Block
from vinefab.model.deployment import Deployment
from vinefab.tasks.map_context import MapContext

Outcome = tuple[float, Mapping[str, float]]
"""A score, higher is better, and the named numbers that it is made of."""


class TaskOutcomes(NamedTuple):
    """What j growths are worth."""

    score: Floats  # shape (j,)
    terms: Mapping[str, Floats]  # the named numbers that the scores are made of, each of shape (j,)

    def one(self, index: int) -> Outcome:
        """Return what one of the growths is worth."""
        terms = {name: float(values[index]) for name, values in self.terms.items()}
        return float(self.score[index]), terms


class Task(Protocol):
    """Scores one deployment; a frozen dataclass whose fields are its parameters."""

    @property
    def name(self) -> str:
        """Its name in the registry and in files."""
        ...

    @property
    def lowest(self) -> float:
        """A number that no score falls below; designs that cannot be made rank below it."""
        ...

    def evaluate(self, deployment: Deployment, ground: MapContext) -> Outcome:
        """Return the score of one final state and its terms."""
        ...


class BlockTask(Protocol):
    """A task that scores many growths at once faster than one by one."""

    def evaluate_block(self, block: Block, grounds: Sequence[MapContext]) -> TaskOutcomes:
        """Return what `Task.evaluate` would for every growth of a block."""
        ...


def outcomes(task: Task, block: Block, grounds: Sequence[MapContext]) -> TaskOutcomes:
    """Return a task's score and terms for every growth of a block."""
    # Asked for every block, where asking whether it is a `BlockTask` would take longer.
    at_once: Callable[[Block, Sequence[MapContext]], TaskOutcomes] | None
    at_once = getattr(task, "evaluate_block", None)
    return one_by_one(task, block, grounds) if at_once is None else at_once(block, grounds)


def one_by_one(task: Task, block: Block, grounds: Sequence[MapContext]) -> TaskOutcomes:
    """Return a task's score and terms for every growth of a block, each from its deployment."""
    terrain = block.terrain.tolist()
    return merged_outcomes(
        [
            task.evaluate(block.deployment(index), grounds[terrain[index]])
            for index in range(len(block))
        ]
    )


def merged_outcomes(found: Sequence[Outcome]) -> TaskOutcomes:
    """Return several growths' scores and terms as columns."""
    names = tuple(found[0][1]) if found else ()
    for _, terms in found:
        if tuple(terms) != names:
            raise BadInputError("a task's terms", list(terms), f"always the same: {list(names)}")
    rows = np.array([(score, *terms.values()) for score, terms in found], dtype=np.float64)
    columns = np.ascontiguousarray(rows.reshape(len(found), 1 + len(names)).T)
    return TaskOutcomes(columns[0], dict(zip(names, columns[1:], strict=True)))


def concatenated_outcomes(parts: Sequence[TaskOutcomes]) -> TaskOutcomes:
    """Return the outcomes of several blocks, at least one, as those of one."""
    if len(parts) == 1:
        return parts[0]
    names = list(parts[0].terms)
    for part in parts:
        if part.terms.keys() != parts[0].terms.keys():
            raise BadInputError("a task's terms", list(part.terms), f"always the same: {names}")
    terms = {name: np.concatenate([part.terms[name] for part in parts]) for name in names}
    return TaskOutcomes(np.concatenate([part.score for part in parts]), terms)


def search_form(task: Task) -> Task:
    """Return the form of a task that a search evaluates.

    A task may define ``for_search() -> Task``: itself with faster approximations, unless its
    parameters ask for exact scores. Reported scores take the task as it is.
    """
    faster: Callable[[], Task] | None = getattr(task, "for_search", None)
    return task if faster is None else faster()
