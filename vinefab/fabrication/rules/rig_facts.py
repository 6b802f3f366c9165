"""What rules need to know of a test rig and of the corridors of a map."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RigPartFacts:
    """A part of a rig.

    Parameters
    ----------
    name
        Its name.
    size_mm
        Width, depth and height of its box as it is made.
    problems
        Why its file, read again, does not hold the closed, oriented solid that it should.
    """

    name: str
    size_mm: tuple[float, float, float]
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFacts:
    """A rig, as rules see it.

    Parameters
    ----------
    name
        Its name.
    printer
        Name of the machine that makes the parts.
    room_mm
        Width, depth and height that a part may have on it.
    height_mm
        Height of the obstacles above the floor.
    parts
        All parts.
    """

    name: str
    printer: str
    room_mm: tuple[float, float, float]
    height_mm: float
    parts: tuple[RigPartFacts, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """A narrow place between walls.

    Parameters
    ----------
    width_mm
        How wide it is where robots run: of a rig, in millimetres of the rig.
    x_mm, y_mm
        Its middle, in map coordinates.
    """

    width_mm: float
    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MapCorridors:
    """A map or rig with its narrowest corridors.

    Parameters
    ----------
    name
        Of the map or rig.
    corridors
        The narrowest first.
    """

    name: str
    corridors: tuple[Corridor, ...]
