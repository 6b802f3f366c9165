"""Foreign files are read in a child process, with limits on its time and memory.

The child is a fresh interpreter, not a fork: a fork of a process with threads (OpenCV's, BLAS's)
may wait for them for ever, and multiprocessing would run the user's script again. It reads one
file after another, so that only the first one waits until the readers are loaded.
"""

import atexit
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import IO, Any, ParamSpec, TypeVar, cast

from vinefab.core.errors import UnreadableFileError, VinefabError

if sys.platform == "linux":
    import resource

P = ParamSpec("P")
R = TypeVar("R")

_CPU_S = 8
_CPU_S_PER_MB = 10
"""Of the file: a survey of 20 MB takes 10 s, a drawing that is crossed by itself any time."""
_WALL_S_PER_CPU_S = 5
"""On a busy machine; on Windows and macOS the only limit."""
_MORE_BYTES = 3 << 29
"""Over what the child holds before."""
_OVER_LIMITS = {-getattr(signal, name, 0) for name in ("SIGKILL", "SIGXCPU")} - {0}
"""Exit codes; the first is that of a system without memory."""
_START = """\
import pickle, sys
sys.path[:], module = pickle.load(sys.stdin.buffer)
from vinefab.core.bounded import serve_files
serve_files(module)
"""
_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "VECLIB")}
"""The stacks of more would count as memory."""


def bounded(path: Path, read: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> R:
    """Return the result of a reader for a file, or raise its error.

    The reader is a function of a module, its arguments and result can be pickled.

    Raises
    ------
    UnreadableFileError
        If the reader takes too long or too much memory, or dies.
    """
    megabytes = path.stat().st_size / 1e6 if path.is_file() else 0.0
    cpu_s = round(_CPU_S + _CPU_S_PER_MB * megabytes)
    within = f"cannot be read within {cpu_s} s and {_MORE_BYTES / 2**30:g} GiB"
    advice = "save only what is a wall, with fewer points and copies"
    child = _idle_child() or _Child()
    try:
        # Bytes: the child unpickles them, which loads the reader, under its limits.
        found, error = child.ask(cpu_s, pickle.dumps((read, arguments, options)))
    except EOFError:
        code = child.end()
        why = (
            "" if child.overdue or code in _OVER_LIMITS else f" (its reader ends with code {code})"
        )
        raise UnreadableFileError(path, f"{within}{why}: {advice}") from None
    except BaseException:  # Ctrl-C too
        child.end()
        raise
    if error is None or isinstance(error, VinefabError):
        _IDLE.append(child)
    else:
        child.end()
    # The second is what libraries in C++ say.
    if isinstance(error, MemoryError) or "bad_alloc" in str(error):
        raise UnreadableFileError(path, f"{within}: {advice}") from None
    if error is not None:
        raise error
    result: R = found
    return result


def begin_reader(module: str) -> None:
    """Begin a process that loads a module with a reader, while this one loads what it needs."""
    _IDLE.append(_idle_child() or _Child(module))


class _Child:
    """A process that reads files, one at a time."""

    def __init__(self, module: str = "") -> None:
        self.owner = os.getpid()
        self.overdue = False
        # In a separate session: Ctrl-C reaches the parent alone, which ends it.
        self.process = subprocess.Popen(  # noqa: S603  this interpreter
            [sys.executable, "-P", "-c", _START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | _ONE_THREAD,
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        self._send(pickle.dumps((sys.path, module)))

    def ask(self, cpu_s: int, call: bytes) -> tuple[Any, BaseException | None]:
        """Return the result of a call and None, or None and its error.

        Raises
        ------
        EOFError
            If the process ends before.
        """
        answers = cast("IO[bytes]", self.process.stdout)
        clock = threading.Timer(_WALL_S_PER_CPU_S * cpu_s, self._stop)
        clock.start()
        try:
            self._send(pickle.dumps((str(Path.cwd()), cpu_s, call)))
            answer: tuple[Any, BaseException | None] = pickle.load(answers)  # noqa: S301
        except (BrokenPipeError, pickle.UnpicklingError) as error:
            raise EOFError from error
        finally:
            clock.cancel()
        return answer

    def _send(self, data: bytes) -> None:
        requests = cast("IO[bytes]", self.process.stdin)
        requests.write(data)
        requests.flush()

    def _stop(self) -> None:
        self.overdue = True
        self.process.kill()

    def end(self) -> int:
        """Kill the process, unless it has ended, and return its exit code."""
        self.process.kill()
        with suppress(BrokenPipeError), self.process:
            pass
        return self.process.wait()


_IDLE: list[_Child] = []
"""Children without a file: as many as threads have read at once."""


def _idle_child() -> _Child | None:
    while _IDLE:
        child = _IDLE.pop()
        if child.owner == os.getpid() and child.process.poll() is None:
            return child
    return None


@atexit.register
def end_children() -> None:
    """End the processes that wait for files."""
    while (child := _idle_child()) is not None:
        child.end()


def serve_files(module: str) -> None:
    """Read files as the parent asks, until it is gone: the child's main program.

    Parameters
    ----------
    module
        Loaded before the first file is asked for; none if empty.
    """
    requests: SimpleQueue[tuple[str, int, bytes]] = SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    # Libraries that print do so elsewhere.
    answers = os.fdopen(os.dup(1), "wb")
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)

    def answer(found: object, error: BaseException | None) -> None:
        data = pickle.dumps((found, error))
        answers.write(data)
        answers.flush()

    def last(_: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        error.add_note("".join(traceback.format_tb(trace)))
        answer(None, error)

    sys.excepthook = last
    if module:
        import_module(module)
    while True:
        folder, cpu_s, call = requests.get()
        os.chdir(folder)
        _limit(cpu_s)
        try:
            read, arguments, options = pickle.loads(call)  # noqa: S301  from the parent
            found = read(*arguments, **options)
        except VinefabError as error:
            answer(None, error)
        else:
            answer(found, None)


def _listen(requests: SimpleQueue[tuple[str, int, bytes]]) -> None:
    try:
        while True:
            requests.put(pickle.load(sys.stdin.buffer))  # noqa: S301  from the parent
    finally:
        os._exit(1)  # the parent is gone, or has been killed


def _limit(cpu_s: int) -> None:
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
        wanted = pages * os.sysconf("SC_PAGE_SIZE") + _MORE_BYTES
        for kind, limit in (
            (resource.RLIMIT_DATA, wanted),
            (resource.RLIMIT_CPU, math.ceil(time.process_time()) + cpu_s),
            (resource.RLIMIT_CORE, 0),
        ):
            _, most = resource.getrlimit(kind)
            resource.setrlimit(kind, (limit if most < 0 else min(limit, most), most))
