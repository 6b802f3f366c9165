"""The nouns of a rig: a part as it is printed, all parts together, and triangles of a file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import scipy  # its parts load at their first use
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints, frozen_floats, frozen_ints, positive
from vinefab.rig.rig_options import Printer, RigOptions

VOLUME_SHARE = 1e-4
"""Largest relative error of a volume that is read from a file."""

BOX_MM = 1e-3
"""Largest error of a box that is read from a file."""


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
    # engraved into it and written on the assembly drawing; 0 for a part without a number
    number: int = 0
    # place in the grid of tiles, from 1, row 1 lowest and column 1 leftmost on the map; 0 for parts
    # that are no tiles
    row: int = 0
    column: int = 0
    shell_wall_mm: float = 0.0  # thickness of the walls around what is left empty; 0: solid
    # height at which the filament is changed for another colour; 0: one colour
    colour_change_mm: float = 0.0

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
    def hollow(self) -> bool:
        """Whether anything in the part is left empty."""
        return self.shell_wall_mm > 0.0

    @property
    def area_mm2(self) -> float:
        """Area of the whole surface."""
        corners = self.vertices_mm[self.faces]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(0.5 * np.linalg.norm(doubled, axis=1).sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class ThinPlace:
    """A place where a wall is thinner than the printer can print it."""

    # a point in it, in map coordinates
    x_mm: float
    y_mm: float
    area_mm2: float  # of the thin part, as printed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """All parts of a map's rig."""

    name: str  # of the map
    parts: tuple[RigPart, ...]  # row by row from the map's lower left
    printer: Printer
    options: RigOptions
    style: str = "plate"  # one of `vinefab.rig.rig_options.STYLES`
    # printed parts that stand next to the rig: scale cube, north arrow
    extras: tuple[RigPart, ...] = ()
    # outline of the base plate, in map coordinates
    plate: BaseGeometry = field(default_factory=Polygon)
    # what stands on it, obstacles and border, in map coordinates
    walls: BaseGeometry = field(default_factory=Polygon)
    # what was added there, in map coordinates
    thickened: BaseGeometry = field(default_factory=Polygon)
    # where walls were thinner than the printer's least wall
    thin_places: tuple[ThinPlace, ...] = ()
    origin_mm: tuple[float, float] = (0.0, 0.0)  # lower left corner of the bounds on the map
    # what was left out, filled or joined, by name; see `vinefab.rig.build`
    counts: Mapping[str, int] = field(default_factory=dict)
    joint_gap_mm3: float = 0.0  # volume of the plate that is missing in the gaps around the joints
    notes: tuple[str, ...] = ()  # sentences that the person who prints the rig should read

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", MappingProxyType(dict(self.counts)))

    def on_plan(self, shape: BaseGeometry) -> BaseGeometry:
        """Return a shape of the map in the coordinates of the rig's plan."""
        return shapely.transform(
            shape, lambda points: (points - self.origin_mm) * self.options.scale
        )

    def on_map(self, shape: BaseGeometry) -> BaseGeometry:
        """Return a shape of the plan in map coordinates."""
        return shapely.transform(shape, lambda points: points / self.options.scale + self.origin_mm)

    @property
    def table_to_map(self) -> Floats:
        """The transform, shape (4, 4), from plan and table into map coordinates."""
        matrix = np.diag([1.0 / self.options.scale] * 3 + [1.0])
        matrix[:2, 3] = self.origin_mm
        matrix[2, 3] = -self.options.plate_mm / self.options.scale
        return matrix

    @property
    def printed(self) -> tuple[RigPart, ...]:
        """Everything to print: the parts, then the extras next to the rig."""
        return (*self.parts, *self.extras)

    @property
    def volume_mm3(self) -> float:
        """Designed volume of the parts, without the extras next to the rig."""
        return sum(part.volume_mm3 for part in self.parts)


