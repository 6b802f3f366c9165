"""Worker processes end with the one that began them, and a lost one is said."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import pytest

from vinefab.core.errors import WorkersLostError

PROGRAM = """
import os, sys, time

def work(path):
    with open(path, "w") as stream:
        stream.write(str(os.getpid()))
    time.sleep(60)

if __name__ == "__main__":
    from vinefab.studies.workers import WorkerProcesses

    with WorkerProcesses(1) as processes:
        list(processes.map(work, sys.argv[1:]))
"""


def kill_itself(number):
    os.kill(os.getpid(), number)


@dataclass(frozen=True)
class KillsWorkers:
    """A job of a study that ends in the main process only."""

    key: str

    def run(self):
        from vinefab.studies.study_runs import JobResult  # noqa: PLC0415

        if multiprocessing.parent_process():
            kill_itself(signal.SIGKILL)
        return JobResult(key=self.key)


def test_a_worker_that_is_killed_is_one_error_and_no_hang():
    # Not at the top: the worker would load it too.
    from vinefab.studies.workers import WorkerProcesses  # noqa: PLC0415

    with (
        pytest.raises(WorkersLostError, match="was killed, perhaps for want of memory; run the"),
        WorkerProcesses(1) as processes,
    ):
        list(processes.map(kill_itself, [signal.SIGKILL]))


@pytest.mark.thorough
def test_a_study_says_so_and_keeps_what_is_done(tmp_path):
    from vinefab.studies.study_runs import QUICK_SIZE, JobStore  # noqa: PLC0415

    jobs = [KillsWorkers(key) for key in "abc"]
    with (
        pytest.raises(WorkersLostError, match="what is finished is kept"),
        JobStore(tmp_path / "lab", QUICK_SIZE, 2) as store,
    ):
        store.do(jobs, "jobs")
    assert [path.name for path in (tmp_path / "lab" / "parts").iterdir()] == ["a.json"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_the_process_that_began_them(tmp_path, number):
    (tmp_path / "program.py").write_text(PROGRAM)
    told = tmp_path / "pid"
    began = subprocess.Popen(
        [sys.executable, tmp_path / "program.py", told],
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    )
    _wait_for(lambda: told.exists() and told.read_text())
    worker = int(told.read_text())
    os.kill(began.pid, number)
    began.wait(20)
    _wait_for(lambda: not _is_alive(worker))


def _wait_for(condition):
    for _ in range(400):
        if condition():
            return
        time.sleep(0.05)
    pytest.fail("not within 20 s")


def _is_alive(process):
    try:
        with open(f"/proc/{process}/stat") as stream:  # noqa: PTH123
            return stream.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
