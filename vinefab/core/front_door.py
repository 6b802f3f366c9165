"""Modules that are loaded when they are first used: the one place for imports at run time.

Modules with kernels, and large packages, are imported when something of them is first used
(`imported_later`), in the same words everywhere; type checkers and import-linter see the import::

    if TYPE_CHECKING:
        from vinefab.growth import batch_kernel
    else:
        batch_kernel = imported_later("vinefab.growth.batch_kernel")

`Design.grow` and ``_repr_svg_`` belong to nouns at the bottom of the house and need rooms at the
top of it. An import there, even one inside a function, would let data climb back, and a saved
design could no longer be cut without the simulator. So the nouns know such a module by its name
only, and it is loaded when the method is first called. ``vinefab.maps`` and ``vinefab.rig`` are
rooms and public names at once: they find their verbs so, too.
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


def front_door(part: str) -> Any:  # noqa: ANN401  types this room must not know
    """Return a module of a room above, by its name in the package: ``prediction.deploy``."""
    return import_module(f"vinefab.{part}")


def callable_room(room: str, part: str) -> None:
    """Let a room be the public function of its name as well.

    Python binds a package to its name in the package above once one of its modules is loaded, so
    ``vinefab.rig`` cannot be the function alone: it is both, whatever was loaded before.

    Parameters
    ----------
    room
        The package, ``vinefab.rig``.
    part
        The module with the function, as for `front_door`.
    """
    name = room.rpartition(".")[2]

    class CallableRoom(ModuleType):
        def __call__(self, *given: Any, **named: Any) -> Any:  # noqa: ANN401  as the function
            return getattr(front_door(part), name)(*given, **named)

        def __getattr__(self, wanted: str) -> Any:  # noqa: ANN401  of the function
            if wanted in ("__signature__", "__wrapped__"):
                function = getattr(front_door(part), name)
                return inspect.signature(function) if wanted == "__signature__" else function
            raise AttributeError(f"module {room!r} has no attribute {wanted!r}")

    sys.modules[room].__class__ = CallableRoom
