"""Searches of the page: begun, followed, stopped, resumed, loaded; each is a command's run.

A search is a child process of the server that runs ``vinefab optimize``, nothing else. It stops as
with Ctrl-C, everything recorded, when the page asks for it, when the server ends, and also when the
server is killed: it notices that the pipe to it has closed (`vinefab.core.interruption`).
"""

import asyncio
import inspect
import os
import shlex
import subprocess
import sys
import tempfile
import threading
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from vinefab.core.atomic import folder_to_fill, write_text
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    UnknownNameError,
    UnreadableFileError,
    VinefabError,
    located,
)
from vinefab.core.file_mark import marked
from vinefab.core.interruption import STOP_WITH_INPUT
from vinefab.core.plain_text import visible
from vinefab.core.validation import check_plain
from vinefab.model.files.design_toml import design_content
from vinefab.model.files.shipped import path_inside
from vinefab.search.outset import with_trunk_for_film
from vinefab.search.record.generations import first_difference
from vinefab.search.record.result import RECORD_FILE, RecordTail, RunArchive
from vinefab.search.settings import LIMIT_NAMES, RunSettings, plain_settings, read_run
from vinefab.studio.edited_map import PAGE
from vinefab.studio.followed_run import (
    FollowedRecord,
    best_of,
    best_words,
    final_front,
    front_design,
    listed_score,
    point_of,
    winner_words,
)
from vinefab.studio.run_request import RUN_FILE, run_files, run_proposal
from vinefab.studio.state import StudioState

_PAUSE_S = 0.35
"""Between two looks at the record of a run that is going on."""

_PATIENCE_S = 10.0
"""How long a search may take to stop before it is killed; its record is whole then too."""

MOST_FOLDERS, DEEPEST_FOLDER, MOST_RUNS = 3000, 4, 60
"""How far earlier runs are looked for below the folders of the desk."""

MOST_CANDIDATES, MOST_RUN_FILE_BYTES = 40, 1 << 18
"""Of files that may be the run file of a record."""


@dataclass(slots=True)
class RunningSearch:
    """A search that this server began."""

    folder: Path
    command: str  # as a user would type it
    process: subprocess.Popen[bytes]
    complaints: IO[bytes]  # what it writes to standard error
    record: FollowedRecord
    written: Mapping[Path, str] = field(default_factory=dict)  # files of a new search
    was_asked_to_stop: bool = False

    def ask_to_stop(self) -> None:
        """Stop it as Ctrl-C would."""
        self.was_asked_to_stop = True
        pipe = self.process.stdin
        if pipe is not None:
            with suppress(OSError, ValueError):  # it has ended, or was asked before
                # Another process of the server may hold a copy of the pipe: closing is not enough.
                pipe.write(b"\n")
                pipe.flush()
                pipe.close()

    def state(self) -> str:
        """Return ``running``, ``ended``, ``stopped`` or ``failed``."""
        code = self.process.poll()
        if code is None:
            return "running"
        if code in (0, 1):  # 1: the winner breaks a rule
            return "ended"
        return "stopped" if self.was_asked_to_stop or code == _INTERRUPTED else "failed"

    def complaint(self) -> str:
        """Return the line with which it failed."""
        self.complaints.seek(0, os.SEEK_END)
        self.complaints.seek(max(0, self.complaints.tell() - _MOST_COMPLAINT_BYTES))
        lines = self.complaints.read().decode("utf-8", "replace").strip().splitlines()
        words = lines[-1].removeprefix("error: ") if lines else "it ended without a word"
        code = self.process.returncode
        return visible(words) if code >= 0 else f"it was ended by signal {-code}; it can be resumed"


_INTERRUPTED = 130
_MOST_COMPLAINT_BYTES = 8192

SearchEvent = dict[str, Any]


