"""Folder locks: one process at a time."""

import os
import sys
from pathlib import Path

from vinefab.core.errors import CannotWriteError


def lock_folder(folder: Path, problem: str) -> int | None:
    """Lock a folder for this process until the handle is closed or the process ends.

    Nothing is written. Where the system has no such locks (Windows, some network file systems),
    the folder stays unlocked.
    """
    if sys.platform == "win32":
        return None
    import fcntl  # noqa: PLC0415  exists on POSIX systems only

    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return None  # writing there will report the problem
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise CannotWriteError(folder, problem) from error
    except OSError:
        os.close(handle)
        return None
    return handle
