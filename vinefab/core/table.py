"""Declared tables: one frozen class is a file's table, the noun, the record and the studio's form.

A field says everything once: ``tail_mm: Annotated[float, Ge(0), Unit("mm"), Doc("of the tail")]``.
Readers, writers, reference pages, sliders and error lines come from there::

    class Collar(Table):
        clamp_diameter_mm: Annotated[float, Ge(1), Le(1e4), Unit("mm"), Doc("of the pipe")]
        flare_mm: Annotated[float, Ge(0), Unit("mm"), Slider(0, 100), Doc("of the change")] = 40.0

Inner loops work on arrays and never meet a table.
"""

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_
from pathlib import Path
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Self,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
)

from annotated_types import Ge, Gt, Interval, Le, Lt, Unit
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails
from typing_extensions import Doc

from vinefab.core import __version__
from vinefab.core.errors import BadInputError, UnfitInputError, nearest
from vinefab.core.limits import plain_number

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Slider:
    """Range and step of a field's slider in the studio, in the field's unit."""

    low: float
    high: float
    step: float = 1.0


class _ShownTable:
    """A table as a default in a signature: its fields stand on its own page."""

    def __init__(self, table: BaseModel) -> None:
        self.table = table

    def __repr__(self) -> str:
        return f"{type(self.table).__name__}()"


def _shown(default: object) -> object:
    return _ShownTable(default) if isinstance(default, BaseModel) else default


class _TableType(ModelMetaclass):
    """Lets a table that is made in Python raise `BadInputError`, and take numbers of numpy."""

    def __call__(cls, *args: Any, **given: Any) -> Any:  # noqa: ANN401, N805  a metaclass
        plain = {name: plain_number(value) for name, value in given.items()}
        try:
            return super().__call__(*args, **plain)
        except ValidationError as error:
            table = cast("type[Table]", cls)
            raise bad_input_of(table, error, python=tuple(table.python_keys())) from None

    @property
    def __signature__(cls) -> inspect.Signature:  # noqa: N805  a metaclass
        """What the constructor takes; ``help`` and notebooks show it."""
        table, keyword = cast("type[Table]", cls), inspect.Parameter.KEYWORD_ONLY
        return inspect.Signature(
            [
                inspect.Parameter(
                    key.field,
                    keyword,
                    annotation=_plain(key.annotation),
                    default=inspect.Parameter.empty if key.required else _shown(key.default),
                )
                for key in table.python_keys()
            ]
        )

    @__signature__.setter
    def __signature__(cls, given: object) -> None:  # noqa: N805  as above
        """Leave out pydantic's own, which is there late and spells out every annotation."""


class Table(BaseModel, metaclass=_TableType):
    """Base of every declared table: unknown keys, wrong types, NaN and infinity are refused.

    A check of several fields is a ``model_validator(mode="after")`` that raises `BadInputError`
    with the key inside the table: the names of the tables around it are put before it.
    A field whose key in files is another name has ``Field(alias=...)`` in its annotation; a list
    that is kept as a tuple has ``Field(strict=False)``, and so has an enumeration.
    A field ``schema_`` has the kind of the file as its default: only files must give it.
    """

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        frozen=True,
        defer_build=True,
        validate_by_name=True,
        validate_by_alias=True,
    )

    @classmethod
    def python_keys(cls) -> "Iterator[DeclaredKey]":
        """Yield the parameters of the constructor, in the words of Python."""
        return (key for key in declared_keys(cls) if key.field != "schema_")

    @property
    def content(self) -> dict[str, Any]:
        """The values as files and reports have them; what is None is left out."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:  # noqa: ANN401  of the class statement
        """Document the fields in ``help``: each with its unit and its meaning."""
        if cls.__doc__ and cls.model_fields and "Parameters\n" not in cls.__doc__:
            units = [(key, f", {key.unit}" if key.unit else "") for key in cls.python_keys()]
            rows = [f"    {key.field}{unit}\n        {key.meaning}" for key, unit in units]
            head = ["", "    Parameters", "    ----------"]
            cls.__doc__ = "\n".join([cls.__doc__.rstrip(), *head, *rows])

    def __str__(self) -> str:
        return repr(self)

    def changed(self, **changes: Any) -> Self:  # noqa: ANN401  values of any field
        """Return a copy with other values of some fields, checked as a new one is."""
        # Fields that were not given may follow from the others: they are found anew.
        fields = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**fields | changes)


class TablePart(Table):
    """Base of the keys that are needed of vinefab's own JSON; others are left alone."""

    model_config = ConfigDict(extra="ignore")


