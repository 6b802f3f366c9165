"""Where experiments are done: jobs are kept in a folder and never done twice."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Self

import numpy as np

from vinefab import __version__
from vinefab.core.atomic import ensure_writable, is_ours, write_text
from vinefab.core.errors import BadInputError, ForeignFileError, UnreadableFileError
from vinefab.core.jsontext import json_text
from vinefab.experiments.jobs import Job, Testing, Training, done
from vinefab.experiments.size import Size
from vinefab.model.checked import Floats

SETTINGS = "settings.json"
FINISHED = "finished.json"
"""The file by which the folder is known again, and that says what was begun in it."""

_SETTINGS_SCHEMA = "vinefab/reproduction-settings-1"
_FINISHED_SCHEMA = "vinefab/reproduction-finished-1"
_PART_SCHEMA = "vinefab/reproduction-part-1"

Tell = Callable[[float, str], None]


class Lab:
    """A folder of finished jobs, and processes to do more; closed at the end of its block.

    Parameters
    ----------
    folder
        Made when missing. It must be empty, or have been begun by this class.
    size
        How large the experiments are.
    workers
        Processes; 1 works in this one. No result depends on it.
    tell
        Called after every job with the share of the jobs at hand that is done.

    Raises
    ------
    ForeignFileError
        If the folder holds something else.
    BadInputError
        If it was begun with another size or version.
    """

    def __init__(self, folder: Path, size: Size, workers: int, tell: Tell) -> None:
        self.folder = folder
        self.size = size
        self.workers = workers
        self.tell = tell
        self.spent_s = 0.0
        self._pool: ProcessPoolExecutor | None = None
        _begin(folder, size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def finished(self) -> list[str]:
        """Return the names of the experiments that were finished in the folder."""
        path = self.folder / FINISHED
        return list(_document(path, _FINISHED_SCHEMA)["names"]) if path.exists() else []

    def finish(self, name: str) -> None:
        """Write down that an experiment is finished."""
        names = sorted({*self.finished(), name})
        write_text(self.folder / FINISHED, json_text(_FINISHED_SCHEMA, {"names": names}))

    def train(self, jobs: Sequence[Training]) -> list[dict[str, Any]]:
        """Return what each run found."""
        return self.do(jobs, "training")

    def test(self, jobs: Sequence[Testing]) -> list[Floats]:
        """Return the scores of each test, shape (maps, poses)."""
        return [np.array(found["scores"]) for found in self.do(jobs, "testing")]

    def terms(self, jobs: Sequence[Testing], name: str) -> list[Floats]:
        """Return one term of each test, shape (maps, poses)."""
        return [np.array(found["terms"][name]) for found in self.do(jobs, "testing")]

    def do(self, jobs: Sequence[Job], words: str) -> list[dict[str, Any]]:
        """Return what each job gives; what is kept is not done again.

        Parameters
        ----------
        jobs
            What to do.
        words
            What to call it meanwhile.
        """
        keys = [job.key for job in jobs]
        known = {key: self._kept(key) for key in keys}
        todo = {key: job for key, job in zip(keys, jobs, strict=True) if known[key] is None}
        began_s = time.perf_counter()
        for number, (key, found) in enumerate(self._done(todo), start=1):
            known[key] = found
            text = json_text(_PART_SCHEMA, {"key": key, "result": found})
            write_text(self._path(key), text)
            self.tell(number / len(todo), f"{words} {number} of {len(todo)}")
        self.spent_s += time.perf_counter() - began_s
        return [result for key in keys if (result := known[key]) is not None]

    def _done(self, todo: dict[str, Job]) -> Iterator[tuple[str, dict[str, Any]]]:
        if self.workers == 1 or len(todo) < 2:
            yield from ((key, done(job)) for key, job in todo.items())
            return
        keys = list(todo)
        if self._pool is None:
            # Compiled here first: processes that compile at once would write the same cache.
            first = keys.pop(0)
            yield first, done(todo[first])
            # One pool for all: a process takes seconds to start.
            self._pool = ProcessPoolExecutor(self.workers, mp_context=get_context("spawn"))
        found = self._pool.map(done, [todo[key] for key in keys])
        yield from zip(keys, found, strict=True)

    def _kept(self, key: str) -> dict[str, Any] | None:
        path = self._path(key)
        if not path.is_file():
            return None
        document = _document(path, _PART_SCHEMA)
        if document.get("key") != key or not isinstance(document.get("result"), dict):
            raise UnreadableFileError(path, "is not the part that it is called after")
        return dict(document["result"])

    def _path(self, key: str) -> Path:
        return self.folder / "parts" / f"{key}.json"


def _begin(folder: Path, size: Size) -> None:
    """Write down what is done in a folder, or check that it is the same as before."""
    path = folder / SETTINGS
    now: dict[str, Any] = {"vinefab": __version__, **asdict(size)}
    if not path.exists():
        if folder.is_dir() and any(folder.iterdir()):
            raise ForeignFileError(folder, "holds other files; name a folder of its own")
        write_text(path, json_text(_SETTINGS_SCHEMA, {"settings": now}))
        return
    if not is_ours(path):
        raise ForeignFileError(path)
    ensure_writable(path)
    begun = _document(path, _SETTINGS_SCHEMA).get("settings", {})
    for key, value in now.items():
        if begun.get(key) != value:
            allowed = f"{begun.get(key)!r}, as it was begun; or another folder"
            raise BadInputError(key, value, allowed, path)


def _document(path: Path, schema: str) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise UnreadableFileError(path, "is not JSON") from error
    if not isinstance(document, dict) or document.get("schema") != schema:
        raise UnreadableFileError(path, f"is not a {schema} file")
    return document
