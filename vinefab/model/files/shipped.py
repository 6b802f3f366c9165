"""Designs, machines, materials, recipes, printers and run files by name or by path.

A name is looked for in the user's own folder first, then among the shipped files, then as
``NAME.toml`` in the current folder: a registered name means the same everywhere. The own folder is
``~/.config/vinefab`` (under ``XDG_CONFIG_HOME`` where that is set), or what the environment
variable ``VINEFAB_PROFILES`` says; it has the same folders inside as the project: ``designs``,
``laser_profiles/recipes`` and so on.
"""

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

from vinefab.core.errors import (
    BadInputError,
    UnfitInputError,
    UnknownNameError,
    UnreadableFileError,
    nearest,
)

KINDS = {
    "design": "designs",
    "machine": "laser_profiles/machines",
    "material": "laser_profiles/materials",
    "recipe": "laser_profiles/recipes",
    "printer": "laser_profiles/printers",
    "run file": "examples",
    "contacts file": "contacts",
}
"""Folder of each kind, below the place where shipped files lie."""

USER_VARIABLE = "VINEFAB_PROFILES"
"""Environment variable that names the user's own folder."""

DEFAULT_RECIPE = "co2_60w__stretchlon_200"
DEFAULT_PRINTER = "generic_220"


def shipped_root() -> Path:
    """Return the folder with ``designs`` and ``laser_profiles``.

    An installed package carries them inside; a checkout has them next to the package.
    """
    package = Path(__file__).resolve().parents[2]
    inside = package / "_shipped"
    return inside if inside.is_dir() else package.parent


def user_root() -> Path:
    """Return the user's own folder, whether it exists or not."""
    named = os.environ.get(USER_VARIABLE)
    if named:
        return Path(named).expanduser()
    home = os.environ.get("XDG_CONFIG_HOME")
    return (Path(home) if home else Path("~/.config").expanduser()) / "vinefab"


def names(kind: str) -> tuple[str, ...]:
    """Return the names of all shipped files of one kind (a key of `KINDS`)."""
    return _names_in(shipped_root(), kind)


def user_names(kind: str) -> tuple[str, ...]:
    """Return the names of the user's own files of one kind."""
    return _names_in(user_root(), kind)


def _names_in(root: Path, kind: str) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in (root / KINDS[kind]).glob("*.toml")))


