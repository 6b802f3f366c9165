"""A little of `kill.py`, as a test."""

import random
import time

import pytest

from tests.search import kill

SMALL_MAPS = "options = { size_mm = 250.0, columns = 3, rows = 3 }"
"""The winner is tried on seventy maps: most of the time of a run that is as short as this one."""


class NearTheLeast(random.Random):
    """Draws whole numbers from the lower end of their ranges: a disk that is full soon."""

    def randrange(self, low: int, high: int) -> int:  # type: ignore[override]
        return low + (high - low) // 10


@pytest.mark.thorough
def test_a_run_that_is_killed_and_out_of_disk_ends_as_the_undisturbed_one(tmp_path, monkeypatch):
    monkeypatch.setattr(kill, "GENERATIONS", 150)
    monkeypatch.setattr(kill, "OPTIONS", (*kill.OPTIONS, "--no-page"))
    monkeypatch.setattr(kill, "MAPS", SMALL_MAPS)
    course = kill.Course("cmaes", tmp_path, NearTheLeast(5))
    folder = tmp_path / "struck"
    process = kill.start(course.run_file, folder)
    while not kill.generations(folder):
        assert process.poll() is None
        time.sleep(0.005)
    process.kill()
    process.communicate()
    assert 0 < kill.generations(folder) < 150
    assert course._strike(folder, "full disk")
    course._finish(folder)
    assert kill.content(folder) == course.expected
    assert (folder / "best.toml").read_bytes() == course.best
