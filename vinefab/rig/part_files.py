"""The files of a rig's printed parts, STL and 3MF; every file is read back and compared.

A new format is a `PartFormat` and one line in `PART_FORMATS`; the comparison is the same for all.
STL: one part per file, binary. 3MF: the core of the format only, all parts of one print bed in a
file, each an object at its place. The zip is stored with fixed dates, the numbers are the shortest
that single precision takes back: the same parts give the same bytes.
"""

import io
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as Tree
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import agreeing, counted, one_line
from vinefab.core.registry import Registry
from vinefab.core.validation import Floats, Ints
from vinefab.rig.part import Mesh, Rig, RigPart, mesh_problems
from vinefab.rig.printing import Bed, Printing

_PLACE_MM = 1e-3


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
class PartFormat:
    """A kind of file for printed parts: written, read back and compared with the parts.

    What `read` returns is compared with the parts, the same way for every format.
    """

    suffix: str
    write: Callable[[Sequence[PartItem], str], bytes]  # items and title; the same bytes each time
    read: Callable[[bytes], tuple[ReadPart, ...]]  # raises `UnreadableFileError`
    per_bed: bool = False  # one file per print bed instead of one per part

    def __post_init__(self) -> None:
        for name in ("write", "read"):
            if not callable(getattr(self, name)):
                key = f"part format {self.suffix}: {name}"
                raise BadInputError(key, getattr(self, name), "a function")


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
    text = f"{GENERATOR}: {name}, millimetres".encode("ascii", "replace")
    header = text[:_HEADER_BYTES].ljust(_HEADER_BYTES)
    return header + len(records).to_bytes(4, "little") + bytes(records.tobytes())


def read_stl(data: bytes) -> Mesh:
    """Return what a binary STL file holds.

    Raises
    ------
    UnreadableFileError
        If the bytes are no binary STL file with at least one triangle.
    """
    if problem := _form_problem(data):
        raise UnreadableFileError("STL data", problem)
    corners = np.frombuffer(data, _RECORD, offset=_HEADER_BYTES + 4)["corners"]
    return Mesh.of_corners(corners.astype(np.float64))


def _form_problem(data: bytes) -> str:
    """Return what is wrong with the bytes, triangles aside, or an empty string."""
    if len(data) < _HEADER_BYTES + 4:
        return (
            f"is truncated: {counted(len(data), 'byte')} {agreeing(len(data), 'is', 'are')} less "
            "than a header"
        )
    if data[:5].lower() == b"solid":
        return "begins with 'solid' and would be read as text"
    count = int.from_bytes(data[_HEADER_BYTES : _HEADER_BYTES + 4], "little")
    wanted = _HEADER_BYTES + 4 + count * _RECORD.itemsize
    if len(data) != wanted:
        kind = "truncated" if len(data) < wanted else "too long"
        return (
            f"is {kind}: {counted(len(data), 'byte')} where {counted(count, 'triangle')} take "
            f"{wanted}"
        )
    corners = np.frombuffer(data, _RECORD, offset=_HEADER_BYTES + 4)["corners"]
    return "" if count and np.isfinite(corners).all() else "holds no triangles, or no finite ones"


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


def threemf_bytes(items: Sequence[PartItem], title: str) -> bytes:
    """Return parts as one 3MF file, the same bytes each time."""
    stream = io.BytesIO()
    files = {
        "[Content_Types].xml": _TYPES,
        "_rels/.rels": _RELATIONS,
        MODEL: "".join(_model(items, title)),
    }
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, text in files.items():
            entry = zipfile.ZipInfo(name, _FIRST_DATE)
            entry.create_system, entry.external_attr = _UNIX, _PLAIN_FILE
            archive.writestr(entry, text.encode())
        archive.comment = GENERATOR.encode()
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
    except (ValueError, KeyError, SyntaxError, zipfile.BadZipFile) as error:
        raise UnreadableFileError("3MF data", f"cannot be read: {error}") from error


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
        yield ReadPart(
            name=node.get("name", ""), mesh=_mesh(node, space), shift_mm=(x_mm, y_mm, z_mm)
        )


def _mesh(node: Tree.Element, space: dict[str, str]) -> Mesh:
    points = [
        (float(at.attrib["x"]), float(at.attrib["y"]), float(at.attrib["z"]))
        for at in node.iterfind("mesh/vertices/vertex", space)
    ]
    faces = [
        (int(at.attrib["v1"]), int(at.attrib["v2"]), int(at.attrib["v3"]))
        for at in node.iterfind("mesh/triangles/triangle", space)
    ]
    return Mesh.of_corners(np.array(points)[np.array(faces, dtype=np.int64)])


