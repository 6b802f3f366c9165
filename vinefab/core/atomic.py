"""Writing so that a file is either wholly old or wholly new, and nobody else's file is lost."""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from vinefab.core.errors import CannotWriteError, ForeignFileError, VinefabError
from vinefab.core.hashing import MANIFEST_NAME, digests_in, manifest_text, sha256_of_file
from vinefab.core.jsontext import OWN_MARK
from vinefab.core.lock import lock_folder
from vinefab.core.replacement import NEW, is_incomplete, replace_files, staging_folder

_LOOK_BYTES = 8192
_SCHEMA = re.compile(rb"vinefab/([a-z-]+)-\d")


def is_ours(path: Path) -> bool:
    """Tell whether vinefab wrote a file: its first or last 8 KiB hold the mark."""
    return OWN_MARK in _ends(path)


def ensure_writable(path: Path, *, force: bool = False) -> None:
    """Check, before any long work, that a file may be written.

    Parameters
    ----------
    path
        The file to be written. A missing folder is made to see whether it can be, and taken away
        again: a command that is refused later leaves none behind.
    """
    with _system_errors(path):
        made = _make(path.parent)
        try:
            _check_writable(path, force=force)
        finally:
            _take_away(made)


def _check_writable(path: Path, *, force: bool) -> None:
    with _system_errors(path):
        if path.is_dir():
            raise CannotWriteError(path, "it is a folder")
        if path.exists() and not path.is_file():
            raise CannotWriteError(path, "it is no plain file; --json - writes to the output")
        if path.exists() and not force and not is_ours(path):
            raise ForeignFileError(path)
        if not os.access(path.parent, os.W_OK | os.X_OK):
            raise CannotWriteError(path, "no permission to write in its folder")


def write_bytes(path: Path, data: bytes, *, force: bool = False) -> Path:
    """Write a file in one step: a temporary name beside it, then a rename.

    A link is followed. What vinefab wrote itself is overwritten by the same kind of file only: a
    picture does not replace a map.
    """
    with folder_to_fill(path.parent), _system_errors(path):
        _check_writable(path, force=force)
        if path.exists() and not force and _kind(_ends(path)) != _kind(data[:_LOOK_BYTES]):
            raise ForeignFileError(path, "is another kind of file")
        target = path.resolve()
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    return path


def write_text(path: Path, text: str, *, force: bool = False) -> Path:
    """Write a text file in one step, as `write_bytes` does, in UTF-8 with plain newlines."""
    return write_bytes(path, text.encode("utf-8"), force=force)


@contextmanager
def new_folder(path: Path, mark: str, *, force: bool = False) -> Iterator[Path]:
    """Fill a folder under a temporary name; its files are put in place when the block ends well.

    A folder that vinefab filled before with the same kind of content gets the new files in place
    of the old ones; everything in it that is not in its manifest stays where it is. Any other
    folder that is not empty needs ``force``, and keeps what is in it as well. If the block or
    what follows it raises, nothing has changed (`replacement.replace_files`).
    """
    ensure_own_folder(path, mark, force=force)
    fill = _filled_in_place if path.is_dir() else _filled_beside
    with fill(path, force=force) as folder:
        yield folder


def write_folder(path: Path, files: Mapping[str, bytes], mark: str, *, force: bool = False) -> None:
    """Write files by name into a folder, all or none, as `new_folder` does."""
    with new_folder(path, mark, force=force) as folder:
        for name, data in files.items():
            write_bytes(folder / name, data)


@contextmanager
def _filled_beside(path: Path, *, force: bool) -> Iterator[Path]:
    """Fill a folder that is not there yet: all of it appears in one step."""
    with folder_to_fill(path.parent):
        with _system_errors(path):
            temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
        try:
            yield temporary
            with _system_errors(path):
                _add_manifest(temporary)
                temporary.chmod(0o777 & ~_umask())
                if force and os.path.lexists(path):
                    path.unlink()
                temporary.replace(path)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def _filled_in_place(path: Path, *, force: bool) -> Iterator[Path]:
    """Fill a folder that is there, file by file."""
    handle = lock_folder(path, "another process is writing it")
    try:
        with _system_errors(path):
            staging = staging_folder(path)
        try:
            yield staging / NEW
            with _system_errors(path):
                _add_manifest(staging / NEW)
                replace_files(path, staging, force=force)
        finally:
            # If a replacement could not be undone, its files are still needed.
            if not is_incomplete(path):
                shutil.rmtree(staging, ignore_errors=True)
    finally:
        if handle is not None:
            os.close(handle)


@contextmanager
def folder_to_fill(path: Path) -> Iterator[None]:
    """Make a folder and its parents; if the block raises, remove those that it left empty."""
    with _system_errors(path):
        made = _make(path)
    try:
        yield
    except BaseException:
        _take_away(made)
        raise


def _make(folder: Path) -> list[Path]:
    """Make a folder and those above it, and return which were missing, the deepest first."""
    missing, nearest = [], _nearest_folder(folder)
    for place in (folder, *folder.parents):
        if place == nearest:
            break
        missing.append(place)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        _take_away(missing)
        raise
    return missing


def _nearest_folder(folder: Path) -> Path:
    """Return the deepest folder that is there, of one and those above it."""
    for place in (folder, *folder.parents):
        if place.is_dir():
            return place
        if place.exists():
            raise CannotWriteError(place, "it is a file; name a folder")
    return folder


def _take_away(folders: list[Path]) -> None:
    """Remove folders, deepest first, that are empty."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def ensure_own_folder(path: Path, mark: str, *, force: bool = False) -> None:
    """Check, before any long work, that a folder may be replaced (see `new_folder`)."""
    with _system_errors(path):
        here = Path.cwd()
        if path.resolve() in (here, *here.parents):
            raise CannotWriteError(path, "it holds the current folder; name a folder of its own")
        _nearest_folder(path)
        if not path.exists() or force:
            return
        marked = (path / mark).is_file() and is_ours(path / mark)
        whole = marked and (path / MANIFEST_NAME).is_file()
        if any(path.iterdir()) and not whole and not is_incomplete(path):
            raise ForeignFileError(path)


def ensure_unchanged(path: Path, *, force: bool = False) -> None:
    """Check that a file which vinefab wrote for a person to fill in is still empty, or away."""
    manifest = path.parent / MANIFEST_NAME
    if force or not path.is_file() or not manifest.is_file():
        return
    with _system_errors(path):
        if digests_in(manifest.read_text()).get(path.name) != sha256_of_file(path):
            raise ForeignFileError(path, "was filled in; copy it, or name another folder")


def _add_manifest(folder: Path) -> None:
    manifest = folder / MANIFEST_NAME
    if not manifest.exists():
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        digests = {path.relative_to(folder).as_posix(): sha256_of_file(path) for path in paths}
        manifest.write_text(manifest_text(digests))


def _ends(path: Path) -> bytes:
    with path.open("rb") as stream:
        head = stream.read(_LOOK_BYTES)
        stream.seek(0, os.SEEK_END)
        stream.seek(max(0, stream.tell() - _LOOK_BYTES))
        return head + stream.read()


def _kind(content: bytes) -> bytes:
    """Return what a file is: the schema that it names, or how it begins."""
    schema = _SCHEMA.search(content[:_LOOK_BYTES])
    return schema.group(1) if schema else content[:5]


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
