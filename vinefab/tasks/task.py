"""What a task is: it looks at one final state and says what it is worth."""

from collections.abc import Mapping
from typing import Protocol

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