def _model(items: Sequence[PartItem], title: str) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}">\n'
    yield f'<metadata name="Title">{escape(one_line(title))}</metadata>\n'
    yield f'<metadata name="Application">{GENERATOR}</metadata>\n<resources>\n'
    for number, item in enumerate(items, 1):
        name = quoteattr(item.part.name)
        yield f'<object id="{number}" type="model" name={name}>\n<mesh>\n<vertices>\n'
        values, index = np.unique(item.part.vertices_mm, return_inverse=True)
        texts = [_short(value) for value in values]
        for i, j, k in index.reshape(-1, 3).tolist():
            yield f'<vertex x="{texts[i]}" y="{texts[j]}" z="{texts[k]}"/>\n'
        yield "</vertices>\n<triangles>\n"
        for a, b, c in item.part.faces.tolist():
            yield f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n'
        yield "</triangles>\n</mesh>\n</object>\n"
    yield "</resources>\n<build>\n"
    for number, item in enumerate(items, 1):
        x, y = (_short(value) for value in item.at_mm)
        yield f'<item objectid="{number}" transform="1 0 0 0 1 0 0 0 1 {x} {y} 0"/>\n'
    yield "</build>\n</model>\n"


def _short(value: float) -> str:
    """Return the shortest decimal that single precision takes back."""
    return np.format_float_positional(np.float32(value), trim="-")


STL = PartFormat(
    suffix=".stl",
    write=lambda items, title: stl_bytes(items[0].part.vertices_mm, items[0].part.faces, title),
    read=lambda data: (ReadPart(mesh=read_stl(data)),),
)
THREEMF = PartFormat(suffix=".3mf", write=threemf_bytes, read=read_threemf, per_bed=True)

PART_FORMATS: Registry[PartFormat] = Registry("part format", {"stl": STL, "3mf": THREEMF})
"""All formats by name."""


# --- Files of a rig


def part_files(rig: Rig, printing: Printing) -> dict[str, bytes]:
    """Return the files of a rig's printed parts by name, in every format."""
    return {
        name: one.write(items, f"{rig.name}, {bed.name}" if bed else items[0].part.name)
        for one in PART_FORMATS.values()
        for name, bed, items in _contents(one, rig, printing)
    }


def part_problems(
    files: Mapping[str, bytes], rig: Rig, printing: Printing
) -> dict[str, tuple[str, ...]]:
    """Read every file back and return, by part, what is wrong with it."""
    problems: dict[str, list[str]] = {part.name: [] for part in rig.printed}
    for one in PART_FORMATS.values():
        for name, bed, items in _contents(one, rig, printing):
            prefix = f"({name}) " if bed else ""
            for part, found in read_back_problems(one, files[name], items).items():
                problems[part] += [f"{prefix}{problem}" for problem in found]
    return {name: tuple(found) for name, found in problems.items()}


def read_back_problems(
    part_format: PartFormat, data: bytes, items: Sequence[PartItem]
) -> dict[str, tuple[str, ...]]:
    """Read one file back and return, by part, what is wrong with it."""
    try:
        read = part_format.read(data)
    except UnreadableFileError as error:
        return {item.part.name: (error.problem,) for item in items}
    names = [item.part.name for item in items]
    if len(read) != len(items) or any(
        one.name not in (None, name) for one, name in zip(read, names, strict=True)
    ):
        return {names[0]: ("is in a file with other parts than planned",)}
    found = {}
    for item, one in zip(items, read, strict=True):
        away_mm = float(np.abs(np.subtract((*item.at_mm, 0.0), one.shift_mm)).max())
        place = (f"lies {away_mm:.4g} mm off its place",) if away_mm > _PLACE_MM else ()
        found[item.part.name] = (*mesh_problems(one.mesh, item.part), *place)
    return found


def stl_name(part: RigPart) -> str:
    """Return the name of a part's STL file."""
    return f"{part.name}{STL.suffix}"


def bed_name(bed: Bed) -> str:
    """Return the name of a bed's 3MF file."""
    return f"{bed.name}{THREEMF.suffix}"


def _contents(
    part_format: PartFormat, rig: Rig, printing: Printing
) -> list[tuple[str, Bed | None, list[PartItem]]]:
    """Return the files of a format: name, bed if it is the file of one, and parts."""
    suffix, parts = part_format.suffix, rig.printed
    if not part_format.per_bed:
        return [(f"{part.name}{suffix}", None, [PartItem(part=part)]) for part in parts]
    return [
        (
            f"{bed.name}{suffix}",
            bed,
            [PartItem(part=parts[at.index], at_mm=(at.x_mm, at.y_mm)) for at in bed.places],
        )
        for bed in printing.beds
    ]
