"""Clusters: the same results, lost workers, access, and where a generation is evaluated."""

import json
import math
import subprocess
import sys
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from vinefab.core.errors import BadInputError, MissingPackageError, WorkersLostError
from vinefab.core.extras import EXTRAS
from vinefab.search import dask_cluster
from vinefab.search import dask_cluster as module
from vinefab.search.dask_cluster import (
    DaskEvaluator,
    HandingOut,
    Pace,
    PlacedRun,
    WorkerPayload,
    _evaluated,
    deserialized,
    least_unit_s,
    serialized,
    unit_rows,
)
from vinefab.search.evaluator import (
    TRAINING,
    Evaluations,
    Evaluator,
    EvaluatorSpec,
    Ledger,
    ThreadEvaluator,
)
from vinefab.search.run import Search, make_point_evaluator
from vinefab.search.settings import PartSettings
from vinefab.tasks.reach import Reach

PROGRAM = """
import os, signal, sys
from pathlib import Path
from vinefab.core.progress import heard_by
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
        if progress.done in (2, 4):
            pids = sorted(Client.current().run(os.getpid).values())
            for pid in pids[: progress.done // 2]:
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
        if progress.done == 5:
            # As if dask had not started them again: none is left, and none would come.
            Client.current().cluster.scale(0)

    module.RESTART_S = 5.0
    threads = search(settings, Path(sys.argv[2]) / "threads")
    workers = DaskEvaluator("local:2", threads=0, patience_s=500.0)
    with heard_by(lambda now: tell(now) if now.phase == "generations" else None):
        cluster = search(settings, Path(sys.argv[2]) / "cluster", workers=workers)
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


@pytest.mark.parametrize("task", [None, Reach(buffer_mm=25.0)], ids=["named", "object"])
def test_a_worker_finds_what_the_run_would_find(fabricable, maps, task):
    spec = EvaluatorSpec(settings=fabricable, maps=maps, penalty=LongTrunk(), task=task)
    evaluator = Evaluator.of(spec)
    x = np.random.default_rng(1).random((module.TOGETHER + 5, len(evaluator.space)))
    poses = evaluator.conditions(3, TRAINING, 0, 2)
    found, work = deserialized(_evaluated(WorkerPayload.of(evaluator.spec), x, serialized(poses)))
    expected, _ = evaluator.evaluate(x, poses)
    np.testing.assert_array_equal(found.score, expected.score)
    np.testing.assert_array_equal(found.penalty, expected.penalty)
    assert {name: v.tolist() for name, v in found.terms.items()} == {
        name: v.tolist() for name, v in expected.terms.items()
    }
    assert min(work.making_s, work.growth_s, work.scoring_s) > 0.0
    assert ("reached_mm2" in found.terms) is (task is not None)


def test_tasks_and_penalties_that_cannot_be_sent_are_named(fabricable, maps):
    class Local(Reach):
        pass

    for local in ({"task": Local(), "penalty": LongTrunk()}, {"penalty": lambda _: 0.0}):
        with pytest.raises(BadInputError, match="penalty or task cannot be pickled"):
            WorkerPayload.of(EvaluatorSpec(settings=fabricable, maps=maps, **local))


def test_read_only_views_can_be_sent(maps):
    again = deserialized(serialized(maps[0]))
    assert again.facts == maps[0].facts
    assert type(again.facts) is type(maps[0].facts)


def test_a_worker_with_other_versions_refuses(small, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps))
    payload = WorkerPayload.of(evaluator.spec)
    strange = replace(payload, versions={**payload.versions, "numpy": "0.1"})
    x, poses = np.full((1, len(evaluator.space)), 0.5), evaluator.conditions(3, TRAINING, 0, 1)
    with pytest.raises(BadInputError, match=r"it has numpy .*, and the run 0\.1"):
        _evaluated(strange, x, serialized(poses))


def test_a_worker_without_the_packages_of_the_run_is_named(small, maps):
    theirs = small.changed(task=PartSettings(name="depth"))
    payload = WorkerPayload.of(EvaluatorSpec(settings=theirs, maps=maps, penalty=None))
    x, poses = np.full((1, 3), 0.5), ((), ())
    with pytest.raises(BadInputError, match=r"a worker: it has no task 'depth'.*same packages"):
        _evaluated(payload, x, serialized(poses))
    gone = replace(payload, name="gone", spec=b"cno_such_package\nPenalty\n.")
    with pytest.raises(BadInputError, match=r"it is incomplete: .*no_such_package.*same packages"):
        _evaluated(gone, x, serialized(poses))
    # It comes through the wire as it is.
    with pytest.raises(BadInputError) as told:
        _evaluated(payload, x, serialized(poses))
    assert str(deserialized(serialized(told.value))) == str(told.value)


@pytest.mark.parametrize("address", ["local", "local:0", "local:x", "somewhere", ""])
def test_malformed_addresses_are_refused(address):
    with pytest.raises(BadInputError, match=r"--cluster is .*local:N"):
        DaskEvaluator(address)


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
    """A client of a cluster, and its work, whose workers have all gone."""

    def done(self):
        return False

    def nthreads(self):
        return {}


def test_a_run_gives_up_without_workers(monkeypatch):
    monkeypatch.setattr(module.distributed, "wait", lambda *_, **__: None)
    with pytest.raises(
        WorkersLostError, match=r"no worker for 0\.01 s; --resume continues the recorded run"
    ):
        DaskEvaluator("local:2", patience_s=0.01)._gathered(Deserted(), [Deserted()])


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


COSTS = HandingOut(round_trip_s=0.01, per_unit_s=0.001)


@pytest.mark.parametrize("workers", [1, 2, 7, 256])
@pytest.mark.parametrize("count", [1, 3, 1000])
def test_work_units_have_every_point_once_and_heavy_ones_first(workers, count):
    weights = np.random.default_rng(1).lognormal(size=count)
    units = unit_rows(weights, workers, least=0.0)
    assert sorted(np.concatenate(units).tolist()) == list(range(count))
    assert min(count, workers) <= len(units) <= count
    done = weights[np.concatenate(units)]
    assert (np.diff(done) <= 0.0).all()


def test_only_points_that_are_units_by_themselves_are_sorted():
    weights = np.array([1.0, 5.0, 2.0, 9.0, 1.5, 2.5])
    units = unit_rows(weights, 2, least=4.0)
    assert np.concatenate(units).tolist() == [3, 1, 0, 2, 4, 5]
    assert units[0].tolist() == [3]


def test_no_unit_holds_up_the_end():
    weights = np.random.default_rng(1).lognormal(size=1000)
    work = [float(weights[rows].sum()) for rows in unit_rows(weights, 4, least=10.0)]
    assert max(work[-4:]) <= max(10.0 + weights.max(), 0.02 * weights.sum())


def test_work_units_get_smaller_but_not_below_the_least():
    units = unit_rows(np.ones(1000), 2, least=20.0)
    sizes = [len(rows) for rows in units]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == 333
    assert min(sizes[:-1]) == 20
    assert [len(rows) for rows in unit_rows(np.ones(10), 4, least=1e9)] == [10]
    # As long as nothing is known of the work, every worker gets the same.
    unknown = Pace(threads=0, workers=4, costs=COSTS, work_s=0.0)
    assert [len(rows) for rows in unknown.units(np.ones(100))] == [25, 25, 25, 25]


def test_the_least_unit_is_worth_its_cost() -> None:
    # Few workers: handing out takes a twentieth of the work.
    assert least_unit_s(40.0, 2, COSTS) == pytest.approx(0.02)
    # More: while each does one unit, a unit can be handed out to all.
    assert least_unit_s(40.0, 100, COSTS) == pytest.approx(0.1)
    # Too many: handing out all units takes as long as one of them, with 200 of 10,000 workers.
    assert least_unit_s(40.0, 10_000, COSTS) == pytest.approx(0.2)
    few = Pace(threads=1, workers=10_000, costs=COSTS, work_s=0.04)
    assert len(few.units(np.ones(1000))) == 200


def test_a_generation_goes_where_it_is_done_sooner():
    pace = Pace(threads=1, workers=8, costs=COSTS, work_s=0.001)
    assert not pace.goes_there(np.ones(5), 100)  # 6 ms here, more than a round trip
    assert pace.goes_there(np.ones(1000), 1)
    assert replace(pace, threads=0).goes_there(np.ones(5), 1)
    assert not replace(pace, workers=0).goes_there(np.ones(1000), 1)
    # What was measured counts: eight slow workers, or very fast threads.
    assert not replace(pace, there_s=0.01).goes_there(np.ones(1000), 1)
    assert not replace(pace, here_s=0.0001).goes_there(np.ones(1000), 1)
    # A start must be paid back by the generations to come.
    unstarted = replace(pace, costs=replace(COSTS, start_s=10.0))
    assert not unstarted.goes_there(np.ones(1000), 5)
    assert unstarted.goes_there(np.ones(1000), 50)


def test_the_pace_is_that_of_the_last_generation():
    pace = Pace(threads=2, workers=4, costs=COSTS, work_s=1.0)
    weights = np.full(10, 2.0)
    here = pace.after(weights, 5.0, 8.0, there=False)
    assert (here.work_s, here.seconds_here(20.0), here.there_s) == (0.4, 5.0, None)
    there = here.after(weights, 3.0, 8.0, there=True)
    assert there.seconds_there(weights) == pytest.approx(3.0)
    assert there.seconds_here(20.0) == 5.0
    # The first time, workers load code: that says nothing of the work.
    assert pace.after(weights, None, 8.0, there=True) == pace


@dataclass
class Neighbours:
    """Workers that evaluate in this process what they are handed out."""

    evaluator: Evaluator
    there: list[int]  # how many there are at each call; the last stays
    start_s: float = 0.0
    waited_s: list[float] = field(default_factory=list)
    units: list[int] = field(default_factory=list)

    def connect(self, *, wait_s):
        self.waited_s.append(wait_s)
        return self.there.pop(0) if len(self.there) > 1 else self.there[0]

    def costs(self):
        return replace(COSTS, per_unit_s=1e-6, round_trip_s=1e-6, start_s=self.start_s)

    def begin(self, x, conditions, units):
        self.units.append(len(units))
        parts = [self.evaluator.evaluate(x[rows], conditions)[0] for rows in units]
        back = np.argsort(np.concatenate(units))
        return lambda: Evaluations.concatenated(parts).reordered(back)


@pytest.mark.parametrize("threads", [0, 1])
def test_results_are_those_of_threads_wherever_points_go(small, maps, threads):
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps))
    ledger, remote = Ledger(1), Neighbours(evaluator, there=[0, 8])
    x = np.random.default_rng(1).random((400, len(evaluator.space)))
    conditions = [evaluator.conditions(3, TRAINING, generation, 4) for generation in range(3)]
    with ThreadEvaluator(1).started(evaluator, ledger) as here:
        workers = remote.connect(wait_s=0.0) if threads else remote.connect(wait_s=0.0) + 8
        run = PlacedRun(evaluator, ledger, remote, here=here, threads=threads, workers=workers)
        found = [run.begin(x, met)() for met in conditions]
    for one, met in zip(found, conditions, strict=True):
        usual, _ = evaluator.evaluate(x, met)
        assert one.score.tobytes() == usual.score.tobytes()
        assert list(one.terms) == list(usual.terms)
        assert all(one.terms[n].tobytes() == usual.terms[n].tobytes() for n in usual.terms)
    assert remote.units
    assert all(count >= 8 for count in remote.units)
    if threads:
        # Workers were looked for as long as the points take here, and found.
        assert all(0.0 <= seconds < 60.0 for seconds in remote.waited_s)
        assert f"handed out {len(remote.units)} of 3 batches" in run.decision
    else:
        assert remote.waited_s[1:] == [math.inf] * 3
        assert run.decision == "handed out 3 of 3 batches of designs; as --workers 0 asks"


def test_workers_are_used_only_when_the_run_to_come_pays_for_their_start(small, maps):
    long = small.changed(search=small.search.changed(generations=1000))
    x, workers = np.random.default_rng(1).random((200, 16)), 8
    for settings, start_s, used in ((small, 50.0, False), (long, 0.5, True)):
        evaluator = Evaluator.of(EvaluatorSpec(settings=settings, maps=maps))
        points = x[:, : len(evaluator.space)]
        conditions = [evaluator.conditions(3, TRAINING, number, 4) for number in range(3)]
        remote = Neighbours(evaluator, there=[workers], start_s=start_s)
        ledger = Ledger(1)
        with ThreadEvaluator(1).started(evaluator, ledger) as here:
            run = PlacedRun(evaluator, ledger, remote, here=here, threads=1, workers=workers)
            for met in conditions:
                run.begin(points, met)()
        assert (len(remote.units) > 0) is used
        assert (run.pace.costs.start_s == 0.0) is used
        assert ("once they have started" in run.decision) is not used


ACCESS_PROGRAM = """
import gc, http.client, json, os, stat, sys, time
from pathlib import Path

