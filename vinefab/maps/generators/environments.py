"""The environments that maps can be generated from.

To add one: a file with a frozen options class and ``make(seed, options)``, a line here, a test.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vinefab.core.foreign import calling, ensure_type
from vinefab.core.registry import Registry
from vinefab.maps.generators.cave import CaveOptions, cave_map
from vinefab.maps.generators.corridors import CorridorsOptions, corridors_map
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.generators.pegs import PegsOptions, pegs_map
from vinefab.maps.generators.rubble import RubbleOptions, rubble_map
from vinefab.model.map import Map


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """A generator of related maps."""

    description: str  # one line for lists and help texts
    options: type[Any]  # the options class: callable without arguments, every field documented
    # ``make(seed, options)`` returns a Map; the same arguments give the same map
    make: Callable[[int, Any], Map]

    def generate(self, seed: int, options: object) -> Map:
        """Return the map of a seed.

        Raises
        ------
        BrokenPluginError
            If the generator of another package breaks down, or returns something else.
        """
        what = f"environment {self.description!r}"
        with calling(what, self.make):
            world = self.make(seed, options)
        ensure_type(what, self.make, "map", world, Map)
        return world


ENVIRONMENTS: Registry[Environment] = Registry(
    "environment",
    {
        "grid": Environment(
            description="many convex polygons, one per cell of a grid",
            options=GridOptions,
            make=grid_map,
        ),
        "cave": Environment(
            description="interconnected closed passages and chambers in solid rock",
            options=CaveOptions,
            make=cave_map,
        ),
        "corridors": Environment(
            description="a floor plan of halls, rooms and doors",
            options=CorridorsOptions,
            make=corridors_map,
        ),
        "pegs": Environment(
            description="a peg board: round pegs in some holes of a lattice",
            options=PegsOptions,
            make=pegs_map,
        ),
        "rubble": Environment(
            description="a collapsed building: broken slabs of many sizes that lie one way",
            options=RubbleOptions,
            make=rubble_map,
        ),
    },
    group="vinefab.environments",
)
