"""Other processes that help to work off a list."""

import importlib
import os
import subprocess
import sys
import time
from collections import deque
from pathlib import Path

import pytest

from vinefab.core.helpers import helped, processors


def note(path):
    """Leave a file with the number of the process that worked on it, whole once it is there."""
    part = Path(path).with_suffix(".part")
    part.write_text(str(os.getpid()), encoding="utf-8")
    part.rename(path)


def note_once(path):
    """End the process at the first such thing, note the second."""
    if not Path(path).with_suffix(".begun").exists():
        Path(path).with_suffix(".begun").touch()
        os._exit(3)
    note(path)


def sleep_long(path):
    """Say that it begins, and take longer than any test."""
    note(path)
    time.sleep(600.0)


@pytest.fixture(autouse=True)
def importable(monkeypatch, tmp_path):
    """Let helpers, which know vinefab alone, import this module's functions."""
    (tmp_path / "work_of_helpers.py").write_text(
        Path(__file__).read_text(encoding="utf-8").split("@pytest")[0], encoding="utf-8"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    sys.modules.pop("work_of_helpers", None)


def work(name):
    return getattr(importlib.import_module("work_of_helpers"), name)


def until(path):
    end = time.monotonic() + 60.0
    while not path.exists():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_helpers_work_off_a_list_that_their_caller_leaves_to_them(tmp_path):
    paths = [tmp_path / f"{number}.txt" for number in range(6)]
    waiting = deque(paths)
    with helped(work("note"), waiting, 2) as others:
        while others.wait():
            pass
    assert not waiting
    workers = {path.read_text() for path in paths}
    assert 1 <= len(workers) <= 2
    assert str(os.getpid()) not in workers


def test_without_helpers_all_is_left_to_the_caller(tmp_path):
    waiting = deque([tmp_path / "one.txt"])
    with helped(work("note"), waiting, 0) as others:
        assert not others.wait()
    assert len(waiting) == 1


def test_what_a_helper_fails_at_returns_to_the_list(tmp_path):
    waiting = deque([tmp_path / "one.txt"])
    with helped(work("note_once"), waiting, 1) as others:
        while others.wait():
            pass
        assert list(waiting) == [tmp_path / "one.txt"]
        note_once(waiting.popleft())
    assert (tmp_path / "one.txt").read_text() == str(os.getpid())


def test_an_error_ends_helpers_at_once(tmp_path):
    path, began = tmp_path / "one.txt", time.monotonic()

    def interrupted():
        with helped(work("sleep_long"), deque([path]), 1):
            until(path)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - began < 60.0
    with pytest.raises(ProcessLookupError):
        os.kill(int(path.read_text()), 0)


def test_as_many_processors_as_the_process_may_use():
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("this system binds no process to processors")
    code = "import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]); " + (
        "from vinefab.core.helpers import processors; print(processors())"
    )
    line = [sys.executable, "-c", code]
    said = subprocess.run(line, check=True, capture_output=True, text=True, timeout=60).stdout
    assert said.split() == ["1"]
    assert processors() >= 1
