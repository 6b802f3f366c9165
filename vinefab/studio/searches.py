"""Searches of the page: begun, followed, stopped, resumed, loaded; each is a command's run.

A search is a child process of the server that runs ``vinefab optimize``, nothing else. It stops as
with Ctrl-C, everything recorded, when the page asks for it, when the server ends, and also when the
server is killed: it notices that the pipe to it has closed (`vinefab.core.interruption`).
"""

import asyncio
import os
import shlex
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from vinefab.core.atomic import folder_to_fill, write_text
from vinefab.core.codec import Record
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    UnknownNameError,
    UnreadableFileError,
    VinefabError,
    located,
)
from vinefab.core.hashing import marked
from vinefab.core.interruption import STOP_WITH_INPUT
from vinefab.core.plain_text import counted, visible
from vinefab.core.validation import Floats, check_plain
from vinefab.model.design import Design, design_content
from vinefab.model.files.shipped import path_inside
from vinefab.model.score import Score
from vinefab.search.evaluator import INVALID_FITNESS, EvaluatorSpec
from vinefab.search.finalists import minimized, non_dominated, spread_out
from vinefab.search.free_space import space_of
from vinefab.search.front import FRONT_FILE, FrontFile, FrontObjective
from vinefab.search.manufacturability import with_build_for_film
from vinefab.search.record.generations import Generation, first_difference, touched_text
from vinefab.search.record.result import RECORD_FILE, RecordTail, RunArchive, records_below
from vinefab.search.run import refuse_distant_targets, training_maps
from vinefab.search.settings import LIMIT_NAMES, RunSettings, plain_settings, read_run
from vinefab.search.space import COSTS
from vinefab.studio.file_store import Broadcast
from vinefab.studio.run_request import RUN_FILE, run_files, run_proposal
from vinefab.studio.state import PAGE, StudioState
from vinefab.tasks.reach import TARGETS, TOUCHED

MOST_CURVE_POINTS, MOST_FRONT_POINTS = 240, 120
MOST_FRONT_KEPT = 360
"""A front of three aims may hold most designs of a run: beyond this, some spread over it stay."""

_SIMULATED, _BREAKS = "simulated", "; it breaks fabrication rules or limits"


