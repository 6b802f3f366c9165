"""Ending on request: Ctrl-C, ``kill`` (SIGTERM) and a closed terminal (SIGHUP) are one to all code.

Each raises KeyboardInterrupt in the main thread, so that whatever cleans up after Ctrl-C cleans up
after the others too. A signal that the caller ignores (``nohup``) stays ignored.
"""

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING

from vinefab.core.front_door import imported_later

if TYPE_CHECKING:
    import multiprocessing
    from multiprocessing import resource_tracker
else:  # few commands begin processes, and not all systems have the tracker
    multiprocessing = imported_later("multiprocessing")
    resource_tracker = imported_later("multiprocessing.resource_tracker")

REQUESTS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    if hasattr(signal, name)
)
"""Signals that ask a command to end: a closed terminal sends SIGHUP, on Windows SIGBREAK."""

_FROM_TERMINAL = tuple(request for request in REQUESTS if request is not signal.SIGTERM)
"""What a terminal sends to all processes of a command; SIGTERM is how its own end them."""


_LOADING_S = 5.0
"""So long a request waits at most for modules that are being loaded."""

_IMPORTING = "<frozen importlib._bootstrap>"
"""Where the interpreter loads modules, as frames of calls name it."""

Handler = Callable[[int, FrameType | None], object]


@dataclass(slots=True)
class StopRequest:
    """The request that ended a command, if any."""

    number: int = 0  # of the signal

    @property
    def exit_code(self) -> int:
        """128 and the signal's number, as shells count; of no request that of Ctrl-C."""
        return 128 + (self.number or signal.SIGINT)


@contextmanager
def stop_requests(noted: StopRequest | None = None) -> Iterator[StopRequest]:
    """Let every request to end raise KeyboardInterrupt within the block.

    Parameters
    ----------
    noted
        Tells of the request, also of one that comes as the block begins or ends; a new one if None.
    """
    request, is_over = noted or StopRequest(), False
    first_s = math.inf

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal first_s
        request.number = request.number or number
        if is_over:  # handlers are being put back
            return
        first_s = min(first_s, time.monotonic())
        # Compiled modules print a traceback of an interrupt while they are loaded.
        if _loads_module(frame) and time.monotonic() - first_s < _LOADING_S:
            _repeat_soon(number)
        else:
            raise KeyboardInterrupt

    usual_hook = sys.unraisablehook

    def hook(what: "sys.UnraisableHookArgs") -> None:
        if issubclass(what.exc_type, KeyboardInterrupt):
            _repeat_soon(request.number or signal.SIGINT)
        else:
            usual_hook(what)

    with _handled(stop):
        sys.unraisablehook = hook
        try:
            yield request
        finally:
            is_over = True
            sys.unraisablehook = usual_hook


@contextmanager
def stops_deferred() -> Iterator[None]:
    """Raise a request to end at the end of the block; processes begun in it get none of a terminal.

    They end with this process, or are ended by it. For starting and closing what an exception in
    the middle would leave half done.
    """
    noted: list[int] = []
    try:
        with _handled(lambda number, _: noted.append(number)), _hidden_from_children():
            yield
    finally:
        if noted:  # an error of the block may come from processes that got the same request
            signal.raise_signal(noted[0])


@contextmanager
def _handled(handler: Handler) -> Iterator[None]:
    """Handle the requests that are not ignored; only the main thread of a process can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = {request: signal.getsignal(request) for request in REQUESTS}
    ours = [request for request in REQUESTS if usual[request] not in (signal.SIG_IGN, None)]
    try:
        for request in ours:
            signal.signal(request, handler)
        yield
    finally:
        for request in ours:
            signal.signal(request, usual[request])


@contextmanager
def _hidden_from_children() -> Iterator[None]:
    """Block the terminal's requests in this thread, and so in the processes that it begins."""
    if sys.platform == "win32":
        yield
        return
    usual = signal.pthread_sigmask(signal.SIG_BLOCK, _FROM_TERMINAL)
    try:
        resource_tracker.ensure_running()  # begins a process, and unblocks SIGINT on the way
        signal.pthread_sigmask(signal.SIG_BLOCK, _FROM_TERMINAL)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, usual)


def _loads_module(frame: FrameType | None) -> bool:
    """Tell whether a module is being loaded at a place of a program."""
    while frame is not None and frame.f_code.co_filename != _IMPORTING:
        frame = frame.f_back
    return frame is not None


def _repeat_soon(number: int) -> None:
    again_s = 0.05  # until a request is repeated that came where no exception can be raised
    timer = threading.Timer(again_s, _repeat, (number,))
    timer.daemon = True
    timer.start()


def _repeat(number: int) -> None:
    """Send a request to the main thread, which may have to be woken."""
    main_thread = threading.main_thread().ident
    if sys.platform == "win32" or main_thread is None:
        signal.raise_signal(number)
    else:
        signal.pthread_kill(main_thread, number)


STOP_WITH_INPUT = "VINEFAB_STOP_WITH_INPUT"
"""Environment variable, set to 1 by a program that begins a command and holds its standard input:
when that ends or is written to, the command stops as with Ctrl-C."""


def stop_with_input() -> None:
    """Ask this process to stop when its standard input ends, if `STOP_WITH_INPUT` says so.

    A pipe ends with the process that holds its other end, however that ends.
    """
    if os.environ.get(STOP_WITH_INPUT) == "1":
        threading.Thread(target=_stop_after_input, daemon=True).start()


def _stop_after_input() -> None:
    with suppress(OSError):  # one that is closed has ended
        os.read(0, 1)
    _repeat(signal.SIGINT)


def end_with_parent() -> None:
    """Let this process end when the one that began it does, however that ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.join,), daemon=True).start()


def _end_after(wait: Callable[[], object]) -> None:
    wait()
    os._exit(1)
