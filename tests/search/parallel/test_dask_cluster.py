"""Workers in other processes. Their results are checked in a process of their own."""

import importlib.util
import subprocess
import sys
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError, WorkersLostError
from vinefab.search import dask_cluster as module
from vinefab.search.dask_cluster import (
    DaskEvaluator,
    WorkerPayload,
    _evaluated,
    deserialized,
    serialized,
)
from vinefab.search.evaluator import TRAINING, Evaluator, EvaluatorSpec, Ledger, Work
from vinefab.search.run import Search, make_point_evaluator
from vinefab.search.settings import PartSettings
from vinefab.tasks.reach import Reach

PROGRAM = """
import os, signal, sys
from pathlib import Path
from vinefab.search.settings import read_run
from vinefab.search.run import Search
from vinefab.search import dask_cluster as module
from vinefab.search.dask_cluster import DaskEvaluator
from vinefab.search.dask_cluster import HandingOut
from vinefab.search.run import run_search as search

def main():
    from distributed import Client
    settings = read_run(Path(sys.argv[1]))
    killed = []

    def tell(progress):
        # One worker dies in the middle, later all that there are.
        if progress.generation in (2, 4):
            pids = sorted(Client.current().run(os.getpid).values())
            for pid in pids[: progress.generation // 2]:
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
        if progress.generation == 5:
            # As if dask had not started them again: none is left, and none would come.
            Client.current().cluster.scale(0)

    module.RESTART_S = 5.0
    threads = search(settings, Path(sys.argv[2]) / "threads")
    workers = DaskEvaluator("local:2", threads=0, patience_s=500.0)
    cluster = search(settings, Path(sys.argv[2]) / "cluster", workers=workers, progress=tell)
    assert len(killed) >= 2, killed
    assert cluster.times.workers == 2 and cluster.times.growth_s > 0.0
    assert cluster.best == threads.best
    assert cluster.score == threads.score
    for one, other in zip(cluster.history, threads.history, strict=True):
        assert (one.x == other.x).all() and (one.fitness == other.fitness).all()

    # Workers that are started in the middle, because handing out seems to cost nothing.
    free = HandingOut(round_trip_s=1e-6, per_unit_s=1e-6)
    module.ASSUMED_COSTS = free
    module._DaskWorkers._measured_costs = lambda _: free
    workers = DaskEvaluator("local:2", threads=1)
    mixed = search(settings, Path(sys.argv[2]) / "mixed", workers=workers)
    assert mixed.best == threads.best
    assert "handed out" in mixed.notes[-1] and "handed out 0" not in mixed.notes[-1], mixed.notes

if __name__ == "__main__":
    main()
"""
RUN = """schema = "vinefab/run-1"
[maps]
count = 2
[optimizer]
name = "pso"
population = 12
generations = 6
[evaluation]
fabricable = true
finalists = 2
"""


@pytest.mark.thorough
def test_workers_may_die_and_the_result_is_that_of_threads(tmp_path):
    program, run_file = tmp_path / "program.py", tmp_path / "run.toml"
    program.write_text(PROGRAM)
    run_file.write_text(RUN)
    subprocess.run([sys.executable, program, run_file, tmp_path], check=True, timeout=540)


@dataclass(frozen=True)
class LongTrunk:
    """A penalty that can be sent."""

    most_mm: float = 100.0

    def __call__(self, design):
        return max(0.0, design.trunk_length_mm - self.most_mm)


def test_a_worker_finds_what_the_run_would_find(fabricable, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=fabricable, maps=maps, penalty=LongTrunk()))
    x = np.random.default_rng(1).random((module.TOGETHER + 5, len(evaluator.space)))
    poses = evaluator.conditions(3, TRAINING, 0, 2)
    found, work = deserialized(_evaluated(WorkerPayload.of(evaluator.spec), x, serialized(poses)))
    expected, _ = evaluator.evaluate(x, poses)
    np.testing.assert_array_equal(found.score, expected.score)
    np.testing.assert_array_equal(found.penalty, expected.penalty)
    assert {name: v.tolist() for name, v in found.terms.items()} == {
        name: v.tolist() for name, v in expected.terms.items()
    }
    assert min(work) > 0.0


