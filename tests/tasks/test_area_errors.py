"""A small run of `measure_area_errors.py`, which holds fast scores against exact ones."""

import numpy as np
import pytest

from tests.tasks import measure_area_errors as errors


def test_fast_scores_of_random_deployments_are_near_the_exact_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(errors, "DESIGNS_PER_MAP", 4)
    monkeypatch.setattr(errors, "POSES_PER_MAP", 3)
    for name in ("coverage, raw discs", "coverage, sight", "reach"):
        task, term = errors.TASKS[name]
        share, score, _ = errors.errors(task, term, 12)
        assert len(share) > 9
        assert 0.0 < np.abs(share).max() < 0.01
        assert np.abs(score).max() < 0.005
