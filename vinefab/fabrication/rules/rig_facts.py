"""What rules need to know of a test rig and of the corridors of a map."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RigPartFacts:
    """A part of a rig."""

    name: str  # its name
    size_mm: tuple[float, float, float]  # width, depth and height of its box as it is made
    # why its file, read again, does not hold the closed, oriented solid that it should
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFacts:
    """A rig, as rules see it."""

    name: str  # its name
    printer: str  # name of the machine that makes the parts
    room_mm: tuple[float, float, float]  # width, depth and height that a part may have on it
    height_mm: float  # height of the obstacles above the floor
    parts: tuple[RigPartFacts, ...]  # all parts


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """A narrow place between walls."""

    width_mm: float  # how wide it is where robots run: of a rig, in millimetres of the rig
    # x_mm, y_mm: its middle, in map coordinates
    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MapCorridors:
    """A map or rig with its narrowest corridors."""

    name: str  # of the map or rig
    corridors: tuple[Corridor, ...]  # the narrowest first
