"""The files of a rig: STL and 3MF, each read back and compared, rig.json and the part list.

A new format is a `PartFormat` and one line in `PART_FORMATS`; the comparison is the same for all.
STL: one part per file, binary. 3MF: the core of the format only, all parts of one print bed in a
file, each an object at its place. The zip is stored with fixed dates, the numbers are the shortest
that single precision takes back: the same parts give the same bytes.
"""

import csv
import io
import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal
from xml.etree import ElementTree as Tree
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from pydantic import ConfigDict, Field

from vinefab.core.errors import UnreadableFileError
from vinefab.core.foreign import calling, ensure_type
from vinefab.core.hashing import ROOMY_GENERATOR
from vinefab.core.plain_text import GENERATOR, agreeing, counted, json_text, one_line, rounded
from vinefab.core.progress import each
from vinefab.core.registry import Registry
from vinefab.core.table import TablePart, validated
from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.formats.laser_drawing import FileFormat
from vinefab.fabrication.rules.rule import RigFacts, RigPartFacts
from vinefab.model.files.shipped import json_object, path_inside, read_bytes, read_text
from vinefab.model.finding import CheckReport
from vinefab.model.job import Job, Operation
from vinefab.model.machine import FileName
from vinefab.model.map import Map
from vinefab.rig.build import RigComparison
from vinefab.rig.fixtures import Fixtures
from vinefab.rig.part import (
    BOX_MM,
    VOLUME_SHARE,
    Mesh,
    Printer,
    Rig,
    RigOptions,
    RigPart,
    mesh_problems,
)
from vinefab.rig.printed_base import CORD_MM
from vinefab.rig.rig_plan import usable_mm
from vinefab.rig.solid import shell_words

BASIS = (
    "computed from assumed settings: plastic = min(V, A s + f (V - A s)) with volume V, surface A, "
    "shell s and infill f; time = lines of nozzle x layer over their speeds, of walls and of fill, "
    "+ slowing at corners and ends of lines + travel + layers x the time per layer change "
    "(compared with PrusaSlicer 2.5: docs/making.md); with a measured flow_mm3_s: plastic / flow "
    "+ layers x the time per layer change"
)
"""The formulas, for reports."""

JERK_MM_S = 8.0
"""Change of velocity that a printer takes without slowing down (assumed)."""

_HOPS, _HOPS_PER_RING, _HOP_MM, _RETRACT_S = 3.0, 1.0, 30.0, 0.1
"""Travel moves per part and layer, more for each outline, their length and the time of drawing
the filament back (fitted to PrusaSlicer 2.5)."""

_CHORD, _LEAST_CHORD = 1.5, 0.1
"""Mean length of lines in the inside: over area by perimeter, and at least over the width of the
part (fitted to PrusaSlicer 2.5)."""

_ROUND = 1.0 - 0.25 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UprightFaces:
    """The sides of a part, as an estimate of its printing needs them."""

    area_mm2: float
    # upright edges between two sides: height, and the angle by which a line turns there
    heights_mm: Floats
    turns_rad: Floats
    rings: float  # mean number of closed outlines in a layer


