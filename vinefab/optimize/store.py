"""The record of a run: one SQLite file that is whole after a crash at any moment."""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    UnreadableFileError,
    VinefabError,
)
from vinefab.core.jsontext import GENERATOR
from vinefab.optimize.history import Generation
from vinefab.optimize.identity import RunIdentity
from vinefab.optimize.result import Finalist
from vinefab.optimize.rows import from_blob, score_from_text, score_to_text, to_blob
from vinefab.optimize.space import Space

FILE_NAME = "run.sqlite"
SCHEMA = "vinefab/run-store-1"

# SQLite keeps these texts in the file's first page: the mark in them makes the file known as ours.
_TABLES = (
    f"CREATE TABLE run (/* {GENERATOR} */ key TEXT PRIMARY KEY, value TEXT NOT NULL)",
    "CREATE TABLE session (number INTEGER PRIMARY KEY, began_utc TEXT NOT NULL)",
    "CREATE TABLE generation (number INTEGER PRIMARY KEY, x BLOB NOT NULL, fitness BLOB NOT NULL, "
    "composite BLOB NOT NULL, penalty BLOB NOT NULL, seconds REAL NOT NULL)",
    "CREATE TABLE term (generation INTEGER NOT NULL, name TEXT NOT NULL, value BLOB NOT NULL, "
    "PRIMARY KEY (generation, name))",
    "CREATE TABLE optimizer (only INTEGER PRIMARY KEY CHECK (only = 1), state TEXT NOT NULL)",
    "CREATE TABLE finalist (place INTEGER PRIMARY KEY, x BLOB NOT NULL, penalty REAL NOT NULL, "
    "fitness REAL NOT NULL, score TEXT NOT NULL)",
)


