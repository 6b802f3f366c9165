"""Maps: generated, imported, and measured.

What other rooms use:

- ``generators.environments.ENVIRONMENTS``: generators by name, each with its options class;
  ``grid_map``, ``cave_map``, ``corridors_map``, ``pegs_map`` and ``rubble_map`` in the file of
  their name; ``generators.generated_map.option_fields`` for lists of options.
- ``importers.importers.import_map`` (with ``importers.source_drawing.ImportOptions``),
  ``IMPORTERS`` and ``import_suffixes``.
- ``poses.draw_poses``: poses from the starts of a map. ``passages.narrow_passages``: its narrowest
  places.

``cleanup`` serves the importers only. Files of vinefab's own maps are read and written by
``vinefab.model.files.map_geojson``.

Public functions (``import vinefab as vf``): ``vf.maps.grid(seed=3)``, ``cave``, ``corridors``,
``pegs``, ``rubble``, ``generate`` (any environment by name), ``read`` and ``import_``; all live in
``make_map`` and are loaded when first used.
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
