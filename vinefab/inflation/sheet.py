"""The upper sheet of a welded pattern: its triangles, how it is held, and how it starts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.validation import Floats, Ints
from vinefab.inflation.membrane import POISSON, Membrane
from vinefab.inflation.mesh import SheetMesh, StraightSide, mesh_of
from vinefab.inflation.solve import Equilibrium, Tell, at_rest
from vinefab.model.outline import Contour, Part

LOAD_LENGTH = 0.1
"""Length of seam, in widths of the trunk, over which a load is a mean: about that of a weld band.

The load at a single point of a tight crotch grows with the fineness of the triangles.
"""

FINER = 0.65
"""Spacing in joints and ends over that across straight tubes.

There, edges do not lie along the lines about which the sheet bends, which makes coarse triangles
too stiff.
"""

_START_SLOPE = 0.45  # height of the start over the distance from the seam


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sheet:
    """The upper sheet of a pattern, in widths of its trunk.

    The seam stays in the plane z = 0. A mouth is the cut end of a long tube: its points stay in the
    upright plane x = const and are free in it, which is what an endless tube does there. A pattern
    without a mouth is held at two points against moving as a whole.
    """

    mesh: SheetMesh
    membrane: Membrane
    is_seam: "Ints"  # corners that keep z = 0, in the outline's order

    def inflated(self, *, start: Floats | None = None, tell: Tell | None = None) -> Equilibrium:
        """Return the sheet under pressure.

        Parameters
        ----------
        start
            Corners in space, shape (n, 3), near the result; None: a low roof over the flat sheet.

        Raises
        ------
        NotConvergedError
            If no equilibrium is found.
        """
        return at_rest(self.membrane, self.roof() if start is None else start, tell=tell)

    def roof(self) -> Floats:
        """Return a start: the flat sheet raised with the distance from the seam, shape (n, 3)."""
        points = self.mesh.points
        held = ~self.membrane.free[:, 2]
        away = scipy.spatial.cKDTree(points[held]).query(points)[0]
        return np.column_stack([points, np.where(held, 0.0, _START_SLOPE * away)])

    def seam_loads(self, found: Equilibrium) -> Floats:
        """Return the load that opens the weld at each corner of `SheetMesh.seam`, over p W.

        Force per length of flat seam, the mean over `LOAD_LENGTH` of it; 1 / pi on a straight tube
        of width 1, NaN at a mouth.
        """
        seam = self.mesh.seam
        force = np.abs(self.membrane.forces(found.positions)[seam, 2])
        loop = self.mesh.points[seam]
        ahead = np.hypot(*(np.roll(loop, -1, axis=0) - loop).T)
        # Each corner bears the half of both edges: the force up to the middle of every edge.
        bounds = np.concatenate([[-ahead[-1] / 2.0], np.cumsum(ahead) - ahead / 2.0])
        total = np.concatenate([[0.0], np.cumsum(force)])
        length = float(ahead.sum())
        bounds = np.concatenate([bounds[:-1] - length, bounds, bounds[1:] + length])
        total = np.concatenate([total[:-1] - total[-1], total, total[1:] + total[-1]])
        here = np.concatenate([[0.0], np.cumsum(ahead)[:-1]])
        half = LOAD_LENGTH / 2.0
        loads = np.interp(here + half, bounds, total) - np.interp(here - half, bounds, total)
        loads[~np.isin(seam, self.is_seam)] = np.nan
        mean: Floats = loads / LOAD_LENGTH
        return mean


def sheet_of(
    outline: Contour,
    straights: tuple[StraightSide, ...],
    widths: Mapping[str, float],
    *,
    across: int,
    hoop_strain: float,
) -> Sheet:
    """Return the upper sheet of a pattern.

    Parameters
    ----------
    outline
        Closed, counter-clockwise, in widths of the trunk; segments of `Part.MOUTH` lie across +x.
    straights
        Its straight stretches.
    widths
        Width of each branch of the outline, by its id.
    across
        Triangles across a tube, even.
    hoop_strain
        p W / (pi E t) of the trunk.

    Raises
    ------
    BadInputError
        If the outline cannot be filled with triangles.
    """
    spacing = FINER * np.array([widths[branch] for branch in outline.branches]) / across
    mesh = mesh_of(outline, straights, spacing, across=across)
    points = mesh.points
    free = np.ones((len(points), 3), dtype=np.bool_)
    is_seam = np.zeros(len(points), dtype=np.bool_)
    is_seam[mesh.seam] = True
    mouth = [segment for segment in outline.segments if segment.part is Part.MOUTH]
    for segment in mouth:
        (x, y0), (_, y1) = segment.start_mm, segment.end_mm
        size = abs(y1 - y0)
        on = is_seam & (np.abs(points[:, 0] - x) < 1e-6 * size)
        on &= np.abs(points[:, 1] - (y0 + y1) / 2.0) < size / 2.0 * (1.0 + 1e-6)
        free[on, 0] = False
        corner = on & (np.abs(np.abs(points[:, 1] - (y0 + y1) / 2.0) - size / 2.0) < 1e-6 * size)
        is_seam[on & ~corner] = False
        # Sideways nothing pulls: any one point may hold it.
        free[np.flatnonzero(corner)[0], 1] = False
    free[is_seam, 2] = False
    if not mouth:
        one = int(mesh.seam[0])
        other = int(mesh.seam[np.argmax(np.abs(points[mesh.seam, 0] - points[one, 0]))])
        free[one, :2] = free[other, 1] = False
    membrane = Membrane(points, mesh.triangles, free, hoop_strain=hoop_strain)
    loop = mesh.seam[is_seam[mesh.seam]]
    return Sheet(mesh=mesh, membrane=membrane, is_seam=loop)


def turned_deg(one: Floats, other: Floats) -> float:
    """Return the angle from one direction in the plane to another, -180 to 180."""
    cross, dot = one[0] * other[1] - one[1] * other[0], one[0] * other[0] + one[1] * other[1]
    return math.degrees(math.atan2(cross, dot))


def tube_stretch(hoop_strain: float, poisson: float = POISSON) -> tuple[float, float]:
    """Return by how much the film of a closed tube is stretched around and along, as ratios.

    Parameters
    ----------
    hoop_strain
        p W / (pi E t) of the flat tube.

    Notes
    -----
    St. Venant and Kirchhoff film in plane stress. With the radius R = h W / pi, h and a the
    stretches around and along, equilibrium per flat length is ``h S_h = p a R`` around and
    ``2 W a S_a = p pi R^2`` along.

    Examples
    --------
    >>> [round(stretch, 4) for stretch in tube_stretch(0.01)]
    [1.0077, 1.0006]
    """
    along = 1.0
    for _ in range(200):
        # Around in closed form for a length: both in turn diverge above a strain of 0.55.
        square = (1.0 + 2.0 * hoop_strain * along) / (1.0 + poisson * hoop_strain / along)
        axial = hoop_strain * (square / (2.0 * along) - poisson * along)
        new = math.sqrt(max(0.01, 1.0 + 2.0 * axial))
        if abs(new - along) < 1e-14:
            break
        along = new
    return math.sqrt(square), new
