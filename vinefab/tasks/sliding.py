"""A task whose score falls with branches that stop head-on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.growth.batch import Block
from vinefab.model.checked import Ints
from vinefab.model.deployment import Deployment, Stop
from vinefab.tasks.ground import Ground
from vinefab.tasks.task import Outcome, Task, outcomes

TERM = "head_on"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sliding:
    """Another task, less a weight times the share of deployed branches that stopped head-on.

    Head-on collisions, at branching points above all, keep real robots from growing on (paper,
    3.3.2); its discussion asks for penalties that make them rarer.

    Parameters
    ----------
    task
        The task.
    weight
        What a robot would lose whose branches all stop head-on.
    """

    task: Task
    weight: float

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    @property
    def lowest(self) -> float:
        """The task's lowest score, with all branches stopped head-on."""
        return self.task.lowest - self.weight

    def evaluate(self, deployment: Deployment, ground: Ground) -> Outcome:
        """Return the task's score less the price, and its terms with ``head_on``, the share."""
        share = _share(deployment.stop)
        return self._priced(self.task.evaluate(deployment, ground), share)

    def evaluate_block(self, block: Block, grounds: Sequence[Ground]) -> list[Outcome]:
        """Return what `evaluate` would for every growth of a block.

        Parameters
        ----------
        block
            The growths.
        grounds
            The maps.
        """
        edges = block.branch.tolist()
        stop = block.growth.stop
        return [
            self._priced(outcome, _share(stop[edges[index] : edges[index + 1]]))
            for index, outcome in enumerate(outcomes(self.task, block, grounds))
        ]

    def _priced(self, outcome: Outcome, share: float) -> Outcome:
        score, terms = outcome
        return score - self.weight * share, {**terms, TERM: share}


def _share(stop: Ints) -> float:
    """Return the share of deployed branches that stopped head-on; 0 if none deployed."""
    deployed = int(np.count_nonzero(np.not_equal(stop, Stop.NOT_DEPLOYED)))
    head_on = int(np.count_nonzero(np.equal(stop, Stop.HEAD_ON)))
    return head_on / deployed if deployed else 0.0
