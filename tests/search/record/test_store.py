"""Records of runs through interrupts, crashes and full disks."""

import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, cast

import numpy as np
import pytest

from tests.search.conftest import followed, made_generation, optimize
from tests.search.kill import content
from vinefab.core.atomic import is_ours
from vinefab.core.errors import BadInputError, CannotWriteError, UnreadableFileError
from vinefab.model.deployment import Deployment
from vinefab.search.evaluator import Ledger
from vinefab.search.record import store as module
from vinefab.search.record.generations import Generation, RunIdentity, SearchProgress
from vinefab.search.record.result import RECORD_FILE, RunArchive
from vinefab.search.record.store import Recorder, RunStore
from vinefab.search.run import run_search
from vinefab.search.settings import SearchSettings
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome


class InterruptedError(Exception):
    """In place of what ends a process between two generations."""


def recorded(folder, settings, maps, penalty=None, *, resume=False, stop_after=None):
    """Run into a folder, breaking off after some generations."""

    def interrupt(progress):
        if progress.done == stop_after:
            raise InterruptedError

    with RunStore.open(folder, RunIdentity.of(settings, maps), resume=resume) as store:
        return optimize(settings, maps, penalty=penalty, store=store, progress=interrupt)


def test_interrupted_runs_end_as_the_undisturbed_one(tmp_path, fabricable, maps, film_penalty):
    undisturbed = recorded(tmp_path / "whole", fabricable, maps, film_penalty)
    rng = np.random.default_rng(8)
    for trial in range(4):
        folder = tmp_path / f"trial{trial}"
        stops = sorted(set(rng.integers(1, 6, 2).tolist()))
        for stop in stops:
            with pytest.raises(InterruptedError):
                recorded(folder, fabricable, maps, film_penalty, resume=True, stop_after=stop)
        result = recorded(folder, fabricable, maps, film_penalty, resume=True)
        assert result.best == undisturbed.best
        assert result.score == undisturbed.score
        assert content(folder) == content(tmp_path / "whole")


def test_a_finished_run_is_read_back_without_computing(tmp_path, small, maps, monkeypatch):
    first = recorded(tmp_path, small, maps)

    def forbidden(*_):
        raise AssertionError("evaluated again")

    monkeypatch.setattr("vinefab.search.evaluator.Evaluator.begin", forbidden)
    second = recorded(tmp_path, small, maps, resume=True)
    assert second.best == first.best
    assert second.score == first.score
    assert [g.fitness.tolist() for g in second.history] == [
        g.fitness.tolist() for g in first.history
    ]
    assert {k: v.tolist() for k, v in second.history[1].terms.items()} == {
        k: v.tolist() for k, v in first.history[1].terms.items()
    }


def test_a_folder_with_a_run_is_refused_without_resume_and_nothing_is_lost(tmp_path, small, maps):
    with pytest.raises(InterruptedError):
        recorded(tmp_path, small, maps, stop_after=2)
    before = content(tmp_path)
    with pytest.raises(BadInputError, match="--resume"):
        recorded(tmp_path, small, maps)
    assert content(tmp_path) == before


def test_another_run_cannot_resume_a_record(tmp_path, small, maps):
    recorded(tmp_path, small, maps)
    other = small.changed(search=small.search.changed(seed=9))
    with pytest.raises(
        BadInputError, match=r"optimizer\.seed: 9 is asked for, and the run began with 3"
    ):
        recorded(tmp_path, other, maps, resume=True)
    with pytest.raises(BadInputError, match="maps are not those with which the run began"):
        recorded(tmp_path, small, maps[:1], resume=True)


def test_another_version_cannot_resume_a_record(tmp_path, small, maps):
    recorded(tmp_path, small, maps)
    identity = RunIdentity.of(small, maps)
    newer = replace(identity, versions={**identity.versions, "vinefab": "99.0"})
    with pytest.raises(BadInputError, match="began the run"):
        RunStore.open(tmp_path, newer, resume=True)


def test_the_record_is_recognized_as_ours_during_the_run(tmp_path, small, maps):
    with RunStore.open(tmp_path, RunIdentity.of(small, maps)):
        assert is_ours(tmp_path / RECORD_FILE)


