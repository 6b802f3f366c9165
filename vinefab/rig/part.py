"""The nouns of a rig: a part as it is printed, and all parts together."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints, frozen_floats, frozen_ints, positive
from vinefab.rig.options import RigOptions
from vinefab.rig.printer import Printer


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigPart:
    """One solid, lying as it is printed: lower corner at the origin, plate down."""

    name: str  # file name without suffix
    # corners, shape (n, 3), each value one that single precision (STL) holds exactly
    vertices_mm: Floats
    # triangles as rows of corner indices, shape (m, 3), counter-clockwise seen from outside
    faces: Ints
    # homogeneous transform, shape (4, 4): printed millimetres to map coordinates. It undoes the
    # rig's scale, z = 0 is the floor that the robot lies on.
    to_map: Floats
    volume_mm3: float  # designed volume, from the plan's areas and not from the triangles
    # what is engraved into it and written on the assembly drawing; 0 for what has no number
    number: int = 0
    # row, column: place in the grid of tiles, from 1, row 1 lowest and column 1 leftmost on the
    # map; 0 for parts that are no tiles
    row: int = 0
    column: int = 0

    def __post_init__(self) -> None:
        vertices = frozen_floats("part.vertices_mm", self.vertices_mm, 3)
        faces = frozen_ints(self.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
            raise BadInputError("part.faces", faces.shape, "shape (m, 3), m at least 1")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise BadInputError("part.faces", faces.max(), f"0 to {len(vertices) - 1}")
        to_map = frozen_floats("part.to_map", self.to_map, 4)
        if to_map.shape != (4, 4):
            raise BadInputError("part.to_map", to_map.shape, "shape (4, 4)")
        positive("part.volume_mm3", self.volume_mm3, 1e15, "mm3")
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "to_map", to_map)

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Width, depth and height of the box around the part as printed."""
        span = np.ptp(self.vertices_mm, axis=0)
        return float(span[0]), float(span[1]), float(span[2])

    @property
    def area_mm2(self) -> float:
        """Area of the whole surface."""
        corners = self.vertices_mm[self.faces]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(0.5 * np.linalg.norm(doubled, axis=1).sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class ThinPlace:
    """A place where a wall is thinner than the printer can print it."""

    # x_mm, y_mm: A point in it, in map coordinates
    x_mm: float
    y_mm: float
    area_mm2: float  # area of the thin part, as printed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """All parts of a map's rig."""

    name: str  # name of the map
    parts: tuple[RigPart, ...]  # row by row from the map's lower left
    # printer, options: what they were made for
    printer: Printer
    options: RigOptions
    # ``plate`` (obstacles printed on their plate) or ``board`` (loose, with pegs)
    style: str = "plate"
    # what is printed and stands beside the rig: scale cube, north arrow
    extras: tuple[RigPart, ...] = ()
    # outline of the base plate, in map coordinates
    plate: BaseGeometry = field(default_factory=Polygon)
    # what stands on it, obstacles and border, in map coordinates
    walls: BaseGeometry = field(default_factory=Polygon)
    # what was added there, in map coordinates
    thickened: BaseGeometry = field(default_factory=Polygon)
    # where walls were thinner than the printer's least wall
    thin_places: tuple[ThinPlace, ...] = ()
    # what was left out, mended or joined, by name; see `vinefab.rig.plate`
    counts: Mapping[str, int] = field(default_factory=dict)
    joint_gap_mm3: float = 0.0  # volume of the plate that is missing in the gaps around the joints
    notes: tuple[str, ...] = ()  # sentences that the person who prints the rig should read

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", MappingProxyType(dict(self.counts)))

    @property
    def printed(self) -> tuple[RigPart, ...]:
        """Everything to print: the parts, then what stands beside the rig."""
        return (*self.parts, *self.extras)

    @property
    def volume_mm3(self) -> float:
        """Designed volume of the parts, without what stands beside the rig."""
        return sum(part.volume_mm3 for part in self.parts)
