"""A joint free in space: both sheets under pressure, without the plane that holds the seam.

For studies. Everything that is cut, and every table, takes the seam to stay in its plane, as it
does between a floor and a lid. Free in space, joints of stiff film bow out of it: the sheets have
more film than the bent seam needs, and a child that leans takes up some of it. The energy that this
frees is that of lifting a branch.
"""

from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.inflation.joint import (
    ACROSS,
    CHILD_STUB,
    InflatedJoint,
    JointShape,
    inflated_joint,
    stub_axes,
)
from vinefab.inflation.membrane import Membrane
from vinefab.inflation.sheet import Sheet
from vinefab.inflation.solve import Equilibrium, Tell, at_rest

TRUNK_STUB = 2.5
"""Length of the trunk's stub, in its width: more than in the plane, as the trunk leans too."""

_SEED = 0.02
"""Height in widths, over length squared, by which the start is bent out of the plane."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeJoint:
    """A joint under pressure that may bow (simulated), in widths of its trunk."""

    planar: InflatedJoint  # the same joint with its seam held in the plane
    angles_deg: Floats  # deployed angle of each child to the trunk, seen from above, shape (n,)
    bow_deg: Floats  # by which each child leans out of the plane of trunk and seam, shape (n,)
    energy: float  # of both sheets, over p W^3
    positions: Floats  # corners of both sheets in space: `planar`'s, then the lower ones
    triangles: Ints  # of both sheets, counter-clockwise as seen from outside

    @property
    def gain(self) -> float:
        """By how much less the energy is than in the plane, over p W^3."""
        return 2.0 * self.planar.equilibrium.energy - self.energy


def free_joint(joint: JointShape, *, across: int = ACROSS, tell: Tell | None = None) -> FreeJoint:
    """Return a joint under pressure, free to bow out of its plane.

    Parameters
    ----------
    across
        Triangles across a tube, even.
    tell
        Called before every step of the solution.

    Raises
    ------
    BadInputError
        If the outline cannot be filled with triangles.
    NotConvergedError
        If no equilibrium is found.

    Examples
    --------
    >>> tube = JointShape(angles_deg=(0.0,), widths=(1.0,), fillets=(0.1, 0.1))
    >>> bool(free_joint(tube, across=4).bow_deg[0] < 1.0)
    True
    """
    planar = inflated_joint(
        joint, across=across, trunk_stub=TRUNK_STUB, child_stub=CHILD_STUB, tell=tell
    )
    membrane, start = both_sheets(planar.sheet, planar.equilibrium)
    found = at_rest(membrane, start, tell=tell)
    trunk, *children = stub_axes(planar.sheet.mesh, found.positions)
    forward, side = trunk.heading, np.array([0.0, 1.0, 0.0])
    up = np.cross(forward, side)
    side = np.cross(up, forward)
    headings = np.array([child.heading for child in children])
    along, across_, above = (headings @ axis for axis in (forward, side, up))
    return FreeJoint(
        planar=planar,
        angles_deg=np.degrees(np.arctan2(across_, along)),
        bow_deg=np.abs(np.degrees(np.arcsin(np.clip(above, -1.0, 1.0)))),
        energy=found.energy,
        positions=found.positions,
        triangles=membrane.triangles,
    )


def both_sheets(sheet: Sheet, found: Equilibrium) -> tuple[Membrane, Floats]:
    """Return both sheets of a pattern with a mouth, joined along the seam, and where they start.

    The start is the planar equilibrium, bent a little out of its plane. The cut through the trunk
    stays upright and level.
    """
    upper = sheet.membrane
    count = len(upper.points)
    is_seam = np.zeros(count, dtype=np.bool_)
    is_seam[sheet.is_seam] = True
    twin = np.arange(count)
    twin[~is_seam] = count + np.arange(np.count_nonzero(~is_seam))
    points = np.concatenate([upper.points, upper.points[~is_seam]])
    # Seen from below, corners run the other way round.
    triangles = np.concatenate([upper.triangles, twin[upper.triangles][:, ::-1]])
    free = np.concatenate([upper.free, upper.free[~is_seam]])
    at_mouth = is_seam & ~upper.free[:, 0]
    free[:count][is_seam & ~at_mouth, 2] = True
    lower = found.positions[~is_seam] * (1.0, 1.0, -1.0)
    start = np.concatenate([found.positions, lower])
    from_mouth = start[:, 0] - start[:count][at_mouth, 0].mean()
    start[:, 2] += np.where(free[:, 2], _SEED * from_mouth**2, 0.0)
    hoop_strain = 1.0 / (np.pi * upper.stiffness)
    membrane = Membrane(points, triangles, free, hoop_strain=hoop_strain, poisson=upper.poisson)
    return membrane, start
