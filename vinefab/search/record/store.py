"""The record of a run: one SQLite file that is whole after a crash at any moment."""

import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from vinefab.core.atomic import folder_to_fill
from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.core.jsontext import GENERATOR
from vinefab.core.lock import lock_folder
from vinefab.model.map import Map
from vinefab.search.record.identity import RunIdentity
from vinefab.search.record.record_reading import (
    FILE_NAME,
    SCHEMA,
    damage_errors,
    map_to_text,
    read_finalists,
    read_generations,
    recorded_identity,
    score_to_text,
    state_from_text,
    state_to_text,
    system_errors,
    to_blob,
)
from vinefab.search.record.result import Finalist, Generation
from vinefab.search.record.timing import TimeSplit
from vinefab.search.space import Space

# SQLite keeps these texts in the file's first page: the mark in them makes the file known as ours.
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
)


BUSY = "another process is going on with the same run"


class RunStore:
    """One run's record, open for reading and writing.

    Every generation is one transaction, together with the optimizer's state after it: whatever
    happens, the file holds whole generations and the state to go on from.

    Attributes
    ----------
    drift
        Packages that have another version now than when the run began, in words.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, identity: RunIdentity) -> None:
        self.path = path
        self.identity = identity
        self.drift: tuple[str, ...] = ()
        self._connection = connection
        self._session = 0
        self._held: int | None = None
        self._is_new = False

    @classmethod
    def open(
        cls,
        folder: Path,
        identity: RunIdentity,
        *,
        maps: Sequence[Map] = (),
        resume: bool = False,
    ) -> "RunStore":
        """Open the record in a folder, a new one unless there is one to resume."""
        path = folder / FILE_NAME
        if path.exists() and not resume:
            raise BadInputError("--out", str(folder), "a folder without a run, or --resume")
        with folder_to_fill(folder):
            held = lock_folder(folder, BUSY)
            is_new = not path.exists()
            try:
                with system_errors(path):
                    connection = sqlite3.connect(path, isolation_level=None)
                store = cls(path, connection, identity)
                store._held, store._is_new = held, is_new
            except BaseException:
                _let_go(held)
                raise
            try:
                store._begin(maps)
            except BaseException:
                store._leave(remove=is_new)
                raise
        return store

    def generations(self) -> list[Generation]:
        """Return every generation recorded, in order."""
        with damage_errors(self.path):
            return read_generations(self._connection)

    @property
    def recorded(self) -> int:
        """How many generations are recorded."""
        with system_errors(self.path):
            row = self._connection.execute("SELECT count(*) FROM generation").fetchone()
        return int(row[0])

    def optimizer_state(self) -> Mapping[str, object]:
        """Return the optimizer's state after the last generation recorded."""
        with damage_errors(self.path):
            row = self._connection.execute("SELECT state FROM optimizer").fetchone()
            if row is None:
                raise UnreadableFileError(self.path, "the optimizer's state is missing")
            return state_from_text(row[0])

    def add(
        self,
        generations: Sequence[Generation],
        state: Mapping[str, object],
        times: TimeSplit | None = None,
    ) -> None:
        """Record generations and the optimizer's state after the last one, all or nothing."""
        rows = [
            (g.number, *map(to_blob, (g.x, g.fitness, g.composite, g.penalty)), g.seconds)
            for g in generations
        ]
        terms = [(g.number, name, to_blob(v)) for g in generations for name, v in g.terms.items()]
        with self._transaction() as connection:
            connection.executemany("INSERT INTO generation VALUES (?, ?, ?, ?, ?, ?)", rows)
            connection.executemany("INSERT INTO term VALUES (?, ?, ?)", terms)
            connection.execute(
                "INSERT OR REPLACE INTO optimizer VALUES (1, ?)",
                (state_to_text(state),),
            )
            self._note(times)

    def finish(
        self,
        finalists: Sequence[Finalist],
        stopped: str,
        times: TimeSplit | None = None,
        repair: str = "",
    ) -> None:
        """Record how the run ended; doing so again changes nothing."""
        rows = [
            (place, to_blob(f.x), f.penalty, f.fitness, score_to_text(f.score))
            for place, f in enumerate(finalists)
        ]
        with self._transaction() as connection:
            connection.execute("DELETE FROM finalist")
            connection.executemany("INSERT INTO finalist VALUES (?, ?, ?, ?, ?)", rows)
            words = [("stopped", stopped), *([("repair", repair)] if repair else [])]
            connection.executemany("INSERT OR REPLACE INTO run VALUES (?, ?)", words)
            self._note(times)

    def finalists(self, space: Space) -> tuple[Finalist, ...]:
        """Return the finalists of a run that has ended, best first; none before."""
        with damage_errors(self.path):
            return read_finalists(self._connection, space)

    @property
    def repair(self) -> str:
        """What was done because no design of the search could be made, in words."""
        with system_errors(self.path):
            question = "SELECT value FROM run WHERE key = 'repair'"
            row = self._connection.execute(question).fetchone()
        return "" if row is None else str(row[0])

    def close(self) -> None:
        """Close the file."""
        self._leave(remove=False)

    def __enter__(self) -> "RunStore":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file; one that was begun for a run that is refused goes away again."""
        refused = kind is not None and issubclass(kind, BadInputError | UnknownNameError)
        self._leave(remove=refused and self._is_new and not self._has_generations())

    def _has_generations(self) -> bool:
        with system_errors(self.path):
            return self._connection.execute("SELECT 1 FROM generation").fetchone() is not None

    def _leave(self, *, remove: bool) -> None:
        try:
            self._connection.close()
            if remove:
                for ending in ("", "-wal", "-shm"):
                    self.path.with_name(f"{FILE_NAME}{ending}").unlink(missing_ok=True)
        finally:
            _let_go(self._held)
            self._held = None

    def _note(self, times: TimeSplit | None) -> None:
        if times is not None:
            self._connection.execute(
                "UPDATE session SET seconds = ? WHERE number = ?",
                (json.dumps(times.plain()), self._session),
            )

    def _begin(self, maps: Sequence[Map]) -> None:
        """Make the tables, or check those that are there; record the session."""
        with system_errors(self.path):
            self._connection.execute("PRAGMA journal_mode = WAL")
            # In WAL mode only a power cut, not a kill, can then cost the last generations, and
            # nothing but them; waiting for the disk would take longer than many generations.
            self._connection.execute("PRAGMA synchronous = NORMAL")
        with damage_errors(self.path):
            names = self._connection.execute("SELECT name FROM sqlite_master").fetchall()
        if not names:
            self._create(maps)
        elif ("run",) not in names:
            raise UnreadableFileError(self.path, "is not the record of a run")
        row = (datetime.now(UTC).isoformat(), json.dumps(dict(self.identity.versions)), "{}")
        if names:
            self._compare()
        with self._transaction() as connection:
            made = connection.execute(
                "INSERT INTO session (began_utc, versions, seconds) VALUES (?, ?, ?)", row
            )
            self._session = made.lastrowid or 0

    def _create(self, maps: Sequence[Map]) -> None:
        record = {"schema": SCHEMA, "run_id": self.identity.run_id, **self._identity_texts()}
        with self._transaction() as connection:
            for table in _TABLES:
                connection.execute(table)
            connection.executemany("INSERT INTO run VALUES (?, ?)", record.items())
            texts = enumerate(map(map_to_text, maps))
            connection.executemany("INSERT INTO map VALUES (?, ?)", texts)
        with system_errors(self.path):
            # Into the file itself, so that it is known as ours while the run goes on.
            self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def _identity_texts(self) -> dict[str, str]:
        identity = self.identity
        parts = {
            "settings": identity.settings,
            "maps": identity.maps,
            "versions": identity.versions,
        }
        return {key: json.dumps(value, sort_keys=True) for key, value in parts.items()}

    def _compare(self) -> None:
        """Raise unless the record is of this very run."""
        with damage_errors(self.path):
            kept = dict(self._connection.execute("SELECT key, value FROM run").fetchall())
            recorded = recorded_identity(kept, self.path)
        if problem := self.identity.differs_from(recorded):
            raise problem.at(self.path)
        self.drift = tuple(self.identity.drift(recorded))
        # What the winner is said to come from is what the run began with.
        self.identity = recorded

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing."""
        with system_errors(self.path):
            try:
                # In here: an interrupt comes when it is done, and would leave it open.
                self._connection.execute("BEGIN IMMEDIATE")
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                # A full disk makes SQLite roll back by itself.
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise


def _let_go(held: int | None) -> None:
    if held is not None:
        os.close(held)
