"""vinefab: design, simulate, optimize and make branching vine robots.

``import vinefab as vf`` gives the public names, each loaded when first used::

    design = vf.Design.read("grid_explorer")
    world = vf.maps.grid(seed=3)
    deployment = design.grow(world)
    vf.score(design, task="coverage", maps=[world], poses=3)
    vf.fabricate(design, out="package", allow_uncalibrated=True)

Lengths are millimetres, angles degrees where a function takes them, pressures kPa. A design, map,
recipe or printer may be given as an object, a path or a name; a pose as ``(x_mm, y_mm,
heading_deg)``. What is not in ``__all__`` may change at any time. The names stand in
``__init__.pyi``, where editors and type checkers read them, too.
"""

import lazy_loader

from vinefab import bindings as bindings
from vinefab.core import __version__ as __version__

_load, _, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted(name for name in _names if name != "__version__")  # noqa: PLE0605  of the stub


def __getattr__(name: str) -> object:
    if name in ("rig", "studio"):  # rooms that are also functions, whatever was loaded before
        return __import__(f"{__name__}.{name}", fromlist=[name])
    if name not in _names:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _load(name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