def different_points(points: Floats) -> tuple[Floats, Ints]:
    """Return the rows that differ, in ascending order, and for each row which of them it is.

    It is `numpy.unique` by rows, which compares records one by one, in a fraction of its time.
    """
    order = np.lexsort(points.T[::-1])
    ascending = points[order]
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = (ascending[1:] != ascending[:-1]).any(axis=1)
    index = np.empty(len(points), dtype=np.int64)
    index[order] = np.cumsum(is_new) - 1
    return ascending[is_new], index


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles as a file gives them.

    Corners are the same when their coordinates are, to the last digit. No general mesh library is
    loaded: it would take a second, and swallow an interrupt meanwhile.
    """

    vertices_mm: Floats  # corners, shape (n, 3), all different
    faces: Ints  # corner indices, shape (m, 3)

    @classmethod
    def of_corners(cls, corners_mm: Floats) -> "Mesh":
        """Return the mesh of triangles that are given by their corners, shape (m, 3, 3)."""
        points = np.asarray(corners_mm, dtype=np.float64).reshape(-1, 3) + 0.0
        vertices, index = different_points(points)
        return cls(vertices_mm=vertices, faces=index.reshape(-1, 3))

    @property
    def volume_mm3(self) -> float:
        """Volume enclosed; negative when the triangles face inward."""
        middle = self.vertices_mm.mean(axis=0)
        a, b, c = np.moveaxis((self.vertices_mm - middle)[self.faces], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def box_mm(self) -> Floats:
        """Lowest and highest corner, shape (2, 3)."""
        return np.array([self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)])

    def form_problems(self) -> list[str]:
        """Return the reasons that the triangles do not bound one solid; empty when they do."""
        edges = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        if (edges[:, 0] == edges[:, 1]).any():
            return ["has triangles without an area"]
        owner = np.repeat(np.arange(len(self.faces)), 3)
        low, high = edges.min(axis=1), edges.max(axis=1)
        key = low * len(self.vertices_mm) + high
        order = np.argsort(key, kind="stable")
        _, first, count = np.unique(key[order], return_index=True, return_counts=True)
        closed = bool((count == 2).all())
        pairs = order[first[count == 2]], order[first[count == 2] + 1]
        one, other = (edges[pair, 0] < edges[pair, 1] for pair in pairs)
        adjacent = scipy.sparse.coo_array(
            (np.ones(len(pairs[0]), dtype=np.int8), (owner[pairs[0]], owner[pairs[1]])),
            shape=(len(self.faces), len(self.faces)),
        )
        oriented = bool((one != other).all())
        conditions = {
            "is not closed: an edge has not exactly two triangles": closed,
            "has triangles that face different ways": oriented,
            "is not a solid: open, or inside out": closed and oriented and self.volume_mm3 > 0.0,
            "is more than one piece": scipy.sparse.csgraph.connected_components(
                adjacent, directed=False
            )[0]
            == 1,
        }
        return [text for text, holds in conditions.items() if not holds]


def mesh_problems(mesh: Mesh, part: RigPart) -> tuple[str, ...]:
    """Return every difference between triangles read from a file and the part they stand for."""
    if len(mesh.faces) != len(part.faces):
        return (f"holds {counted(len(mesh.faces), 'triangle')}, not {len(part.faces)}",)
    problems = mesh.form_problems()
    volume_mm3 = mesh.volume_mm3
    if abs(volume_mm3 - part.volume_mm3) > VOLUME_SHARE * part.volume_mm3:
        problems.append(f"has a volume of {volume_mm3:.6g} mm3, not {part.volume_mm3:.6g}")
    box = np.array([part.vertices_mm.min(axis=0), part.vertices_mm.max(axis=0)])
    if np.abs(mesh.box_mm - box).max() > BOX_MM:
        problems.append(f"fills the box {mesh.box_mm.tolist()}, not {box.tolist()}")
    return tuple(problems)
