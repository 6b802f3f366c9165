"""The closed surface of an inflated pattern, and files that viewers of 3-D shapes read (mm)."""

from collections.abc import Callable

import numpy as np

from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import one_line
from vinefab.core.validation import Floats, Ints
from vinefab.inflation.robot import InflatedRobot
from vinefab.rig.part import RigPart
from vinefab.rig.part_files import PartItem, stl_bytes, threemf_bytes


def closed_surface(robot: InflatedRobot) -> tuple[Floats, Ints]:
    """Return corners in mm, shape (n, 3), and triangles, counter-clockwise from outside.

    The lower sheet is the mirror image of the upper one, which has the same corners on the seam;
    a flat lid closes the mouth.
    """
    mesh, upper = robot.sheet.mesh, robot.positions_mm
    on_seam = ~robot.sheet.membrane.free[:, 2]
    count = len(upper)
    off_seam = np.flatnonzero(~on_seam)
    below = np.arange(count)
    below[off_seam] = count + np.arange(len(off_seam))
    vertices = np.concatenate([upper, upper[off_seam] * (1.0, 1.0, -1.0)])
    vertices[:count][on_seam, 2] = 0.0
    # A triangle whose corners all lie on the seam is flat, and its own mirror image.
    triangles = mesh.triangles[~on_seam[mesh.triangles].all(axis=1)]
    faces = [triangles, below[triangles][:, ::-1]]
    ahead = np.roll(mesh.seam, -1)
    mouth = ~(on_seam[mesh.seam] & on_seam[ahead])
    if mouth.any():
        one, two = mesh.seam[mouth], ahead[mouth]
        rim = np.unique(np.concatenate([one, two]))
        middle = upper[rim].mean(axis=0) * (1.0, 1.0, 0.0)
        center = np.full(len(one), len(vertices))
        vertices = np.concatenate([vertices, middle[None]])
        faces += [
            np.column_stack([two, one, center]),
            np.column_stack([below[one], below[two], center]),
        ]
    return vertices, np.concatenate(faces)


def volume_mm3(vertices_mm: Floats, faces: Ints) -> float:
    """Return the volume within a closed surface."""
    a, b, c = (vertices_mm[faces[:, corner]] for corner in range(3))
    return float((np.cross(a, b) * c).sum() / 6.0)


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