import dask, psutil
from distributed import Client, get_worker
from distributed.security import Security

from vinefab.search.dask_cluster import DaskEvaluator

def ports():
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return [
        (process.pid != os.getpid(), connection.laddr.port)
        for process in processes
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
    ]

def status(port, path):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=2)
    try:
        connection.request("GET", path)
        return connection.getresponse().status
    except (OSError, http.client.HTTPException):
        return None
    finally:
        connection.close()

def answers(client):
    # Linux lists sockets piece by piece, while other programs open and close some: one may miss.
    addresses = client.scheduler_info()["workers"]
    wanted, end = {(True, int(one.rpartition(":")[2])) for one in addresses}, time.monotonic() + 60
    while not wanted <= set(found := ports()) and time.monotonic() < end:
        time.sleep(0.05)
    paths = ["/health", "/info", "/status", "/metrics", "/sitemap.json"]
    asked = [(worker, port, path, status(port, path)) for worker, port in found for path in paths]
    # A port that was closed meanwhile may have been given to another program, which answers.
    still = {port for _, port in ports()}
    return [answer for answer in asked if answer[1] in still or answer[-1] is None]

def admitted(address, security=None):
    try:
        with Client(address, security=security, timeout=1.5) as client:
            return client.submit(os.getpid).result(timeout=5)
    except (OSError, TypeError):  # TypeError: no certificates at all
        return None
    finally:
        # dask hangs where what is left of a refused client is deleted while another starts.
        gc.collect()

