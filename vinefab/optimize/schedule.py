"""The poses that generation after generation meets."""

from contextlib import suppress

from vinefab.core.errors import BadInputError
from vinefab.optimize.trial import Trial
from vinefab.tasks.evaluate import Poses

AHEAD = 8
"""Generations whose poses are drawn in one go: that takes half of the time of one at a time."""


class Schedule:
    """Poses drawn some generations ahead, with the places on the maps that belong to them.

    Parameters
    ----------
    trial
        Whose maps they are on.
    seed
        The run's.
    """

    def __init__(self, trial: Trial, seed: int) -> None:
        self._trial, self._seed = trial, seed
        self._drawn: dict[int, Poses] = {}

    def poses(self, generation: int) -> Poses:
        """Return what all points of a generation meet.

        Raises
        ------
        BadInputError
            If a map has no free pose within the range of a start.
        """
        draw = generation if self._trial.evaluation.redraw else 0
        if draw not in self._drawn:
            count = AHEAD if self._trial.evaluation.redraw else 1
            drawn = {draw: self._trial.training_poses(self._seed, draw)}
            # What is wrong with poses further ahead is nobody's matter if the run ends before.
            with suppress(BadInputError):
                for number in range(draw + 1, draw + count):
                    drawn[number] = self._trial.training_poses(self._seed, number)
            self._drawn = drawn
            self._trial.make_ready(drawn.values())
        return self._drawn[draw]
