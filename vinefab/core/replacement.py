"""Replacing what vinefab wrote into a folder, without ever moving what somebody else put there.

New files are made in a hidden folder inside the folder and renamed into place one by one; old ones
wait in that hidden folder until all is done. A failure on the way is undone, rename by rename. A
process that is killed leaves ``INCOMPLETE.txt``, which lists the files that it was writing, so that
the next run knows them for its own. Files of the user stay where they are at every moment.
"""

import os
import shutil
import stat
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from vinefab.core.errors import CannotWriteError, ForeignFileError
from vinefab.core.hashing import MANIFEST_NAME, is_manifest_as_written, listed_in, sha256_of_file
from vinefab.core.jsontext import GENERATOR, OWN_MARK

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


def moved_aside(folder: Path) -> list[Path]:
    """Return the hidden folders next to one, in which killed earlier versions left old files."""
    return sorted(path for path in folder.parent.glob(f".{folder.name}.old.*") if path.is_dir())


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
    names, owned = _new_names(staging / NEW), _owned(folder)
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


def _new_names(new: Path) -> list[str]:
    """Return the names of the new files; the manifest is the last, as it vouches for the others."""
    names = [path.relative_to(new).as_posix() for path in new.rglob("*") if not path.is_dir()]
    return sorted(names, key=lambda name: (name == MANIFEST_NAME, name))


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
        if path.is_dir() and not path.is_symlink() and not _will_be_empty(path, gone):
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


def _will_be_empty(path: Path, gone: set[Path]) -> bool:
    """Tell whether all that a folder holds is removed as stale."""
    files = [place for place in path.rglob("*") if not place.is_dir()]
    return bool(files) and gone.issuperset(files)


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
