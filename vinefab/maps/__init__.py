"""Maps: generated, imported, and measured.

What other rooms use:

- ``generators.environments.ENVIRONMENTS``: generators by name, each with its options class;
  ``grid_map``, ``cave_map``, ``corridors_map``, ``pegs_map`` and ``rubble_map`` in the file of
  their name.
- ``importers.importers.import_map`` (with ``importers.import_options.ImportOptions``),
  ``IMPORTERS`` and ``import_suffixes``.
- ``poses.draw_poses``: poses from the starts of a map. ``passages.narrow_passages``: its narrowest
  places.

``cleanup`` serves the importers only. Files of vinefab's own maps are read and written by
``vinefab.model.map``.

Public functions (``import vinefab as vf``): a function for every registered environment, as
``vf.maps.grid(seed=3)``, ``generate`` (any environment by name), ``read``, ``import_``, ``start``
and ``info``. They are verbs, `vinefab.app.maps`, and loaded when first used.
"""

from importlib import import_module
from typing import Any

from vinefab.core.front_door import ABOVE

_VERBS = ("generate", "import_", "info", "read", "start")


def __getattr__(name: str) -> Any:  # noqa: ANN401  a function, or the list of names
    if name in _VERBS:
        return ABOVE.map_function(name)
    if name.startswith("_") and name != "__all__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    environments = import_module("vinefab.maps.generators.environments").ENVIRONMENTS
    environments.load_plugins()
    if name == "__all__":
        return sorted([*_VERBS, *environments])
    if name not in environments:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return ABOVE.map_generator(name)


def __dir__() -> list[str]:
    return list(__getattr__("__all__"))
