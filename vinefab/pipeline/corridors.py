"""The narrowest corridors of a map, for the rule that compares them with the robot."""

from shapely.geometry.base import BaseGeometry

from vinefab.environments.passages import narrow_passages
from vinefab.model.map import Map
from vinefab.model.rigfacts import Corridor, Course

MOST = 50
"""How many of the narrowest corridors are looked at."""


def course_of(world: Map) -> Course:
    """Return the narrowest corridors of a map."""
    return corridors_in(world.name, world.free_space)


def corridors_in(name: str, free: BaseGeometry, scale: float = 1.0) -> Course:
    """Return the narrowest corridors of a free space.

    Parameters
    ----------
    name
        Whose they are.
    free
        Free space, in map coordinates.
    scale
        Millimetres that the robot sees per millimetre of the map.
    """
    return Course(
        name=name,
        corridors=tuple(
            Corridor(
                width_mm=scale * passage.width_mm,
                x_mm=passage.middle_mm[0],
                y_mm=passage.middle_mm[1],
            )
            for passage in narrow_passages(free, MOST)
        ),
    )