def folder_modes():
    folder = Path(get_worker().local_directory)
    return [oct(stat.S_IMODE(path.stat().st_mode)) for path in list(folder.parents)[:2]]

def main():
    seen = {}
    with DaskEvaluator("local:1")._client() as client:
        client.wait_for_workers(1)
        address = client.scheduler.address
        bare = address.split("://")[1]
        seen["address"] = address
        seen["folder_modes"] = client.submit(folder_modes).result()
        seen["answers"] = answers(client)
        for thing, name in (("plain", f"tcp://{bare}"), ("tls", address)):
            seen[f"{thing} without"] = admitted(name)
        worker = next(iter(client.scheduler_info()["workers"])).split("://")[1]
        seen["plain at the worker"] = admitted(f"tcp://{worker}")
        seen["tls with others"] = admitted(address, Security.temporary())

        folder, own = Path(sys.argv[1]), client.security
        files = {"ca-file": own.tls_ca_file, "client.cert": own.tls_client_cert,
                 "client.key": own.tls_client_key}
        for name, content in files.items():
            (folder / name).write_text(content)
        named = {f"distributed.comm.tls.{name}": str(folder / name) for name in files}
        with dask.config.set(named), DaskEvaluator(address)._client() as other:
            seen["tls with its files"] = other.submit(len, "abc").result(timeout=5)

        client.restart(timeout=60)
        seen["answers of another worker"] = answers(client)
    (Path(sys.argv[1]) / "seen.json").write_text(json.dumps(seen))

