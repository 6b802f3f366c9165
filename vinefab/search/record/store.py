"""Writing the record of a run: one SQLite file, consistent after a crash at any moment."""

import json
import math
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vinefab.core.atomic import folder_to_fill, lock_folder
from vinefab.core.codec import Record, from_json, json_of
from vinefab.core.errors import (
    BadInputError,
    UnfitInputError,
    UnknownNameError,
    UnreadableFileError,
)
from vinefab.core.plain_text import GENERATOR
from vinefab.core.progress import announce, is_heard
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.search.evaluator import Ledger, TimeSplit
from vinefab.search.record.generations import (
    Extension,
    Finalist,
    Generation,
    RunIdentity,
    SearchProgress,
)
from vinefab.search.record.result import (
    BUSY,
    EXTENSION_TABLE,
    RECORD_FILE,
    RECORD_SCHEMA,
    R,
    chained_digest,
    damage_errors,
    ensure_recorded,
    last_digest,
    map_to_text,
    read_extensions,
    read_finalists,
    read_generations,
    recorded_entry,
    recorded_identity,
    state_from_text,
    state_to_text,
    system_errors,
    to_blob,
)
from vinefab.search.settings import SearchSettings
from vinefab.search.space import DesignSpace

# SQLite stores these texts in the first page of the file, where the mark identifies it as ours.
_TABLES = (
    f"CREATE TABLE run (/* {GENERATOR} */ key TEXT PRIMARY KEY, value TEXT NOT NULL)",
    "CREATE TABLE map (place INTEGER PRIMARY KEY, content TEXT NOT NULL)",
    "CREATE TABLE session (number INTEGER PRIMARY KEY, began_utc TEXT NOT NULL, "
    "versions TEXT NOT NULL, seconds TEXT NOT NULL)",
    "CREATE TABLE generation (number INTEGER PRIMARY KEY, x BLOB NOT NULL, fitness BLOB NOT NULL, "
    "composite BLOB NOT NULL, penalty BLOB NOT NULL, seconds REAL NOT NULL)",
    "CREATE TABLE term (generation INTEGER NOT NULL, name TEXT NOT NULL, value BLOB NOT NULL, "
    "PRIMARY KEY (generation, name))",
    "CREATE TABLE optimizer (only INTEGER PRIMARY KEY CHECK (only = 1), state TEXT NOT NULL)",
    "CREATE TABLE finalist (place INTEGER PRIMARY KEY, x BLOB NOT NULL, penalty REAL NOT NULL, "
    "fitness REAL NOT NULL, score TEXT NOT NULL)",
    # By part: of every generation, chained with the one before; of the optimizer's state and of the
    # finalists, number 0, chained with the last generation.
    "CREATE TABLE digest (part TEXT NOT NULL, number INTEGER NOT NULL, value TEXT NOT NULL, "
    "PRIMARY KEY (part, number))",
)


