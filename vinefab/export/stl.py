"""Binary STL out, and read again to see whether it says what it should."""

from pathlib import Path

import numpy as np

from vinefab.core.jsontext import GENERATOR
from vinefab.export.mesh import Mesh
from vinefab.model.checked import Floats, Ints
from vinefab.rig.part import RigPart

_HEADER_BYTES = 80
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VOLUME_SHARE = 1e-4
_BOX_MM = 1e-3


def stl_bytes(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    """Return a solid as binary STL, the same bytes each time.

    Parameters
    ----------
    vertices_mm
        Shape (n, 3).
    faces
        Shape (m, 3), counter-clockwise seen from outside.
    name
        Put into the header together with our mark; what does not fit is cut off.
    """
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


def check_stl(file: Path | bytes, part: RigPart) -> tuple[str, ...]:
    """Read an STL file again and say what is wrong with it.

    Parameters
    ----------
    file
        The file or its content.
    part
        What it should hold: volume within 0.01 %, box within 0.001 mm.

    Returns
    -------
    tuple of str
        Problems, one sentence each; empty when the file is right.
    """
    data = file if isinstance(file, bytes) else file.read_bytes()
    problem = stl_problem(data)
    if problem:
        return (problem,)
    return mesh_problems(read_stl(data), part)


def mesh_problems(mesh: Mesh, part: RigPart) -> tuple[str, ...]:
    """Say what is wrong with the triangles of a file, of whatever format, that holds one part."""
    if len(mesh.faces) != len(part.faces):
        return (f"holds {len(mesh.faces)} triangles, not {len(part.faces)}",)
    return (*mesh.form_problems(), *_size_problems(mesh, part))


def read_stl(data: bytes) -> Mesh:
    """Return what a binary STL file holds; `stl_problem` has found nothing wrong with its form."""
    corners = np.frombuffer(data, _RECORD, offset=_HEADER_BYTES + 4)["corners"]
    return Mesh.of_corners(corners.astype(np.float64))


def stl_problem(data: bytes) -> str:
    """Return what is wrong with the bytes before any triangle is looked at, or nothing."""
    if len(data) < _HEADER_BYTES + 4:
        return f"is truncated: {len(data)} bytes are less than a header"
    if data[:5].lower() == b"solid":
        return "begins with 'solid' and would be read as text"
    count = int.from_bytes(data[_HEADER_BYTES : _HEADER_BYTES + 4], "little")
    wanted = _HEADER_BYTES + 4 + count * _RECORD.itemsize
    if len(data) != wanted:
        kind = "truncated" if len(data) < wanted else "too long"
        return f"is {kind}: {len(data)} bytes where {count} triangles take {wanted}"
    corners = np.frombuffer(data, _RECORD, offset=_HEADER_BYTES + 4)["corners"]
    return "" if count and np.isfinite(corners).all() else "holds no triangles, or no finite ones"


def _size_problems(mesh: Mesh, part: RigPart) -> list[str]:
    problems = []
    volume_mm3 = mesh.volume_mm3
    if abs(volume_mm3 - part.volume_mm3) > _VOLUME_SHARE * part.volume_mm3:
        problems.append(f"has a volume of {volume_mm3:.6g} mm3, not {part.volume_mm3:.6g}")
    box = np.array([part.vertices_mm.min(axis=0), part.vertices_mm.max(axis=0)])
    if np.abs(mesh.box_mm - box).max() > _BOX_MM:
        problems.append(f"fills the box {mesh.box_mm.tolist()}, not {box.tolist()}")
    return problems