@pytest.mark.parametrize("text", ["not a database, but long enough to be taken for one", ""])
def test_foreign_files_are_kept(tmp_path, small, maps, text):
    path = tmp_path / RECORD_FILE
    path.write_text(text)
    with pytest.raises(BadInputError):
        recorded(tmp_path, small, maps)
    if text:
        with pytest.raises(UnreadableFileError):
            recorded(tmp_path, small, maps, resume=True)
        assert path.read_text() == text


def test_a_foreign_database_is_kept(tmp_path, small, maps):
    connection = sqlite3.connect(tmp_path / RECORD_FILE)
    connection.execute("CREATE TABLE theirs (a)")
    connection.close()
    with pytest.raises(UnreadableFileError, match="not the record of a run"):
        recorded(tmp_path, small, maps, resume=True)


@dataclass
class Trunk:
    """A penalty on trunks beyond a length, after whose last call the user stops the run."""

    most_mm: float
    calls_left: int = 10**9

    def __call__(self, design):
        self.calls_left -= 1
        if self.calls_left < 0:
            raise KeyboardInterrupt
        return max(0.0, design.trunk_length_mm - self.most_mm) / 100.0

    def passes(self, design):
        return self(design) == 0.0


@pytest.fixture
def too_short_mm(fabricable, maps):
    """A trunk so short that the search finds none."""
    history = optimize(fabricable, maps, penalty=Trunk(most_mm=0.0)).history
    return min(100.0 * float(generation.penalty.min()) for generation in history) - 1.0


