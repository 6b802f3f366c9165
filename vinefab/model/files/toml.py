"""Reading TOML files against a schema; every error is one line with file, key and value."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from vinefab.core.errors import BadInputError, UnreadableFileError, located, nearest
from vinefab.core.validation import check_plain
from vinefab.core.version import __version__
from vinefab.model.files.shipped import read_text

M = TypeVar("M", bound=BaseModel)

LARGEST_TOML_BYTES = 1 << 20
"""A hundred times the largest that is shipped; all keys of it are looked at in two seconds."""
_LONG_INTEGER = re.compile(r"[0-9][0-9_]{4299}")
_LONG_KEY = re.compile(r"""(?<![\w"'-])(?:["']?[\w-]++["']?[ \t]*+\.[ \t]*+){64}""")


class Form(BaseModel):
    """Base of every file schema: unknown keys, wrong types, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


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
    """Return data as an instance of a schema."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise _as_bad_input(model, min(error.errors(), key=_rank), source) from error


def _rank(detail: ErrorDetails) -> int:
    """Return the rank of an error: the smallest of several is reported."""
    if detail["loc"][:1] == ("schema",) and detail["type"] != "missing":
        return 0  # another kind of file: everything else follows from that
    # A misspelt key shows up twice, as unknown and as missing: the first is the helpful one.
    return 1 if detail["type"] == "extra_forbidden" else 2


def _as_bad_input(
    model: type[BaseModel], detail: ErrorDetails, source: str | Path
) -> BadInputError:
    *above, last = detail["loc"] or ("",)
    unknown = detail["type"] == "extra_forbidden"  # then the last part is the user's own
    parts = [part for part in above if not _is_union_tag(part)]
    location = (*parts, last) if unknown or not _is_union_tag(last) else tuple(parts)
    key = _dotted(location)
    if unknown:
        known = _known_keys(model, location[:-1])
        hint = nearest(str(location[-1]), known)
        return BadInputError(
            key, detail["input"], f"no such key{hint} ({', '.join(known)})", source
        )
    if detail["type"] == "missing":
        return BadInputError(key, None, "it must be given", source)
    allowed = _allowed(detail["msg"])
    if key == "schema":
        allowed += _other_kind(detail["input"], allowed)
    return BadInputError(key, detail["input"], allowed, source)


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


def _is_union_tag(part: int | str) -> bool:
    return isinstance(part, str) and (part.startswith("function-") or part[:1].isupper())


def _allowed(message: str) -> str:
    text = message.removeprefix("Input should be ").removeprefix("Value error, ")
    return text[:1].lower() + text[1:]


def _dotted(location: tuple[int | str, ...]) -> str:
    """Return ``level[2].branches``; entries of a list are counted from 1."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _known_keys(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    current: Any = model
    for part in location:
        if isinstance(part, int):
            continue
        fields = getattr(current, "model_fields", {})
        match = [f for name, f in fields.items() if part in (name, f.alias)]
        current = _inner_model(match[0].annotation) if match else None
    fields = getattr(current, "model_fields", {})
    return [field.alias or name for name, field in fields.items()]


def _inner_model(annotation: Any) -> Any:  # noqa: ANN401  an annotation can be anything
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = [_inner_model(part) for part in getattr(annotation, "__args__", ())]
    return next((part for part in inner if part is not None), None)