if __name__ == "__main__":
    main()
"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What a program sees that tries to get into a local cluster."""
    folder = tmp_path_factory.mktemp("access")
    program = folder / "program.py"
    program.write_text(ACCESS_PROGRAM)
    command = [sys.executable, program, folder]
    subprocess.run(command, check=True, timeout=120)
    return json.loads((folder / "seen.json").read_text())


def test_a_local_cluster_admits_only_its_own_run(seen):
    assert seen["address"].startswith("tls://127.0.0.1:")
    for stranger in ("plain without", "plain at the worker", "tls without", "tls with others"):
        assert seen[stranger] is None, stranger


@pytest.mark.parametrize("moment", ["answers", "answers of another worker"])
def test_nothing_answers_over_http(seen, moment):
    assert {worker for worker, *_ in seen[moment]} == {True, False}
    assert [answer for answer in seen[moment] if answer[-1] is not None] == []


def test_nobody_else_can_change_what_workers_import(seen):
    assert seen["folder_modes"][-1] == "0o700"


def test_a_scheduler_with_tls_takes_its_files_from_dask_s_settings(seen):
    assert seen["tls with its files"] == 3


@pytest.fixture
def tls_files(tmp_path):
    """Return a function that names files for TLS in dask's settings."""
    import dask  # noqa: PLC0415 - an extra
    import distributed  # noqa: F401, PLC0415 - it loads its settings

    def named(**contents):
        settings = dict.fromkeys(("ca_file", "client.cert", "client.key"))
        for name, content in contents.items():
            path = tmp_path / name
            if content is not None:
                path.write_text(content)
            settings[name.replace("client_", "client.")] = str(path)
        tls = {
            f"distributed.comm.tls.{name.replace('_', '-')}": settings[name] for name in settings
        }
        return dask.config.set(tls)

    return named


