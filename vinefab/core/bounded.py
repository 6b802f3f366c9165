"""Foreign files are read in a child process with limits on its time and memory."""

import copyreg
import multiprocessing
import os
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import MappingProxyType
from typing import Any, ParamSpec, TypeVar

from vinefab.core.errors import UnreadableFileError

if sys.platform == "linux":
    import resource

P = ParamSpec("P")
R = TypeVar("R")

_CPU_S = 20
_CPU_S_PER_MB = 20
"""Of the file: a survey of 20 MB takes 10 s, a drawing that is crossed by itself any time."""
_MORE_BYTES = 3 << 29
"""Over what the process holds before."""
_ADVICE = "save only what is a wall, with fewer points and copies"


def _read_only(values: dict[str, Any]) -> MappingProxyType[str, Any]:
    return MappingProxyType(values)


copyreg.pickle(MappingProxyType, lambda proxy: (_read_only, (dict(proxy),)))


def bounded(path: Path, read: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> R:
    """Return what a reader returns for a file, or raise its error.

    Raises
    ------
    UnreadableFileError
        If the reader takes too long or too much memory, or dies.
    """
    # Windows and macOS have no fork that is safe, or no limit of memory: no limits hold there.
    if sys.platform != "linux":
        return read(*arguments, **options)
    megabytes = path.stat().st_size / 1e6 if path.is_file() else 0.0
    cpu_s = round(_CPU_S + _CPU_S_PER_MB * megabytes)
    within = f"cannot be read within {cpu_s} s and {_MORE_BYTES / 2**30:g} GiB: {_ADVICE}"
    with warnings.catch_warnings():
        # Python 3.12 warns of threads; a reader takes no lock that they could hold.
        warnings.simplefilter("ignore", DeprecationWarning)
        pool = ProcessPoolExecutor(
            1, multiprocessing.get_context("fork"), initializer=_limit, initargs=(cpu_s,)
        )
        with pool:
            try:
                return pool.submit(read, *arguments, **options).result()
            except (BrokenProcessPool, MemoryError) as error:
                raise UnreadableFileError(path, within) from error


def _limit(cpu_s: int) -> None:
    if (cv2 := sys.modules.get("cv2")) is not None:
        cv2.setNumThreads(1)  # a fork has none of the threads that OpenCV would wait for
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
        held = pages * os.sysconf("SC_PAGE_SIZE")
        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        wanted = held + _MORE_BYTES
        resource.setrlimit(resource.RLIMIT_DATA, (wanted if most < 0 else min(wanted, most), most))
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
