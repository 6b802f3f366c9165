"""A small run of `measure_area_errors.py`, which holds fast scores against exact ones."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest


@pytest.fixture(scope="module")
def errors() -> ModuleType:
    name = "measure_area_errors"
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def test_fast_scores_of_random_deployments_are_near_the_exact_ones(
    errors: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(errors, "DESIGNS_PER_MAP", 4)
    monkeypatch.setattr(errors, "POSES_PER_MAP", 3)
    for name in ("coverage, raw discs", "coverage, sight", "reach"):
        task, term = errors.TASKS[name]
        share, score, faster = errors.errors(task, term, 12)
        assert len(share) > 9
        assert 0.0 < np.abs(share).max() < 0.01
        assert np.abs(score).max() < 0.005
        assert faster > 5.0
