"""3MF, the core of the format only: all parts of one print bed in a file.

Each part is an object at its place. The zip is stored with fixed dates, the numbers are the
shortest that single precision takes back: the same parts give the same bytes.
"""

import io
import zipfile
from collections.abc import Iterator, Sequence
from xml.etree import ElementTree as Tree
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from vinefab.core.errors import UnreadableFileError
from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import one_line
from vinefab.rig.part import Mesh, PartFormat, PartItem, ReadPart, RigPart

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
        [float(vertex.get(axis, "nan")) for axis in "xyz"]
        for vertex in node.iterfind("mesh/vertices/vertex", space)
    ]
    faces = [
        [int(triangle.get(corner, "-1")) for corner in ("v1", "v2", "v3")]
        for triangle in node.iterfind("mesh/triangles/triangle", space)
    ]
    vertices = np.array(points, dtype=np.float64)
    return Mesh.of_corners(vertices[np.array(faces, dtype=np.int64)])


def _model(items: Sequence[PartItem], title: str) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}">\n'
    yield f'<metadata name="Title">{_escaped(title)}</metadata>\n'
    yield f'<metadata name="Application">{GENERATOR}</metadata>\n<resources>\n'
    for number, item in enumerate(items, 1):
        yield from _object(number, item.part)
    yield "</resources>\n<build>\n"
    for number, item in enumerate(items, 1):
        x, y = (_short(value) for value in item.at_mm)
        yield f'<item objectid="{number}" transform="1 0 0 0 1 0 0 0 1 {x} {y} 0"/>\n'
    yield "</build>\n</model>\n"


def _object(number: int, part: RigPart) -> Iterator[str]:
    yield f'<object id="{number}" type="model" name={quoteattr(part.name)}>\n<mesh>\n<vertices>\n'
    for x, y, z in part.vertices_mm.astype(np.float32):
        yield f'<vertex x="{_short(x)}" y="{_short(y)}" z="{_short(z)}"/>\n'
    yield "</vertices>\n<triangles>\n"
    for a, b, c in part.faces.tolist():
        yield f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n'
    yield "</triangles>\n</mesh>\n</object>\n"


def _short(value: float) -> str:
    """Return the shortest decimal that single precision takes back."""
    return np.format_float_positional(np.float32(value), trim="-")


def _escaped(text: str) -> str:
    return escape(one_line(text))


THREEMF = PartFormat(suffix=".3mf", write=threemf_bytes, read=read_threemf, per_bed=True)