def stopped(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("place", ["run.reevaluated", "record.store.RunStore.finish"])
def test_a_run_stopped_at_its_finalists_ends_as_the_undisturbed_one(
    tmp_path, fabricable, maps, monkeypatch, place
):
    folder, penalty = tmp_path / "struck", Trunk(most_mm=150.0)
    recorded(tmp_path / "whole", fabricable, maps, penalty)
    with monkeypatch.context() as patch:
        patch.setattr(f"vinefab.search.{place}", stopped)
        with pytest.raises(KeyboardInterrupt):
            recorded(folder, fabricable, maps, penalty)
    assert len(content(folder)["generation"]) == 5
    assert content(folder)["finalist"] == []
    recorded(folder, fabricable, maps, penalty, resume=True)
    assert content(folder) == content(tmp_path / "whole")


def test_a_run_stopped_in_its_repair_ends_as_the_undisturbed_one(
    tmp_path, fabricable, maps, too_short_mm
):
    folder = tmp_path / "struck"
    whole = recorded(tmp_path / "whole", fabricable, maps, Trunk(most_mm=too_short_mm))
    assert "changes of the best 3: 3 of them are manufacturable now" in whole.repair
    # 30 designs are penalized by the search; what comes after is the repair.
    for calls in (31, 35):
        halfway = Trunk(most_mm=too_short_mm, calls_left=calls)
        with pytest.raises(KeyboardInterrupt):
            recorded(folder, fabricable, maps, halfway, resume=True)
        assert len(content(folder)["generation"]) == 5
        assert content(folder)["finalist"] == []
    for _ in range(2):  # the second time from the record alone
        again = recorded(folder, fabricable, maps, Trunk(most_mm=too_short_mm), resume=True)
        assert (again.best, again.repair) == (whole.best, whole.repair)
        assert content(folder) == content(tmp_path / "whole")


def test_a_second_process_is_refused_before_it_begins(tmp_path, small, maps):
    identity = RunIdentity.of(small, maps)
    with RunStore.open(tmp_path / "run", identity) as one:
        before = content(tmp_path / "run")
        with pytest.raises(CannotWriteError, match="another process is working on the same run"):
            RunStore.open(tmp_path / "run", identity, resume=True)
        assert content(tmp_path / "run") == before
        one.add([optimize(small, maps).history[0]], {"generation": 1})
    RunStore.open(tmp_path / "run", identity, resume=True).close()


def test_two_processes_cannot_write_the_same_generation(tmp_path, small, maps, monkeypatch):
    """Where the system has no locks, the record itself keeps two processes apart."""
    monkeypatch.setattr("vinefab.search.record.store.lock_folder", lambda *_: None)
    identity = RunIdentity.of(small, maps)
    with (
        RunStore.open(tmp_path, identity) as one,
        RunStore.open(tmp_path, identity, resume=True) as two,
    ):
        generation = optimize(small, maps).history[0]
        one.add([generation], {"generation": 1})
        with pytest.raises(CannotWriteError, match="another process"):
            two.add([generation], {"generation": 1})
        assert len(two.generations()) == 1


def test_a_record_created_for_a_refused_run_is_deleted(tmp_path, small, maps):
    identity, folder = RunIdentity.of(small, maps), tmp_path / "deep" / "run"

    def refuse(error, *, resume=False):
        with RunStore.open(folder, identity, resume=resume):
            raise error

    with pytest.raises(BadInputError):
        refuse(BadInputError("--cluster", "nowhere", "somewhere"))
    assert not (folder / RECORD_FILE).exists()
    # What stops a run from outside leaves what it has, and so does a run that had begun before.
    with pytest.raises(InterruptedError):
        refuse(InterruptedError())
    with pytest.raises(BadInputError):
        refuse(BadInputError("--cluster", "nowhere", "somewhere"), resume=True)
    assert (folder / RECORD_FILE).exists()


def test_a_folder_that_cannot_be_written_is_named(tmp_path, small, maps):
    (tmp_path / "file").write_text("x")
    with pytest.raises(CannotWriteError, match="file"):
        RunStore.open(tmp_path / "file" / "run", RunIdentity.of(small, maps))


def test_a_full_disk_keeps_what_was_recorded(tmp_path, small, maps):
    generations = optimize(small, maps).history
    with RunStore.open(tmp_path, RunIdentity.of(small, maps)) as store:
        store.add([generations[0]], {"generation": 1})
        # SQLite's own limit on the file's size answers as a full disk does.
        pages = store._connection.execute("PRAGMA page_count").fetchone()[0]
        store._connection.execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(CannotWriteError, match="full"):
            store.add([generations[1]], {"generation": "x" * 100_000})
        assert len(store.generations()) == 1
        assert store.optimizer_state() == {"generation": 1}


def test_an_interrupt_as_a_transaction_begins_leaves_the_record_usable(tmp_path, small, maps):
    history = optimize(small, maps).history

    class Interrupted:
        """A connection that is interrupted just after its transaction began."""

        def __init__(self, connection):
            self.real, self.is_hit = connection, False

        def execute(self, text, *values):
            found = self.real.execute(text, *values)
            if text.startswith("BEGIN") and not self.is_hit:
                self.is_hit = True
                raise KeyboardInterrupt
            return found

        def __getattr__(self, name):
            return getattr(self.real, name)

    with RunStore.open(tmp_path, RunIdentity.of(small, maps)) as store:
        store._connection = Interrupted(store._connection)  # type: ignore[assignment]
        with pytest.raises(KeyboardInterrupt):
            store.add(history[:1], {"generation": 1})
        assert store.recorded == 0
        store.add(history[:2], {"generation": 2})
        assert store.recorded == 2


def test_an_interrupt_while_a_record_is_closed_leaves_it_to_the_next(tmp_path, small, maps):
    class Interrupted:
        def close(self):
            raise KeyboardInterrupt

    identity = RunIdentity.of(small, maps)
    store = RunStore.open(tmp_path, identity)
    store._connection.close()
    store._connection = Interrupted()  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        store.close()
    RunStore.open(tmp_path, identity, resume=True).close()


SEARCH = SearchSettings(population=3, generations=10)


class FakeStore:
    """In place of the record."""

    def __init__(self):
        self.entries: list[tuple[list[int], object]] = []

    def add(self, generations, state, times):
        assert times.total_s >= 0.0
        self.entries.append(([g.number for g in generations], state["generation"]))

    @property
    def recorded(self):
        return sum(len(numbers) for numbers, _ in self.entries)


def interrupted(recorder):
    """Record six generations, the last of which is never finished."""
    history = list[Generation]()
    with recorder:
        for number in range(6):
            recorder.write()
            if number == 5:
                raise KeyboardInterrupt
            history.append(made_generation(number, (0.1, 1.0 / (number + 1), 0.0)))
            recorder.note(history, {"generation": number + 1})


def kept(pause_s, monkeypatch):
    """Return the record of an interrupted run, and its progress reports."""
    monkeypatch.setattr(module, "_PAUSE_S", pause_s)
    store, reports = FakeStore(), list[SearchProgress]()
    with pytest.raises(KeyboardInterrupt), followed(reports.append):
        interrupted(Recorder(store, SEARCH, Ledger(1)))
    return store, reports


def test_slow_generations_are_recorded_one_by_one(monkeypatch):
    store, _ = kept(0.0, monkeypatch)
    assert store.entries == [([number], number + 1) for number in range(5)]


def test_fast_generations_are_recorded_together_and_none_is_lost(monkeypatch):
    store, _ = kept(60.0, monkeypatch)
    assert [number for entry, _ in store.entries for number in entry] == list(range(5))
    assert len(store.entries) < 5
    assert all(state == numbers[-1] + 1 for numbers, state in store.entries)


def test_every_generation_is_reported_with_the_run_so_far(monkeypatch):
    _, reports = kept(60.0, monkeypatch)
    assert [progress.done for progress in reports] == [1, 2, 3, 4, 5]
    assert {progress.best for progress in reports} == {1.0}
    assert reports[-1].elapsed_s == 10.0
    assert reports[-1].left_s == 10.0
    assert reports[-1].mean == pytest.approx((0.1 + 0.2) / 3)


def test_a_record_that_cannot_be_written_ends_the_run_with_its_own_error():
    class Full(FakeStore):
        def add(self, *_):
            raise OSError("full")

    recorder = Recorder(Full(), SEARCH, Ledger(1))
    with pytest.raises(OSError, match="full"):
        interrupted(recorder)


@pytest.mark.parametrize("when", ["before it is done", "after it is done"])
def test_an_interrupt_while_recording_costs_nothing(when, monkeypatch):
    class Interrupted(FakeStore):
        def add(self, generations, state, times):
            is_third = len(self.entries) == 2 and not hits
            if not is_third or when == "after it is done":
                super().add(generations, state, times)
            if is_third:
                hits.append(1)
                raise KeyboardInterrupt

    monkeypatch.setattr(module, "_PAUSE_S", 0.0)
    hits: list[int] = []
    store = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        interrupted(Recorder(store, SEARCH, Ledger(1)))
    assert store.entries == [([0], 1), ([1], 2), ([2], 3)]


def test_an_interrupt_while_noting_leaves_no_generation_with_the_state_before_it():
    class Slow(dict[str, object]):
        def items(self):
            raise KeyboardInterrupt

    store, history = (
        FakeStore(),
        [made_generation(0), made_generation(1)],
    )
    recorder = Recorder(store, SEARCH, Ledger(1))
    recorder.note(history[:1], {"generation": 1})
    with pytest.raises(KeyboardInterrupt), recorder:
        recorder.note(history, Slow(generation=2))
    assert store.entries == [([0], 1)]


def test_later_changes_of_an_optimizers_state_are_not_recorded():
    entries: list[Mapping[str, object]] = []

    class Keeping(FakeStore):
        def add(self, generations, state, times):
            super().add(generations, {"generation": 1}, times)
            entries.append(state)

    state: dict[str, object] = {"place": np.zeros(2), "numbers": [[1]]}
    with Recorder(Keeping(), SEARCH, Ledger(1)) as recorder:
        recorder.note([made_generation(0)], state)
        cast("np.ndarray", state["place"])[:] = 7.0
        cast("list[list[int]]", state["numbers"])[0].append(2)
    assert [(list(e["place"]), e["numbers"]) for e in entries] == [([0.0, 0.0], [[1]])]


@dataclass(frozen=True)
class Film:
    """A task of the user's own, with a parameter."""

    unit_mm: float = 1000.0
    name: ClassVar[str] = "film"
    lowest: ClassVar[float] = 0.0

    def evaluate(self, deployment: Deployment, ground: MapContext) -> Outcome:  # noqa: ARG002
        return float(deployment.grown_mm.sum()) / self.unit_mm, {}


def test_a_run_for_a_task_object_is_recorded_and_resumed_only_with_the_same_task(tmp_path, small):
    whole = run_search(small, tmp_path / "whole", task=Film())

    def interrupt(progress):
        if progress.done == 2:
            raise KeyboardInterrupt

    folder = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt), followed(interrupt):
        run_search(small, folder, task=Film())
    with pytest.raises(
        BadInputError,
        match=r"task\.parameters\.unit_mm: 1\.0 is asked for, and the run began with 1000\.0",
    ):
        run_search(small, folder, task=Film(unit_mm=1.0), resume=True)
    with pytest.raises(
        BadInputError, match=r"task\.name: 'coverage' is asked for, and the run began with 'film'"
    ):
        run_search(small, folder, resume=True)
    assert run_search(small, folder, task=Film(), resume=True).best == whole.best
    assert RunArchive.read(folder / RECORD_FILE).result().best == whole.best


