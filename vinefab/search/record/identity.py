"""What identifies the input of a computation: fingerprints of maps, versions of packages."""

import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from vinefab.core import __version__
from vinefab.core.hashing import fingerprint
from vinefab.model.map import Map
from vinefab.model.start import start_record

# As in records of before: searches no longer compute with cmaes, which fixes use.
_PACKAGES = ("cmaes", "numba", "numpy", "pymoo", "pyswarms", "scipy", "shapely")

_own_version = cache(version)  # to ask takes a millisecond; plug-ins are asked for each time


def package_versions(others: Iterable[str] = ()) -> dict[str, str]:
    """Return the versions of all packages that a run's numbers depend on."""
    versions = {"vinefab": __version__, "python": platform.python_version()}
    for name in (*_PACKAGES, *others):
        if name not in versions:
            try:
                versions[name] = (_own_version if name in _PACKAGES else version)(name)
            except PackageNotFoundError:
                versions[name] = "none"
    return versions


def map_fingerprint(world: Map) -> str:
    """Return the fingerprint of a map's name, bounds, obstacles, starts and targets."""
    starts = [start_record(start) for start in world.starts]
    return fingerprint(
        world.name,
        world.bounds.wkb_hex,
        [obstacle.wkb_hex for obstacle in world.obstacles],
        starts,
        # Maps without them keep the fingerprint that they had before there were any.
        *([[target.content for target in world.targets]] if world.targets else []),
    )
