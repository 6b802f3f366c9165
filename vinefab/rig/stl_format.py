"""Binary STL: one part per file."""

from collections.abc import Sequence

import numpy as np

from vinefab.core.errors import UnreadableFileError
from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import agreeing, counted
from vinefab.core.validation import Floats, Ints
from vinefab.rig.part import Mesh, PartFormat, PartItem, ReadPart

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


def _write(items: Sequence[PartItem], title: str) -> bytes:
    (item,) = items
    return stl_bytes(item.part.vertices_mm, item.part.faces, title)


def _read(data: bytes) -> tuple[ReadPart, ...]:
    return (ReadPart(mesh=read_stl(data)),)


STL = PartFormat(suffix=".stl", write=_write, read=_read)
