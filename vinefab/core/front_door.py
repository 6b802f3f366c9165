"""How the nouns and two rooms reach what is above them.

`Design.grow` and ``_repr_svg_`` belong to nouns at the bottom of the house and need rooms at the
top of it. An import there, even one inside a function, would let data climb back, and a saved
design could no longer be cut without the simulator. So the nouns know such a module by its name
only, and it is loaded when the method is first called. ``vinefab.maps`` and ``vinefab.rig`` are
rooms and public names at once: they find their verbs so, too.
"""

import inspect
import sys
from importlib import import_module
from types import ModuleType
from typing import Any


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
