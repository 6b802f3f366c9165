"""Frozen values as JSON and back: their fields are its keys, their types its validation."""

import json
import math
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

from pydantic import AllowInfNan, BeforeValidator, ConfigDict, Field, PlainSerializer, TypeAdapter
from pydantic import ValidationError as _ValidationError

from vinefab.core.errors import UnreadableFileError, VinefabError
from vinefab.core.frozen import FrozenMapping
from vinefab.core.plain_text import json_text, plain, rounded
from vinefab.core.table import dotted

MaybeNan = Annotated[
    float,
    AllowInfNan(),
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: value if math.isfinite(value) else None),
]
"""A number that may be missing: NaN, which JSON has as null."""

IF_KNOWN = Field(exclude_if=lambda value: value is None)
"""In the annotation of a field: JSON leaves it out where it is None."""


def decimals(digits: int) -> PlainSerializer:
    """Return the mark of a field whose numbers JSON has with so many decimals; NaN is null."""
    return PlainSerializer(partial(rounded, digits=digits))


EXACT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
"""What is read has exactly the types of the fields; for nouns that are no `Record`, as their
``__pydantic_config__``."""


def exact(*, infinite_as_null: bool = False, **names: str) -> ConfigDict:
    """Return `EXACT` for ``__pydantic_config__``, with another name in JSON for some fields.

    Parameters
    ----------
    infinite_as_null
        Numbers that are not finite are written as null, and not read again.
    """
    config = ConfigDict(**EXACT, alias_generator=lambda name: names.get(name, name))
    return ConfigDict(**config, ser_json_inf_nan="null") if infinite_as_null else config


T = TypeVar("T")


def content_of(value: object) -> dict[str, Any]:
    """Return the fields of a frozen dataclass as JSON has them."""
    kind: Any = type(value)
    if getattr(kind, "__pydantic_config__", EXACT).get("ser_json_inf_nan") == "null":
        # Values in Python would keep the infinite ones.
        written = _codec(kind).dump_json(value, by_alias=True, warnings=False, fallback=_plain)
        read: dict[str, Any] = json.loads(written)
        return read
    content: dict[str, Any] = _codec(kind).dump_python(
        value, mode="json", by_alias=True, warnings=False, fallback=_plain
    )
    return content


def json_of(value: object) -> str:
    """Return the fields of a frozen dataclass as JSON; numbers read back the same."""
    return json.dumps(content_of(value), allow_nan=False)


def from_json(kind: type[T], text: str | bytes) -> T:
    """Return the value of `json_of`.

    Raises
    ------
    ValueError
        For text that cannot be parsed, and for a field of another type.
    """
    given: Any = kind
    try:
        found: T = _codec(given).validate_json(text)
    except _ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = dotted(first["loc"])
        raise ValueError(": ".join(filter(None, (where, first["msg"])))) from error
    return found


class Record:
    """Base of frozen dataclasses that are written as JSON, whole or as a part, and read again.

    Values of other dataclasses and tables may be fields. What is read has exactly the types of the
    fields: no number as a text, no other keys; one with a default may miss.

    Attributes
    ----------
    schema
        Kind and version of the file that one is written to, if it is.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, slots=True, kw_only=True)
    ... class Seen(Record):
    ...     poses: int
    ...     where: str = "grid"
    >>> Seen(poses=3).as_json, Seen.of_json('{"poses": 3}')
    ('{"poses": 3, "where": "grid"}', Seen(poses=3, where='grid'))
    >>> Seen.of_json('{"poses": "3"}')
    Traceback (most recent call last):
    ValueError: poses: Input should be a valid integer
    """

    __slots__ = ()
    schema: ClassVar[str] = ""
    __pydantic_config__: ClassVar[ConfigDict] = EXACT

    @property
    def content(self) -> dict[str, Any]:
        """The fields as JSON has them."""
        return content_of(self)

    @property
    def as_json(self) -> str:
        """The fields as JSON; numbers read back the same."""
        return json_of(self)

    @classmethod
    def of_json(cls, text: str | bytes) -> Self:
        """Return the value of `as_json`; errors as of `from_json`."""
        return from_json(cls, text)

    def json_text(self) -> str:
        """Return the document of a file."""
        return json_text(self.schema, self.content)

    @classmethod
    def read(cls, path: Path, most_bytes: int = 1 << 30) -> Self:
        """Return the value of `json_text` from a file.

        Raises
        ------
        UnreadableFileError
            For a file that cannot be read, or of another kind.
        """
        try:
            if path.stat().st_size > most_bytes:
                raise UnreadableFileError(path, f"is larger than {most_bytes >> 20} MiB")
            document = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(document, dict) or document.pop("schema", None) != cls.schema:
                raise UnreadableFileError(path, f"is not a file of schema {cls.schema}")
            document.pop("generator", None)
            return cls.of_json(json.dumps(document))
        except VinefabError:
            raise
        except OSError as error:
            raise UnreadableFileError(path, error.strerror or "is not readable") from error
        except (ValueError, RecursionError) as error:
            raise UnreadableFileError(path, f"is damaged ({error})") from error


def _plain(value: object) -> object:
    """Return a value of a type that pydantic does not know, nested in values of any type."""
    return dict(value) if isinstance(value, FrozenMapping) else plain(value)


@cache
def _codec(kind: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