class RunStore:
    """A run's record, open for reading and writing.

    Every generation is one transaction, together with the optimizer's state after it: after any
    crash the file holds complete generations and the state to resume from.

    Attributes
    ----------
    drift
        Packages with other versions than when the run began, one message each.
    extensions
        Each time that the limits of the run were raised.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, identity: RunIdentity) -> None:
        self.path = path
        self.identity = identity
        self.drift: tuple[str, ...] = ()
        self.extensions: tuple[Extension, ...] = ()
        self._connection = connection
        self._session = 0
        self._lock: int | None = None
        self._is_new = False

    @classmethod
    def open(
        cls,
        folder: Path,
        identity: RunIdentity,
        *,
        maps: Sequence[Map] = (),
        resume: bool = False,
        raises_limits: bool = False,
    ) -> "RunStore":
        """Open the record in a folder, or begin a new one.

        Parameters
        ----------
        raises_limits
            Whether the identity may have other limits than the record, which then has them too.

        Raises
        ------
        BadInputError
            Where a record is there and is not to be resumed, or is of another run.
        CannotWriteError
            Where it cannot be written, or another process has it open.
        """
        path = folder / RECORD_FILE
        if path.exists() and not resume:
            raise UnfitInputError(
                "--out", f"{folder} holds a run", "give another folder, or --resume"
            )
        with folder_to_fill(folder):
            lock = lock_folder(folder, BUSY)
            is_new = not path.exists()
            try:
                with system_errors(path):
                    connection = sqlite3.connect(path, isolation_level=None)
                store = cls(path, connection, identity)
                store._lock, store._is_new = lock, is_new
            except BaseException:
                _unlock(lock)
                raise
            try:
                store._begin(maps, raises_limits=raises_limits)
            except BaseException:
                store._close(remove=is_new)
                raise
        return store

    def generations(self) -> list[Generation]:
        """Return every generation recorded, in order."""
        with damage_errors(self.path):
            return read_generations(self._connection)

    @property
    def recorded(self) -> int:
        """Number of generations recorded."""
        with system_errors(self.path):
            row = self._connection.execute("SELECT count(*) FROM generation").fetchone()
        return int(row[0])

    def optimizer_state(self) -> Mapping[str, object]:
        """Return the optimizer's state after the last generation recorded."""
        with damage_errors(self.path):
            row = self._connection.execute("SELECT state FROM optimizer").fetchone()
            if row is None:
                raise UnreadableFileError(self.path, "the optimizer's state is missing")
            ensure_recorded(self._connection, "optimizer", row)
            return state_from_text(row[0])

    def add(
        self,
        generations: Sequence[Generation],
        state: Mapping[str, object],
        times: TimeSplit | None = None,
    ) -> None:
        """Record generations and the optimizer's state after the last one, all or nothing."""
        rows = [
            (g.number, *map(to_blob, (g.x, g.fitness, g.composite, g.penalty)), float(g.seconds))
            for g in generations
        ]
        terms = [[(name, to_blob(v)) for name, v in g.terms.items()] for g in generations]
        named = [(row[0], *one) for row, some in zip(rows, terms, strict=True) for one in some]
        text = state_to_text(state)
        with self._transaction() as connection:
            connection.executemany("INSERT INTO generation VALUES (?, ?, ?, ?, ?, ?)", rows)
            connection.executemany("INSERT INTO term VALUES (?, ?, ?)", named)
            connection.execute("INSERT OR REPLACE INTO optimizer VALUES (1, ?)", (text,))
            self._record_digests(list(zip(rows, terms, strict=True)))
            self._record_digest("optimizer", (text,))
            self._record_times(times)

    def finish(
        self,
        finalists: Sequence[Finalist],
        stopped: str,
        times: TimeSplit | None = None,
        repair: str = "",
        notes: Sequence[str] = (),
    ) -> None:
        """Record the end of the run; recording it again changes nothing."""
        rows = [
            (place, to_blob(f.x), float(f.penalty), float(f.fitness), json_of(f.score))
            for place, f in enumerate(finalists)
        ]
        with self._transaction() as connection:
            connection.execute("DELETE FROM finalist")
            connection.executemany("INSERT INTO finalist VALUES (?, ?, ?, ?, ?)", rows)
            self._record_digest("finalists", rows)
            entries = [("stopped", stopped), ("notes", json.dumps(notes))]
            entries += [("repair", repair)] if repair else []
            connection.executemany("INSERT OR REPLACE INTO run VALUES (?, ?)", entries)
            self._record_times(times)

    def finalists(self, space: DesignSpace) -> tuple[Finalist, ...]:
        """Return the finalists of a run that has ended, best first; none before."""
        with damage_errors(self.path):
            return read_finalists(self._connection, space)

    @property
    def repair(self) -> str:
        """Message on the feasibility repair; empty where none was needed."""
        with system_errors(self.path):
            query = "SELECT value FROM run WHERE key = 'repair'"
            row = self._connection.execute(query).fetchone()
        return "" if row is None else str(row[0])

    def kept(self, key: str, kind: type[R]) -> R | None:
        """Return the value that `keep` recorded under a key; None without one."""
        with damage_errors(self.path):
            query = "SELECT key, value FROM run WHERE key = ?"
            return recorded_entry(
                dict(self._connection.execute(query, (key,)).fetchall()), key, kind
            )

    def keep(self, key: str, value: Record) -> None:
        """Record a value: the ``recipe``, or the ``prediction`` of the winner."""
        with self._transaction() as connection:
            connection.execute("INSERT OR REPLACE INTO run VALUES (?, ?)", (key, value.as_json))

    def close(self) -> None:
        """Close the file."""
        self._close(remove=False)

    def __enter__(self) -> "RunStore":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file; delete it if it was created for a run that is refused."""
        refused = kind is not None and issubclass(kind, BadInputError | UnknownNameError)
        self._close(remove=refused and self._is_new and not self.recorded)

    def _close(self, *, remove: bool) -> None:
        try:
            self._connection.close()
            if remove:
                for ending in ("", "-wal", "-shm"):
                    self.path.with_name(f"{RECORD_FILE}{ending}").unlink(missing_ok=True)
        finally:
            _unlock(self._lock)
            self._lock = None

    def _record_digests(self, rows: Sequence[tuple[Sequence[Any], Sequence[Any]]]) -> None:
        """Record digests of generations after those that are there, each with its terms."""
        before, made = last_digest(self._connection), list[tuple[str, int, str]]()
        for row, terms in rows:
            before = chained_digest(before, row, list(terms))
            made.append(("generation", row[0], before))
        self._connection.executemany("INSERT INTO digest VALUES (?, ?, ?)", made)

    def _record_digest(self, part: str, row: Sequence[Any]) -> None:
        """Record the digest of a part that stands after the last generation."""
        value = chained_digest(last_digest(self._connection), row)
        self._connection.execute("INSERT OR REPLACE INTO digest VALUES (?, 0, ?)", (part, value))

    def _record_times(self, times: TimeSplit | None) -> None:
        if times is not None:
            self._connection.execute(
                "UPDATE session SET seconds = ? WHERE number = ?",
                (times.as_json, self._session),
            )

    def _begin(self, maps: Sequence[Map], *, raises_limits: bool) -> None:
        """Create the tables, or compare those that exist with the run; record the session."""
        with system_errors(self.path):
            self._connection.execute("PRAGMA journal_mode = WAL")
            # In WAL mode a power cut, not a kill, can then lose the last generations and nothing
            # else; waiting for the disk would take longer than many generations.
            self._connection.execute("PRAGMA synchronous = NORMAL")
        with damage_errors(self.path):
            names = self._connection.execute("SELECT name FROM sqlite_master").fetchall()
        if not names:
            run_id = self.identity.run_id
            entries = {"schema": RECORD_SCHEMA, "run_id": run_id, **self._identity_texts()}
            with self._transaction() as connection:
                for table in _TABLES:
                    connection.execute(table)
                connection.executemany("INSERT INTO run VALUES (?, ?)", entries.items())
                texts = enumerate(map(map_to_text, maps))
                connection.executemany("INSERT INTO map VALUES (?, ?)", texts)
            with system_errors(self.path):
                # Into the file itself, so that it is recognized as ours during the run.
                self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        elif ("run",) not in names:
            raise UnreadableFileError(self.path, "is not the record of a run")
        row = (datetime.now(UTC).isoformat(), json.dumps(dict(self.identity.versions)), "{}")
        if names:
            self._compare(raises_limits=raises_limits)
        with self._transaction() as connection:
            session = connection.execute(
                "INSERT INTO session (began_utc, versions, seconds) VALUES (?, ?, ?)", row
            )
            self._session = session.lastrowid or 0

    def _identity_texts(self) -> dict[str, str]:
        identity = self.identity
        parts = {
            "settings": identity.settings,
            "maps": identity.maps,
            "versions": identity.versions,
        }
        return {key: json.dumps(value, sort_keys=True) for key, value in parts.items()}

    def _compare(self, *, raises_limits: bool) -> None:
        """Raise unless the record is of this run; raise its limits if that is asked for."""
        with damage_errors(self.path):
            entries = dict(self._connection.execute("SELECT key, value FROM run").fetchall())
            recorded = recorded_identity(entries, self.path)
            now = recorded
            if raises_limits:
                now = recorded.with_limits(self.identity.settings["search"])
            problem = self.identity.differs_from(now)
            self.drift = tuple(self.identity.drift(recorded))
        if problem is not None:
            raise problem.at(self.path)
        # The winner's origin names the versions with which the run began.
        self.identity = now
        if now.limits != recorded.limits:
            self._extend(recorded, entries.get("stopped", ""))
        with damage_errors(self.path):
            self.extensions = read_extensions(self._connection)

    def _extend(self, recorded: RunIdentity, stopped: str) -> None:
        """Record other limits, and that a run which had ended has not."""
        with damage_errors(self.path):
            row = self._connection.execute("SELECT score FROM finalist WHERE place = 0").fetchone()
            score = None if row is None else from_json(Score, row[0]).composite["mean"]
        extension = Extension(
            utc=datetime.now(UTC).isoformat(),
            generations_done=self.recorded,
            stopped=stopped,
            before=recorded.limits,
            after=self.identity.limits,
            score=score,
        )
        settings, run_id = self._identity_texts()["settings"], self.identity.run_id
        with self._transaction() as connection:
            connection.execute(EXTENSION_TABLE)
            connection.execute("INSERT INTO extension (content) VALUES (?)", (extension.as_json,))
            rows = [("settings", settings), ("run_id", run_id)]
            connection.executemany("INSERT OR REPLACE INTO run VALUES (?, ?)", rows)
            ended = "('stopped', 'repair', 'notes', 'prediction')"
            connection.execute(f"DELETE FROM run WHERE key IN {ended}")  # noqa: S608  constants
            connection.execute("DELETE FROM finalist")
            connection.execute("DELETE FROM digest WHERE part = 'finalists'")

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing."""
        with system_errors(self.path):
            try:
                # Within the try: an interrupt right after it must roll it back.
                self._connection.execute("BEGIN IMMEDIATE")
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                # On a full disk SQLite rolls back by itself.
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise


