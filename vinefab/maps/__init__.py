"""Maps: generators, importers of other programs' files, cleanup, passages, poses.

Public functions (``import vinefab as vf``): ``vf.maps.grid(seed=3)``, ``cave``, ``corridors``,
``pegs``, ``rubble``, ``generate`` (any environment by name), ``read`` and ``import_``; all live in
`make_map` and are loaded when first used. Rooms above use `generators.environments`,
`importers.importers`, `passages` and `poses`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__all__ = ["cave", "corridors", "generate", "grid", "import_", "pegs", "read", "rubble"]

if TYPE_CHECKING:
    from vinefab.maps.make_map import (
        cave,
        corridors,
        generate,
        grid,
        import_,
        pegs,
        read,
        rubble,
    )
else:

    def __getattr__(name: str) -> Any:  # noqa: ANN401  what the name stands for
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module("vinefab.maps.make_map"), name)


def __dir__() -> list[str]:
    return [*__all__]
