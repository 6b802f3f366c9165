"""Registries of named parts, extended by plug-ins, and parts built from a table of parameters."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from vinefab.core.errors import BadInputError, UnknownNameError, nearest
from vinefab.core.validation import plain_number

T = TypeVar("T")

_BROKEN_PLUGIN = (ImportError, AttributeError, NameError, SyntaxError, TypeError, ValueError)
"""Errors that importing a broken plug-in raises."""


class Registry(Mapping[str, T], Generic[T]):
    """Parts of one kind, by name.

    Attributes
    ----------
    broken
        Plug-ins that do not load: name and problem, to be shown to the user.
    packages
        Package of each plug-in, by the part's name.

    Examples
    --------
    >>> shades = Registry("shade", {"dark": 0.2})
    >>> shades["dark"]
    0.2
    >>> "bright" in shades
    False
    """

    def __init__(
        self,
        kind: str,
        builtin: Mapping[str, T],
        group: str = "",
        problem: Callable[[str, object], str] = lambda _name, _part: "",
    ) -> None:
        self.kind = kind
        self.broken: dict[str, str] = {}
        self.packages: dict[str, str] = {}
        self._parts = dict(builtin)
        self._group = group
        self._problem = problem

    def __getitem__(self, name: str) -> T:
        if name not in self._parts:
            self.load_plugins()
        if name not in self._parts:
            problem = self.broken.get(name, "")
            raise UnknownNameError(self.kind, name, self._parts, problem=problem)
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def load_plugins(self) -> None:
        """Add the parts that installed packages offer, once.

        Looking up a name that vinefab lacks does so too: every command and every process of a run
        finds plug-ins, and only those that need them wait for them. A built-in name is never
        replaced.
        """
        group, self._group = self._group, ""
        for point in entry_points(group=group) if group else ():
            if point.name in self._parts:
                self.broken[point.name] = "the name is taken by a part of vinefab"
                continue
            try:
                part = point.load()
            except _BROKEN_PLUGIN as error:
                self.broken[point.name] = f"{type(error).__name__}: {error}"
                continue
            if problem := self._problem(point.name, part):
                self.broken[point.name] = problem
            else:
                self._parts[point.name] = part
                self.packages[point.name] = point.dist.name if point.dist else ""


def with_parameters(part: Callable[..., T], key: str, parameters: Mapping[str, object]) -> T:
    """Return a part built from its defaults and the given parameters."""
    known = {field.name: field.default for field in fields(part)} if is_dataclass(part) else {}
    values = {}
    for name, value in parameters.items():
        if name not in known:
            allowed = f"one of {', '.join(known)}{nearest(name, known)}"
            raise BadInputError(f"{key}.{name}", value, allowed)
        values[name] = _like(f"{key}.{name}", plain_number(value), known[name])
    return part(**values)


def _like(key: str, value: object, default: object) -> object:
    """Return a value converted to the type of its default."""
    if isinstance(default, bool) or isinstance(value, bool):
        fits = isinstance(default, bool) and isinstance(value, bool)
    elif isinstance(default, float):
        fits = isinstance(value, int | float)
        value = float(value) if isinstance(value, int) else value
    elif isinstance(default, tuple):  # the part itself judges what is in the list
        fits = isinstance(value, list | tuple)
    else:
        fits = isinstance(value, type(default))
    if not fits:
        kinds = {
            bool: "true or false",
            int: "a whole number",
            float: "a number",
            str: "a text",
            tuple: "a list",
        }
        raise BadInputError(key, value, kinds.get(type(default), "another kind of value"))
    return value