def validated(model: type[M], data: Mapping[str, Any], source: str | Path | None = None) -> M:
    """Return data, as a file has it, as a table; only keys of files are taken.

    Raises
    ------
    BadInputError
        If a value is not allowed; its key is dotted, ``level[2].branches``.
    """
    if "schema_" in model.model_fields and "schema" not in data:
        kind = model.model_fields["schema_"].default
        raise BadInputError("schema", None, f"schema = {kind!r}", source)
    try:
        return model.model_validate(data, by_alias=True, by_name=False)
    except ValidationError as error:
        wrong = bad_input_of(model, error, source)
        if wrong.key == "schema" and wrong.value is not None:
            allowed = f"{wrong.allowed}{_other_kind(wrong.value, wrong.allowed)}"
            wrong = BadInputError(wrong.key, wrong.value, allowed, source)
        raise wrong from None


_KINDS_OF_FILES = {
    "design": "a design: vinefab grow, check, fabricate and others take it",
    "run": "a run file: vinefab optimize takes it",
    "map": "a map: --map and --maps take it",
    "recipe": "a recipe: --recipe takes it",
    "machine": "a machine: a recipe names it",
    "material": "a film: a recipe names it",
    "printer": "a printer: --printer of vinefab rig takes it",
    "contacts": "measured contacts: --contacts takes them",
}
"""What files are for, by the kind that their schema names."""


def _other_kind(given: object, allowed: str) -> str:
    """Return a hint on a file of another kind or version, behind a semicolon, or nothing."""
    found = re.fullmatch(r"vinefab/([a-z]+)-(\d{1,4})", given) if isinstance(given, str) else None
    if found is None:
        return ""
    if f"vinefab/{found[1]}-" in allowed:
        return f"; this is vinefab {__version__}, and another version wrote it"
    about = _KINDS_OF_FILES.get(found[1])
    return f"; this is {about}" if about else ""


# --- What is declared ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclaredKey:
    """What a table declares of one of its keys."""

    name: str  # in files
    field: str  # in Python
    annotation: Any  # type of its values
    title: str  # for people; empty: as its name
    limits: tuple[Ge | Gt | Le | Lt, ...]  # of a number
    unit: str  # empty: none
    meaning: str
    slider: Slider | None
    required: bool
    default: Any  # None where required


def declared_keys(table: type[BaseModel]) -> Iterator[DeclaredKey]:
    """Yield the declared keys of a table, in their order.

    Of an optional number or a list of numbers these are the limits and the unit of the numbers. A
    field with ``Field(exclude=True)`` is not a key of files.
    """
    for name, field in table.model_fields.items():
        if field.exclude:
            continue
        marks = [
            part
            for mark in (*field.metadata, *_inner_marks(field.annotation))
            for part in (mark if isinstance(mark, Interval) else (mark,))
        ]
        required = field.is_required() or name == "schema_"
        yield DeclaredKey(
            name=field.alias or name,
            field=name,
            annotation=field.annotation,
            title=field.title or "",
            limits=tuple(mark for mark in marks if isinstance(mark, Ge | Gt | Le | Lt)),
            unit=next((str(mark.unit) for mark in marks if isinstance(mark, Unit)), ""),
            meaning=next((mark.documentation for mark in marks if isinstance(mark, Doc)), ""),
            slider=next((mark for mark in marks if isinstance(mark, Slider)), None),
            required=required,
            default=None if required else field.get_default(call_default_factory=True),
        )


def _plain(annotation: Any) -> Any:  # noqa: ANN401  any annotation
    """Return an annotation without its marks."""
    origin, inside = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _plain(inside[0])
    if origin in (Union, UnionType):
        return reduce(or_, map(_plain, inside))
    if origin in (tuple, list):
        return origin[tuple(one if one is ... else _plain(one) for one in inside)]
    return annotation


def _inner_marks(annotation: Any) -> Iterator[Any]:  # noqa: ANN401  any annotation
    yield from getattr(annotation, "__metadata__", ())
    for part in getattr(annotation, "__args__", ()):
        yield from _inner_marks(part)


