"""Reading the record of a run, whoever wrote it and whatever became of it."""

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from shapely.errors import ShapelyError

from vinefab.core.errors import CannotWriteError, UnreadableFileError, VinefabError
from vinefab.optimize.history import Generation
from vinefab.optimize.identity import RunIdentity
from vinefab.optimize.result import Finalist
from vinefab.optimize.rows import from_blob, score_from_text
from vinefab.optimize.space import Space

FILE_NAME = "run.sqlite"
SCHEMA = "vinefab/run-store-2"


def recorded_identity(kept: Mapping[str, str], path: Path) -> RunIdentity:
    """Return what a record is of.

    Parameters
    ----------
    kept
        Its table ``run``.
    path
        Where it lies.

    Raises
    ------
    UnreadableFileError
        If it has a form that this version does not read.
    """
    if kept.get("schema") != SCHEMA:
        raise UnreadableFileError(
            path, f"is of form {kept.get('schema')}; this vinefab reads {SCHEMA}"
        )
    return RunIdentity(
        settings=json.loads(kept["settings"]),
        maps=tuple(json.loads(kept["maps"])),
        versions=json.loads(kept["versions"]),
    )


def read_generations(connection: sqlite3.Connection) -> list[Generation]:
    """Return every generation recorded, in order."""
    rows = connection.execute(
        "SELECT number, x, fitness, composite, penalty, seconds FROM generation ORDER BY 1"
    ).fetchall()
    return [_generation(connection, row) for row in rows]


def _generation(connection: sqlite3.Connection, row: tuple[Any, ...]) -> Generation:
    number, x, fitness, composite, penalty, seconds = row
    terms = connection.execute(
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


def read_finalists(connection: sqlite3.Connection, space: Space) -> tuple[Finalist, ...]:
    """Return the finalists of a run that has ended, best first; none before."""
    rows = connection.execute(
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


@contextmanager
def system_errors(path: Path) -> Iterator[None]:
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
    except UnicodeDecodeError as error:  # SQLite quotes damaged bytes
        raise UnreadableFileError(path, f"is damaged or no record ({error})") from error
    except OSError as error:
        raise CannotWriteError(path, error.strerror or str(error)) from error


_DAMAGE = (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, ShapelyError)
"""What making sense of damaged texts and numbers raises."""


@contextmanager
def damage_errors(path: Path) -> Iterator[None]:
    """Say of whatever goes wrong while a record is read that the record is damaged.

    Raises
    ------
    UnreadableFileError
        In place of what SQLite and the decoding of its content raise.
    """
    try:
        yield
    except (sqlite3.Error, *_DAMAGE) as error:
        words = " ".join(str(error).split())[:80]
        raise UnreadableFileError(path, f"is damaged or no record ({words})") from error
    except OSError as error:
        if isinstance(error, VinefabError):
            raise
        raise UnreadableFileError(path, error.strerror or str(error)) from error