class SearchDesk:
    """The searches of one server; one runs at a time.

    Parameters
    ----------
    roots
        Folders below which searches may be begun, resumed and loaded.
    home
        Where new searches are proposed: the folder where the command was started.
    """

    def __init__(self, roots: tuple[Path, ...], home: Path | None = None) -> None:
        self.home = (home or Path.cwd()).resolve()
        self.roots = tuple(root.resolve() for root in roots) or (self.home,)
        self._running: RunningSearch | None = None
        self._told: SearchEvent | None = None
        self._rows: dict[Path, tuple[list[tuple[int, int]], dict[str, Any]]] = {}
        self._lock = threading.RLock()

    def propose(self, ask: Mapping[str, Any], state: StudioState) -> dict[str, Any]:
        """Return what the page offers for a new search, and the command for its folder."""
        folder = self._new_folder(ask["folder"]) if ask.get("folder") else self._free_folder()
        return {
            **run_proposal(state),
            "folder": self._shown(folder),
            "command": shlex.join(["vinefab", *self._arguments(folder / RUN_FILE, folder)]),
        }

    def start(self, ask: Mapping[str, Any], state: StudioState) -> dict[str, Any]:
        """Write the run file of a search into a new folder, and begin it."""
        with self._lock:
            self._refuse_second()
            with located(PAGE):
                check_plain(ask)
            folder = self._new_folder(ask["folder"]) if ask.get("folder") else self._free_folder()
            ask = {**ask, **self._found_maps(ask)}
            written: dict[Path, str] = {}
            with folder_to_fill(folder):
                try:
                    for name, text in run_files(state, ask, folder).items():
                        written[write_text(folder / name, text)] = text
                    read_run(folder / RUN_FILE)
                except VinefabError as error:
                    _take_back(written)
                    raise _on_page(error, folder / RUN_FILE) from error
            return self._begin(self._arguments(folder / RUN_FILE, folder), folder, written)

    def resume(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Go on with a run that was stopped, also one of the command line."""
        with self._lock:
            self._refuse_second()
            folder = self._inside("folder", ask.get("folder"))
            tail = RecordTail.read(folder / RECORD_FILE)
            if tail is not None:
                run_file, seed = self._run_file(ask, folder, tail.settings)
            elif (folder / RUN_FILE).is_file():  # stopped before there was a record
                run_file, seed = folder / RUN_FILE, []
            else:
                raise UnreadableFileError(folder, f"has no {RECORD_FILE} of a run")
            return self._begin([*self._arguments(run_file, folder), *seed, "--resume"], folder, {})

    def stop(self) -> dict[str, Any]:
        """Ask the running search to stop; an event tells when it has."""
        running = self._running
        if running is None or running.state() != "running":
            raise BadInputError("search", None, "one that is running", PAGE)
        running.ask_to_stop()
        return {"folder": self._shown(running.folder), "state": "stopping"}

    def runs(self) -> dict[str, Any]:
        """Return the runs below the desk's folders, the latest first."""
        paths, is_whole = _records_below(self.roots)
        newest = sorted(paths, key=_stamp, reverse=True)
        return {
            "runs": [self._row(path) for path in newest[:MOST_RUNS]],
            "left_out": max(0, len(newest) - MOST_RUNS),
            "is_whole": is_whole,
            "search": self._told,
            "home": str(self.home),
        }

    def load(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return the best design of a run, or a point of its front.

        Parameters
        ----------
        ask
            ``folder`` and ``point``: ``best``; ``G:R``, row R of generation G; or the name of a
            design of the front that the run ended with.
        """
        folder, point = self._inside("folder", ask.get("folder")), ask.get("point", "best")
        if not isinstance(point, str):
            raise BadInputError("point", point, "best, G:R or a design of the front", PAGE)
        if point == "best":
            content, words = best_of(folder)
        elif ":" in point:
            content, words = point_of(folder, point)
        else:
            content, words = front_design(folder, point)
        return {"design": content, "folder": self._shown(folder), "point": point, "words": words}

    def front(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return the front of a run: the one that it ended with, or the one so far."""
        folder = self._inside("folder", ask.get("folder"))
        record = FollowedRecord(folder / RECORD_FILE)
        record.look()
        if record.front is None:
            raise BadInputError("folder", ask["folder"], "a run with several objectives", PAGE)
        final = final_front(folder, record)
        return {"folder": self._shown(folder), "front": final or record.front.plain()}

    def news(self) -> SearchEvent | None:
        """Return what has changed since the last call; None where nothing has."""
        with self._lock:
            if self._running is None:
                return None
            event = self._event(self._running)
            if event == self._told:
                return None
            self._told = event
            if event["state"] != "running":
                self._end(self._running)
            return event

    async def watch(self, tell: Callable[[SearchEvent], Awaitable[None] | None]) -> None:
        """Tell what searches do, until cancelled."""
        while True:
            event = await asyncio.to_thread(self.news)
            if event is not None:
                told = tell(event)
                if inspect.isawaitable(told):
                    await told
            await asyncio.sleep(_PAUSE_S)

    def close(self) -> None:
        """Stop the running search as Ctrl-C would, and wait for it; it can be resumed."""
        running = self._running
        if running is None:
            return
        running.ask_to_stop()
        try:
            running.process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            running.process.kill()
            running.process.wait()
        self.news()

    def _begin(
        self, arguments: list[str], folder: Path, written: Mapping[Path, str]
    ) -> dict[str, Any]:
        """Run a command of vinefab as a child that ends with this process."""
        command = shlex.join(["vinefab", *arguments])
        complaints = tempfile.TemporaryFile()  # noqa: SIM115  closed when the search has ended
        try:
            process = subprocess.Popen(  # noqa: S603  our own program
                [sys.executable, "-m", "vinefab", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=complaints,
                cwd=self.home,
                env={**os.environ, STOP_WITH_INPUT: "1"},
                start_new_session=True,  # Ctrl-C is for the server, which passes it on once
            )
        except OSError as error:
            complaints.close()
            raise CannotWriteError(folder, f"no process ({error.strerror})") from error
        self._running = RunningSearch(
            folder=folder,
            command=command,
            process=process,
            complaints=complaints,
            record=FollowedRecord(folder / RECORD_FILE),
            written=written,
        )
        self._told = None
        return {"folder": self._shown(folder), "command": command, "state": "running"}

    def _end(self, running: RunningSearch) -> None:
        if running.process.stdin is not None:
            with suppress(OSError):
                running.process.stdin.close()
        running.complaints.close()
        if running.state() == "failed" and not running.record.path.exists():
            # Refused before it began: another try finds the folder as it was.
            _take_back(running.written)
            with suppress(OSError):
                running.folder.rmdir()
        self._running = None

    def _event(self, running: RunningSearch) -> SearchEvent:
        # Before the record is read: an ended search has then written all of it.
        state, record = running.state(), running.record
        problem = "" if state != "failed" else running.complaint()
        try:
            record.look()
        except UnreadableFileError as error:
            problem = problem or str(error)
        event = {
            "event": "search",
            "folder": self._shown(running.folder),
            "state": state,
            "share": record.share,
            "generations": record.generations,
            "most_generations": record.settings.search.generations if record.settings else None,
            "evaluations": record.evaluations,
            "task": record.settings.task.name if record.settings else None,
            "curve": record.curve_points(),
            "best": record.best_content(),
            "best_score": record.best if record.best_at is not None else None,
            "best_words": best_words(record),
            "best_breaks": record.best_breaks,
            "front": record.front.plain() if record.front else None,
            "line": problem or _line(state, record, asked=running.was_asked_to_stop),
            "command": running.command,
        }
        return event if state != "ended" else {**event, **self._outcome(running)}

    def _outcome(self, running: RunningSearch) -> dict[str, Any]:
        """Return what an ended search changes of its last event."""
        try:
            result = RunArchive.read(running.record.path).result()
            front = final_front(running.folder, running.record)
        except VinefabError as error:
            return {"line": str(error)}
        breaks = running.process.returncode == 1
        rules = "; it breaks fabrication rules or limits" if breaks else ""
        found = {
            "best": design_content(result.best),
            "best_score": result.score.composite["mean"],
            "best_words": f"{winner_words(result.score)}{rules}",
            "best_breaks": breaks,
        }
        return {**found, "front": front} if front else found

    def _arguments(self, run_file: Path, folder: Path) -> list[str]:
        """Return the command as a user would type it in the folder of the server."""
        run, out = self._shown(run_file), self._shown(folder)
        return ["optimize", run, "--out", out, "--workers", "1", "--quiet"]

    def _refuse_second(self) -> None:
        if self._running is not None and self._running.state() == "running":
            where = self._shown(self._running.folder)
            raise BadInputError("search", f"running in {where}", "one at a time: stop it", PAGE)
        self.news()

    def _inside(self, key: str, given: object) -> Path:
        """Return a path of the page, which must lie in one of the desk's folders."""
        if not isinstance(given, str) or not given or not given.isprintable():
            raise BadInputError(key, given, "a path in letters that can be shown", PAGE)
        return path_inside(key, given, self.roots, PAGE, self.home)

    def _shown(self, path: Path) -> str:
        """Return a path as the page shows it: from the server's folder where it lies below."""
        return str(path.relative_to(self.home) if path.is_relative_to(self.home) else path)

    def _free_folder(self) -> Path:
        is_allowed = any(self.home.is_relative_to(root) for root in self.roots)
        base = self.home if is_allowed else self.roots[0]
        number = 1
        while (base / f"search_{number}").exists():
            number += 1
        return base / f"search_{number}"

    def _new_folder(self, given: object) -> Path:
        """Return a folder for a new search: none yet, or an empty one."""
        folder = self._inside("folder", given)
        try:
            is_taken = folder.exists() and not (folder.is_dir() and not any(folder.iterdir()))
        except OSError as error:
            raise UnreadableFileError(folder, error.strerror or "is not readable") from error
        if is_taken or folder in self.roots:
            raise BadInputError("folder", given, "a new folder, or an empty one", PAGE)
        return folder

    def _found_maps(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return the map files that are asked for by their whole paths, which must be allowed."""
        maps = ask.get("maps")
        if not isinstance(maps, Mapping) or not isinstance(maps.get("files"), list):
            return {}
        files = [str(self._inside("maps.files", name)) for name in maps["files"]]
        return {"maps": {**maps, "files": files}}

    def _run_file(
        self, ask: Mapping[str, Any], folder: Path, recorded: RunSettings
    ) -> tuple[Path, list[str]]:
        """Return the run file of a record, and the option for its seed where the file has another.

        The page may name it; otherwise it is looked for in the run's folder and the one above.
        """
        if ask.get("run"):
            given = self._inside("run", ask["run"])
            settings = read_run(given)
            return given, _seed_option(settings, recorded)
        for path in _toml_files(folder, self.roots):
            try:
                settings = read_run(path)
            except VinefabError:
                continue
            # Seed and limits aside.
            if first_difference(_compared(settings), _compared(recorded)) is None:
                return path, _seed_option(settings, recorded)
        allowed = f"its run file: none in {self._shown(folder)} or the folder above asks for it"
        raise BadInputError("run", None, allowed, PAGE)

    def _row(self, path: Path) -> dict[str, Any]:
        """Return one run for the page's list; one that did not change is not read again."""
        running = self._running
        if running is not None and running.record.path == path:
            return self._listed(path)
        stamp = [_stamp(path.with_name(RECORD_FILE + ending)) for ending in ("", "-wal")]
        if path not in self._rows or self._rows[path][0] != stamp:
            self._rows[path] = stamp, self._listed(path)
        return self._rows[path][1]

    def _listed(self, path: Path) -> dict[str, Any]:
        """Return one run for the page's list."""
        running = self._running
        is_running = running is not None and running.record.path == path
        record = FollowedRecord(path, has_front=False)
        try:
            record.look()
        except VinefabError as error:
            return {"folder": self._shown(path.parent), "state": "unreadable", "line": str(error)}
        settings = record.settings
        if settings is None:
            line = "has no generation yet"
            return {"folder": self._shown(path.parent), "state": "unfinished", "line": line}
        state = "running" if is_running else "ended" if record.stopped else "unfinished"
        score, words = listed_score(record)
        return {
            "folder": self._shown(path.parent),
            "state": state,
            "name": settings.name,
            "task": settings.task.name,
            "objectives": list(settings.objectives),
            "generations": record.generations,
            "most_generations": settings.search.generations,
            "best_score": score,
            "best_words": words,
            "line": _line(state, record),
        }


_WHY = {
    "evaluations": ": as many designs as asked for",
    "stall": ": nothing improved any more",
    "wall_time": ": its time was over",
}


def _line(state: str, record: FollowedRecord, *, asked: bool = False) -> str:
    """Return how far a search is, in words."""
    if record.settings is None:
        return "starting" if state == "running" else "stopped before it began; it can be resumed"
    most = record.settings.search.generations
    done = f"generation {record.generations} of {most}"
    if state == "running":
        if asked:
            return f"stopping after {done}"
        if record.stopped or record.generations >= most:
            return f"{done}; finalists on fresh poses, prediction, page"
        return done
    if state == "ended":
        return f"ended after {done}{_WHY.get(record.stopped, '')}"
    return f"stopped after {done}; everything is recorded, it can be resumed"


def _on_page(error: VinefabError, run_file: Path) -> VinefabError:
    """Return an error about a run file that is gone again as one about the page."""
    if isinstance(error, BadInputError | UnknownNameError) and error.source == str(run_file):
        return error.at(PAGE)
    return error


def _take_back(written: Mapping[Path, str]) -> None:
    """Remove files that a search wrote before it was refused, unless somebody changed them."""
    for path, text in written.items():
        with suppress(OSError):
            if path.read_bytes() == marked(text.encode()):
                path.unlink()


def _records_below(roots: tuple[Path, ...]) -> tuple[list[Path], bool]:
    """Return the records in folders and below, and whether all of these were looked at."""
    found: dict[Path, None] = {}
    looked = 0
    for root in roots:
        for folder in _folders(root):
            looked += 1
            if looked > MOST_FOLDERS:
                return list(found), False
            path = folder / RECORD_FILE
            if path.is_file():
                found[path] = None
    return list(found), True


def _folders(root: Path) -> Iterator[Path]:
    """Yield a folder and those below it, to some depth, without links and hidden ones."""
    for name, below, _ in os.walk(root):
        folder = Path(name)
        yield folder
        is_deepest = len(folder.relative_to(root).parts) >= DEEPEST_FOLDER
        below[:] = [] if is_deepest else sorted(name for name in below if not name.startswith("."))


def _stamp(path: Path) -> tuple[int, int]:
    """Return time and size of a file; zeros for one that is not there."""
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size


def _toml_files(folder: Path, roots: tuple[Path, ...]) -> Iterator[Path]:
    """Yield files that may be the run file of a record: in its folder, then in the one above."""
    looked = 0
    for where in (folder, folder.parent):
        if not any(where.is_relative_to(root) for root in roots):
            continue
        for path in sorted(where.glob("*.toml")):
            looked += 1
            if looked > MOST_CANDIDATES:
                return
            with suppress(OSError):
                if path.is_file() and path.stat().st_size <= MOST_RUN_FILE_BYTES:
                    yield path


def _compared(settings: RunSettings) -> dict[str, Any]:
    plain: Any = plain_settings(with_trunk_for_film(settings))
    search = {k: v for k, v in plain["search"].items() if k not in (*LIMIT_NAMES, "seed")}
    maps = {**plain["maps"], "files": len(plain["maps"]["files"])}
    return {**plain, "search": search, "maps": maps}


def _seed_option(settings: RunSettings, recorded: RunSettings) -> list[str]:
    seed = recorded.search.seed
    return [] if settings.search.seed == seed else ["--seed", str(seed)]


DeskFunction = Callable[
    [SearchDesk, StudioState | Mapping[str, Any] | None, Mapping[str, Any]], Any
]


def _state(given: StudioState | Mapping[str, Any] | None, ask: Mapping[str, Any]) -> StudioState:
    """Return what is open on the page: given as such, or sent with the question."""
    found = given if given is not None else ask.get("state")
    if isinstance(found, StudioState):
        return found
    if not isinstance(found, Mapping):
        raise BadInputError("state", found, "what is open on the page", PAGE)
    return StudioState.of(found)


SEARCH_DESK: Mapping[str, DeskFunction] = {
    "search_propose": lambda desk, state, ask: desk.propose(ask, _state(state, ask)),
    "search_start": lambda desk, state, ask: desk.start(ask, _state(state, ask)),
    "search_stop": lambda desk, _state, _ask: desk.stop(),
    "search_resume": lambda desk, _state, ask: desk.resume(ask),
    "search_runs": lambda desk, _state, _ask: desk.runs(),
    "search_load": lambda desk, _state, ask: desk.load(ask),
    "search_front": lambda desk, _state, ask: desk.front(ask),
}
"""What the page may ask of the desk; each answers with plain values."""
