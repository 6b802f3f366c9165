"""How the nouns reach what is above them: drawing, growing and files of results.

`Design.grow` and ``_repr_svg_`` belong to nouns at the bottom of the house and need rooms at the
top of it. An import there, even one inside a function, would let data climb back, and a saved
design could no longer be cut without the simulator. So the nouns know one module by its name only,
and it is loaded when such a method is first called.
"""

import importlib
from typing import Any

_FRONT_DOOR = "vinefab.api"


def front_door() -> Any:  # noqa: ANN401  a module, whose types this room must not know
    """Return the module of public functions, which sees all rooms."""
    return importlib.import_module(_FRONT_DOOR)
