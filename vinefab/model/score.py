"""Scores of a design on a task, evaluation by evaluation."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vinefab.core.front_door import front_door
from vinefab.core.plain_text import counted
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
    parts
        What earned and cost how much of the score: they add up to it. Empty where the task does
        not say, and in scores of a search.
    """

    map_name: str
    pose: Pose
    score: float
    terms: Mapping[str, float]
    parts: Mapping[str, float] = field(default_factory=dict)


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
    parts
        What earned and cost how much of the mean, as in `Evaluation`.
    growth
        The growth options by name.
    notes
        What a user should know about the deployments, a sentence each.
    summary
        The score in lines, where `vinefab.score` returned it.
    """

    task: str
    evaluations: tuple[Evaluation, ...]
    composite: Mapping[str, float]
    parts: Mapping[str, float] = field(default_factory=dict)
    growth: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    summary: tuple[str, ...] = ()

    def json_text(self) -> str:
        """Return the score as JSON: ``vinefab/score-1``."""
        from vinefab.model.files.results_json import score_text  # noqa: PLC0415  it needs scores

        return score_text(self)

    def __repr__(self) -> str:
        weighed = ", ".join(f"{kind} {value:.4g}" for kind, value in self.composite.items())
        return f"<Score {self.task}: {weighed}; {counted(len(self.evaluations), 'evaluation')}>"

    def _repr_html_(self) -> str:
        """Show the evaluations in a notebook."""
        shown: str = front_door().html_of(self)
        return shown

    @property
    def scores(self) -> Floats:
        """The scores in order, shape (n,)."""
        return np.array([evaluation.score for evaluation in self.evaluations])
