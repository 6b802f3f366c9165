"""Progress: the named phases of a command's work, each with its own count.

Work announces its phases and counts, as a program writes a log, and never knows who hears them: a
line on a terminal, a page of the studio, a function of the user's, or none. No result depends on
it. A phase inside another is announced with it: ``finalists 1 of 8, joints 2 of 5``.
"""

import builtins
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import TextIO, TypeVar

from vinefab.core.plain_text import visible

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Where a command's work stands: a phase and its count.

    Attributes
    ----------
    phase
        What is being done; the counted things stand last: ``walls of maps``.
    done, total
        How many of them are done, of how many; total 0: nothing is counted, or no end is known.
    words
        A few more words on the last one.
    left_s
        Estimated time until the end of this phase in s, where the work itself knows it.
    within
        The phase that this one is a part of, if any.
    """

    phase: str
    done: int = 0
    total: int = 0
    words: str = ""
    left_s: float | None = None
    within: "Progress | None" = None

    @property
    def share(self) -> float | None:
        """Share of the outermost counted phase that is done, 0 to 1; None where none is counted."""
        if self.within is not None and (outer := self.within.share) is not None:
            return outer
        return self.done / self.total if self.total else None

    @property
    def chain(self) -> tuple["Progress", ...]:
        """The phases that this one is a part of, the outermost first, and itself."""
        return (*(self.within.chain if self.within is not None else ()), self)

    @property
    def count(self) -> str:
        """The phase with its count, and those around it."""
        counts = []
        for one in self.chain:
            number = f" {one.done:,}" if one.done or one.total else ""
            counts.append(f"{one.phase}{number}{f' of {one.total:,}' if one.total else ''}")
        return ", ".join(counts)

    def __str__(self) -> str:
        return f"{self.count}: {self.words}" if self.words else self.count


COMPILING = "compiling once on this computer, functions"
"""The phase in which code that the cache lacks is compiled; others go on meanwhile."""

Listener = Callable[[Progress], None]
"""Hears every announcement."""


# --- Announcing ---------------------------------------------------------------------------------


class _Audience:
    """Who listens to the work of a context, and the phases that it is in."""

    def __init__(self, listeners: tuple[Listener, ...], phases: "list[Phase]") -> None:
        self.listeners, self.phases = listeners, phases

    def hear(self, progress: Progress, depth: int | None = None) -> None:
        """Let all hear where the work stands, inside of the first phases, or of all."""
        within = progress.within
        for outer in self.phases[:depth]:
            within = replace(outer.now, within=within)
        progress = replace(progress, within=within)
        token = _AUDIENCE.set(None)  # what a listener itself does is heard by none
        try:
            for listener in self.listeners:
                listener(progress)
        finally:
            _AUDIENCE.reset(token)


_AUDIENCE: ContextVar[_Audience | None] = ContextVar("audience", default=None)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Let a function hear what the work of a block announces; earlier listeners hear it too."""
    before = _AUDIENCE.get()
    earlier, phases = ((), []) if before is None else (before.listeners, before.phases)
    audience = _Audience((listener, *earlier), phases)
    token = _AUDIENCE.set(audience)
    _ALL.append(audience)
    try:
        yield
    finally:
        _ALL.remove(audience)
        _AUDIENCE.reset(token)


_ALL = list[_Audience]()
"""Every audience of this process, in any thread."""


def announce_to_all(progress: Progress) -> None:
    """Let every listener of this process hear of work that all may wait for, in any thread."""
    for listener in dict.fromkeys(one for audience in tuple(_ALL) for one in audience.listeners):
        listener(progress)


def is_heard() -> bool:
    """Tell whether anyone listens."""
    return _AUDIENCE.get() is not None


def announce(progress: Progress) -> None:
    """Let the listeners hear where the work stands, inside of the phases that it is in."""
    audience = _AUDIENCE.get()
    if audience is not None:
        audience.hear(progress)