@dataclass(slots=True)
class FollowedRecord:
    """A record that is read step by step while its run continues."""

    path: Path
    has_front: bool = True  # whether the front so far is wanted
    tail: RecordTail | None = None  # what was read last; None before there is a record
    generations: int = 0  # read so far
    evaluations: int = 0
    best: float = INVALID_FITNESS  # best fitness
    best_at: tuple[int, int] | None = None  # its generation and row
    best_breaks: bool = False  # whether it has a penalty
    best_touched: str = ""  # how many targets it touches; empty without targets
    best_x: Floats = field(default_factory=lambda: np.empty(0))
    curve: list[tuple[int, float]] = field(default_factory=list)  # evaluations and best fitness
    front: "LiveFront | None" = None

    @property
    def settings(self) -> RunSettings | None:
        """The settings of the run."""
        return None if self.tail is None else self.tail.settings

    @property
    def stopped(self) -> str:
        """Why the run stopped; empty before it has."""
        return self.tail.stopped if self.tail else ""

    def look(self) -> None:
        """Read the new generations."""
        tail = RecordTail.read(self.path, self.generations)
        if tail is None:
            return
        if self.tail is None and tail.settings.objectives and self.has_front:
            self.front = LiveFront(tail.settings)
        self.tail = tail
        for generation in tail.generations:
            self.generations = generation.number + 1
            self.evaluations += len(generation.fitness)
            if generation.best > self.best:
                row = int(np.argmax(generation.fitness))
                if self.best_breaks and generation.penalty[row] == 0.0:
                    # Designs that break something rank below all others, on their own scale.
                    self.curve.clear()
                self.best, self.best_at = generation.best, (generation.number, row)
                self.best_x = generation.x[row]
                self.best_breaks = bool(generation.penalty[row] > 0.0)
                if TARGETS in generation.terms:
                    of_best = [float(generation.terms[name][row]) for name in (TOUCHED, TARGETS)]
                    self.best_touched = touched_text(*of_best)
                self.curve.append((self.evaluations, self.best))
            if self.front is not None:
                self.front.take(generation)

    @property
    def share(self) -> float:
        """Share of the generations that are done; runs with other limits may end before."""
        if self.settings is None:
            return 0.0
        return min(1.0, self.generations / self.settings.search.generations)

    def best_content(self) -> dict[str, Any] | None:
        """Return the best design so far; None before there is one."""
        if self.settings is None or self.best_at is None:
            return None
        space = space_of(self.settings.space, self.settings.build)
        return design_content(space.design(self.best_x, self.settings.name))

    def curve_points(self) -> list[list[float]]:
        """Return the curve up to now, in a bounded number of points."""
        points = [list(point) for point in self.curve]
        if points and points[-1][0] < self.evaluations:
            points.append([self.evaluations, self.best])
        if len(points) <= MOST_CURVE_POINTS:
            return points
        chosen = np.linspace(0, len(points) - 1, MOST_CURVE_POINTS).round().astype(int)
        return [points[place] for place in chosen.tolist()]


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownObjective(FrontObjective):
    """An objective as charts name it."""

    kind: str  # ``planned`` or ``simulated``


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontPoint:
    """A design of a front on the page."""

    point: str  # by which the page asks for it
    label: str
    values: tuple[float, ...]  # by objective
    breaks: bool = False  # whether it has a penalty


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFront(Record):
    """A front as the page shows it."""

    objectives: tuple[ShownObjective, ...]  # the task first
    points: tuple[FrontPoint, ...]
    is_final: bool  # whether the run has ended with it


class LiveFront:
    """The designs of a run with several objectives that no other dominates so far."""

    def __init__(self, settings: RunSettings) -> None:
        self._settings = settings
        self._space = space_of(settings.space, settings.build)
        self._at: list[tuple[int, int]] = []  # generation and row of each
        self._fitness, self._costs = np.empty(0), np.empty((0, len(settings.further_objectives)))

    def take(self, generation: Generation) -> None:
        """Let the designs of a generation that break nothing join, and drop what they dominate."""
        names = self._settings.further_objectives
        costs = minimized(generation.x, generation.terms, self._space, names)
        valid = np.isfinite(generation.composite) & (generation.penalty == 0.0)
        rows = np.flatnonzero(valid & np.isfinite(costs).all(axis=1))
        at = [*self._at, *((generation.number, row) for row in rows.tolist())]
        fitness = np.concatenate([self._fitness, generation.fitness[rows]])
        costs = np.vstack([self._costs, costs[rows]])
        kept = np.flatnonzero(non_dominated(fitness, costs))
        if len(kept) > MOST_FRONT_KEPT:
            kept = kept[spread_out(costs[kept], MOST_FRONT_POINTS)]
        self._at = [at[place] for place in kept.tolist()]
        self._fitness, self._costs = fitness[kept], costs[kept]

    @property
    def shown(self) -> ShownFront:
        """The front for the page, its points in the order of the first further objective."""
        settings = self._settings
        signs = [1.0 if name in COSTS else -1.0 for name in settings.further_objectives]
        points = (
            FrontPoint(
                point="{}:{}".format(*self._at[place]),
                label=f"generation {self._at[place][0] + 1}",
                values=(
                    float(self._fitness[place]),
                    *(s * float(c) for s, c in zip(signs, self._costs[place], strict=True)),
                ),
            )
            for place in spread_out(self._costs, MOST_FRONT_POINTS)
        )
        return ShownFront(objectives=_objectives(settings), points=tuple(points), is_final=False)


