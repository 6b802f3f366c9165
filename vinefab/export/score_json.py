"""The score of a design on a task as JSON: ``vinefab/score-1``."""

from vinefab.core.jsontext import json_text
from vinefab.export.deployment_json import pose_content
from vinefab.model.score import Score

SCHEMA = "vinefab/score-1"


def score_text(score: Score) -> str:
    """Return a score with every evaluation that it is made of.

    Raises
    ------
    ValueError
        If a score or term is NaN or infinite.
    """
    evaluations = [
        {
            "map": evaluation.map_name,
            "pose": pose_content(evaluation.pose),
            "score": evaluation.score,
            "terms": dict(evaluation.terms),
        }
        for evaluation in score.evaluations
    ]
    content = {"task": score.task, "evaluations": evaluations, "composite": dict(score.composite)}
    return json_text(SCHEMA, content)
