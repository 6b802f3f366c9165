"""A little of `kill.py` in every run of the tests."""

import importlib.util
import random
import sys
from pathlib import Path
from types import ModuleType

import pytest

SMALL_MAPS = "options = { size_mm = 250.0, columns = 3, rows = 3 }"
"""The winner is tried on seventy maps: most of the time of a run that is as short as this one."""


@pytest.fixture(scope="module")
def kill() -> ModuleType:
    spec = importlib.util.spec_from_file_location("kill_runs", Path(__file__).with_name("kill.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules["kill_runs"] = module
    spec.loader.exec_module(module)
    return module


def test_a_run_that_is_killed_and_out_of_disk_ends_as_the_undisturbed_one(
    kill: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kill, "GENERATIONS", 25)
    monkeypatch.setattr(kill, "OPTIONS", (*kill.OPTIONS, "--no-page"))
    monkeypatch.setattr(kill, "MAPS", SMALL_MAPS)
    course = kill.Course("cmaes", tmp_path, random.Random(5))  # noqa: S311
    folder = tmp_path / "struck"
    for kind in ("full disk", "kill"):
        course._strike(folder, kind)
        assert kill.generations(folder) <= 25
    assert course.blows["full disk"] == 1
    course._finish(folder)
    assert kill.content(folder) == course.expected
    assert (folder / "best.toml").read_bytes() == course.best