def test_a_task_object_is_sent_to_the_workers(small, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps, task=Reach(buffer_mm=25.0)))
    x = np.random.default_rng(1).random((3, len(evaluator.space)))
    poses = evaluator.conditions(3, TRAINING, 0, 1)
    evaluations, _ = deserialized(
        _evaluated(WorkerPayload.of(evaluator.spec), x, serialized(poses))
    )
    np.testing.assert_array_equal(evaluations.score, evaluator.evaluate(x, poses)[0].score)
    assert set(evaluations.terms) == {"reached_mm2", "grown_mm"}


def test_a_task_that_cannot_be_sent_is_named(small, maps):
    class Local(Reach):
        pass

    spec = EvaluatorSpec(settings=small, maps=maps, task=Local())
    with pytest.raises(BadInputError, match="a task that can be pickled"):
        WorkerPayload.of(spec)


def test_read_only_views_can_be_sent(maps):
    again = deserialized(serialized(maps[0]))
    assert again.facts == maps[0].facts
    assert type(again.facts) is type(maps[0].facts)


def test_a_penalty_that_cannot_be_sent_is_named(fabricable, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=fabricable, maps=maps, penalty=lambda _: 0.0))
    with pytest.raises(BadInputError, match="a penalty and a task that can be pickled"):
        WorkerPayload.of(evaluator.spec)


def test_a_worker_with_other_versions_refuses(small, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps))
    payload = WorkerPayload.of(evaluator.spec)
    strange = replace(payload, versions={**payload.versions, "numpy": "0.1"})
    x, poses = np.full((1, len(evaluator.space)), 0.5), evaluator.conditions(3, TRAINING, 0, 1)
    with pytest.raises(BadInputError, match=r"numpy .*; allowed: numpy 0\.1, as the run has"):
        _evaluated(strange, x, serialized(poses))


def test_a_worker_without_the_packages_of_the_run_is_named(small, maps):
    theirs = small.changed(task=PartSettings(name="depth"))
    payload = WorkerPayload.of(EvaluatorSpec(settings=theirs, maps=maps, penalty=None))
    x, poses = np.full((1, 3), 0.5), ((), ())
    with pytest.raises(BadInputError, match=r"a worker is .*without task 'depth'.*same packages"):
        _evaluated(payload, x, serialized(poses))
    gone = replace(payload, name="gone", spec=b"cno_such_package\nPenalty\n.")
    with pytest.raises(BadInputError, match=r"a worker is .*no_such_package.*same packages"):
        _evaluated(gone, x, serialized(poses))
    # It comes through the wire as it is.
    with pytest.raises(BadInputError) as told:
        _evaluated(payload, x, serialized(poses))
    assert str(deserialized(serialized(told.value))) == str(told.value)


@pytest.mark.parametrize("address", ["local", "local:0", "local:x", "somewhere", ""])
def test_malformed_addresses_are_refused(address):
    with pytest.raises(BadInputError, match=r"--cluster is .*local:N"):
        DaskEvaluator(address)


def test_the_missing_extra_is_named(monkeypatch):
    def without(name):
        return None if name == "distributed" else found(name)

    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", without)
    with pytest.raises(BadInputError, match=r"pip install 'vinefab\[cluster\]'"):
        DaskEvaluator("local:2")


def test_a_small_run_stays_in_threads_and_says_why(small, maps, monkeypatch):
    def started(_):
        raise AssertionError("workers were started")

    monkeypatch.setattr(DaskEvaluator, "_client", started)
    cluster = DaskEvaluator("local:2")
    result, usual = Search.of(small, maps).run(workers=cluster), Search.of(small, maps).run()
    assert result.best == usual.best
    (note,) = [note for note in result.notes if note.startswith("cluster local:2: ")]
    assert "handed out 0 of 6 batches of designs; the last large one had " in note
    assert "s on 2 threads here" in note
    assert "s on 2 workers once they have started, 10 s (assumed)" in note
    assert result.times.workers == 2


