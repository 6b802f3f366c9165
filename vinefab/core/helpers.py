"""Other processes that help to work off a list, each a fresh interpreter.

For work of whole seconds that holds the interpreter's lock. Unlike a pool of `multiprocessing`,
helpers never run the main module of the user again, and may be started anywhere.
"""

import base64
import importlib
import os
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

_PACKAGE = Path(__file__).resolve().parent.parent

_PROGRAM = (
    "import sys; sys.path.append(sys.argv[1]); from vinefab.core.helpers import _help; "
    "_help(sys.argv[2], sys.argv[3])"
)

_PATIENCE_S = 0.2  # where nothing interrupts a longer wait


def processors() -> int:
    """Return the number of processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Helpers:
    """Processes that take things from a list until it is empty."""

    def __init__(self, threads: list[threading.Thread]) -> None:
        self._threads = threads

    def wait(self) -> bool:
        """Wait for a moment; return whether a helper still works."""
        for thread in self._threads:
            if thread.is_alive():
                thread.join(_PATIENCE_S)
                return True
        return False


@contextmanager
def helped(
    work: Callable[[T], None],
    waiting: deque[T],
    count: int,
    during: Callable[[T], AbstractContextManager[None]] = lambda _: nullcontext(),
) -> Iterator[Helpers]:
    """Let other processes take things from a list and work on them, as long as the block lasts.

    What a helper makes of a thing is for the function to keep, in a file. A thing whose helper ends
    too early returns to the list: the block must work off what is left, until no helper works.
    Helpers end with the block, and are killed if it raises.

    Parameters
    ----------
    work
        A function of a module, called in the helpers with things that can be pickled.
    waiting
        Things to be done; the block may take some itself.
    count
        Number of helpers; 0 where there are none.
    during
        A block that is entered while a helper works on a thing, in a thread of this process.
    """
    line = [sys.executable, "-P", "-c", _PROGRAM, str(_PACKAGE.parent)]
    line += [work.__module__, work.__qualname__]
    with ExitStack() as stack:
        processes, threads = list[subprocess.Popen[bytes]](), list[threading.Thread]()
        try:
            for _ in range(count if sys.executable else 0):
                process = subprocess.Popen(  # noqa: S603  this interpreter, on our own code
                    line,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                )
                processes.append(stack.enter_context(process))
                threads.append(
                    threading.Thread(target=_ask, args=(process, waiting, during), daemon=True)
                )
                threads[-1].start()
            yield Helpers(threads)
            while Helpers(threads).wait():
                pass
        except BaseException:
            for process in processes:
                process.kill()
            raise


def _ask(
    process: subprocess.Popen[bytes],
    waiting: deque[T],
    during: Callable[[T], AbstractContextManager[None]],
) -> None:
    """Let a process work on one thing after the other, as long as some wait."""
    if process.stdin is None or process.stdout is None:
        return
    while True:
        try:
            thing = waiting.popleft()
        except IndexError:
            break
        try:
            with during(thing):
                process.stdin.write(base64.b64encode(pickle.dumps(thing)) + b"\n")
                process.stdin.flush()
                if process.stdout.readline().strip() != _DONE:
                    raise BrokenPipeError
        except OSError:
            waiting.append(thing)
            break
    with suppress(OSError):
        process.stdin.close()


_DONE = b"done"


def _help(module: str, name: str) -> None:
    """Work on what lines of standard input hold, and answer each when it is done."""
    work = getattr(importlib.import_module(module), name)
    for line in sys.stdin.buffer:
        work(pickle.loads(base64.b64decode(line)))  # noqa: S301  from the process that began this
        sys.stdout.buffer.write(_DONE + b"\n")
        sys.stdout.buffer.flush()
