"""How what a run records is written into rows, without losing a bit of any number."""

import base64
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

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


def state_to_text(state: Mapping[str, object]) -> str:
    """Return an optimizer's state as JSON, arrays of floats as the bits that they are made of."""
    plain = {
        name: {"shape": value.shape, "bits": base64.b64encode(to_blob(value)).decode()}
        if isinstance(value, np.ndarray)
        else value
        for name, value in state.items()
    }
    return json.dumps(plain, allow_nan=False)


def state_from_text(text: str) -> dict[str, Any]:
    """Return the state of `state_to_text`; arrays are arrays of floats again."""
    return {
        name: from_blob(base64.b64decode(value["bits"])).reshape(value["shape"])
        if isinstance(value, dict)
        else value
        for name, value in json.loads(text).items()
    }


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
