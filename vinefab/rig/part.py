"""The nouns of a rig: its printer and sizes, a part as it is printed, all parts, and triangles."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
import shapely
from annotated_types import Ge, Interval, Unit
from manifold3d import Manifold, Mesh64
from pydantic import Field, create_model, model_validator
from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, located
from vinefab.core.frozen import FrozenMapping
from vinefab.core.limits import DEFAULT_MARKER_MM, SMALLEST
from vinefab.core.plain_text import counted, visible
from vinefab.core.table import Table, declared_keys, validated
from vinefab.core.validation import Floats, Ints, frozen_floats, frozen_ints, positive
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import read_toml
from vinefab.model.quantity import Quantity

if TYPE_CHECKING:
    from vinefab.model.map import Map

MOST_PARTS = 2000
"""Most parts that may be asked for: every one is a solid, a file and a place on a bed."""

GRID_MM = 1e-3
"""Plans are snapped to this grid: far below what a printer can do, far above what single
precision (STL) resolves at the size of a bed, so that no two corners melt into one in the file."""

Mm = Annotated[float, Unit("mm")]
MmIfGiven = Annotated[float | None, Unit("mm")]


def _within(low: float, high: float) -> Interval:
    return Interval(ge=low, le=high)


_SIZE, _DETAIL = _within(SMALLEST, 1e4), _within(SMALLEST, 100)
Speed = Annotated[float, _within(SMALLEST, 1e4), Unit("mm/s"), Doc("of the nozzle")]


class Printer(Table):
    """A printer's limits; from ``layer_mm`` on for estimates only."""

    name: Annotated[str, Doc("file name of its profile")]
    bed_width_mm: Annotated[Mm, _SIZE, Doc("of the build volume")]
    bed_depth_mm: Annotated[Mm, _SIZE, Doc("of the build volume")]
    height_mm: Annotated[Mm, _SIZE, Doc("of the build volume")]
    nozzle_mm: Annotated[Mm, _SIZE, Doc("diameter of the nozzle")] = 0.4
    least_wall_mm: Annotated[Mm, _DETAIL, Doc("thinnest wall that prints")] = 0.8
    clearance_mm: Annotated[Mm, _DETAIL, Doc("gap between parts that fit together")] = 0.2
    layer_mm: Annotated[Mm, _DETAIL, Doc("height of a layer")] = 0.2
    shell_mm: Annotated[Mm, _DETAIL, Doc("thickness of the skin")] = 0.8
    infill: Annotated[float, _within(0, 1), Doc("share of the inside that is filled")] = 0.15
    wall_speed_mm_s: Speed = 80.0
    fill_speed_mm_s: Speed = 100.0
    travel_speed_mm_s: Speed = 150.0
    acceleration_mm_s2: Annotated[
        float, _within(SMALLEST, 1e6), Unit("mm/s2"), Doc("of the nozzle")
    ] = 2000.0
    flow_mm3_s: Annotated[
        float | None,
        _within(SMALLEST, 1000),
        Unit("mm3/s"),
        Doc("mean extrusion rate of whole parts, measured: takes the place of the speeds"),
    ] = None
    layer_change_s: Annotated[float, _within(0, 3600), Unit("s"), Doc("extra time per layer")] = 1.0
    filament_mm: Annotated[Mm, _DETAIL, Doc("diameter of the filament")] = 1.75
    density_g_cm3: Annotated[
        float, _within(SMALLEST, 30), Unit("g/cm3"), Doc("of the filament")
    ] = 1.24


def _form_of_printers() -> type[Table]:
    """Return the form of a printer's file: every number of `Printer` with its standing."""
    version = Doc("kind of file and its version")
    fields: dict[str, Any] = {
        "schema_": (Annotated[Literal["vinefab/printer-1"], Field(alias="schema"), version], ...),
        "title": (Annotated[str, Doc("for people")], ...),
    }
    held: tuple[Any, Any] = (Quantity, ...)
    for key in declared_keys(Printer):
        if key.field == "layer_mm":  # from here on for estimates only
            held = (Quantity | None, None)
        if key.field != "name":
            fields[key.field] = (Annotated[held[0], Unit(key.unit), Doc(key.meaning)], held[1])
    doc = "A file in ``laser_profiles/printers``; what is for estimates only may be left out."
    return create_model("PrinterForm", __base__=Table, __doc__=doc, **fields)


