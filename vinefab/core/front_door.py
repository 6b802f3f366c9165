"""Modules that are loaded when they are first used: the one place for imports at run time.

Modules with kernels, and large packages, are imported when something of them is first used
(`imported_later`), in the same words everywhere; type checkers and import-linter see the import::

    if TYPE_CHECKING:
        from vinefab.growth import batch_kernel
    else:
        batch_kernel = imported_later("vinefab.growth.batch_kernel")

`Design.grow` and ``_repr_svg_`` belong to nouns at the bottom of the house and need rooms at the
top of it. An import there, even one inside a function, would let data climb back, and a saved
design could no longer be cut without the simulator. So a noun calls a function of `ABOVE`, and
`vinefab.bindings` says which functions these are: one list, which type checkers and import-linter
read. ``vinefab.maps``, ``vinefab.rig`` and ``vinefab.studio`` are rooms and public names at once:
they find their verbs there, too.
"""

import inspect
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """A module that is imported when something of it is first used, by any thread."""

    def __init__(self, name: str, within: Callable[[], AbstractContextManager[None]]) -> None:
        super().__init__(name)
        self._within = within

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401  of any module
        with self._within():
            module = import_module(self.__name__)
        return getattr(module, name)


def imported_later(
    name: str, within: Callable[[], AbstractContextManager[None]] = nullcontext
) -> Any:  # noqa: ANN401  a module
    """Return a module that is imported when it is first used; a missing one is told then.

    Parameters
    ----------
    within
        Context of the import, in whichever thread it happens.
    """
    return _Later(name, within)


class Above:
    """Functions of rooms above that methods of nouns call; set by `vinefab.bindings`."""

    picture: Callable[..., Any]  # ``_repr_svg_`` of nouns
    plot: Callable[..., Any]  # ``plot`` of nouns and results
    score_page: Callable[..., Any]  # `Score.drawing`
    history_page: Callable[..., Any]  # `RunResult.drawing`
    grow: Callable[..., Any]  # `Design.grow`
    deployment_summary: Callable[..., Any]  # `Deployment.summary`
    write_deployment: Callable[..., Any]  # `Deployment.write`
    map_info: Callable[..., Any]  # `Map.info`
    map_summary: Callable[..., Any]  # `Map.summary`
    page: Callable[..., str]  # `Result.page`
    blocks_html: Callable[..., str]  # ``_repr_html_`` of results
    verb: Callable[[str], Callable[..., Any]]  # a public function by the words of its command
    map_function: Callable[[str], Callable[..., Any]]  # ``vinefab.maps.read`` and its like
    map_generator: Callable[[str], Callable[..., Any]]  # ``vinefab.maps.grid``


ABOVE = Above()


def callable_room(room: str) -> None:
    """Let a room be the public function of its name as well.

    Python binds a package to its name in the package above once one of its modules is loaded, so
    ``vinefab.rig`` cannot be the function alone: it is both, whatever was loaded before.

    Parameters
    ----------
    room
        The package, ``vinefab.rig``; its function is the verb of its name.
    """
    name = room.rpartition(".")[2]

    class CallableRoom(ModuleType):
        def __call__(self, *given: Any, **named: Any) -> Any:  # noqa: ANN401  as the function
            return ABOVE.verb(name)(*given, **named)

        def __getattr__(self, wanted: str) -> Any:  # noqa: ANN401  of the function
            if wanted in ("__signature__", "__wrapped__"):
                function = ABOVE.verb(name)
                return inspect.signature(function) if wanted == "__signature__" else function
            raise AttributeError(f"module {room!r} has no attribute {wanted!r}")

    sys.modules[room].__class__ = CallableRoom


class Pictured:
    """A noun that has a picture: in notebooks, and on axes of Matplotlib."""

    __slots__ = ()

    def plot(self, ax: Any = None, *, legend: bool = True) -> Any:  # noqa: ANN401  of Matplotlib
        """Draw it on axes of Matplotlib, and return them.

        Parameters
        ----------
        ax
            The axes, in mm; None: new ones.
        legend
            Whether to explain signs and colours next to the axes.

        Raises
        ------
        MissingPackageError
            If Matplotlib is not installed.

        Examples
        --------
        >>> from vinefab import maps
        >>> maps.pegs(seed=1).plot().get_xlabel()  # doctest: +SKIP
        'x (mm)'
        """
        return ABOVE.plot(self, ax, legend=legend)

    def _repr_svg_(self) -> str | None:
        """Show it in a notebook; a robot on its map, or alone where the map is not known."""
        drawn: str | None = ABOVE.picture(self)
        return drawn