def upright_faces(part: RigPart) -> UprightFaces:
    """Return the sides of a part, from its triangles."""
    corners = part.vertices_mm[part.faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(doubled, axis=1)
    leaning = 1e-3
    upright = np.abs(doubled[:, 2]) < leaning * length
    faces = part.faces[upright]
    normals = doubled[upright, :2] / np.maximum(length[upright], 1e-12)[:, None]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort(edges.T)
    same = (edges[order][1:] == edges[order][:-1]).all(axis=1)
    first = order[:-1][same]
    one, other = normals[owner[first]], normals[owner[order[1:][same]]]
    rise_mm = np.abs(np.diff(part.vertices_mm[edges[first], 2], axis=1)[:, 0])
    cross, dot = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0], (one * other).sum(axis=1)
    turns = np.abs(np.arctan2(cross, dot))
    bent = (turns > leaning) & (rise_mm > 0.0)
    # A convex outline turns by a whole circle in each layer, others by somewhat more.
    rings = float((turns * rise_mm)[bent].sum()) / (2.0 * np.pi * max(part.size_mm[2], 1e-9))
    return UprightFaces(
        area_mm2=float(0.5 * length[upright].sum()),
        heights_mm=rise_mm[bent],
        turns_rad=turns[bent],
        rings=max(1.0, rings),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintEstimate:
    """Material and time of a print."""

    plastic_mm3: float  # extruded
    mass_g: float
    filament_m: float  # length of filament
    time_s: float  # without heating and without clearing the bed

    def words(self) -> str:
        """Return time, mass and filament as a phrase."""
        minutes = round(self.time_s / 60.0)
        time = f"{minutes // 60} h {minutes % 60:02d} min"
        return f"{time}, {self.mass_g:.0f} g, {self.filament_m:.1f} m of filament"


def print_estimate(parts: Sequence[RigPart], printer: Printer) -> PrintEstimate:
    """Estimate material and time of parts that are printed together on one bed.

    A skin of thickness s around a solid of volume V and surface A holds about A s; the rest is
    filled to the share f. Thin parts are all skin, hence the lesser of the two; walls of shells
    have half a wall as skin on each side.
    """
    layers = [math.ceil(part.size_mm[2] / printer.layer_mm) for part in parts]
    time_s = max(layers, default=0) * printer.layer_change_s
    plastic_mm3 = moving_s = 0.0
    for part in parts:
        sides = upright_faces(part)
        # Each side of a shell's wall has half of it as skin.
        skin_mm = min(printer.shell_mm, 0.5 * part.shell_wall_mm or printer.shell_mm)
        level_mm2 = part.area_mm2 - sides.area_mm2
        skin_mm3 = level_mm2 * printer.shell_mm + sides.area_mm2 * skin_mm
        filled_mm3 = skin_mm3 + printer.infill * (part.volume_mm3 - skin_mm3)
        extruded_mm3 = min(part.volume_mm3, filled_mm3)
        plastic_mm3 += extruded_mm3
        moving_s += _moving_s(part, sides, (extruded_mm3, skin_mm), printer)
    flow_mm3_s = printer.flow_mm3_s
    time_s += moving_s if flow_mm3_s is None else plastic_mm3 / flow_mm3_s
    across_mm2 = 0.25 * math.pi * printer.filament_mm**2
    return PrintEstimate(
        plastic_mm3=plastic_mm3,
        mass_g=1e-3 * plastic_mm3 * printer.density_g_cm3,
        filament_m=1e-3 * plastic_mm3 / across_mm2,
        time_s=time_s,
    )


def _moving_s(
    part: RigPart, sides: UprightFaces, plastic: tuple[float, float], printer: Printer
) -> float:
    """Return the time that the nozzle moves for a part: along walls, in its inside, and between."""
    plastic_mm3, skin_mm = plastic
    # A line as wide as the nozzle, its sides round.
    line_mm2 = (printer.nozzle_mm - _ROUND * printer.layer_mm) * printer.layer_mm
    slope = printer.acceleration_mm_s2
    side_mm2 = max(sides.area_mm2, 1e-9)
    wall_mm3 = min(plastic_mm3, side_mm2 * skin_mm)
    wall_s = wall_mm3 / line_mm2 / printer.wall_speed_mm_s
    # A corner of the plan is passed once by each line next to it, in each layer.
    lines = wall_mm3 / side_mm2 / printer.nozzle_mm
    speed = printer.wall_speed_mm_s
    kept = np.minimum(speed, JERK_MM_S / np.maximum(2.0 * np.sin(0.5 * sides.turns_rad), 1e-9))
    slowed_s = (sides.heights_mm * (speed - kept) ** 2).sum() / (speed * slope * printer.layer_mm)
    fill_mm = (plastic_mm3 - wall_mm3) / line_mm2
    wide_mm, deep_mm, _ = part.size_mm
    least_mm = _LEAST_CHORD * min(wide_mm, deep_mm)
    chord_mm = max(_CHORD * part.volume_mm3 / side_mm2, least_mm)
    fill_s = (
        fill_mm / printer.fill_speed_mm_s + fill_mm / chord_mm * printer.fill_speed_mm_s / slope
    )
    travel = printer.travel_speed_mm_s
    hop_s = _HOP_MM / travel + travel / slope + _RETRACT_S
    layers = math.ceil(part.size_mm[2] / printer.layer_mm)
    hops = layers * (_HOPS + _HOPS_PER_RING * sides.rings)
    return float(wall_s + lines * slowed_s + fill_s + hops * hop_s)


_SLACK_MM = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedPart:
    """A part on a bed, or a piece on a sheet."""

    index: int  # from 0
    # lower left corner of its box
    x_mm: float
    y_mm: float


def packed_on_beds(
    sizes_mm: Sequence[tuple[float, float]], room_mm: tuple[float, float], gap_mm: float
) -> list[list[PlacedPart]]:
    """Put boxes on as few beds as shelves allow, without turning them.

    Boxes are taken by falling depth and set side by side on shelves; a box goes onto the first
    shelf, on the first bed, that has room.
    """
    beds: list[list[PlacedPart]] = []
    shelves: list[list[float]] = []  # bed, y, depth, next free x
    tops: list[float] = []  # next free y of each bed
    order = sorted(range(len(sizes_mm)), key=lambda index: (-sizes_mm[index][1], index))
    for index in order:
        wide_mm, deep_mm = sizes_mm[index]
        for shelf in shelves:
            bed, y_mm, depth_mm, x_mm = shelf
            if deep_mm <= depth_mm + _SLACK_MM and x_mm + wide_mm <= room_mm[0] + _SLACK_MM:
                break
        else:
            bed = next(
                (bed for bed, top in enumerate(tops) if top + deep_mm <= room_mm[1] + _SLACK_MM),
                len(beds),
            )
            if bed == len(beds):
                beds.append([])
                tops.append(0.0)
            y_mm, x_mm = tops[int(bed)], 0.0
            shelf = [bed, y_mm, deep_mm, x_mm]
            shelves.append(shelf)
            tops[int(bed)] += deep_mm + gap_mm
        beds[int(bed)].append(PlacedPart(index=index, x_mm=x_mm, y_mm=y_mm))
        shelf[3] = x_mm + wide_mm + gap_mm
    return beds


def beds_of(
    parts: Sequence[RigPart], printer: Printer, options: RigOptions
) -> tuple[tuple[PlacedPart, ...], ...]:
    """Return the beds on which parts are printed, each part where it lies on its bed.

    Only parts whose colour changes at the same height share a bed: the printer stops there.
    """
    margin_mm = options.bed_margin_mm
    beds = []
    part_gap_mm = 5.0  # least distance between two parts on a bed
    for change_mm in sorted({part.colour_change_mm for part in parts}):
        indices = [at for at, part in enumerate(parts) if part.colour_change_mm == change_mm]
        sizes = [(parts[at].size_mm[0], parts[at].size_mm[1]) for at in indices]
        packed = packed_on_beds(sizes, usable_mm(printer, options), part_gap_mm)
        beds += [[replace(at, index=indices[at.index]) for at in bed] for bed in packed]
    return tuple(
        tuple(
            PlacedPart(index=at.index, x_mm=at.x_mm + margin_mm, y_mm=at.y_mm + margin_mm)
            for at in sorted(bed, key=lambda at: at.index)
        )
        for bed in sorted(beds, key=lambda bed: min(at.index for at in bed))
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Bed:
    """Parts that are printed together."""

    number: int  # from 1
    places: tuple[PlacedPart, ...]  # parts, by their index in ``Rig.printed``, and where they lie
    estimate: PrintEstimate

    @property
    def name(self) -> str:
        """Name of its files, without suffix."""
        return f"bed_{self.number:02d}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Printing:
    """All beds of a rig."""

    beds: tuple[Bed, ...]  # in the order of the parts

    @property
    def total(self) -> PrintEstimate:
        """What all beds take."""
        names = ("plastic_mm3", "mass_g", "filament_m", "time_s")
        beds = [bed.estimate for bed in self.beds]
        return PrintEstimate(**{name: sum(getattr(bed, name) for bed in beds) for name in names})

    def bed_of(self, index: int) -> Bed:
        """Return the bed of a part, by its index in ``Rig.printed``."""
        return next(bed for bed in self.beds if any(at.index == index for at in bed.places))


def printing_of(rig: Rig) -> Printing:
    """Return the beds on which a rig is printed."""
    parts = rig.printed
    beds = beds_of(parts, rig.printer, rig.options)
    return Printing(
        beds=tuple(
            Bed(
                number=number,
                places=places,
                estimate=print_estimate([parts[at.index] for at in places], rig.printer),
            )
            for number, places in enumerate(beds, 1)
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartItem:
    """A part as a file places it."""

    part: RigPart
    at_mm: tuple[float, float] = (0.0, 0.0)  # where its lower corner lies on the bed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadPart:
    """A part as a file gives it."""

    mesh: Mesh  # in its own coordinates
    name: str | None = None  # None: the format has no names
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # where the file puts it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartFileSpec:
    """The content of a file of printed parts."""

    items: Sequence[PartItem]
    title: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartFormat(FileFormat[PartFileSpec, bytes, tuple[ReadPart, ...]]):
    """A kind of file for printed parts."""

    per_bed: bool = False  # one file per print bed instead of one per part


# --- STL

_HEADER_BYTES = 80
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def stl_bytes(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    """Return a solid as binary STL, the same bytes each time."""
    triangles = np.asarray(vertices_mm, dtype=np.float64)[np.asarray(faces)]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(triangles), dtype=_RECORD)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = triangles
    # The mark comes first: a header that began with "solid" would pass for the text form.
    text = f"{ROOMY_GENERATOR}: {name}, millimetres".encode("ascii", "replace")
    header = text[:_HEADER_BYTES].ljust(_HEADER_BYTES)
    return header + len(records).to_bytes(4, "little") + bytes(records.tobytes())


def read_stl(data: bytes) -> Mesh:
    """Return the mesh of a binary STL file.

    Raises
    ------
    UnreadableFileError
        If the bytes are no binary STL file with at least one triangle.
    """
    count = int.from_bytes(data[_HEADER_BYTES : _HEADER_BYTES + 4], "little")
    wanted = _HEADER_BYTES + 4 + count * _RECORD.itemsize
    found, problem = counted(len(data), "byte"), ""
    if len(data) < _HEADER_BYTES + 4:
        problem = f"is truncated: {found} {agreeing(len(data), 'is', 'are')} less than a header"
    elif data[:5].lower() == b"solid":
        problem = "begins with 'solid' and would be read as text"
    elif len(data) != wanted:
        kind = "truncated" if len(data) < wanted else "too long"
        problem = f"is {kind}: {found} where {counted(count, 'triangle')} take {wanted}"
    if problem:
        raise UnreadableFileError("STL data", problem)
    corners = np.frombuffer(data, _RECORD, offset=_HEADER_BYTES + 4)["corners"]
    if not (count and np.isfinite(corners).all()):
        raise UnreadableFileError("STL data", "holds no triangles, or no finite ones")
    return Mesh.of_corners(corners.astype(np.float64))


# --- 3MF

MODEL = "3D/3dmodel.model"
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"

_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""
_RELATIONS = f"""<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/{MODEL}" Id="rel0"
 Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""
_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
_UNIX, _PLAIN_FILE = 3, 0o100644 << 16


def threemf_bytes(spec: PartFileSpec) -> bytes:
    """Return parts as one 3MF file, the same bytes each time."""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>\n',
        f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}">\n',
        f'<metadata name="Title">{escape(one_line(spec.title))}</metadata>\n',
        f'<metadata name="Application">{GENERATOR}</metadata>\n<resources>\n',
    ]
    for number, item in enumerate(spec.items, 1):
        name = quoteattr(item.part.name)
        lines.append(f'<object id="{number}" type="model" name={name}>\n<mesh>\n<vertices>\n')
        values, index = np.unique(item.part.vertices_mm, return_inverse=True)
        texts = [_short(value) for value in values]
        for i, j, k in index.reshape(-1, 3).tolist():
            lines.append(f'<vertex x="{texts[i]}" y="{texts[j]}" z="{texts[k]}"/>\n')
        lines.append("</vertices>\n<triangles>\n")
        for a, b, c in item.part.faces.tolist():
            lines.append(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n')
        lines.append("</triangles>\n</mesh>\n</object>\n")
    lines.append("</resources>\n<build>\n")
    for number, item in enumerate(spec.items, 1):
        x, y = (_short(value) for value in item.at_mm)
        lines.append(f'<item objectid="{number}" transform="1 0 0 0 1 0 0 0 1 {x} {y} 0"/>\n')
    lines.append("</build>\n</model>\n")
    stream = io.BytesIO()
    files = {
        "[Content_Types].xml": _TYPES,
        "_rels/.rels": _RELATIONS,
        MODEL: "".join(lines),
    }
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, text in files.items():
            entry = zipfile.ZipInfo(name, _FIRST_DATE)
            entry.create_system, entry.external_attr = _UNIX, _PLAIN_FILE
            archive.writestr(entry, text.encode())
        archive.comment = ROOMY_GENERATOR.encode()
    return stream.getvalue()


def read_threemf(data: bytes) -> tuple[ReadPart, ...]:
    """Return the parts that a 3MF file of ours places.

    Raises
    ------
    UnreadableFileError
        If the bytes are no zip, are damaged, or are not such a file.
    """
    try:
        return tuple(_placed_parts(data))
    except (ValueError, LookupError, SyntaxError, zipfile.BadZipFile) as error:
        raise UnreadableFileError("3MF data", f"cannot be read: {error}") from None


def _placed_parts(data: bytes) -> Iterator[ReadPart]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if archive.testzip() is not None:
            raise ValueError("a file in the zip is damaged")
        root = Tree.fromstring(archive.read(MODEL))  # noqa: S314  just written by ourselves
    if root.get("unit") != "millimeter":
        raise ValueError(f"the unit is {root.get('unit')}, not millimeter")
    space = {"": CORE}
    objects = {node.get("id"): node for node in root.iterfind("resources/object", space)}
    for item in root.iterfind("build/item", space):
        node = objects[item.get("objectid")]
        numbers = [float(text) for text in item.get("transform", "").split()]
        if numbers[:9] != [1, 0, 0, 0, 1, 0, 0, 0, 1]:
            raise ValueError("an item is turned")
        x_mm, y_mm, z_mm = numbers[9:]
        points = np.array(
            [
                [float(at.attrib[axis]) for axis in ("x", "y", "z")]
                for at in node.iterfind("mesh/vertices/vertex", space)
            ]
        )
        faces = [
            [int(at.attrib[corner]) for corner in ("v1", "v2", "v3")]
            for at in node.iterfind("mesh/triangles/triangle", space)
        ]
        yield ReadPart(
            name=node.get("name", ""),
            mesh=Mesh.of_corners(points[np.array(faces, dtype=np.int64)]),
            shift_mm=(x_mm, y_mm, z_mm),
        )


def _short(value: float) -> str:
    """Return the shortest decimal that single precision takes back."""
    return np.format_float_positional(np.float32(value), trim="-")


STL = PartFormat(
    suffix=".stl",
    write=lambda spec: stl_bytes(
        spec.items[0].part.vertices_mm, spec.items[0].part.faces, spec.title
    ),
    read=lambda data: (ReadPart(mesh=read_stl(data)),),
)
THREEMF = PartFormat(suffix=".3mf", write=threemf_bytes, read=read_threemf, per_bed=True)

PART_FORMATS: Registry[PartFormat] = Registry("part format", {"stl": STL, "3mf": THREEMF})
"""All formats by name."""


# --- Files of a rig


def part_files(rig: Rig, printing: Printing) -> dict[str, bytes]:
    """Return the files of a rig's printed parts by name, in every format."""
    written = each("files of parts", _all_specs(rig, printing), lambda made: made[1])
    return {name: _written(one, spec) for one, name, spec in written}


def _written(one: PartFormat, spec: PartFileSpec) -> bytes:
    what = f"part format {one.suffix}"
    with calling(what, one.write):
        data = one.write(spec)
    ensure_type(what, one.write, "file", data, bytes)
    return data


def part_problems(
    files: Mapping[str, bytes], rig: Rig, printing: Printing
) -> dict[str, tuple[str, ...]]:
    """Read every file back and return, by part, what is wrong with it."""
    problems: dict[str, list[str]] = {part.name: [] for part in rig.printed}
    read = each("files read back", _all_specs(rig, printing), lambda made: made[1])
    for one, name, spec in read:
        prefix = f"({name}) " if one.per_bed else ""
        for part, found in read_back_problems(one, files[name], spec.items).items():
            problems[part] += [f"{prefix}{problem}" for problem in found]
    return {name: tuple(found) for name, found in problems.items()}


def read_back_problems(
    part_format: PartFormat, data: bytes, items: Sequence[PartItem]
) -> dict[str, tuple[str, ...]]:
    """Read one file back and return, by part, what is wrong with it."""
    try:
        with calling(f"part format {part_format.suffix}", part_format.read):
            read = part_format.read(data)
    except UnreadableFileError as error:
        return {item.part.name: (error.problem,) for item in items}
    names = [item.part.name for item in items]
    if len(read) != len(items) or any(
        one.name not in (None, name) for one, name in zip(read, names, strict=True)
    ):
        return {names[0]: ("is in a file with other parts than planned",)}
    found = {}
    place_mm = 1e-3
    for item, one in zip(items, read, strict=True):
        away_mm = float(np.abs(np.subtract((*item.at_mm, 0.0), one.shift_mm)).max())
        place = (f"lies {away_mm:.4g} mm off its place",) if away_mm > place_mm else ()
        found[item.part.name] = (*mesh_problems(one.mesh, item.part), *place)
    return found


def stl_name(part: RigPart) -> str:
    """Return the name of a part's STL file."""
    return f"{part.name}{STL.suffix}"


def bed_name(bed: Bed) -> str:
    """Return the name of a bed's 3MF file."""
    return f"{bed.name}{THREEMF.suffix}"


def _specs(part_format: PartFormat, rig: Rig, printing: Printing) -> dict[str, PartFileSpec]:
    """Return the contents of a format's files by name."""
    suffix, parts = part_format.suffix, rig.printed
    if not part_format.per_bed:
        return {
            f"{part.name}{suffix}": PartFileSpec(items=(PartItem(part=part),), title=part.name)
            for part in parts
        }
    return {
        f"{bed.name}{suffix}": PartFileSpec(
            items=[PartItem(part=parts[at.index], at_mm=(at.x_mm, at.y_mm)) for at in bed.places],
            title=f"{rig.name}, {bed.name}",
        )
        for bed in printing.beds
    }


def _all_specs(rig: Rig, printing: Printing) -> list[tuple[PartFormat, str, PartFileSpec]]:
    """Return every file of the printed parts: its format, name and content."""
    formats = PART_FORMATS.values()
    return [(one, *named) for one in formats for named in _specs(one, rig, printing).items()]


RIG_NAME = "rig.json"
"""The file by which the folder of a rig is known again."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigRecord:
    """Content of rig.json and parts.csv."""

    rig: Rig
    world: Map
    printing: Printing
    comparison: RigComparison  # of the assembled rig with the map
    report: CheckReport  # of the rules about rigs
    jobs: Mapping[str, Job] = field(default_factory=dict)  # sheets for the laser, by file name
    why_style: str = ""  # the chosen style and the needs of the other
    fixtures: Fixtures = field(default_factory=Fixtures)


def rig_text(record: RigRecord, digests: Mapping[str, str]) -> str:
    """Return rig.json.

    A part's ``transform_to_map`` is a 4 x 4 matrix by rows: applied to a point of its STL file
    (x, y, z, 1) in printed millimetres it gives map coordinates, z = 0 being the floor. Corners of
    markers run from the upper left clockwise, in map coordinates; the base holder is in printed
    millimetres, its pose in map coordinates.
    """
    rig, world, printing = record.rig, record.world, record.printing
    base, printed = record.fixtures.base, record.fixtures.printed
    # Numbers are rounded to what they mean, so that files do not differ in a last digit; arrays
    # (transforms, corners) and the values of the map and the rules stay.
    parts = [
        {
            "name": part.name,
            "number": part.number,
            "file": stl_name(part),
            "sha256": digests[stl_name(part)],
            "bed": bed_name(printing.bed_of(index)),
            "row": part.row,
            "column": part.column,
            "volume_mm3": part.volume_mm3,
            "size_mm": part.size_mm,
            "triangles": len(part.faces),
            "hollow": part.hollow,
            "colour_change_mm": part.colour_change_mm,
            "transform_to_map": part.to_map,
        }
        for index, part in enumerate(rig.printed)
    ]
    content: dict[str, Any] = {
        "units": "mm",
        "map": {
            "name": world.name,
            "environment": world.environment,
            "seed": world.seed,
            "walls": world.wall_count,
            "lower_left_mm": world.bounds.bounds[:2],
            "size_mm": world.size_mm,
        },
        "printer": rig.printer.model_dump(),
        "options": rig.options.model_dump(),
        "style": rig.style,
        "why_style": record.why_style,
        "shells": {
            "parts": sum(part.hollow for part in rig.parts),
            "solid_parts": sum(not part.hollow for part in rig.parts),
            "words": shell_words(rig),
        },
        "parts": parts[: len(rig.parts)],
        "extras": parts[len(rig.parts) :],
        "beds": [
            {
                "file": bed_name(bed),
                "sha256": digests[bed_name(bed)],
                "parts": [rig.printed[at.index].name for at in bed.places],
                "estimate": asdict(bed.estimate),
            }
            for bed in printing.beds
        ],
        "laser": [
            {
                "file": name,
                "sha256": digests[name],
                "sheet_mm": (job.sheet_width_mm, job.sheet_height_mm),
                "cut_mm": job.length_mm(Operation.CUT),
                "mark_mm": job.length_mm(Operation.MARK),
            }
            for name, job in record.jobs.items()
        ],
        "markers": [
            {
                "number": marker.number,
                "corners_mm": marker.corners_mm,
                "z_mm": marker.z_mm,
                "side_printed_mm": rig.options.marker_mm,
                "made": rig.options.marker_kind,
            }
            for marker in record.fixtures.markers
        ],
        "base_holder": base
        and {
            "start": base.start,
            "pose": world.starts[base.start - 1].pose.content,
            "tube_mm": base.tube.diameter_mm,
            "tube_standing": base.tube.standing,
            "bore_mm": base.bore_mm,
            "axis_mm": base.axis_mm,
            "reach_mm": base.reach_mm,
            "headings_deg": base.headings_deg,
            "screws": {"thread": "M3", "count": 2, "least_length_mm": base.screw_mm},
            "parts": [part.name for part in base.parts],
        },
        "printed_base": printed
        and {
            "tube_mm": printed.tube_mm,
            "bore_mm": printed.bore_mm,
            "chamber_mm": printed.chamber_mm,
            "port_mm": printed.port_mm,
            "seats": {
                "cord_mm": CORD_MM,
                "ring_inside_mm": printed.ring_mm,
                "lid_cord_mm": printed.lid_cord_mm,
            },
            "screws": {"thread": "M3", "count": 4, "least_length_mm": printed.screw_mm},
            "parts": [part.name for part in printed.parts],
        },
        "estimate": {"basis": BASIS, **asdict(printing.total)},
        "volume_mm3": rig.volume_mm3,
        "joint_gap_mm3": rig.joint_gap_mm3,
        "counts": rig.counts,
        "thin_places": [asdict(place) for place in rig.thin_places],
        "against_map": asdict(record.comparison),
        "checks": record.report.content,
        "notes": rig.notes,
    }
    exact = {key: content[key] for key in ("map", "checks")}
    return json_text("vinefab/rig-1", {**rounded(content, 6), **exact})


def parts_text(rig: Rig, printing: Printing) -> str:
    """Return the part list as CSV, our mark in a comment above the column names."""
    text = io.StringIO()
    names = "number,file,bed,row,column,x_mm,y_mm,z_mm,volume_cm3,triangles"
    text.write(f"# {GENERATOR}\n{names}\n")
    table = csv.writer(text, lineterminator="\n")
    for index, part in enumerate(rig.printed):
        cells = [part.number or "", stl_name(part), bed_name(printing.bed_of(index))]
        cells += [part.row or "", part.column or "", *(f"{size:.2f}" for size in part.size_mm)]
        table.writerow([*cells, f"{part.volume_mm3 / 1000.0:.2f}", len(part.faces)])
    return text.getvalue()


# --- A folder read back: forms hold no more than the rules need


Above0 = Annotated[float, Field(gt=0)]


class PartForm(TablePart):
    """An entry of ``parts`` or ``extras``."""

    name: str
    file: FileName
    volume_mm3: Above0
    size_mm: Annotated[tuple[float, float, float], Field(strict=False)]


class RigPrinter(Printer):
    """The printer that the rig was made for."""

    model_config = ConfigDict(extra="ignore")


class OptionsForm(TablePart):
    """The sizes of the rig."""

    height_mm: Above0
    bed_margin_mm: float


class MapForm(TablePart):
    """The map of the rig."""

    name: str


class RigForm(TablePart):
    """``rig.json``."""

    schema_: Literal["vinefab/rig-1"] = Field(alias="schema")
    style: Literal["plate", "board"]
    map: MapForm
    printer: RigPrinter
    options: OptionsForm
    parts: list[PartForm]
    extras: list[PartForm]


def read_rig(folder: Path) -> RigFacts:
    """Return the facts that the rules need of a rig from its folder, every STL file read."""
    path = folder if folder.name == RIG_NAME else folder / RIG_NAME
    form = validated(RigForm, json_object(read_text(path), path), path)
    parts = []
    for part in (one for one in (*form.parts, *form.extras) if one.file.endswith(".stl")):
        file = path_inside("file", part.file, (path.parent,), path)
        try:
            mesh = read_stl(read_bytes(file))
        except UnreadableFileError as error:
            facts = RigPartFacts(name=part.name, size_mm=part.size_mm, problems=(error.problem,))
            parts.append(facts)
            continue
        problems, volume_mm3 = mesh.form_problems(), mesh.volume_mm3
        if abs(volume_mm3 - part.volume_mm3) > VOLUME_SHARE * part.volume_mm3:
            problems.append(f"has a volume of {volume_mm3:.6g} mm3, not {part.volume_mm3:.6g}")
        span_mm = np.ptp(mesh.box_mm, axis=0)
        if np.abs(span_mm - part.size_mm).max() > BOX_MM:
            problems.append(f"measures {span_mm.tolist()} mm, not {list(part.size_mm)}")
        size_mm = (float(span_mm[0]), float(span_mm[1]), float(span_mm[2]))
        parts.append(RigPartFacts(name=part.name, size_mm=size_mm, problems=tuple(problems)))
    printer, margin_mm = form.printer, 2.0 * form.options.bed_margin_mm
    wide_mm, deep_mm = printer.bed_width_mm - margin_mm, printer.bed_depth_mm - margin_mm
    height_mm = form.options.height_mm
    return RigFacts(
        name=form.map.name,
        printer=printer.name,
        room_mm=(wide_mm, deep_mm, printer.height_mm),
        height_mm=height_mm,
        parts=tuple(parts),
    )
