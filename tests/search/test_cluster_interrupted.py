"""Ctrl-C with a cluster: one line, nothing left, and the run goes on where it was."""

import os
import signal
import subprocess
import sys
import time

import pytest

from vinefab.core.errors import WorkersLostError
from vinefab.search.dask_cluster import DaskEvaluator

RUN = """schema = "vinefab/run-1"
name = "long"
[maps]
count = 1
[optimizer]
population = 4
generations = 100000
[evaluation]
fabricable = false
"""


@pytest.mark.thorough
def test_ctrl_c_while_the_cluster_starts_is_one_line(tmp_path):
    (tmp_path / "long.toml").write_text(RUN)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    command = [sys.executable, "-m", "vinefab", "optimize", tmp_path / "long.toml"]
    process = subprocess.Popen(
        [*command, "--out", tmp_path / "run", "--cluster", "local:1", "--workers", "0", "-q"],
        env=os.environ | {"TMPDIR": str(temporary)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not list(temporary.glob("vinefab-*")) and process.poll() is None:
        time.sleep(0.01)
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    words = process.communicate(timeout=60)[1]
    assert process.returncode == 130, words
    assert words.count("\n") == 1, words
    assert "to resume: vinefab optimize" in words
    assert list(temporary.iterdir()) == []


def test_a_worker_that_ends_while_it_starts_is_one_error(monkeypatch):
    def failing(**_):
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr("distributed.LocalCluster", failing)
    with (
        pytest.raises(WorkersLostError, match="a worker ended while it started"),
        DaskEvaluator("local:1")._client(),
    ):
        pass