CHANGES = {
    "generation": "UPDATE generation SET fitness = (SELECT composite FROM generation WHERE "
    "number = 0), composite = fitness WHERE number = 2",
    "time": "UPDATE generation SET seconds = seconds + 1.0 WHERE number = 2",
    "term": "UPDATE term SET value = zeroblob(length(value)) WHERE generation = 2",
    "taken away": "DELETE FROM generation WHERE number = 2",
    "taken with its digest": "DELETE FROM generation WHERE number = 2; "
    "DELETE FROM digest WHERE part = 'generation' AND number = 2",
    "all after it": "DELETE FROM generation WHERE number >= 2",
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_record_with_a_changed_row_is_refused_by_its_generation(tmp_path, small, maps, change):
    with pytest.raises(InterruptedError):
        recorded(tmp_path, small, maps, stop_after=4)
    with sqlite3.connect(tmp_path / RECORD_FILE) as connection:
        connection.executescript(CHANGES[change])
    connection.close()
    words = r"run\.sqlite: is damaged .*\(generation 3 is not as it was recorded"
    with pytest.raises(UnreadableFileError, match=words):
        recorded(tmp_path, small, maps, resume=True)
    with pytest.raises(UnreadableFileError, match=words):
        RunArchive.read(tmp_path / RECORD_FILE)


@pytest.mark.parametrize(
    ("part", "change"),
    [
        ("finalists", "UPDATE finalist SET place = 1 - place WHERE place < 0; "
                      "UPDATE finalist SET fitness = fitness + 1.0 WHERE place = 0"),
        ("finalists", "DELETE FROM finalist WHERE place = 0"),
    ],
)  # fmt: skip
def test_a_record_with_changed_finalists_is_refused(tmp_path, small, maps, part, change):
    recorded(tmp_path, small, maps)
    with sqlite3.connect(tmp_path / RECORD_FILE) as connection:
        connection.executescript(change)
    connection.close()
    with pytest.raises(UnreadableFileError, match=f"its part {part} is not as it was recorded"):
        recorded(tmp_path, small, maps, resume=True)
    with pytest.raises(UnreadableFileError, match=f"its part {part} is not as it was recorded"):
        RunArchive.read(tmp_path / RECORD_FILE)


def test_a_changed_state_of_the_optimizer_is_refused(tmp_path, small, maps):
    with pytest.raises(InterruptedError):
        recorded(tmp_path, small, maps, stop_after=2)
    with sqlite3.connect(tmp_path / RECORD_FILE) as connection:
        connection.execute("UPDATE optimizer SET state = state || ' '")
    connection.close()
    with pytest.raises(UnreadableFileError, match="its part optimizer is not as it was recorded"):
        recorded(tmp_path, small, maps, resume=True)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("DROP TABLE digest", "no such table: digest"),
        ("DELETE FROM digest", "generation 1 is not as it was recorded"),
        ("DELETE FROM digest WHERE part = 'optimizer'", "its part optimizer is not as"),
    ],
)
def test_a_record_without_digests_is_refused(tmp_path, small, maps, change, words):
    with pytest.raises(InterruptedError):
        recorded(tmp_path, small, maps, stop_after=2)
    with sqlite3.connect(tmp_path / RECORD_FILE) as connection:
        connection.execute(change)
    connection.close()
    with pytest.raises(UnreadableFileError, match=words):
        recorded(tmp_path, small, maps, resume=True)