def test_threads_beside_a_cluster():
    assert DaskEvaluator("local:3").threads == 3
    assert DaskEvaluator("tcp://host:1").threads == 1
    assert make_point_evaluator(5, "tcp://host:1").threads == 5  # type: ignore[attr-defined]
    assert make_point_evaluator(None, None).count == 1
    with pytest.raises(BadInputError, match="--workers is 0; allowed: 1 or more"):
        make_point_evaluator(0, None)


class Deserted:
    """A client of a cluster whose workers have all gone, or whose work kills them."""

    def __init__(self, error=None):
        self.error = error
        self.retried = 0

    def submit(self, *_, **__):
        return self

    @property
    def status(self):
        return "error"

    def done(self):
        return self.error is not None

    def nthreads(self):
        return {}

    def gather(self, _):
        assert self.error is not None
        raise self.error()

    def retry(self):
        self.retried += 1


def test_a_run_gives_up_without_workers(monkeypatch):
    monkeypatch.setattr(module.distributed, "wait", lambda *_, **__: None)
    with pytest.raises(
        WorkersLostError, match=r"no worker for 0\.01 s; --resume continues the recorded run"
    ):
        DaskEvaluator("local:2", patience_s=0.01)._gathered(Deserted(), [Deserted()])


def test_counting_starts_with_the_ledger():
    ledger = Ledger(1)
    assert ledger.worked_s == 0.0
    ledger.add(Work(making_s=1.0, scoring_s=0.5))
    ledger.add(Work(growth_s=0.25))
    assert ledger.worked_s == 1.75


class Shrinking:
    """A client whose workers come and go."""

    def __init__(self, *counts):
        self.counts = list(counts)
        self.waited: list[float] = []

    def submit(self, *_, **__):
        return self

    def done(self):
        return True

    def gather(self, _):
        return []

    def nthreads(self):
        return {"worker": self.counts.pop(0) if len(self.counts) > 1 else self.counts[0]}

    def wait_for_workers(self, _, timeout):
        self.waited.append(timeout)
        raise TimeoutError


@pytest.mark.parametrize(
    ("wait_s", "counts", "expected"), [(np.inf, (3, 2, 0), [3, 2, 2]), (0.0, (3, 0, 1), [3, 0, 1])]
)
def test_workers_are_counted_again_and_those_that_restart_are_waited_for(
    small, maps, monkeypatch, wait_s, counts, expected
):
    client, cluster = Shrinking(*counts), DaskEvaluator("tcp://host:1")
    monkeypatch.setattr(module, "POLL_S", -1.0)
    monkeypatch.setattr(DaskEvaluator, "_client", lambda _: nullcontext(client))
    payload = WorkerPayload.of(EvaluatorSpec(settings=small, maps=maps))
    with ExitStack() as stack:
        workers = module._DaskWorkers(cluster, stack, payload, Ledger(1))
        assert [workers.connect(wait_s=wait_s) for _ in range(3)] == expected
    assert client.waited == []


def test_a_run_that_may_not_compute_here_gives_up_without_a_first_worker(small, maps, monkeypatch):
    client, cluster = Shrinking(0), DaskEvaluator("tcp://host:1", threads=0, patience_s=7.0)
    monkeypatch.setattr(DaskEvaluator, "_client", lambda _: nullcontext(client))
    payload = WorkerPayload.of(EvaluatorSpec(settings=small, maps=maps))
    with ExitStack() as stack:
        workers = module._DaskWorkers(cluster, stack, payload, Ledger(1))
        assert workers.connect(wait_s=3.0) == 0  # so long the work would take here
        with pytest.raises(WorkersLostError, match="no worker within 7 s"):
            workers.connect(wait_s=np.inf)
    assert client.waited == [3.0, 7.0]