class Phase:
    """A phase that is going on: it is told how much of it is done."""

    def __init__(self, now: Progress) -> None:
        self.now = now
        self._audience = _AUDIENCE.get()
        self._depth = 0 if self._audience is None else len(self._audience.phases)

    def at(self, done: int, words: str = "", left_s: float | None = None) -> None:
        """Announce how many are done."""
        most = self.now.total or done  # estimated totals may be passed
        self.now = replace(self.now, done=min(done, most), words=words, left_s=left_s)
        if self._audience is not None:
            self._audience.hear(self.now, self._depth)

    def more(self, count: int = 1, words: str = "") -> None:
        """Announce that some more are done."""
        self.at(self.now.done + count, words)

    def __enter__(self) -> "Phase":
        self.at(self.now.done, self.now.words)
        if self._audience is not None:  # phases that begin now are inside of it
            self._audience.phases.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        if self._audience is not None and self in self._audience.phases:
            del self._audience.phases[self._depth :]  # and whatever inside of it was not left


def phase(name: str, total: int = 0, words: str = "") -> Phase:
    """Return a phase of the work, announced where its block begins.

    Parameters
    ----------
    name
        What is done; the counted things stand last: ``walls of maps``.
    total
        How many; 0: nothing is counted, or no end is known.
    words
        A few more words.
    """
    return Phase(Progress(phase=name, total=total, words=words))


def each(
    name: str, things: Iterable[T], words: Callable[[T], str] = lambda _: "", total: int = 0
) -> Iterator[T]:
    """Yield some things, and announce how many are done.

    Parameters
    ----------
    name
        What is done with them: ``walls of maps``.
    words
        Names the thing that is being done.
    total
        How many there are, of things without a length.
    """
    total = len(things) if isinstance(things, Sized) else total
    if isinstance(things, Sized) and not total:
        return
    with phase(name, total) as count:
        for done, thing in enumerate(things):
            count.at(done, words(thing))
            yield thing


# --- One line -----------------------------------------------------------------------------------


class ProgressLine:
    """What a command announced, as one line with its time and the time left.

    Parameters
    ----------
    title
        The command.
    clock
        Seconds that only grow.
    """

    def __init__(self, title: str, clock: Callable[[], float] | None = None) -> None:
        self._title, self._clock = title, clock or time.monotonic
        self._began_s = self._clock()
        self._now: Progress | None = None
        self._compiling: Progress | None = None
        self._heard_s = self._began_s
        # By phase: the count and the time at which it was heard first, and last.
        self._paces = dict[str, tuple[tuple[int, float], tuple[int, float]]]()

    def hear(self, progress: Progress) -> None:
        """Note what is announced."""
        heard_s = self._clock()
        for one in progress.chain:
            last = one.done, heard_s
            first, before = self._paces.get(one.phase, (last, last))
            if one.done < before[0]:  # it begins anew
                first = last
            elif one.done == before[0]:  # still the same one: no news on the pace
                last = before
            self._paces[one.phase] = first, last
        self._heard_s = heard_s
        if progress.phase == COMPILING:  # what needs it continues afterwards
            self._compiling = progress if progress.done < progress.total else None
        else:
            self._now = progress

    @property
    def elapsed_s(self) -> float:
        """Time since the beginning."""
        return self._clock() - self._began_s

    @property
    def now(self) -> Progress | None:
        """What is shown: code that is compiled, or else what was heard last."""
        return self._compiling or self._now

    @property
    def left_s(self) -> float | None:
        """Time until the end of the outermost phase of which it can be known; None: of none."""
        now_s = self._clock()
        for one in self.now.chain if self.now is not None else ():
            (first, first_s), (last, last_s) = self._paces[one.phase]
            if one.left_s is not None:
                left_s = one.left_s - (now_s - self._heard_s)
            elif one.total and last > first:
                pace_s = (last_s - first_s) / (last - first)
                left_s = pace_s * (one.total - last) - (now_s - last_s)
            else:
                continue
            if left_s >= 0.5:
                return left_s
        return None

    @property
    def what(self) -> str:
        """Phase, count and words."""
        return "" if self.now is None else str(self.now)

    @property
    def left(self) -> str:
        """The time left as text; empty where it is not known."""
        return "" if self.left_s is None else f"about {duration_text(self.left_s)} left"

    @property
    def times(self) -> str:
        """The time since the beginning and, where it is known, the time left of the phase."""
        return ", ".join(filter(None, (duration_text(self.elapsed_s), self.left)))

    def text(self) -> str:
        """Return the line."""
        now = self.now
        if now is None:
            return f"{self._title} ({self.times})"
        words = f": {now.words}" if now.words else ""
        return f"{self._title}: {now.count} ({self.times}){words}"


FIRST_S = 10.0
"""Until the first line in a file or pipe; a command that ends before writes nothing."""