PrinterForm = _form_of_printers()


def read_printer(name_or_path: str | Path) -> Printer:
    """Read a printer's profile.

    Every number in the file is a table of ``value``, ``standing`` (measured, paper, published,
    computed or assumed) and ``source``, so that a guess is never taken for a measurement.
    """
    path = locate("printer", name_or_path)
    form = validated(PrinterForm, read_toml(path), path)
    with located(path):
        values = {name: held.value for name, held in form if isinstance(held, Quantity)}
        return Printer(name=visible(path.stem), **values)


class RigOptions(Table):
    """Sizes of a rig, as printed.

    Style ``plate`` is obstacles printed on their plate, ``board`` printed obstacles with pegs on a
    board that a laser cuts and drills, ``auto`` the quicker of these to print. A start at most
    ``entry_reach_mm`` from the bounds, measured backwards along its heading, gets an opening in the
    border; one further away gets a round hole through the plate.
    """

    style: Annotated[
        Literal["auto", "plate", "board"], Doc("plate, board, or the quicker to print")
    ] = "auto"
    plate_mm: Annotated[Mm, _within(0.2, 100), Doc("thickness of base plate or board")] = 3.0
    height_mm: Annotated[Mm, _within(0.2, 1e4), Doc("height of obstacles and border")] = 30.0
    border_mm: Annotated[
        Mm, _within(0.2, 1000), Doc("thickness of the wall around the bounds, outside of them")
    ] = 4.0
    entry_width_mm: Annotated[
        Mm,
        _within(0, 1e4),
        Doc("width of the entry; the start's sideways spread comes on top; 0: none"),
    ] = 40.0
    entry_reach_mm: Annotated[
        Mm, _within(0, 1e4), Doc("farthest from the bounds that a start has an entry")
    ] = 60.0
    wall_mm: Annotated[
        MmIfGiven,
        _within(0, 100),
        Doc("walls of hollow obstacles: whole lines of the nozzle, else its least; 0: solid"),
    ] = None
    top_mm: Annotated[Mm, Ge(0), Doc("closed top of loose obstacles; 0: open")] = 0.0
    scale: Annotated[float, _within(SMALLEST, 1e3), Doc("rig mm per map mm")] = 1.0
    clearance_mm: Annotated[
        MmIfGiven,
        _within(0, 5),
        Doc("gap around what is pushed into each other, else the printer's"),
    ] = None
    joint: Annotated[Literal["dovetail", "none"], Doc("what holds tiles together")] = "dovetail"
    mark_depth_mm: Annotated[
        Mm, _within(0, 5), Doc("depth of number and north arrow in the underside of tiles; 0: none")
    ] = 0.4
    peg_mm: Annotated[Mm, _within(1, 50), Doc("diameter of the pegs of loose obstacles")] = 5.0
    kerf_mm: Annotated[Mm, _within(0, 2), Doc("width that the laser removes")] = 0.2
    sheet_width_mm: Annotated[Mm, _within(100, 1e4), Doc("width of the laser's sheets")] = 1000.0
    sheet_depth_mm: Annotated[Mm, _within(100, 1e4), Doc("depth of the laser's sheets")] = 600.0
    bed_margin_mm: Annotated[Mm, _within(0, 1000), Doc("rim of the bed that stays free")] = 5.0
    sliver_mm: Annotated[
        Mm, _within(0, 1), Doc("loose pieces and gaps thinner than this are left out, and counted")
    ] = 0.05
    most_parts: Annotated[int, _within(1, MOST_PARTS), Doc("more parts are refused")] = 100
    markers: Annotated[
        Literal["print", "paper", "engrave", "none"] | None,
        Doc(
            "corner markers for photos: print (raised black cells), paper (a place for a paper "
            "marker), engrave (into the board; where there is one, the default) or none"
        ),
    ] = None
    marker_mm: Annotated[Mm, _within(12, 1000), Doc("side of a marker with its black frame")] = (
        DEFAULT_MARKER_MM
    )
    base_start: Annotated[
        int | None,
        _within(0, 10_000),
        Doc("start, from 1, that gets a holder for the base; else the first, if it fits; 0: none"),
    ] = None
    collar_mm: Annotated[
        MmIfGiven, _within(3, 300), Doc("outer diameter of the base's tube, else the design's")
    ] = None

    port_mm: Annotated[
        Mm, _within(2, 30), Doc("hole for the fitting in a printed base's lid; 8.8: tap G 1/8")
    ] = 8.8

    surface: Annotated[
        str | None,
        Doc("what its walls are like: smooth, rough, or one of your contacts file; else the map's"),
    ] = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.top_mm > self.height_mm:
            allowed = f"at most the height, {self.height_mm:g} mm"
            raise BadInputError("top_mm", self.top_mm, allowed)
        if self.mark_depth_mm > 0.5 * self.plate_mm:
            allowed = f"at most half of the plate, {0.5 * self.plate_mm:g} mm"
            raise BadInputError("mark_depth_mm", self.mark_depth_mm, allowed)
        if self.markers == "engrave" and self.style == "plate":
            allowed = "print, paper or none for style plate, which has no board"
            raise BadInputError("markers", self.markers, allowed)
        return self

    @property
    def marker_kind(self) -> str:
        """How the corner markers are made: what was asked for, or what suits the style."""
        return self.markers or ("print" if self.style == "plate" else "engrave")

    def gap_mm(self, printer: Printer) -> float:
        """Return the gap around what is pushed into each other."""
        return printer.clearance_mm if self.clearance_mm is None else self.clearance_mm

    def fitted(self, world: "Map", side_mm: float) -> "RigOptions":
        """Return the options with the scale at which the rig's longer side has some length."""
        room_mm = side_mm - 2.0 * self.border_mm
        if not room_mm > 0.0:
            allowed = f"more than the border on both sides, {2.0 * self.border_mm:g} mm"
            raise BadInputError("--fit-mm", side_mm, allowed)
        return self.changed(scale=room_mm / max(world.size_mm))


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
        object.__setattr__(self, "counts", FrozenMapping(self.counts))

    @property
    def style(self) -> str:
        """``plate`` or ``board``."""
        return self.options.style

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
    """Triangles as a file gives them; corners with the same coordinates are one."""

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
        """Return why the triangles do not bound one solid, or nothing."""
        edges, count = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), len(self.vertices_mm)
        if (edges[:, 0] == edges[:, 1]).any():
            return ["has triangles without an area"]
        # Both ends of an edge in one number: edges are then counted without comparing rows.
        both_ways = np.sort(edges, axis=1) @ (count, 1)
        if (np.unique(both_ways, return_counts=True)[1] != 2).any():
            # manifold3d would join four triangles at an edge in pairs.
            return ["is not closed: an edge has not exactly two triangles"]
        if len(np.unique(edges @ (count, 1))) < len(edges):
            return ["has triangles that face different ways"]
        if self.volume_mm3 <= 0.0:
            return ["is inside out"]
        pieces = len(manifold_of(self.vertices_mm, self.faces).decompose())
        return ["is more than one piece"] if pieces > 1 else []


def manifold_of(vertices_mm: Floats, faces: Ints) -> Manifold:
    """Return corners and triangles as a solid of manifold3d, empty when they do not bound one."""
    # Copies: manifold3d does not take read-only arrays.
    vertices = np.array(vertices_mm, dtype=np.float64, order="C")
    return Manifold(Mesh64(vertices, np.array(faces, dtype=np.uint64, order="C")))


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
