"""Parts with parameters, built from a table that a user wrote."""

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import TypeVar

from vinefab.core.errors import BadInputError, nearest

T = TypeVar("T")


def with_parameters(part: Callable[..., T], key: str, parameters: Mapping[str, object]) -> T:
    """Return a part made with its defaults and what the user gave.

    Parameters
    ----------
    part
        A dataclass whose fields all have plain defaults (a number, a string, true or false).
    key
        Where the table stands, for errors (``task``, ``optimizer``).
    parameters
        Names and values; whole numbers do for numbers.

    Raises
    ------
    BadInputError
        If a name is unknown, or a value of the wrong kind or out of range.
    """
    known = {field.name: field.default for field in fields(part)} if is_dataclass(part) else {}
    values = {}
    for name, value in parameters.items():
        if name not in known:
            allowed = f"one of {', '.join(known)}{nearest(name, known)}"
            raise BadInputError(f"{key}.{name}", value, allowed)
        values[name] = _like(f"{key}.{name}", value, known[name])
    return part(**values)


def _like(key: str, value: object, default: object) -> object:
    """Return a value as the kind that its default is of."""
    if isinstance(default, bool) or isinstance(value, bool):
        fits = isinstance(default, bool) and isinstance(value, bool)
    elif isinstance(default, float):
        fits = isinstance(value, int | float)
        value = float(value) if isinstance(value, int) else value
    else:
        fits = isinstance(value, type(default))
    if not fits:
        kinds = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
        raise BadInputError(key, value, kinds.get(type(default), "another kind of value"))
    return value