STEP_S, MOST_STEP_S, OF_ELAPSED = 10.0, 300.0, 60.0
"""Between lines whose numbers change: at first, at most, and the share of the time so far."""

PHASE_S, STANDING = 2.0, 3.0
"""The least time between two lines, when a phase begins; and how many usual pauses a line stands
of which no number changes."""


class ProgressLines:
    """Lines for a file or a pipe: as phases change, and now and then as their numbers do."""

    def __init__(self, line: ProgressLine, write: Callable[[str], None]) -> None:
        self._line, self._write = line, write
        self._written_s, self._phase, self._said = -1e9, "", ""

    def look(self) -> None:
        """Write a line if it is time for one."""
        line, elapsed_s = self._line, self._line.elapsed_s
        if elapsed_s < FIRST_S or line.now is None:
            return
        phase_now, said = line.now.chain[0].phase, f"{line.what} {line.left}"
        since_s = elapsed_s - self._written_s
        pause_s = min(max(STEP_S, elapsed_s / OF_ELAPSED), MOST_STEP_S)
        changed = phase_now != self._phase and since_s >= PHASE_S
        moved = said != self._said and since_s >= pause_s
        if changed or moved or since_s >= STANDING * pause_s:
            self._write(f"{visible(line.text())}\n")
            self._written_s, self._phase, self._said = elapsed_s, phase_now, said


LOOK_S = 0.5
"""Between two looks whether there is something new to show."""


@contextmanager
def progress_in_lines(title: str) -> Iterator[Listener]:
    """Write the progress of a block into standard error, in lines."""

    def write(text: str) -> None:
        with suppress(OSError, ValueError):  # its reader is gone
            if sys.stderr is not None:  # as with 2>&- in a shell
                sys.stderr.write(text)
                sys.stderr.flush()

    line = ProgressLine(title)
    with ticking(ProgressLines(line, write).look):
        yield line.hear


@contextmanager
def progress_seen(see: Callable[[ProgressLine], None]) -> Iterator[Listener]:
    """Let a function see the progress of a block, in a thread, whenever its line is another."""
    line, last = ProgressLine(""), ""

    def look() -> None:
        nonlocal last
        now = f"{line.what} {line.left}"
        if line.now is not None and now != last:
            last = now
            see(line)

    with ticking(look):
        yield line.hear


SHOWN_AFTER_S = 2.0
"""A public function shows its progress after so long."""


@contextmanager
def progress_shown(title: str) -> Iterator[Listener]:
    """Show the progress of a block in one line, which ends with it, to somebody who watches.

    That is who sits at a terminal or in a notebook; elsewhere nothing is written.
    """
    stream: TextIO | None = sys.stderr
    if stream is None or not stream.isatty():
        # IPython gives its cells this name; in a notebook standard error would look like trouble.
        shell = getattr(builtins, "get_ipython", lambda: None)()
        stream = None if shell is None else sys.stdout
    if stream is None:
        yield lambda _progress: None
        return
    line = ProgressLine(title)
    renewed = _Renewed(line, stream)
    with ticking(renewed.look):
        yield line.hear
    renewed.clear()


class _Renewed:
    """One line that is written over itself."""

    def __init__(self, line: ProgressLine, stream: TextIO) -> None:
        self._line, self._stream, self._width = line, stream, 0

    def look(self) -> None:
        if self._line.elapsed_s >= SHOWN_AFTER_S:
            text = visible(self._line.text())
            self._put(f"\r{text:<{self._width}}")
            self._width = len(text)

    def clear(self) -> None:
        if self._width:
            self._put(f"\r{'':<{self._width}}\r")

    def _put(self, text: str) -> None:
        with suppress(OSError, ValueError):  # its reader is gone
            self._stream.write(text)
            self._stream.flush()


@contextmanager
def ticking(look: Callable[[], None]) -> Iterator[None]:
    """Let a thread call a function now and then until a block is over, also while it waits."""
    is_over = threading.Event()

    def tick() -> None:
        while not is_over.wait(LOOK_S):
            look()

    ticker = threading.Thread(target=tick, daemon=True)
    ticker.start()
    try:
        yield
    finally:
        is_over.set()
        ticker.join()


def duration_text(seconds: float) -> str:
    """Return a rounded duration as text.

    Examples
    --------
    >>> duration_text(9.6), duration_text(80.0), duration_text(7500.0)
    ('10 s', '1 min 20 s', '2 h 5 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
