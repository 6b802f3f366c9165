"""Frozen values as JSON and back: their fields are its keys, their types its validation."""

import json
import math
from functools import cache
from typing import Annotated, Any, ClassVar, Self

from pydantic import AllowInfNan, BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter
from pydantic import ValidationError as _ValidationError

from vinefab.core.table import dotted

MaybeNan = Annotated[
    float,
    AllowInfNan(),
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: value if math.isfinite(value) else None),
]
"""A number that may be missing: NaN, which JSON has as null."""


class Record:
    """Base of frozen dataclasses that are written as JSON, whole or as a part, and read again.

    Values of other dataclasses and tables may be fields. A field with a default is left out where
    it has it. What is read has exactly the types of the fields: no number as a text, no other keys.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, slots=True, kw_only=True)
    ... class Seen(Record):
    ...     poses: int
    ...     where: str = "grid"
    >>> Seen(poses=3).text, Seen.of_text('{"poses": 3}')
    ('{"poses": 3}', Seen(poses=3, where='grid'))
    >>> Seen.of_text('{"poses": "3"}')
    Traceback (most recent call last):
    ValueError: poses: Input should be a valid integer
    """

    __slots__ = ()
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(
        strict=True, extra="forbid", allow_inf_nan=False
    )

    @property
    def content(self) -> dict[str, Any]:
        """The fields as JSON has them."""
        kind: Any = type(self)
        plain: dict[str, Any] = _codec(kind).dump_python(
            self, mode="json", by_alias=True, exclude_defaults=True, warnings=False
        )
        return plain

    @property
    def text(self) -> str:
        """The fields as JSON; numbers read back the same."""
        return json.dumps(self.content, allow_nan=False)

    @classmethod
    def of_text(cls, text: str | bytes) -> Self:
        """Return the value of `text`.

        Raises
        ------
        ValueError
            For text that cannot be parsed, and for a field of another type.
        """
        kind: Any = cls
        try:
            found: Self = _codec(kind).validate_json(text)
        except _ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = dotted(first["loc"])
            raise ValueError(": ".join(filter(None, (where, first["msg"])))) from error
        return found


@cache
def _codec(kind: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
