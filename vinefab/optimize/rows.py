"""How what a run records is written into rows, without losing a bit of any number."""

import json
from dataclasses import asdict

import numpy as np

from vinefab.model.checked import Floats
from vinefab.model.map import Pose
from vinefab.model.score import Evaluation, Score
from vinefab.tasks.composite import composite


def to_blob(values: Floats) -> bytes:
    """Return numbers as 64-bit little-endian floats, in order."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def from_blob(data: bytes, rows: int | None = None) -> Floats:
    """Return the numbers of `to_blob`, shape (n,), or (rows, n / rows)."""
    values = np.frombuffer(data, dtype="<f8").astype(np.float64)
    return values if rows is None else values.reshape(rows, -1)


def score_to_text(score: Score) -> str:
    """Return a score as JSON; floats are written so that they read back the same."""
    evaluations = [
        {
            "map": evaluation.map_name,
            "pose": asdict(evaluation.pose),
            "score": evaluation.score,
            "terms": dict(evaluation.terms),
        }
        for evaluation in score.evaluations
    ]
    return json.dumps({"task": score.task, "evaluations": evaluations}, allow_nan=False)


def score_from_text(text: str) -> Score:
    """Return the score of `score_to_text`."""
    record = json.loads(text)
    evaluations = tuple(
        Evaluation(
            map_name=entry["map"],
            pose=Pose(**entry["pose"]),
            score=entry["score"],
            terms=entry["terms"],
        )
        for entry in record["evaluations"]
    )
    return Score(
        task=record["task"],
        evaluations=evaluations,
        composite=composite([evaluation.score for evaluation in evaluations]),
    )
