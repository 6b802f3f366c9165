"""How the nouns and two rooms reach what is above them.

`Design.grow` and ``_repr_svg_`` belong to nouns at the bottom of the house and need rooms at the
top of it. An import there, even one inside a function, would let data climb back, and a saved
design could no longer be cut without the simulator. So the nouns know one module by its name only,
and it is loaded when such a method is first called. ``vinefab.maps`` and ``vinefab.rig`` are rooms
and public names at once: they find their verbs so, too.
"""

from importlib import import_module
from typing import Any


def front_door(part: str = "noun_methods") -> Any:  # noqa: ANN401  types this room must not know
    """Return a module at the top of the package, which sees all rooms."""
    return import_module(f"vinefab.{part}")
