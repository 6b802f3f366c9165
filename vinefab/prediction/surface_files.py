"""A closed surface as a file that viewers of 3-D shapes read, millimetres."""

from collections.abc import Callable

import numpy as np

from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import one_line
from vinefab.core.validation import Floats, Ints
from vinefab.inflation.surface import volume_mm3
from vinefab.rig.part import RigPart
from vinefab.rig.part_files import PartItem, stl_bytes, threemf_bytes


def _threemf(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    single = np.asarray(vertices_mm, dtype=np.float32).astype(np.float64)
    part = RigPart(
        name=name,
        vertices_mm=single,
        faces=faces,
        to_map=np.eye(4),
        volume_mm3=volume_mm3(vertices_mm, faces),
    )
    return threemf_bytes([PartItem(part=part)], name)


def _obj(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    lines = [f"# {GENERATOR}: {one_line(name)}, millimetres"]
    lines += [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices_mm.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def _ply(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    lines = [
        "ply",
        "format ascii 1.0",
        f"comment {GENERATOR}: {one_line(name)}, millimetres",
        f"element vertex {len(vertices_mm)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
        *(f"{x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices_mm.tolist()),
        *(f"3 {a} {b} {c}" for a, b, c in faces.tolist()),
    ]
    return ("\n".join(lines) + "\n").encode()


SURFACE_FORMATS: dict[str, Callable[[Floats, Ints, str], bytes]] = {
    ".stl": stl_bytes,
    ".obj": _obj,
    ".3mf": _threemf,
    ".ply": _ply,
}
"""What writes each ending: corners in mm, triangles and a name as bytes, the same each time."""
