"""Reading TOML files against a schema; every error is one line with file, key and value."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from vinefab.core import table
from vinefab.core.errors import BadInputError, UnreadableFileError, located
from vinefab.core.table import declared_keys
from vinefab.core.validation import check_plain
from vinefab.core.version import __version__
from vinefab.model.files.shipped import read_text

M = TypeVar("M", bound=BaseModel)

LARGEST_TOML_BYTES = 1 << 20
"""A hundred times the largest that is shipped; all keys of it are looked at in two seconds."""
_LONG_INTEGER = re.compile(r"[0-9][0-9_]{4299}")
_LONG_KEY = re.compile(r"""(?<![\w"'-])(?:["']?[\w-]++["']?[ \t]*+\.[ \t]*+){64}""")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file."""
    return toml_content(read_text(path, LARGEST_TOML_BYTES), path)


def toml_content(text: str, path: str | Path) -> dict[str, Any]:
    """Return the content of the text of a TOML file."""
    if long_key := _LONG_KEY.search(text):
        # tomllib would need time that grows with the square of the parts.
        line = text.count("\n", 0, long_key.start()) + 1
        raise UnreadableFileError(path, f"line {line}: a key of over 64 parts; allowed: fewer")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        hint = ", but JSON, as maps are (--map)" if text.lstrip()[:1] == "{" else ""
        raise UnreadableFileError(path, f"is not TOML{hint}: {error}") from error
    except ValueError as error:
        # Python refuses to read integers of so many digits.
        found = _LONG_INTEGER.search(text)
        line = text.count("\n", 0, found.start() if found else 0) + 1
        problem = f"line {line}: an integer of over 4300 digits; allowed: at most 64 bits"
        raise UnreadableFileError(path, problem) from error
    except RecursionError as error:
        raise UnreadableFileError(path, "is not readable TOML: nested too deep") from error
    with located(path):
        check_plain(content, finite=False)
    return content


def validated(model: type[M], data: Mapping[str, Any], source: str | Path) -> M:
    """Return data as an instance of a schema; a file of another kind is told by its schema."""
    try:
        return table.validated(model, data, source)
    except BadInputError as error:
        if error.key != "schema" or error.value is None:
            raise
        allowed = f"{error.allowed}{_other_kind(error.value, error.allowed)}"
        raise BadInputError(error.key, error.value, allowed, source) from error


def table_content(table: BaseModel) -> dict[str, Any]:
    """Return a declared table as the keys and plain values of a file.

    Keys without a value are left out, and words at their default; numbers are not, as a later
    version may have other defaults.
    """
    content = {}
    for key in declared_keys(type(table)):
        value = getattr(table, key.field)
        usual = isinstance(value, str) and value == key.default and key.name != "schema"
        if value is not None and not usual:
            content[key.name] = _plain(value)
    return content


def _plain(value: Any) -> Any:  # noqa: ANN401  a value of any field
    if isinstance(value, BaseModel):
        return table_content(value)
    if isinstance(value, Mapping):
        return {name: _plain(inner) for name, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, tuple | list) else value


_KINDS_OF_FILES = {
    "design": "a design: vinefab grow, check, fabricate and others take it",
    "run": "a run file: vinefab optimize takes it",
    "map": "a map: --map and --maps take it",
    "recipe": "a recipe: --recipe takes it",
    "machine": "a laser: a recipe names it",
    "material": "a film: a recipe names it",
    "printer": "a printer: --printer of vinefab rig takes it",
    "contacts": "measured contacts: --contacts takes them",
}
"""What files are for, by the kind that their schema names."""


def _other_kind(given: object, allowed: str) -> str:
    """Return what a file of another kind or version is, behind a semicolon, or nothing."""
    found = re.fullmatch(r"vinefab/([a-z]+)-(\d{1,4})", given) if isinstance(given, str) else None
    if found is None:
        return ""
    if f"vinefab/{found[1]}-" in allowed:
        return f"; this is vinefab {__version__}, and another version wrote it"
    about = _KINDS_OF_FILES.get(found[1])
    return f"; this is {about}" if about else ""