def path_given(key: str, given: object, allowed: str = "a path") -> Path:
    """Return a path that a caller passed, or raise BadInputError if it is something else."""
    text = os.fspath(given) if isinstance(given, str | PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise BadInputError(key, given, allowed)
    return Path(text)


def locate(kind: str, name_or_path: str | PathLike[str]) -> Path:
    """Return the file that a user means.

    Parameters
    ----------
    name_or_path
        A path, with or without its suffix ``.toml``, or a name as in `registered`. A bare name that
        is registered and is a file ``NAME.toml`` here too means the registered one.
    """
    path = path_given(kind, name_or_path, "a path or a name")
    if path.is_file():
        return path
    is_bare = path.parent == Path() and not path.suffix
    if is_bare:
        found = file_named(kind, str(name_or_path))
        if found is not None:
            return found
    with_suffix = path.with_name(f"{path.name}.toml") if path.name else path
    if with_suffix.is_file():
        return with_suffix
    if is_bare:
        known = {*names(kind), *user_names(kind), *_names_here(kind)}
        raise UnknownNameError(kind, str(name_or_path), known)
    return existing_file(path, near=".toml")


def file_named(kind: str, name: str) -> Path | None:
    """Return the user's own or the shipped file of a name; None where there is none.

    Files name each other so: the current folder makes no difference.
    """
    places = (root / KINDS[kind] / f"{name}.toml" for root in (user_root(), shipped_root()))
    return next((place for place in places if place.is_file()), None)


_MOST_LOOKED_AT = 200


def _names_here(kind: str) -> tuple[str, ...]:
    """Return the stems of files of a kind in the current folder."""
    schema = b'"vinefab/%b-' % kind.removesuffix(" file").encode()
    found = list[str]()
    for path in sorted(Path().glob("*.toml"))[:_MOST_LOOKED_AT]:
        with suppress(OSError):
            if path.is_file() and schema in path.read_bytes()[:_HEAD_BYTES]:
                found.append(path.stem)
    return tuple(found)


_HEAD_BYTES = 2000


_OF_THE_SYSTEM = (Path("/proc"), Path("/sys"))
"""What lies here looks like files, may never end or block, and is not opened."""


def existing_file(path: Path, near: str = "") -> Path:
    """Return a path that leads to a file, or raise UnreadableFileError.

    Parameters
    ----------
    near
        The ending of files of its folder whose names the error may suggest; none if empty.
    """
    if path.is_dir():
        raise UnreadableFileError(path, "is a folder, not a file")
    if path.exists() and not path.is_file():
        raise UnreadableFileError(path, "is a device or a pipe, not a file")
    if not path.is_file():
        others = sorted(path.parent.glob(f"*{near}"))[:_MOST_LOOKED_AT] if near else []
        hint = nearest(path.name, [one.name for one in others])
        raise UnreadableFileError(path, f"there is no such file{hint}")
    real = path.resolve()
    if any(real.is_relative_to(place) for place in _OF_THE_SYSTEM):
        raise UnreadableFileError(path, f"is part of the system ({real.parts[1]}), not a file")
    return path


def read_bytes(path: Path, most_bytes: int = 1 << 30) -> bytes:
    """Return the content of a file."""
    existing_file(path)
    try:
        too_large = path.stat().st_size > most_bytes
        data = b"" if too_large else path.read_bytes()
    except PermissionError:
        raise UnreadableFileError(path, "no permission to read it") from None
    except OSError as error:
        raise UnreadableFileError(path, f"cannot be read: {error.strerror}") from None
    if too_large:
        raise UnreadableFileError(path, f"is larger than {most_bytes} bytes")
    return data


def read_text(path: Path, most_bytes: int = 1 << 30) -> str:
    """Return the content of a UTF-8 text file; errors as in `read_bytes`."""
    data = read_bytes(path, most_bytes)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"is not UTF-8 text (byte {error.start})"
        for kind, begin in _PICTURES.items():
            if data.startswith(begin):
                problem = (
                    f"is a {kind} picture; vinefab map import makes a map of one, vinefab observe "
                    "reads a photo of a grown robot"
                )
        raise UnreadableFileError(path, problem) from None


_PICTURES: dict[str, tuple[bytes, ...]] = {
    "PNG": (b"\x89PNG",),
    "JPEG": (b"\xff\xd8\xff",),
    "GIF": (b"GIF8",),
    "TIFF": (b"II*\0", b"MM\0*"),
}
"""How files of pictures begin: a photo is easily given where a design or a map is asked for."""


def json_object(text: str, path: Path) -> dict[str, Any]:
    """Return the content of a JSON file, which has to be an object."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {str(error)[:100]}") from None
    if not isinstance(content, dict):
        raise UnreadableFileError(path, "is not a JSON object")
    return content


def path_inside(
    key: str,
    given: object,
    folders: Sequence[Path],
    source: str | Path,
    base: Path | None = None,
    shipped: Sequence[Path] = (),
) -> Path:
    """Return where a path leads, links followed: into one of some folders, or below it.

    Parameters
    ----------
    key, source
        What names the path, and where.
    base
        Where a relative path begins; the first folder if None.
    shipped
        Further folders, which a refusal does not list.

    Raises
    ------
    BadInputError
        If it leads elsewhere, or is not a path.
    """
    longest_name = 255
    try:
        path = path_given(key, given)
        too_long = any(len(part.encode()) > longest_name for part in path.parts)
    except BadInputError as error:
        raise error.at(source) from None
    except UnicodeEncodeError:  # halves of letters
        too_long = True
    longest_path = 1024
    if too_long or len(str(given)) > longest_path:
        raise UnfitInputError(key, "the path is too long", "shorten it", source)
    real = Path(os.path.realpath((base or folders[0]) / path))
    if not is_inside(real, (*folders, *shipped)):
        shown = " or ".join(dict.fromkeys(map(str, folders)))
        problem = f"{str(given)!r} leads out of {shown}"
        raise UnfitInputError(key, problem, "name a file inside", source)
    return real


def is_inside(path: Path, folders: Sequence[Path]) -> bool:
    """Tell whether a path leads, links followed, into one of some folders or below it."""
    real = Path(os.path.realpath(path))
    return any(real.is_relative_to(os.path.realpath(folder)) for folder in folders)
