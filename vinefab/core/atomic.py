"""Atomic writing: a file is wholly old or wholly new, and no foreign file is lost.

New files of a folder are made in a hidden folder inside it and renamed into place one by one; old
ones wait in that hidden folder until all is done. A failure on the way is undone, rename by rename.
A process that is killed leaves ``INCOMPLETE.txt``, which lists the files that it was writing, so
that the next run knows them for its own. Files of the user stay where they are at every moment.
"""

import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vinefab.core.errors import (
    CannotWriteError,
    ForeignFileError,
    ReadBackError,
    VinefabError,
)
from vinefab.core.front_door import imported_later
from vinefab.core.hashing import (
    MANIFEST_NAME,
    Authorship,
    authorship,
    digests_in,
    has_mark,
    is_manifest_as_written,
    listed_in,
    manifest_text,
    marked,
    sha256_of,
    sha256_of_file,
)
from vinefab.core.plain_text import GENERATOR, OWN_MARK, readable

if TYPE_CHECKING:
    import fcntl
else:  # POSIX systems only
    fcntl = imported_later("fcntl")

_LOOK_BYTES = 8192
_MOST_BYTES = 1 << 28
"""Of a file whose digest is looked at; a larger one counts as changed."""
_SCHEMA = re.compile(rb"vinefab/([a-z-]+)-\d")


def is_ours(path: Path) -> bool:
    """Tell whether vinefab wrote a file, changed since or not: its ends hold the mark."""
    return has_mark(_ends(path))


def _authorship(path: Path) -> Authorship:
    if not is_ours(path):
        return Authorship.FOREIGN
    is_small = path.stat().st_size <= _MOST_BYTES
    return authorship(path.read_bytes()) if is_small else Authorship.CHANGED


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
        if _is_there(path) and not path.is_file():
            raise CannotWriteError(path, "not a plain file; --json - writes to the output")
        if is_protected(path):
            raise CannotWriteError(path, PROTECTED)
        if path.exists() and not force:
            found = _authorship(path)
            if found is Authorship.FOREIGN:
                raise ForeignFileError(path)
            if found is Authorship.CHANGED:
                raise ForeignFileError(path, found.value)
        if not os.access(path.parent, os.W_OK | os.X_OK):
            raise CannotWriteError(path, "no permission to write in its folder")


def write_bytes(
    path: Path, data: bytes, *, force: bool = False, sealed: bool = True, private: bool = False
) -> Path:
    """Write a file in one step: a temporary name in its folder, then a rename.

    A link is followed, and the permissions of a file that is replaced are kept. What vinefab wrote
    itself is overwritten by the same kind of file only: a picture does not replace a map.

    Parameters
    ----------
    force
        Overwrite whatever is there.
    sealed
        Whether the digest is put into the mark (`hashing`): not in a file that a person edits.
    private
        Whether only the user may read it.
    """
    with folder_to_fill(path.parent), _system_errors(path):
        _ensure_replaceable(path, data, force=force)
        _put(path, marked(data) if sealed else data, private=private)
    return path


def _ensure_replaceable(path: Path, data: bytes, *, force: bool) -> None:
    """Check that a file may be written, in place of one of the same kind where there is one."""
    _check_writable(path, force=force)
    if path.exists() and not force and _kind(_ends(path)) != _kind(data[:_LOOK_BYTES]):
        raise ForeignFileError(path, "is another kind of file")


def keep_aside(path: Path) -> Path:
    """Copy a file to ``NAME.old``, or the next name that is free."""
    number = 1
    while os.path.lexists(kept := path.with_name(f"{path.name}.old{number if number > 1 else ''}")):
        number += 1
    shutil.copy2(path, kept)
    return kept


def _put(path: Path, data: bytes, *, private: bool = False) -> None:
    """Put a file in place, with the permissions of the one that it replaces."""
    with _staged(path, data, private=private) as put:
        put()


