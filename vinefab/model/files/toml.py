"""Reading TOML files against a schema; every error is one line with file, key and value."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from vinefab.core.errors import UnreadableFileError, located
from vinefab.core.limits import check_plain
from vinefab.core.table import declared_keys
from vinefab.model.files.shipped import read_text

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
        raise UnreadableFileError(path, f"is not TOML{hint}: {error}") from None
    except ValueError:
        # Python refuses to read integers of so many digits.
        found = _LONG_INTEGER.search(text)
        line = text.count("\n", 0, found.start() if found else 0) + 1
        problem = f"line {line}: an integer of over 4300 digits; allowed: at most 64 bits"
        raise UnreadableFileError(path, problem) from None
    except RecursionError:
        raise UnreadableFileError(path, "is not readable TOML: nested too deep") from None
    with located(path):
        check_plain(content, finite=False)
    return content


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