PEM = "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"


@pytest.mark.parametrize(
    ("contents", "problem"),
    [
        ({}, "CA_FILE is not set"),
        ({"ca_file": PEM}, "CLIENT__CERT is not set"),
        ({"ca_file": None}, "No such file or directory: .*ca_file"),
        ({"ca_file": PEM, "client_cert": PEM, "client_key": None}, "No such file.*client_key"),
        (
            {"ca_file": "x", "client_cert": "x", "client_key": "x"},
            r"(\[SSL|\[X509|SSL:|certificate)[^)]*\)",
        ),
        ({"ca_file": PEM, "client_cert": PEM}, r"(\[SSL|\[X509|SSL:|certificate)[^)]*\)"),
    ],
)
@pytest.mark.parametrize("kind", ["address", "file"])
def test_missing_and_wrong_tls_files_are_one_line(tls_files, tmp_path, contents, problem, kind):
    address = "tls://127.0.0.1:9"
    if kind == "file":
        (tmp_path / "scheduler.json").write_text(json.dumps({"address": address}))
        address = str(tmp_path / "scheduler.json")
    with (
        tls_files(**contents),
        pytest.raises(BadInputError, match=f"--cluster is .*tls://HOST:PORT.*{problem}") as told,
        DaskEvaluator(address)._client(),
    ):
        pass
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("needed", EXTRAS["cluster"])
def test_all_that_the_extra_installs_is_needed(monkeypatch, needed):
    monkeypatch.setitem(sys.modules, needed, None)
    with pytest.raises(MissingPackageError, match=r"pip install 'vinefab\[cluster\]'"):
        DaskEvaluator("local:2")


def test_tls_files_are_named_in_the_documents():
    text = (Path(__file__).parents[2] / "docs" / "long_runs.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in dask_cluster.TLS_FILES)
