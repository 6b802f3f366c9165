"""Writing so that a file is either wholly old or wholly new, and nobody else's file is lost."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vinefab.core.errors import CannotWriteError, ForeignFileError, VinefabError

OWN_MARK = b"written by vinefab"
FOLDER_MARKS = ("job.json", "rig.json", "coupons.json", "results.json", "run.sqlite")
_LOOK_BYTES = 8192


def is_ours(path: Path) -> bool:
    """Tell whether vinefab wrote a file: its first or last 8 KiB hold the mark."""
    with path.open("rb") as stream:
        head = stream.read(_LOOK_BYTES)
        stream.seek(0, os.SEEK_END)
        stream.seek(max(0, stream.tell() - _LOOK_BYTES))
        return OWN_MARK in head or OWN_MARK in stream.read()


def ensure_writable(path: Path, *, force: bool = False) -> None:
    """Check, before any long work, that a file may be written.

    Parameters
    ----------
    path
        The file to be written; its folder is made when missing.
    force
        Overwrite even what vinefab did not write.

    Raises
    ------
    ForeignFileError
        If the file exists and is not ours.
    CannotWriteError
        If the folder cannot be made or written to, or the path is a folder.
    """
    with _system_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise CannotWriteError(path, "it is a folder")
        if path.exists() and not force and not is_ours(path):
            raise ForeignFileError(path)
        if not os.access(path.parent, os.W_OK | os.X_OK):
            raise CannotWriteError(path, "no permission to write in its folder")


def write_bytes(path: Path, data: bytes, *, force: bool = False) -> Path:
    """Write a file in one step: a temporary name beside it, then a rename.

    Parameters
    ----------
    path
        The file to write.
    data
        Its whole content.
    force
        Overwrite even what vinefab did not write.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    ForeignFileError, CannotWriteError
        As in `ensure_writable`; nothing that was there has changed then.
    """
    ensure_writable(path, force=force)
    with _system_errors(path):
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    return path


def write_text(path: Path, text: str, *, force: bool = False) -> Path:
    """Write a text file in one step, as `write_bytes` does, in UTF-8 with plain newlines."""
    return write_bytes(path, text.encode("utf-8"), force=force)


@contextmanager
def new_folder(path: Path, *, force: bool = False) -> Iterator[Path]:
    """Fill a folder under a temporary name and put it in place when the block ends well.

    A folder that vinefab filled before (it holds a file named in `FOLDER_MARKS` with our mark) or
    an empty one is replaced, but files in it that others wrote are kept; any other folder needs
    ``force``. If the block raises, nothing has changed.

    Parameters
    ----------
    path
        The folder to make.
    force
        Replace even a folder that vinefab did not fill.

    Yields
    ------
    Path
        The temporary folder to write into.

    Raises
    ------
    ForeignFileError
        If the folder holds files and is not ours.
    CannotWriteError
        If the system refuses.
    """
    ensure_own_folder(path, force=force)
    with _system_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        yield temporary
        _put_in_place(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def ensure_own_folder(path: Path, *, force: bool = False) -> None:
    """Check, before any long work, that a folder may be replaced (see `new_folder`)."""
    with _system_errors(path):
        if not path.exists() or force:
            return
        if not path.is_dir():
            raise ForeignFileError(path)
        marks = [path / name for name in FOLDER_MARKS if (path / name).is_file()]
        if any(path.iterdir()) and not any(is_ours(mark) for mark in marks):
            raise ForeignFileError(path)


def _put_in_place(temporary: Path, path: Path) -> None:
    with _system_errors(path):
        temporary.chmod(0o777 & ~_umask())
        if path.is_dir():
            old = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent))
            path.replace(old / "old")
            temporary.replace(path)
            _keep_foreign(old / "old", path)
            shutil.rmtree(old, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
            temporary.replace(path)


def _keep_foreign(old: Path, new: Path) -> None:
    """Carry over what somebody else put into a folder of ours, unless we wrote the same name."""
    for path in sorted(old.rglob("*")):
        target = new / path.relative_to(old)
        if path.is_file() and not target.exists() and not is_ours(path):
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)


@contextmanager
def _system_errors(path: Path) -> Iterator[None]:
    """Turn what the system says into one of our errors."""
    try:
        yield
    except VinefabError:
        raise
    except OSError as error:
        raise CannotWriteError(path, error.strerror or str(error)) from error


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
