import numpy as np
import pytest

from vinefab.core.statistics import mean_interval
from vinefab.demonstration import demo_interval_text
from vinefab.model.map import Pose
from vinefab.model.score import Evaluation, Score


def score_of(values, maps=None):
    pose = Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0)
    return Score(
        task="coverage",
        evaluations=tuple(
            Evaluation(map_name=name, pose=pose, score=float(value), terms={})
            for name, value in zip(maps or ["m"] * len(values), values, strict=True)
        ),
        composite={"mean": float(np.mean(values))},
    )


def test_the_interval_of_a_score_is_that_of_the_normal_law():
    values = np.random.default_rng(3).normal(0.5, 0.1, 400)
    text = demo_interval_text(score_of(values))
    low, high = (float(end) for end in text.partition("[")[2].partition(";")[0].split(", "))
    half = 1.96 * values.std() / np.sqrt(400)
    assert (low, high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.1 * half + 5e-4
    )


def test_the_interval_is_written_behind_the_mean():
    assert demo_interval_text(score_of([0.25, 0.25])) == "0.250 (2 poses: no interval)"
    low, high = mean_interval([0.0, 1.0])
    assert demo_interval_text(score_of([0.0, 1.0])) == f"0.500 [{low:.3f}, {high:.3f}; 2 poses]"
    assert demo_interval_text(score_of([0.25])) == "0.250 (1 map: no interval)"


def test_the_interval_is_over_maps_for_poses_on_one_are_alike():
    same = demo_interval_text(score_of([0.0, 0.0, 1.0, 1.0], ["a", "a", "b", "b"]))
    assert same == demo_interval_text(score_of([0.0, 1.0], ["a", "b"]))