def _objectives(settings: RunSettings) -> tuple[ShownObjective, ...]:
    """Return the objectives of a run, the task first."""
    return tuple(
        ShownObjective(
            name=one.name.replace("_", " ") if one.name in COSTS else f"{one.name} score",
            better=one.better,
            unit=one.unit,
            # A cost follows from the design alone.
            kind="planned" if one.name in COSTS else _SIMULATED,
        )
        for one in map(FrontObjective.named, (settings.task.name, *settings.further_objectives))
    )


def best_words(record: FollowedRecord) -> str:
    """Say where the best fitness so far comes from."""
    if record.best_at is None:
        return f"no valid design yet ({_SIMULATED})"
    breaks = _BREAKS if record.best_breaks else ""
    where = f"generation {record.best_at[0] + 1}"
    return f"best fitness so far, of many tries: likely too good ({_SIMULATED}, {where}{breaks})"


def winner_words(score: Score) -> str:
    """Say over how many poses a winner's score is a mean."""
    return (
        f"mean score of the winner on {counted(len(score.evaluations), 'fresh pose')} "
        f"({_SIMULATED})"
    )


_MOST_FRONT_BYTES = 1 << 24


def final_front(folder: Path, record: FollowedRecord) -> ShownFront | None:
    """Return the front that a run ended with, from its ``front.json``; None without one."""
    path, settings = folder / FRONT_FILE, record.settings
    if settings is None or not settings.objectives or not record.stopped or not path.exists():
        return None
    found = FrontFile.read(path, _MOST_FRONT_BYTES)
    if {one.name for one in found.objectives} != {*settings.objectives}:
        raise UnreadableFileError(path, "has other objectives than its run")
    if any("/" in one.design or "\\" in one.design for one in found.designs):
        raise UnreadableFileError(path, "is not a front of a run (it names a design by a path)")
    names = (settings.task.name, *settings.further_objectives)
    points = (
        FrontPoint(
            point=one.design,
            label=f"{one.design}{', knee' if one.knee else ''}",
            values=tuple(one.values[name] for name in names),
            breaks=one.penalty > 0.0,
        )
        for one in found.designs
    )
    return ShownFront(objectives=_objectives(settings), points=tuple(points), is_final=True)


_PAUSE_S = 0.35
"""Between two looks at the record of a run that is going on."""

_PATIENCE_S = 10.0
"""Time for a search to stop before it is killed; its record is whole then too."""

MOST_FOLDERS, DEEPEST_FOLDER, MOST_RUNS = 3000, 4, 60
"""Limits of the search for earlier runs below the folders."""

MOST_CANDIDATES, MOST_RUN_FILE_BYTES = 40, 1 << 18
"""Number and size of files that are tried as the run file of a record."""


@dataclass(slots=True)
class RunningSearch:
    """A search that this server began."""

    folder: Path
    command: str  # as a user would type it
    process: subprocess.Popen[bytes]
    errors: IO[bytes]  # what it writes to standard error
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

    def error_line(self) -> str:
        """Return the line with which it failed."""
        self.errors.seek(0, os.SEEK_END)
        self.errors.seek(max(0, self.errors.tell() - _MOST_ERROR_BYTES))
        lines = self.errors.read().decode("utf-8", "replace").strip().splitlines()
        words = lines[-1].removeprefix("error: ") if lines else "it ended without a word"
        code = self.process.returncode
        return visible(words) if code >= 0 else f"it was ended by signal {-code}; it can be resumed"


_INTERRUPTED = 130
_MOST_ERROR_BYTES = 8192