def _unlock(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


_PAUSE_S = 0.25
"""Generations within this time are recorded together: the most that a kill can lose."""


class Recorder:
    """Records generations and reports progress, each while the next one is evaluated."""

    def __init__(
        self,
        store: RunStore | None,
        search: SearchSettings,
        ledger: Ledger,
        judged: Callable[[SearchProgress], SearchProgress] = lambda progress: progress,
    ) -> None:
        self._store, self._search, self._ledger = store, search, ledger
        self._judged = judged
        self._unreported: Sequence[Generation] | None = None
        self._reported: SearchProgress | None = None
        self._pending = _PendingGenerations((), {})
        self._written_s = -math.inf

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Record pending generations, also after an error."""
        if kind is KeyboardInterrupt and self._store is not None:
            # It may have come during recording, or just after.
            self._pending = self._pending.after(self._store.recorded)
        self._write()
        if kind is None:
            self.report()

    def note(self, history: Sequence[Generation], state: Mapping[str, object]) -> None:
        """Hold the last generation, and the state after it, to be recorded."""
        # Copied, because an optimizer may reuse the arrays that it returns.
        copied = {
            name: value.copy() if isinstance(value, np.ndarray) else deepcopy(value)
            for name, value in state.items()
        }
        # In one assignment: an interrupt must not leave a generation with the state before it.
        self._pending = _PendingGenerations((*self._pending.generations, history[-1]), copied)
        self._unreported = history

    def write(self) -> None:
        """Report the last generation; record pending ones unless that was just done."""
        if time.monotonic() - self._written_s >= _PAUSE_S:
            self._write()
        self.report()

    def report(self) -> None:
        """Announce the last generation, unless that was done."""
        history, self._unreported = self._unreported, None
        if history is not None and is_heard():
            with self._ledger.spending("store"):
                progress = _progress_after(self._reported, history, self._search)
                self._reported = self._judged(progress)
                announce(self._reported)

    def _write(self) -> None:
        generations, state = self._pending
        if generations and self._store is not None:
            with self._ledger.spending("store"):
                self._store.add(generations, state, self._ledger.split())
        # Only now: an interrupt above leaves them pending.
        self._pending = _PendingGenerations((), state)
        self._written_s = time.monotonic()


class _PendingGenerations(NamedTuple):
    """Generations to be recorded."""

    generations: tuple[Generation, ...]  # in order
    state: Mapping[str, object]  # the optimizer's state after the last one

    def after(self, count: int) -> "_PendingGenerations":
        """Return the same without the generations before a number."""
        return _PendingGenerations(
            tuple(g for g in self.generations if g.number >= count), self.state
        )


def _progress_after(
    before: SearchProgress | None, history: Sequence[Generation], search: SearchSettings
) -> SearchProgress:
    """Return the progress after the last generation, from that after an earlier one."""
    new = history if before is None else history[before.done :]
    best, elapsed_s, evaluations = -math.inf, 0.0, 0
    if before is not None:
        best, elapsed_s, evaluations = before.best, before.elapsed_s, before.evaluations
    best = max([best, *(generation.best for generation in new)])
    elapsed_s += sum(generation.seconds for generation in new)
    evaluations += sum(len(generation.fitness) for generation in new)
    # The share that is done is by the limit that is nearest.
    shares = [len(history) / search.generations]
    if search.evaluations:
        shares.append(evaluations / search.evaluations)
    if search.wall_time_s:
        shares.append(elapsed_s / search.wall_time_s)
    last = history[-1]
    designs = last.composite[np.isfinite(last.composite)]
    return SearchProgress(
        done=len(history),
        total=search.generations,
        best=best,
        mean=float(designs.mean()) if len(designs) else 0.0,
        spread=float(designs.std()) if len(designs) else 0.0,
        fabricable_share=last.fabricable_share,
        elapsed_s=elapsed_s,
        left_s=elapsed_s * (1.0 / min(1.0, max(shares)) - 1.0),
        evaluations=evaluations,
        history=history,
    )
