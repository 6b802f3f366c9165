"""A task whose score falls with branches that stop head-on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.growth.batch import Block
from vinefab.model.deployment import Deployment, Stop
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome, Task, TaskOutcomes, outcomes

TERM = "head_on"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sliding:
    """Another task, less a weight times the share of deployed branches that stopped head-on.

    Head-on collisions, at branching points above all, keep real robots from growing on (paper,
    3.3.2); its discussion asks for penalties that make them rarer.
    """

    task: Task  # the task
    weight: float  # what a robot would lose whose branches all stop head-on

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    @property
    def lowest(self) -> float:
        """The task's lowest score, with all branches stopped head-on."""
        return self.task.lowest - self.weight

    def evaluate(self, deployment: Deployment, ground: MapContext) -> Outcome:
        """Return the task's score less the price, and its terms with ``head_on``, the share."""
        score, terms = self.task.evaluate(deployment, ground)
        share = float(_shares(deployment.stop, np.array([0, len(deployment.stop)]))[0])
        return score - self.weight * share, {**terms, TERM: share}

    def evaluate_block(self, block: Block, grounds: Sequence[MapContext]) -> TaskOutcomes:
        """Return what `evaluate` would for every growth of a block."""
        share = _shares(block.growth.stop, block.branch)
        score, terms = outcomes(self.task, block, grounds)
        return TaskOutcomes(score - self.weight * share, {**terms, TERM: share})


def _shares(stop: Ints, first: Ints) -> Floats:
    """Return the share of each growth's deployed branches that stopped head-on; 0 if none did.

    Parameters
    ----------
    first
        Where the branches of each growth begin, shape (j + 1,).
    """
    growth = np.repeat(np.arange(len(first) - 1), np.diff(first))
    deployed, head_on = (
        np.bincount(growth[which], minlength=len(first) - 1)
        for which in (np.not_equal(stop, Stop.NOT_DEPLOYED), np.equal(stop, Stop.HEAD_ON))
    )
    return np.asarray(head_on / np.maximum(deployed, 1))
