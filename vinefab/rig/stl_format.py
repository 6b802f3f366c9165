"""Binary STL: written, read again, and what the triangles of a mesh enclose.

Written for files of solids: corners are the same when their coordinates are, to the last digit.
No general mesh library is loaded: it would take a second, and swallow an interrupt meanwhile.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vinefab.core.jsontext import GENERATOR
from vinefab.core.validation import Floats, Ints
from vinefab.rig.part import RigPart


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles as a file gives them."""

    vertices_mm: Floats  # corners, shape (n, 3), all different
    faces: Ints  # corner indices, shape (m, 3)

    @classmethod
    def of_corners(cls, corners_mm: Floats) -> "Mesh":
        """Return the mesh of triangles that are given by their corners, shape (m, 3, 3)."""
        points = np.ascontiguousarray(corners_mm, dtype=np.float64).reshape(-1, 3) + 0.0
        vertices, index = np.unique(points, axis=0, return_inverse=True)
        return cls(vertices_mm=vertices, faces=np.asarray(index, dtype=np.int64).reshape(-1, 3))

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
        """Return why the triangles do not bound one solid, in words; nothing when they do."""
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
        adjacent = coo_array(
            (np.ones(len(pairs[0]), dtype=np.int8), (owner[pairs[0]], owner[pairs[1]])),
            shape=(len(self.faces), len(self.faces)),
        )
        oriented = bool((one != other).all())
        said = {
            "is not closed: an edge has not exactly two triangles": closed,
            "has triangles that face different ways": oriented,
            "is no solid: open, or inside out": closed and oriented and self.volume_mm3 > 0.0,
            "is more than one piece": connected_components(adjacent, directed=False)[0] == 1,
        }
        return [text for text, holds in said.items() if not holds]


_HEADER_BYTES = 80
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VOLUME_SHARE = 1e-4
_BOX_MM = 1e-3


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


def check_stl(file: Path | bytes, part: RigPart) -> tuple[str, ...]:
    """Read an STL file again and say what is wrong with it."""
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
