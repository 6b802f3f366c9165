"""Named collections of parts that users may add to."""

from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from vinefab.core.errors import UnknownNameError

T = TypeVar("T")

_BROKEN_PLUGIN = (ImportError, AttributeError, NameError, SyntaxError, TypeError, ValueError)
"""What loading somebody else's module raises when it is broken."""


class Registry(Mapping[str, T], Generic[T]):
    """Parts of one kind, by name.

    Parameters
    ----------
    kind
        What the parts are, in the words of an error message (``task``, ``optimizer``).
    builtin
        The parts that come with vinefab.

    Attributes
    ----------
    broken
        Plug-ins that could not be loaded: name and what went wrong, to be shown to the user.

    Examples
    --------
    >>> shades = Registry("shade", {"dark": 0.2})
    >>> shades["dark"]
    0.2
    >>> "bright" in shades
    False
    """

    def __init__(self, kind: str, builtin: Mapping[str, T]) -> None:
        self.kind = kind
        self.broken: dict[str, str] = {}
        self._parts = dict(builtin)

    def __getitem__(self, name: str) -> T:
        if name not in self._parts:
            raise UnknownNameError(self.kind, name, self._parts)
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def load_plugins(self, group: str) -> None:
        """Add the parts that installed packages offer under an entry-point group.

        Called when an application starts, never on import. A built-in name is never replaced.

        Parameters
        ----------
        group
            Entry-point group, such as ``vinefab.tasks``.
        """
        for point in entry_points(group=group):
            if point.name in self._parts:
                self.broken[point.name] = "the name is taken by a part of vinefab"
                continue
            try:
                self._parts[point.name] = point.load()
            except _BROKEN_PLUGIN as error:
                self.broken[point.name] = f"{type(error).__name__}: {error}"