# --- Errors --------------------------------------------------------------------------------------


def bad_input_of(
    model: type[BaseModel],
    error: ValidationError,
    source: str | Path | None = None,
    *,
    python: Sequence[DeclaredKey] | None = None,
) -> BadInputError:
    """Return the error line of the first of pydantic's errors: key, value, what is allowed.

    Parameters
    ----------
    python
        What the constructor takes, for a table that is made in Python: its parameters are named.
    """
    detail = min(error.errors(include_url=False), key=_rank)
    *above, last = detail["loc"] or ("",)
    unknown = detail["type"] == "extra_forbidden"  # then the last part is the user's own
    parts = [part for part in above if not _is_union_tag(part)]
    location = (*parts, last) if unknown or not _is_union_tag(last) else tuple(parts)
    key = dotted(location)
    if python is not None:
        key = _as_typed(key, python)
    if unknown:
        is_parameter = python is not None and len(location) == 1
        known = _known_keys(model, location[:-1])
        if is_parameter and python is not None:
            known = [one.field for one in python]
        word = "parameter" if is_parameter else "key"
        remedy = nearest(str(location[-1]), known).removeprefix("; ") or "leave it out"
        listed = f"{word}s: {', '.join(known)}"
        return UnfitInputError(key, f"there is no such {word}", f"{remedy} ({listed})", source)
    if detail["type"] == "missing":
        return UnfitInputError(key, "is missing", "give it", source)
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, BadInputError):  # of a check of several fields
        apart = "." if key and cause.key and not cause.key.startswith("[") else ""
        return cause.under(f"{key}{apart}{cause.key}", source)
    text = detail["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    if detail["type"] == "model_type":
        kind, keys = detail["ctx"]["class_name"], ", ".join(_known_keys(model, location))
        text = f"a table of {keys}; in Python also an instance of {kind}"
    inside, given = _beyond(detail)
    return BadInputError(f"{key}{inside}", given, text[:1].lower() + text[1:], source)


def _beyond(detail: ErrorDetails) -> tuple[str, object]:
    """Return the key, and the number, by which an inline table breaks the range of its field."""
    given, limits = detail["input"], detail.get("ctx", {})
    if isinstance(given, Mapping | BaseModel) and ("ge" in limits or "le" in limits):
        for name in ("value", "low", "high"):
            number = dict(given).get(name)
            if isinstance(number, int | float) and not (
                limits.get("ge", number) <= number <= limits.get("le", number)
            ):
                return f".{name}", number
    return "", given


def _rank(detail: ErrorDetails) -> int:
    """Return the rank of an error: the smallest of several is reported."""
    if detail["loc"][:1] == ("schema",) and detail["type"] != "missing":
        return 0  # another kind of file: everything else follows from that
    # A misspelt key shows up twice, as unknown and as missing: the first is the helpful one.
    return 1 if detail["type"] == "extra_forbidden" else 2


def _is_union_tag(part: int | str) -> bool:
    return isinstance(part, str) and (part.startswith("function-") or part[:1].isupper())


def dotted(location: tuple[int | str, ...]) -> str:
    """Return ``level[2].branches``; entries of a list are counted from 1."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _as_typed(key: str, parameters: Sequence[DeclaredKey]) -> str:
    """Return the parameter that gives a key of files in Python."""
    for one in parameters:
        if key == one.name or key.startswith((f"{one.name}.", f"{one.name}[")):
            return f"{one.field}{key.removeprefix(one.name)}"
    return key


def _known_keys(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Return the keys of files that the table at a location knows."""
    current: Any = model
    for part in location:
        if not isinstance(part, int):
            fields: dict[str, FieldInfo] = getattr(current, "model_fields", {})
            match = [f for name, f in fields.items() if part in (name, f.alias)]
            current = inner_table(match[0].annotation) if match else None
    known: dict[str, FieldInfo] = getattr(current, "model_fields", {})
    return [field.alias or name for name, field in known.items() if not field.exclude]


def inner_table(annotation: Any) -> type[BaseModel] | None:  # noqa: ANN401  any annotation
    """Return the table that a field holds, alone or in a list; None where it holds none."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (inner_table(part) for part in getattr(annotation, "__args__", ()))
    return next((part for part in inner if part is not None), None)
