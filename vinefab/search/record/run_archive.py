"""What the record of a run says, without the run file and without changing the record."""

import json
import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.model.map import Map
from vinefab.search.record.identity import RunIdentity
from vinefab.search.record.record_reading import (
    FILE_NAME,
    damage_errors,
    map_from_text,
    read_finalists,
    read_generations,
    recorded_identity,
    settings_from_plain,
)
from vinefab.search.record.result import Finalist, Generation, RunResult, with_origin
from vinefab.search.record.timing import TimeSplit
from vinefab.search.settings import RunSettings
from vinefab.search.space import Space


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """One time that a run was worked on."""

    began_utc: str  # when, as ISO 8601
    times: TimeSplit  # where its time went


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunArchive:
    """A record, read."""

    path: Path  # the file
    # identity, settings: what it is of
    identity: RunIdentity
    settings: RunSettings
    maps: tuple[Map, ...]  # the training maps
    history: tuple[Generation, ...]  # every generation
    finalists: tuple[Finalist, ...]  # best first; none before the run has ended
    stopped: str  # why it stopped; an empty string before it has
    sessions: tuple[Session, ...]  # in order
    repair: str = ""  # what was done because no design of the search could be made, in words

    @classmethod
    def read(cls, path: Path) -> "RunArchive":
        """Return what a record says; the run may be going on meanwhile."""
        if not path.is_file():
            raise UnreadableFileError(path, "there is no such file")
        with damage_errors(path):
            # A read-only connection may still have to make the files that WAL lives in.
            connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True)
            try:
                return cls._from(connection, path)
            finally:
                connection.close()

    @classmethod
    def _from(cls, connection: sqlite3.Connection, path: Path) -> "RunArchive":
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
        if "run" not in tables:
            raise UnreadableFileError(path, "is not the record of a run")
        kept = dict(connection.execute("SELECT key, value FROM run").fetchall())
        identity = recorded_identity(kept, path)
        settings = settings_from_plain(identity.settings)
        maps = connection.execute("SELECT content FROM map ORDER BY place").fetchall()
        sessions = connection.execute("SELECT began_utc, seconds FROM session ORDER BY number")
        space = Space(settings.space, settings.build)
        return cls(
            path=path,
            identity=identity,
            settings=settings,
            maps=tuple(map_from_text(text) for (text,) in maps),
            history=tuple(read_generations(connection)),
            finalists=read_finalists(connection, space),
            stopped=kept.get("stopped", ""),
            sessions=tuple(_session(*row) for row in sessions),
            repair=kept.get("repair", ""),
        )

    @property
    def best_so_far(self) -> float | None:
        """The best fitness of all generations; None before the first."""
        best = [generation.best for generation in self.history]
        return max(best) if best else None

    def result(self) -> RunResult:
        """Return what the run ended with."""
        if not self.finalists:
            raise BadInputError(str(self.path), "a run that has not ended", "one that has")
        run_id = self.identity.run_id
        return RunResult(
            run_id=run_id,
            best=with_origin(self.finalists[0], self.settings, run_id, self.identity.versions),
            finalists=self.finalists,
            history=self.history,
            stopped=self.stopped,
            times=self.sessions[-1].times,
            asked=self.settings.evaluation.fabricable,
            repair=self.repair,
        )


def _session(began_utc: str, seconds: str) -> Session:
    return Session(began_utc=began_utc, times=TimeSplit.from_plain(json.loads(seconds)))


def records_in(folder: Path) -> list[Path]:
    """Return the records in a folder, in it directly or anywhere below, in order."""
    if not folder.is_dir():
        raise UnreadableFileError(folder, "there is no such folder")
    return sorted(folder.rglob(FILE_NAME))


def plain_summary(archive: RunArchive) -> dict[str, Any]:
    """Return a record in a few plain values."""
    settings, history = archive.settings, archive.history
    winner = archive.finalists[0] if archive.finalists else None
    return {
        "folder": str(archive.path.parent),
        "run": archive.identity.run_id,
        "name": settings.name,
        "task": settings.task.name,
        "optimizer": settings.optimizer.name,
        "seed": settings.search.seed,
        "generations": len(history),
        "most_generations": settings.search.generations,
        "evaluations": sum(len(generation.fitness) for generation in history),
        "seconds": sum(generation.seconds for generation in history),
        "best_fitness": archive.best_so_far,
        "stopped": archive.stopped or None,
        "winner_score": None if winner is None else dict(winner.score.composite),
        "sessions": [{"began_utc": s.began_utc, **s.times.plain()} for s in archive.sessions],
        "versions": dict(archive.identity.versions),
    }