class SearchManager:
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
        self._last_event: dict[str, Any] | None = None
        self._rows: dict[Path, tuple[list[tuple[int, int]], dict[str, Any]]] = {}
        self._lock = threading.RLock()

    def propose(self, ask: Mapping[str, Any], state: StudioState) -> dict[str, Any]:
        """Return the form of a new search, and its command."""
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
            maps = ask.get("maps")
            if isinstance(maps, Mapping) and isinstance(maps.get("files"), list):
                whole = [str(self._inside("maps.files", name)) for name in maps["files"]]
                ask = {**ask, "maps": {**maps, "files": whole}}
            written: dict[Path, str] = {}
            with folder_to_fill(folder):
                try:
                    for name, text in run_files(state, ask, folder).items():
                        written[write_text(folder / name, text)] = text
                    settings = read_run(folder / RUN_FILE)
                    if settings.maps.files:  # targets lie on them; generated ones have none
                        with located(PAGE):
                            refuse_distant_targets(
                                EvaluatorSpec(settings=settings, maps=training_maps(settings))
                            )
                except VinefabError as error:
                    _remove_unchanged(written)
                    source = str(folder / RUN_FILE)  # it is gone again: the page is named
                    if (
                        isinstance(error, BadInputError | UnknownNameError)
                        and error.source == source
                    ):
                        raise error.at(PAGE) from None
                    raise
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
        """Return the runs below the folders, the latest first."""
        paths, is_whole = records_below(self.roots, most=MOST_FOLDERS, deepest=DEEPEST_FOLDER)
        newest = sorted(paths, key=_stamp, reverse=True)
        running = self._running.record.path if self._running is not None else None
        rows = []
        for path in newest[:MOST_RUNS]:
            stamp = [_stamp(path.with_name(RECORD_FILE + ending)) for ending in ("", "-wal")]
            if path == running:
                rows.append(self._listed(path))
                continue
            if path not in self._rows or self._rows[path][0] != stamp:  # it has changed
                self._rows[path] = stamp, self._listed(path)
            rows.append(self._rows[path][1])
        return {
            "runs": rows,
            "left_out": max(0, len(newest) - MOST_RUNS),
            "is_whole": is_whole,
            "search": self._last_event,
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
        record = FollowedRecord(folder / RECORD_FILE, has_front=False)
        if ":" in point:
            wanted, _, row = point.partition(":")
            tail = None
            if wanted.isascii() and wanted.isdigit() and row.isascii() and row.isdigit():
                tail = RecordTail.read(folder / RECORD_FILE, min(int(wanted), 2**62))
            found = [] if tail is None else [g for g in tail.generations if g.number == int(wanted)]
            if tail is None or not found or int(row) >= len(found[0].x):
                allowed = "G:R, a row of a generation of the run"
                raise BadInputError("point", point, allowed, folder)
            design = space_of(tail.settings.space, tail.settings.build).design(found[0].x[int(row)])
            name = f"{tail.settings.name}_{wanted}_{row}"[:100]
            content = design_content(design.changed(name=name))
            fitness = found[0].fitness[int(row)]
            words = f"fitness {fitness:.4f} in the search: likely too good ({_SIMULATED})"
        elif point == "best":
            record.look()
            best = record.best_content()
            if record.stopped:
                result = RunArchive.read(record.path).result()
                best = design_content(result.best)
                words = f"{result.score.composite['mean']:.4f}: {winner_words(result.score)}"
            elif best is not None:
                words = f"fitness {record.best:.4f}: {best_words(record)}"
            if best is None:
                raise BadInputError("point", "best", "a run with a valid design", folder)
            content = best
        else:
            record.look()
            front = final_front(folder, record)
            known = {one.point: one.values for one in front.points} if front else {}
            if point not in known:
                allowed = f"one of {', '.join(known) or 'none'}"
                raise BadInputError("point", point, allowed, folder)
            words = f"score {known[point][0]:.4f} on fresh poses ({_SIMULATED})"
            path = path_inside("design", f"front/{point}.toml", (folder,), folder / FRONT_FILE)
            content = design_content(Design.read(path))
        return {"design": content, "folder": self._shown(folder), "point": point, "words": words}

    def front(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return the front of a run: the one that it ended with, or the one so far."""
        folder = self._inside("folder", ask.get("folder"))
        record = FollowedRecord(folder / RECORD_FILE)
        record.look()
        if record.front is None:
            raise BadInputError("folder", ask["folder"], "a run with several objectives", PAGE)
        front = final_front(folder, record) or record.front.shown
        return {"folder": self._shown(folder), "front": front.content}

    def poll(self) -> dict[str, Any] | None:
        """Return the event of the running search; None if it is that of the last call."""
        with self._lock:
            if self._running is None:
                return None
            event = self._event(self._running)
            if event == self._last_event:
                return None
            self._last_event = event
            if event["state"] != "running":
                running, self._running = self._running, None
                if running.process.stdin is not None:
                    with suppress(OSError):
                        running.process.stdin.close()
                running.errors.close()
                if event["state"] == "failed" and not running.record.path.exists():
                    # Refused before it began: another try finds the folder as it was.
                    _remove_unchanged(running.written)
                    with suppress(OSError):
                        running.folder.rmdir()
            return event

    async def watch(self, broadcast: Broadcast) -> None:
        """Send the events of searches, until cancelled."""
        while True:
            event = await asyncio.to_thread(self.poll)
            if event is not None:
                broadcast(event)
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
        self.poll()

    def _begin(
        self, arguments: list[str], folder: Path, written: Mapping[Path, str]
    ) -> dict[str, Any]:
        """Run a command of vinefab as a child that ends with this process."""
        command = shlex.join(["vinefab", *arguments])
        errors = tempfile.TemporaryFile()  # noqa: SIM115  closed when the search has ended
        try:
            process = subprocess.Popen(  # noqa: S603  our own program
                [sys.executable, "-m", "vinefab", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                cwd=self.home,
                env={**os.environ, STOP_WITH_INPUT: "1"},
                start_new_session=True,  # Ctrl-C is for the server, which passes it on once
            )
        except OSError as error:
            errors.close()
            raise CannotWriteError(folder, f"no process ({error.strerror})") from None
        self._running = RunningSearch(
            folder=folder,
            command=command,
            process=process,
            errors=errors,
            record=FollowedRecord(folder / RECORD_FILE),
            written=written,
        )
        self._last_event = None
        return {"folder": self._shown(folder), "command": command, "state": "running"}

    def _event(self, running: RunningSearch) -> dict[str, Any]:
        # Before the record is read: an ended search has then written all of it.
        state, record = running.state(), running.record
        problem = "" if state != "failed" else running.error_line()
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
            "evaluations": record.evaluations,
            "task": record.settings.task.name if record.settings else None,
            "curve": record.curve_points(),
            "best": record.best_content(),
            "best_score": record.best if record.best_at is not None else None,
            "best_touched": record.best_touched,
            "best_words": best_words(record),
            "front": record.front.shown.content if record.front else None,
            "line": problem or _line(state, record, asked=running.was_asked_to_stop),
            "command": running.command,
        }
        if state != "ended":
            return event
        try:
            result = RunArchive.read(record.path).result()
            front = final_front(running.folder, record)
        except VinefabError as error:
            return {**event, "line": str(error)}
        breaks = running.process.returncode == 1
        return {
            **event,
            "best": design_content(result.best),
            "best_score": result.score.composite["mean"],
            "best_touched": result.targets.headline if result.targets else "",
            "best_words": f"{winner_words(result.score)}{_BREAKS if breaks else ''}",
            **({"front": front.content} if front else {}),
        }

    def _arguments(self, run_file: Path, folder: Path) -> list[str]:
        """Return the command as a user would type it in the folder of the server."""
        run, out = self._shown(run_file), self._shown(folder)
        return ["optimize", run, "--out", out, "--workers", "1", "--quiet"]

    def _refuse_second(self) -> None:
        if self._running is not None and self._running.state() == "running":
            where = self._shown(self._running.folder)
            raise BadInputError("search", f"running in {where}", "one at a time: stop it", PAGE)
        self.poll()

    def _inside(self, key: str, given: object) -> Path:
        """Return a path of the page, which must lie in one of the folders."""
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
            raise UnreadableFileError(folder, error.strerror or "is not readable") from None
        if is_taken or folder in self.roots:
            raise BadInputError("folder", given, "a new folder, or an empty one", PAGE)
        return folder

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
        places = [
            path
            for where in (folder, folder.parent)
            if any(where.is_relative_to(root) for root in self.roots)
            for path in sorted(where.glob("*.toml"))
        ]
        for path in places[:MOST_CANDIDATES]:
            try:
                if not path.is_file() or path.stat().st_size > MOST_RUN_FILE_BYTES:
                    continue
                settings = read_run(path)
            except (OSError, VinefabError):
                continue
            # Seed and limits aside.
            if first_difference(_compared(settings), _compared(recorded)) is None:
                return path, _seed_option(settings, recorded)
        allowed = f"its run file: none in {self._shown(folder)} or the folder above asks for it"
        raise BadInputError("run", None, allowed, PAGE)

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
        score, words = record.best if record.best_at is not None else None, best_words(record)
        touched = record.best_touched
        if record.tail and record.stopped and (winner := record.tail.winner_score) is not None:
            score, words = winner.composite["mean"], winner_words(winner)
            touched = winner.targets.headline if winner.targets else ""
        return {
            "folder": self._shown(path.parent),
            "state": state,
            "name": settings.name,
            "task": settings.task.name,
            "objectives": list(settings.objectives),
            "generations": record.generations,
            "most_generations": settings.search.generations,
            "best_score": score,
            "best_touched": touched,
            "best_words": words,
            "line": _line(state, record),
        }


_WHY = {
    "evaluations": ": as many designs as asked for",
    "stall": ": nothing improved any more",
    "wall_time": ": its time was over",
}


def _line(state: str, record: FollowedRecord, *, asked: bool = False) -> str:
    """Say how far a search is."""
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


def _remove_unchanged(written: Mapping[Path, str]) -> None:
    """Remove files that a search wrote before it was refused, unless somebody changed them."""
    for path, text in written.items():
        with suppress(OSError):
            if path.read_bytes() == marked(text.encode()):
                path.unlink()


def _stamp(path: Path) -> tuple[int, int]:
    """Return time and size of a file; zeros for one that is not there."""
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size


def _compared(settings: RunSettings) -> dict[str, Any]:
    plain: Any = plain_settings(with_build_for_film(settings))
    search = {k: v for k, v in plain["search"].items() if k not in (*LIMIT_NAMES, "seed")}
    maps = {**plain["maps"], "files": len(plain["maps"]["files"])}
    return {**plain, "search": search, "maps": maps}


def _seed_option(settings: RunSettings, recorded: RunSettings) -> list[str]:
    seed = recorded.search.seed
    return [] if settings.search.seed == seed else ["--seed", str(seed)]


SearchRequest = Callable[[SearchManager, Mapping[str, Any], Mapping[str, Any]], dict[str, Any]]
"""Takes the searches, the open state of the page, and its request."""

SEARCH_REQUESTS: Mapping[str, SearchRequest] = {
    "search_propose": lambda searches, state, ask: searches.propose(ask, StudioState.of(state)),
    "search_start": lambda searches, state, ask: searches.start(ask, StudioState.of(state)),
    "search_stop": lambda searches, _state, _ask: searches.stop(),
    "search_resume": lambda searches, _state, ask: searches.resume(ask),
    "search_runs": lambda searches, _state, _ask: searches.runs(),
    "search_load": lambda searches, _state, ask: searches.load(ask),
    "search_front": lambda searches, _state, ask: searches.front(ask),
}
"""The requests of the page about searches, by name."""
