"""The whole surface of an inflated pattern: both sheets and the mouth's lid, closed."""

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.inflation.robot import InflatedRobot


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