@contextmanager
def _staged(path: Path, data: bytes, *, private: bool = False) -> Iterator[Callable[[], object]]:
    """Write a file under a temporary name; what is yielded puts it in place."""
    target = Path(os.path.realpath(path))
    mode = stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~_umask()
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(0o600 if private else mode)
        yield partial(temporary.replace, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_files(files: Mapping[Path, bytes], *, force: bool = False) -> None:
    """Write several files as `write_bytes` does, or none: all are on the disk before one is put."""
    with ExitStack() as made:
        steps = list[tuple[Path, Callable[[], object]]]()
        for path, data in files.items():
            made.enter_context(folder_to_fill(path.parent))
            with _system_errors(path):
                _ensure_replaceable(path, data, force=force)
                steps.append((path, made.enter_context(_staged(path, marked(data)))))
        for path, put in steps:
            with _system_errors(path):
                put()


def write_text(path: Path, text: str, *, force: bool = False) -> Path:
    """Write a text file in one step, as `write_bytes` does, in UTF-8 with plain newlines."""
    return write_bytes(path, readable(text).encode("utf-8"), force=force)


@contextmanager
def new_folder(path: Path, mark: str, *, force: bool = False) -> Iterator[Path]:
    """Fill a folder under a temporary name; its files are put in place when the block ends well.

    A folder that vinefab filled before with the same kind of content gets the new files in place
    of the old ones; everything in it that is not in its manifest stays where it is. Any other
    folder that is not empty needs ``force``, and keeps its other files as well. If the block or
    what follows it raises, nothing has changed (`replacement.replace_files`).
    """
    ensure_own_folder(path, mark, force=force)
    fill = _filled_in_place if path.is_dir() else _filled_beside
    with fill(path, force=force) as folder:
        yield folder


def write_folder(path: Path, files: Mapping[str, bytes], mark: str, *, force: bool = False) -> None:
    """Write files by name into a folder, all or none, as `new_folder` does."""
    with new_folder(path, mark, force=force) as folder:
        fill_folder(folder, files)


def fill_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by name as they are, without digests in them: the folder's manifest has those."""
    for name, data in files.items():
        with folder_to_fill((folder / name).parent), _system_errors(folder / name):
            _put(folder / name, data)


@contextmanager
def _filled_beside(path: Path, *, force: bool) -> Iterator[Path]:
    """Fill a folder that is not there yet: all of it appears in one step."""
    with folder_to_fill(path.parent):
        with _system_errors(path):
            temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
        try:
            with _named_in_place(temporary, path):
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
            with _named_in_place(staging / NEW, path):
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
def _named_in_place(staging: Path, folder: Path) -> Iterator[None]:
    """Name files of a hidden folder in errors by the places that they are made for."""
    try:
        yield
    except (CannotWriteError, ForeignFileError, ReadBackError) as error:
        path = _in_place(error.path, staging, folder)
        if path is None:
            raise
        raise type(error)(path, error.problem) from error
    except VinefabError:
        raise
    except OSError as error:
        path = _in_place(error.filename or "", staging, folder)
        if path is None:
            raise
        raise CannotWriteError(path, error.strerror or str(error)) from None


def _in_place(path: str | os.PathLike[str], staging: Path, folder: Path) -> Path | None:
    place = Path(os.fsdecode(path))
    return folder / place.relative_to(staging) if place.is_relative_to(staging) else None


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
        if _is_there(place):
            raise CannotWriteError(place, "it is a file; name a folder")
    return folder


def _is_there(path: Path) -> bool:
    """Tell whether a path leads to something; a loop of links raises OSError."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def _take_away(folders: list[Path]) -> None:
    """Remove folders, deepest first, that are empty."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def ensure_own_folder(path: Path, mark: str, *, force: bool = False) -> None:
    """Check, before any long work, that a folder may be replaced (see `new_folder`)."""
    with _system_errors(path):
        here = Path.cwd()
        if Path(os.path.realpath(path)) in (here, *here.parents):
            raise CannotWriteError(path, "it holds the current folder; name another folder")
        _nearest_folder(path)
        if not _is_there(path) or force:
            return
        marked = (path / mark).is_file() and is_ours(path / mark)
        whole = marked and (path / MANIFEST_NAME).is_file()
        if any(path.iterdir()) and not whole and not is_incomplete(path):
            raise ForeignFileError(path)


def is_filled_in(path: Path, files: Mapping[str, bytes], *, force: bool = False) -> bool:
    """Tell whether a person filled in a file of a folder that holds the same files as now.

    Parameters
    ----------
    files
        The files of the folder, by name, as they would be written now.

    Raises
    ------
    ForeignFileError
        If it was filled in and the folder was written with other files.
    """
    manifest = path.parent / MANIFEST_NAME
    if force or not path.is_file() or not manifest.is_file():
        return False
    with _system_errors(path):
        before = digests_in(manifest.read_text(encoding="utf-8"))
        if before.get(path.name) == sha256_of_file(path):
            return False
    if before != {name: sha256_of(data) for name, data in files.items()}:
        raise ForeignFileError(path, "was filled in; copy it, or name another folder")
    return True


def _add_manifest(folder: Path) -> None:
    manifest = folder / MANIFEST_NAME
    if not manifest.exists():
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        digests = {path.relative_to(folder).as_posix(): sha256_of_file(path) for path in paths}
        manifest.write_bytes(manifest_text(digests).encode(errors="surrogateescape"))


def _ends(path: Path) -> bytes:
    with path.open("rb") as stream:
        head = stream.read(_LOOK_BYTES)
        stream.seek(0, os.SEEK_END)
        stream.seek(max(0, stream.tell() - _LOOK_BYTES))
        return head + stream.read()


def _kind(content: bytes) -> bytes:
    """Return the kind of a file: the schema that it names, or its first bytes."""
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
        raise CannotWriteError(path, error.strerror or str(error)) from None


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current


def lock_folder(folder: Path, problem: str) -> int | None:
    """Lock a folder for this process until the handle is closed or the process ends.

    Nothing is written. Where the system has no such locks (Windows, some network file systems),
    the folder stays unlocked.
    """
    if sys.platform == "win32":
        return None
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return None  # writing there will report the problem
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise CannotWriteError(folder, problem) from None
    except OSError:
        os.close(handle)
        return None
    return handle


INCOMPLETE_NAME = "INCOMPLETE.txt"
"""Stands in a folder while, and only while, files of two runs may lie in it side by side."""

NEW, OLD = "new", "old"
"""Parts of the staging folder: files to be put in place, and those that they replace."""

_PREFIX = ".vinefab-new."
_ADVICE = f"""\
# {GENERATOR}
# A run was stopped while it replaced the files of this folder. Those listed below may be of an
# earlier run, of the stopped one, or missing: run the command again. Other files are untouched.
"""

PROTECTED = "it is write-protected"

Owned = dict[str, set[str]]
"""Files that vinefab wrote into a folder, by name, with the digests that it wrote."""


def is_protected(path: Path) -> bool:
    """Tell whether a file is there that this user may not write."""
    if not path.exists():
        return False
    return not path.stat().st_mode & 0o222 or not os.access(path, os.W_OK)


def staging_folder(folder: Path) -> Path:
    """Make a hidden folder inside a folder, on its file system, for the files to come."""
    staging = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
    (staging / NEW).mkdir()
    (staging / OLD).mkdir()
    return staging


def is_incomplete(folder: Path) -> bool:
    """Tell whether a run was killed while it replaced the files of a folder."""
    return (folder / INCOMPLETE_NAME).is_file()


def replace_files(folder: Path, staging: Path, *, force: bool) -> None:
    """Put the new files of a staging folder in place of those that an earlier run wrote.

    What the earlier run listed in its manifest and the new one does not have is removed, unless
    somebody changed it. After a failure everything is as it was before.

    Raises
    ------
    ForeignFileError
        Before anything is changed: if a file of somebody else, or one that was changed since
        vinefab wrote it, stands where a new file belongs, unless ``force`` is given.
    CannotWriteError
        Before anything is changed: if a folder stands where a new file belongs, a file where a
        new folder does, or a file is write-protected.
    """
    new = [path for path in (staging / NEW).rglob("*") if not path.is_dir()]
    names = sorted(path.relative_to(staging / NEW).as_posix() for path in new)
    # The manifest is the last, as it vouches for the others.
    names.sort(key=lambda name: name == MANIFEST_NAME)
    owned = _owned(folder)
    stale = [
        name for name in sorted(owned) if name not in names and _is_as_written(folder, name, owned)
    ]
    _refuse_conflicts(folder, names, stale, owned, force=force)
    _write_mark(folder, staging, names, owned)
    undo: list[Callable[[], object]] = []
    try:
        for name in stale:
            _set_aside(folder, staging, name, undo)
            _remove_empty_parents(folder, name, undo)
        for name in names:
            _put_in_place(folder, staging, name, undo)
    except BaseException:
        for step in reversed(undo):
            step()  # if one fails, the mark and its files stay for the next run
        _forget(folder, staging)
        raise
    _forget(folder, staging)


def _owned(folder: Path) -> Owned:
    """Return the files that the manifest, and the mark of a killed run, list."""
    owned: Owned = {}
    for path in (folder / MANIFEST_NAME, folder / INCOMPLETE_NAME):
        if not path.is_file() or OWN_MARK not in path.read_bytes()[:200]:
            continue
        for name, digest in listed_in(path.read_text(encoding="utf-8", errors="replace")):
            if ".." not in Path(name).parts and not Path(name).is_absolute():
                owned.setdefault(name, set()).add(digest)
    return owned


def _is_as_written(folder: Path, name: str, owned: Owned) -> bool:
    """Tell whether a file is there and is what vinefab wrote."""
    path = folder / name
    if path.is_symlink() or not path.is_file():
        return False
    if sha256_of_file(path) in owned.get(name, ()):
        return True
    return name == MANIFEST_NAME and is_manifest_as_written(
        path.read_text(encoding="utf-8", errors="replace")
    )


def _refuse_conflicts(
    folder: Path, names: list[str], stale: list[str], owned: Owned, *, force: bool
) -> None:
    gone = {folder / name for name in stale}
    for path in (*gone, *(folder / name for name in names)):
        if path.is_file() and is_protected(path):
            raise CannotWriteError(path, PROTECTED)
    # The manifest first: without it no other file is known.
    for name in sorted(names, key=lambda name: name != MANIFEST_NAME):
        path = folder / name
        for above in path.relative_to(folder).parents:
            place = folder / above
            if os.path.lexists(place) and not place.is_dir() and place not in gone:
                raise CannotWriteError(place, "a folder is to be written here; move the file away")
        if path.is_dir() and not path.is_symlink():
            held = [one for one in path.rglob("*") if not one.is_dir()]
            if not held or not gone.issuperset(held):  # not all of it is removed as stale
                raise CannotWriteError(path, "a file is to be written here; move the folder away")
        if (
            os.path.lexists(path)
            and not path.is_dir()
            and not force
            and not _is_as_written(folder, name, owned)
        ):
            problem = (
                "was changed since vinefab wrote it"
                if name in owned or name == MANIFEST_NAME
                else "was not written by vinefab"
            )
            raise ForeignFileError(path, problem)


def _write_mark(folder: Path, staging: Path, names: list[str], owned: Owned) -> None:
    """Write, in one step, which files may be of two runs from now on."""
    listed = [(digest, name) for name in sorted(owned) for digest in sorted(owned[name])]
    listed += [(sha256_of_file(staging / NEW / name), name) for name in names]
    text = _ADVICE + "".join(f"{digest}  {name}\n" for digest, name in listed)
    mark = staging / INCOMPLETE_NAME
    with mark.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    mark.replace(folder / INCOMPLETE_NAME)


def _set_aside(folder: Path, staging: Path, name: str, undo: list[Callable[[], object]]) -> None:
    path, kept = folder / name, staging / OLD / name
    kept.parent.mkdir(parents=True, exist_ok=True)
    undo.append(partial(_move_back, kept, path))
    path.replace(kept)


def _move_back(kept: Path, path: Path) -> None:
    """Undo `_set_aside`, which may have been stopped before or after it moved the file."""
    if os.path.lexists(kept):
        kept.replace(path)


def _remove_empty_parents(folder: Path, name: str, undo: list[Callable[[], object]]) -> None:
    for place in (folder / name).parents:
        if place == folder or any(place.iterdir()):
            return
        undo.append(partial(place.mkdir, exist_ok=True))
        place.rmdir()


def _put_in_place(folder: Path, staging: Path, name: str, undo: list[Callable[[], object]]) -> None:
    path, made = folder / name, staging / NEW / name
    for place in reversed(path.relative_to(folder).parents[:-1]):
        if not (folder / place).is_dir():
            undo.append(partial(_remove_if_empty, folder / place))
            (folder / place).mkdir()
    if path.is_dir() and not path.is_symlink():
        undo.append(partial(path.mkdir, exist_ok=True))
        path.rmdir()
    if os.path.lexists(path):
        if not path.is_symlink():
            made.chmod(stat.S_IMODE(path.stat().st_mode))
        _set_aside(folder, staging, name, undo)
    undo.append(partial(_take_back, path, made))
    made.replace(path)


def _remove_if_empty(place: Path) -> None:
    with suppress(OSError):
        place.rmdir()


def _take_back(path: Path, made: Path) -> None:
    """Undo the last step of `_put_in_place`, if it was done."""
    if not os.path.lexists(made):
        path.replace(made)


def _forget(folder: Path, staging: Path) -> None:
    """Take away the mark and all staging folders, those of runs that were killed too."""
    (folder / INCOMPLETE_NAME).unlink(missing_ok=True)
    shutil.rmtree(staging, ignore_errors=True)
    for left in folder.glob(f"{_PREFIX}*"):
        shutil.rmtree(left, ignore_errors=True)