class RunStore:
    """One run's record, open for reading and writing.

    Every generation is one transaction, together with the optimizer's state after it: whatever
    happens, the file holds whole generations and the state to go on from.

    Parameters
    ----------
    path
        The file.
    connection
        An open connection to it.
    identity
        What the record is of.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, identity: RunIdentity) -> None:
        self.path = path
        self.identity = identity
        self._connection = connection

    @classmethod
    def open(cls, folder: Path, identity: RunIdentity, *, resume: bool = False) -> "RunStore":
        """Open the record in a folder, a new one unless there is one to resume.

        Parameters
        ----------
        folder
            Made when missing.
        identity
            What the run is; a record to resume must be of the same.
        resume
            Go on with the run that the folder holds; when it holds none, begin one.

        Raises
        ------
        BadInputError
            If the folder holds a run and ``resume`` is not asked for, or holds another run.
        UnreadableFileError
            If what it holds is not a record that this version reads.
        CannotWriteError
            If the system refuses.
        """
        path = folder / FILE_NAME
        if path.exists() and not resume:
            raise BadInputError("--out", str(folder), "a folder without a run, or --resume")
        with _system_errors(path):
            folder.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(path, isolation_level=None)
        try:
            store = cls(path, connection, identity)
            store._begin()
        except BaseException:
            connection.close()
            raise
        return store

    def generations(self) -> list[Generation]:
        """Return every generation recorded, in order."""
        with _system_errors(self.path):
            rows = self._connection.execute(
                "SELECT number, x, fitness, composite, penalty, seconds FROM generation ORDER BY 1"
            ).fetchall()
            return [self._generation(row) for row in rows]

    def optimizer_state(self) -> Mapping[str, object]:
        """Return the optimizer's state after the last generation recorded."""
        with _system_errors(self.path):
            row = self._connection.execute("SELECT state FROM optimizer").fetchone()
        if row is None:
            raise UnreadableFileError(self.path, "the optimizer's state is missing")
        return cast("dict[str, object]", json.loads(row[0]))

    def add(self, generation: Generation, state: Mapping[str, object]) -> None:
        """Record a generation and the optimizer's state after it.

        Raises
        ------
        CannotWriteError
            If the system refuses, or another process has recorded the same generation.
        """
        columns = (generation.x, generation.fitness, generation.composite, generation.penalty)
        row = (generation.number, *map(to_blob, columns), generation.seconds)
        terms = [(generation.number, name, to_blob(v)) for name, v in generation.terms.items()]
        with self._transaction() as connection:
            connection.execute("INSERT INTO generation VALUES (?, ?, ?, ?, ?, ?)", row)
            connection.executemany("INSERT INTO term VALUES (?, ?, ?)", terms)
            connection.execute(
                "INSERT OR REPLACE INTO optimizer VALUES (1, ?)",
                (json.dumps(state, allow_nan=False),),
            )

    def finish(self, finalists: Sequence[Finalist], stopped: str) -> None:
        """Record how the run ended; doing so again changes nothing."""
        rows = [
            (place, to_blob(f.x), f.penalty, f.fitness, score_to_text(f.score))
            for place, f in enumerate(finalists)
        ]
        with self._transaction() as connection:
            connection.execute("DELETE FROM finalist")
            connection.executemany("INSERT INTO finalist VALUES (?, ?, ?, ?, ?)", rows)
            connection.execute("INSERT OR REPLACE INTO run VALUES ('stopped', ?)", (stopped,))

    def finalists(self, space: Space) -> tuple[Finalist, ...]:
        """Return the finalists of a run that has ended, best first; none before.

        Parameters
        ----------
        space
            What their points stand for.
        """
        with _system_errors(self.path):
            rows = self._connection.execute(
                "SELECT x, penalty, fitness, score FROM finalist ORDER BY place"
            ).fetchall()
        return tuple(
            Finalist(
                x=from_blob(x),
                design=space.design(from_blob(x)),
                score=score_from_text(score),
                penalty=penalty,
                fitness=fitness,
            )
            for x, penalty, fitness, score in rows
        )

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> "RunStore":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _begin(self) -> None:
        """Make the tables, or check those that are there; record the session."""
        with _system_errors(self.path):
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute("PRAGMA synchronous = FULL")
            names = self._connection.execute("SELECT name FROM sqlite_master").fetchall()
        if not names:
            self._create()
        elif ("run",) not in names:
            raise UnreadableFileError(self.path, "is not the record of a run")
        else:
            self._compare()
        with self._transaction() as connection:
            now = datetime.now(UTC).isoformat(timespec="seconds")
            connection.execute("INSERT INTO session (began_utc) VALUES (?)", (now,))

    def _create(self) -> None:
        record = {"schema": SCHEMA, "run_id": self.identity.run_id, **self._identity_texts()}
        with self._transaction() as connection:
            for table in _TABLES:
                connection.execute(table)
            connection.executemany("INSERT INTO run VALUES (?, ?)", record.items())
        with _system_errors(self.path):
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
        with _system_errors(self.path):
            kept = dict(self._connection.execute("SELECT key, value FROM run").fetchall())
        if kept.get("schema") != SCHEMA:
            raise UnreadableFileError(
                self.path, f"is of form {kept.get('schema')}; this vinefab reads {SCHEMA}"
            )
        recorded = RunIdentity(
            settings=json.loads(kept["settings"]),
            maps=tuple(json.loads(kept["maps"])),
            versions=json.loads(kept["versions"]),
        )
        if problem := self.identity.differs_from(recorded):
            raise problem.at(self.path)

    def _generation(self, row: tuple[Any, ...]) -> Generation:
        number, x, fitness, composite, penalty, seconds = row
        terms = self._connection.execute(
            "SELECT name, value FROM term WHERE generation = ? ORDER BY rowid", (number,)
        ).fetchall()
        return Generation(
            number=number,
            x=from_blob(x, rows=len(from_blob(fitness))),
            fitness=from_blob(fitness),
            composite=from_blob(composite),
            penalty=from_blob(penalty),
            terms={name: from_blob(value) for name, value in terms},
            seconds=seconds,
        )

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing."""
        with _system_errors(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                # A full disk makes SQLite roll back by itself.
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise


@contextmanager
def _system_errors(path: Path) -> Iterator[None]:
    """Turn what SQLite and the system say into errors of ours."""
    try:
        yield
    except VinefabError:
        raise
    except sqlite3.IntegrityError as error:
        problem = "another process is going on with the same run"
        raise CannotWriteError(path, problem) from error
    except sqlite3.OperationalError as error:
        raise CannotWriteError(path, str(error)) from error
    except sqlite3.DatabaseError as error:
        raise UnreadableFileError(path, str(error)) from error
    except OSError as error:
        raise CannotWriteError(path, error.strerror or str(error)) from error
