"""What a task is: it looks at one final state and says what it is worth."""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

from vinefab.growth.batch import Block
from vinefab.model.deployment import Deployment
from vinefab.tasks.ground import Ground

Outcome = tuple[float, Mapping[str, float]]
"""A score, higher is better, and the named numbers that it is made of."""


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

    def evaluate(self, deployment: Deployment, ground: Ground) -> Outcome:
        """Return the score of one final state and its terms.

        Parameters
        ----------
        deployment
            Where the robot ended.
        ground
            The map that it grew on, prepared.
        """
        ...


@runtime_checkable
class BlockTask(Protocol):
    """A task that scores many growths at once faster than one by one."""

    def evaluate_block(self, block: Block, grounds: Sequence[Ground]) -> list[Outcome]:
        """Return what `Task.evaluate` would for every growth of a block.

        Parameters
        ----------
        block
            The growths.
        grounds
            The maps of the block's launches, prepared.
        """
        ...


def outcomes(task: Task, block: Block, grounds: Sequence[Ground]) -> list[Outcome]:
    """Return a task's score and terms for every growth of a block."""
    if isinstance(task, BlockTask):
        return task.evaluate_block(block, grounds)
    return one_by_one(task, block, grounds)


def one_by_one(task: Task, block: Block, grounds: Sequence[Ground]) -> list[Outcome]:
    """Return a task's score and terms for every growth of a block, each from its deployment."""
    terrain = block.terrain.tolist()
    return [
        task.evaluate(block.deployment(index), grounds[terrain[index]])
        for index in range(len(block))
    ]
