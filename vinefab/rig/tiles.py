"""A plan divided into tiles: what belongs to each, joints included."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.rig.clean import Pieces, bridged, pieces_of, snapped_union, without_slivers
from vinefab.rig.options import GRID_MM
from vinefab.rig.plan import RigPlan
from vinefab.rig.split import Cuts, Seam, socket_of, tabs_of

Cell = tuple[int, int]
"""Row and column of a tile, from 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigTile:
    """The plan of one connected part."""

    cell: Cell  # where in the grid it lies
    # plate, solids: one outline, and what stands on it; both snapped, each corner of one on the
    # other's edge being a corner there too
    plate: Polygon
    solids: Pieces


@dataclass(frozen=True, slots=True, kw_only=True)
class Dovetail:
    """A dovetail between two tiles."""

    # giver, taker: the tiles with the tab and with the socket
    giver: Cell
    taker: Cell
    # tab, socket: their outlines
    tab: Polygon
    socket: BaseGeometry

    @property
    def gap_mm2(self) -> float:
        """Area between tab and socket that stays empty."""
        return float(self.socket.difference(self.tab).area)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dovetails:
    """All joints of a rig."""

    joints: tuple[Dovetail, ...]  # seam by seam
    bare_seams: int  # number of seams without room for a joint


def dovetails_of(plan: RigPlan, cuts: Cuts, clearance_mm: float) -> Dovetails:
    """Return the dovetails of all seams between neighbouring tiles."""
    plate = plan.plate
    shapely.prepare(plate)
    tree = shapely.STRtree(plan.solids)
    joints: list[Dovetail] = []
    bare = 0
    for seam, giver, taker in _seams(cuts):
        tabs = tabs_of(seam, plate, tree)
        bare += not tabs and _line(seam).intersects(plate)
        joints += [
            Dovetail(giver=giver, taker=taker, tab=tab, socket=_socket(tab, seam, clearance_mm))
            for tab in tabs
        ]
    return Dovetails(joints=tuple(joints), bare_seams=bare)


def rig_tiles(
    plan: RigPlan, cuts: Cuts, joints: Dovetails, least_mm: tuple[float, float]
) -> Iterator[RigTile]:
    """Yield the plans of all parts, row by row."""
    tree = shapely.STRtree(plan.solids)
    for row in range(len(cuts.y_mm) - 1):
        for column in range(len(cuts.x_mm) - 1):
            cell = row, column
            plates = _plates(plan.plate, _rectangle(cuts, cell), cell, joints)
            for plate in without_slivers(plates, max(least_mm))[0]:
                near = plan.solids[np.sort(tree.query(plate))]
                yield _tile(cell, plate, near, least_mm)


def _tile(
    cell: Cell,
    plate: Polygon,
    near: Pieces,
    least_mm: tuple[float, float],
) -> RigTile:
    sliver_mm, bridge_mm = least_mm
    solids = snapped_union(shapely.intersection(near, plate, grid_size=GRID_MM))
    solids, _ = without_slivers(solids, sliver_mm)
    solids, _ = bridged(solids, plate, bridge_mm)
    # Snapping moved corners on slanted edges by up to half a step: let the plate follow, so that
    # no solid hangs over its edge and no two edges nearly coincide.
    plate = max(snapped_union(solids, plate), key=shapely.area)
    return RigTile(cell=cell, plate=plate, solids=solids)


def _plates(plate: BaseGeometry, rectangle: Polygon, cell: Cell, joints: Dovetails) -> Pieces:
    tabs = [joint.tab for joint in joints.joints if joint.giver == cell]
    sockets = [joint.socket for joint in joints.joints if joint.taker == cell]
    own = shapely.intersection(plate, rectangle, grid_size=GRID_MM)
    own = shapely.union_all([own, *tabs], grid_size=GRID_MM)
    return pieces_of(shapely.difference(own, shapely.union_all(sockets), grid_size=GRID_MM))


def _seams(cuts: Cuts) -> Iterator[tuple[Seam, Cell, Cell]]:
    """Yield each seam with the tile that gives tabs and the one that takes them."""
    x, y = cuts.x_mm, cuts.y_mm
    rows, columns = len(y) - 1, len(x) - 1
    for row in range(rows):
        for column in range(1, columns):
            seam = Seam(upright=True, at_mm=x[column], low_mm=y[row], high_mm=y[row + 1])
            yield seam, (row, column - 1), (row, column)
    for row in range(1, rows):
        for column in range(columns):
            seam = Seam(upright=False, at_mm=y[row], low_mm=x[column], high_mm=x[column + 1])
            yield seam, (row - 1, column), (row, column)


def _line(seam: Seam) -> shapely.LineString:
    ends = [(seam.at_mm, seam.low_mm), (seam.at_mm, seam.high_mm)]
    return shapely.LineString(ends if seam.upright else [(y, x) for x, y in ends])


def _socket(tab: Polygon, seam: Seam, clearance_mm: float) -> BaseGeometry:
    """Return the socket's share beyond the seam; what lies before it belongs to the giver."""
    socket = socket_of(tab, clearance_mm)
    x_min, y_min, x_max, y_max = socket.bounds
    if seam.upright:
        x_min = seam.at_mm
    else:
        y_min = seam.at_mm
    return shapely.intersection(socket, shapely.box(x_min, y_min, x_max, y_max))


def _rectangle(cuts: Cuts, cell: Cell) -> Polygon:
    row, column = cell
    return shapely.box(cuts.x_mm[column], cuts.y_mm[row], cuts.x_mm[column + 1], cuts.y_mm[row + 1])
