"""Progress as lines of text: in the log of a command, and of a public function for its caller."""

import builtins
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import TextIO

from vinefab.core.plain_text import visible

FIRST_S = 10.0
"""Until the first line; a command that ends before says nothing."""

STEP_S, MOST_STEP_S = 30.0, 300.0
"""Between lines: at first, and at most, as the pauses grow with the time that has passed."""


@contextmanager
def progress_in_lines(title: str) -> Iterator[Callable[[float, str], None]]:
    """Write the progress of a block, as it is then, now and then.

    A thread writes it, so that there are lines also while a long step tells nothing.
    """
    with _written_beside(_write_lines, title) as tell:
        yield tell


SHOWN_AFTER_S, SHOWN_EVERY_S = 2.0, 0.5
"""A public function shows its progress after so long, and renews the line so often."""


@contextmanager
def progress_shown(title: str, *, shown: bool) -> Iterator[Callable[[float, str], None]]:
    """Show the progress of a block in one line, which ends with it, to somebody who watches.

    That is who sits at a terminal or in a notebook; elsewhere nothing is written.
    """
    stream = _watched_stream() if shown else None
    if stream is None:
        yield lambda _share, _words: None
        return
    with _written_beside(partial(_renew_line, stream=stream), title) as tell:
        yield tell


@contextmanager
def _written_beside(
    write: Callable[["_State", threading.Event], None], title: str
) -> Iterator[Callable[[float, str], None]]:
    """Let a thread write what a block tells, until the block is over."""
    state, is_over = _State(title), threading.Event()
    writer = threading.Thread(target=write, args=(state, is_over), daemon=True)
    writer.start()
    try:
        yield state.update
    finally:
        is_over.set()
        writer.join()


def _watched_stream() -> TextIO | None:
    """Return where somebody sees a line that is written again and again, if anywhere."""
    if sys.stderr is not None and sys.stderr.isatty():
        return sys.stderr
    # IPython gives its cells this name; in a notebook standard error would look like trouble.
    shell = getattr(builtins, "get_ipython", lambda: None)()
    return None if shell is None else sys.stdout


def _renew_line(state: "_State", is_over: threading.Event, stream: TextIO) -> None:
    pause_s, width = SHOWN_AFTER_S, 0
    with suppress(OSError, ValueError):  # its reader is gone
        while not is_over.wait(pause_s):
            line = visible(state.line())
            stream.write(f"\r{line:<{width}}")
            stream.flush()
            pause_s, width = SHOWN_EVERY_S, len(line)
        if width:
            stream.write(f"\r{'':<{width}}\r")
            stream.flush()


def _write_lines(state: "_State", is_over: threading.Event) -> None:
    pause_s = FIRST_S
    while not is_over.wait(pause_s):
        with suppress(OSError, ValueError):  # its reader is gone
            if sys.stderr is not None:  # as with 2>&- in a shell
                sys.stderr.write(f"{state.line()}\n")
                sys.stderr.flush()
        pause_s = min(max(STEP_S, state.elapsed_s / 10.0), MOST_STEP_S)


class _State:
    """What was last told of the progress."""

    def __init__(self, title: str) -> None:
        self._title, self._began_s = title, time.monotonic()
        self._share, self._words = 0.0, ""
        self._first: tuple[float, float] | None = None  # share and time of the first that was told

    def update(self, share: float, words: str) -> None:
        """Note the share of the work that is done, and a few words."""
        if self._first is None or share < self._share:  # a command of several parts begins anew
            self._first = share, time.monotonic()
        self._share, self._words = share, words

    @property
    def elapsed_s(self) -> float:
        """Time since the beginning."""
        return time.monotonic() - self._began_s

    def line(self) -> str:
        """Return the progress in one line."""
        left_s = self._left_s()
        left = "" if left_s is None else f", about {duration_text(left_s)} left"
        words = f": {self._words}" if self._words else ""
        done = f"{100 * self._share:.0f} % after {duration_text(self.elapsed_s)}"
        return f"{self._title}: {done}{left}{words}"

    def _left_s(self) -> float | None:
        """Return the time left at the pace since the first report, which may be of earlier work."""
        if self._first is None:
            return None
        share, at_s = self._first
        gained = self._share - share
        return None if gained <= 0.0 else (time.monotonic() - at_s) * (1.0 - self._share) / gained


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
