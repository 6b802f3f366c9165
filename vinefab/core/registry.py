"""Registries of named parts, extended by plug-ins, and parts built from a table of parameters."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from vinefab.core.errors import (
    BadInputError,
    BrokenPluginError,
    UnfitInputError,
    UnknownNameError,
    inside,
    nearest,
)
from vinefab.core.foreign import boundary, calling, line_of
from vinefab.core.front_door import imported_later
from vinefab.core.limits import plain_number

if TYPE_CHECKING:
    from vinefab.core import table
else:
    table = imported_later("vinefab.core.table")  # pydantic waits until a part is one

T = TypeVar("T")

_BROKEN_PLUGIN = (ImportError, AttributeError, NameError, SyntaxError, TypeError, ValueError)
"""Errors of a plug-in that does not fit what is installed: noted, and the others go on."""


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
        builtin: Mapping[str, T | str],
        group: str = "",
        problem: Callable[[str, object], str] = lambda _name, _part: "",
    ) -> None:
        self.kind = kind
        self.broken: dict[str, str] = {}
        self.packages: dict[str, str] = {}
        self._parts: dict[str, Any] = dict(builtin)
        self._group = group
        self._problem = problem

    def __getitem__(self, name: str) -> T:
        if name not in self._parts:
            self.load_plugins()
        if name not in self._parts:
            problem = self.broken.get(name, "")
            raise UnknownNameError(self.kind, name, self._parts, problem=problem)
        part = self._parts[name]
        if isinstance(part, str):  # ``module:name`` of a part that is loaded when it is asked for
            module, _, attribute = part.partition(":")
            part = self._parts[name] = getattr(import_module(module), attribute)
        return part  # type: ignore[no-any-return]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def names(self) -> tuple[str, ...]:
        """Return the names of all parts, those of plug-ins too.

        Raises
        ------
        BrokenPluginError
            As `load_plugins` does.
        """
        self.load_plugins()
        return tuple(self._parts)

    def load_plugins(self) -> None:
        """Add the parts that installed packages offer, once.

        Looking up a name that vinefab lacks does so too: every command and every process of a run
        finds plug-ins, and only those that need them wait for them. A built-in name is never
        replaced, and one that two plug-ins share is neither's. What they print goes to stderr.

        Raises
        ------
        BrokenPluginError
            If a plug-in breaks down; one that is only not importable is noted in ``broken``.
        """
        offered: dict[str, set[EntryPoint]] = {}
        for point in entry_points(group=self._group) if self._group else ():
            offered.setdefault(point.name, set()).add(point)
        parts: dict[str, T] = {}
        for name, points in offered.items():
            if name in self._parts:
                self.broken[name] = "the name is taken by a part of vinefab"
            elif len(points) > 1:
                self.broken[name] = (
                    f"the name is taken twice: {', '.join(sorted(map(_of, points)))}"
                )
            else:
                (point,) = points
                part, problem = self._loaded(point)
                if problem:
                    self.broken[name] = problem
                else:
                    parts[name] = part
                    self.packages[name] = point.dist.name if point.dist else ""
        self._parts |= parts
        self._group = ""

    def _loaded(self, point: EntryPoint) -> tuple[Any, str]:
        """Return a plug-in's part, and why it cannot be used; empty if it can."""
        try:
            named = f"{self.kind} {point.name!r} {_of(point)}"
            with boundary(lambda error: BrokenPluginError(named, line_of(error))):
                part = point.load()
                return part, self._problem(point.name, part)
        except BrokenPluginError as error:
            if isinstance(error.__cause__, _BROKEN_PLUGIN):
                return None, error.problem
            raise


def _of(point: EntryPoint) -> str:
    """Return where a plug-in comes from: its package and its entry point."""
    package = f"of package {point.dist.name} " if point.dist else ""
    return f"{package}({point.group}: {point.value})"


def _is_table(part: type) -> bool:
    """Return whether a part is a declared table; pydantic is not loaded to know it."""
    return hasattr(part, "model_fields")


def parameter_names(part: type) -> tuple[str, ...]:
    """Return the names of a part's parameters: a declared table's or a dataclass's fields."""
    if _is_table(part):
        return tuple(part.model_fields)  # type: ignore[attr-defined]
    return tuple(field.name for field in fields(part)) if is_dataclass(part) else ()


def parameter_values(part: object) -> dict[str, Any]:
    """Return the values of a part's parameters by their names."""
    if _is_table(type(part)):
        dumped: dict[str, Any] = part.model_dump()  # type: ignore[attr-defined]
        return dumped
    return {name: getattr(part, name) for name in parameter_names(type(part))}


def with_parameters(part: Callable[..., T], key: str, parameters: Mapping[str, object]) -> T:
    """Return a part built from its defaults and the given parameters.

    A part that is a declared table checks itself; plug-ins may have plain dataclasses.
    """
    if isinstance(part, type) and _is_table(part):
        plain = {name: plain_number(value) for name, value in parameters.items()}
        with inside(key), calling(key, part):
            return cast("T", table.validated(part, plain))
    known = {field.name: field.default for field in fields(part)} if is_dataclass(part) else {}
    values = {}
    for name, value in parameters.items():
        if name not in known:
            remedy = nearest(name, known).removeprefix("; ") or "leave it out"
            listed = f"parameters: {', '.join(known) or 'none'}"
            problem = "there is no such parameter"
            raise UnfitInputError(f"{key}.{name}", problem, f"{remedy} ({listed})")
        values[name] = _like(f"{key}.{name}", plain_number(value), known[name])
    with calling(key, part):
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
