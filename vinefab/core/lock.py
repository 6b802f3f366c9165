"""Keeping a folder to one process at a time."""

import os
from pathlib import Path

from vinefab.core.errors import CannotWriteError


def lock_folder(folder: Path, problem: str) -> int | None:
    """Take a folder for this process, until the handle is closed or the process ends.

    Nothing is written. Where the system has no such locks (not every network file system has),
    nobody is kept out.
    """
    if os.name != "posix":
        return None
    import fcntl  # noqa: PLC0415 - there is none on other systems

    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return None  # what is to be written there will tell
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise CannotWriteError(folder, problem) from error
    except OSError:
        os.close(handle)
        return None
    return handle
