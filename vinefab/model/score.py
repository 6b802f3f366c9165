"""Scores of a design on a task, evaluation by evaluation."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.map import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """One deployment's score.

    Parameters
    ----------
    map_name
        The map that the robot grew on.
    pose
        Where it started.
    score
        The task's score, higher is better.
    terms
        The named numbers that make up the score.
    """

    map_name: str
    pose: Pose
    score: float
    terms: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """All evaluations of one design on one task.

    Parameters
    ----------
    task
        Name of the task.
    evaluations
        At least one.
    composite
        Composites of the scores: ``mean``, ``best``, ``min_deviation``.
    """

    task: str
    evaluations: tuple[Evaluation, ...]
    composite: Mapping[str, float]

    def __repr__(self) -> str:
        weighed = ", ".join(f"{kind} {value:.4g}" for kind, value in self.composite.items())
        return f"<Score {self.task}: {weighed}; {len(self.evaluations)} evaluations>"

    @property
    def scores(self) -> Floats:
        """The scores in order, shape (n,)."""
        return np.array([evaluation.score for evaluation in self.evaluations])
