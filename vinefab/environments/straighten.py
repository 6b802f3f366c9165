"""Traced loops made into one polygon of straight walls, none of them closed, opened or crossed."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from vinefab.environments.split import split_loops
from vinefab.environments.trace import corners_between
from vinefab.environments.walls import Walls
from vinefab.model.checked import Floats, Ints

LEAST_TOLERANCE = 0.75
"""In cells. The corners of a straight wall's cells lie up to 0.71 beside it, so below this stairs
could not be told from walls."""

LEAST_GAP = 0.3
"""In cells: walls of the result stay this far apart (the trace's keep 0.7), so that a wall one
cell thick neither vanishes nor opens, and a passage one cell wide does not close."""

_SMALL_SHARE = 0.1
_THIN_SHARE = 0.5

Lines = NDArray[np.object_]


@dataclass(frozen=True, slots=True)
class Straightened:
    """A polygon and how far it is from the boundary of its cells; in cells.

    Attributes
    ----------
    polygon
        Valid; as many holes as the trace has.
    deviation
        Bound of the Hausdorff distance between the two boundaries.
    """

    polygon: Polygon
    deviation: float


def straighten(loops: list[Floats], tolerance: float) -> Straightened:
    """Return a polygon whose walls follow traced loops within a tolerance.

    Loops that are rectangles are kept as they are. Small and thin loops are followed more
    closely, to 0.1 of their size and half of their thickness, so that a pillar stays a pillar.
    Where straight walls stray, come too near to each other or jump over each other they are taken
    back towards the trace, step by step, and there only; the trace itself has none of these
    faults, so this ends.

    Parameters
    ----------
    loops
        From `boundary_loops` of one 4-connected region: the outer boundary, which runs
        counter-clockwise, and its holes, in any order.
    tolerance
        Largest deviation in cells, at least `LEAST_TOLERANCE`.
    """
    rectangles = [_rectangle(loop) for loop in loops]
    fixed = [rectangle for rectangle in rectangles if rectangle is not None]
    rough = [loop for loop, rectangle in zip(loops, rectangles, strict=True) if rectangle is None]
    if not rough:
        return Straightened(_polygon(fixed), 0.0)
    walls = split_loops(rough, np.array([_tolerance_for(loop, tolerance) for loop in rough]))
    while _refine(walls, fixed):
        pass
    return Straightened(_polygon(_rings(walls, fixed)), float(walls.deviation().max()))


def _tolerance_for(loop: Floats, tolerance: float) -> float:
    size = float(np.ptp(loop, axis=0).max())
    thickness = 2.0 * float(Polygon(loop).area) / len(loop)
    own = min(_SMALL_SHARE * size, _THIN_SHARE * thickness)
    return max(LEAST_TOLERANCE, min(tolerance, own))


def _rectangle(loop: Floats) -> Floats | None:
    """Return the corners of a loop that is a rectangle of cells, else None."""
    low, high = loop.min(axis=0), loop.max(axis=0)
    if len(loop) != 2 * round(float((high - low).sum())):
        return None
    lattice = corners_between(loop, np.roll(loop, -1, axis=0))
    at_corner = ((lattice == low) | (lattice == high)).all(axis=1)
    return lattice[at_corner] if at_corner.sum() == 4 else None


def _rings(walls: Walls, fixed: list[Floats]) -> list[Floats]:
    return [*np.split(walls.corners, walls.opening[1:]), *fixed]


def _polygon(rings: list[Floats]) -> Polygon:
    outer = _outer(np.array([Polygon(ring) for ring in rings]))
    return Polygon(rings[outer], [ring for index, ring in enumerate(rings) if index != outer])


def _outer(solids: Lines) -> int:
    return int(np.argmax(shapely.area(solids)))


def _refine(walls: Walls, fixed: list[Floats]) -> bool:
    """Take one step at every fault of the kind that comes first; return whether there was one."""
    bad = walls.strays()
    if not bad.any():
        rings = _rings(walls, fixed)
        ends = np.cumsum([len(ring) for ring in rings])
        pairs = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
        lines = np.asarray(shapely.linestrings(np.concatenate(pairs)))
        faults = _too_near(lines, ends)
        if not len(faults):
            faults = _jumping(rings, lines, ends)
        bad[faults[faults < len(bad)]] = True
    return walls.refine(bad)


def _too_near(lines: Lines, ends: Ints) -> Ints:
    """Return the indices of segments that come too near to others."""
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=LEAST_GAP)
    one, two = one[one < two], two[one < two]
    owner = np.searchsorted(ends, np.arange(len(lines)), side="right")
    size = np.diff(ends, prepend=0)[owner[one]]
    steps = np.minimum(two - one, size - (two - one))
    # Next neighbours may be joined by a short wall; that is no fault unless they cross.
    crossing = (steps == 2) & shapely.intersects(lines[one], lines[two])
    clash = (owner[one] != owner[two]) | (steps > 2) | crossing
    return np.concatenate([one[clash], two[clash]])


def _jumping(rings: list[Floats], lines: Lines, ends: Ints) -> Ints:
    """Return the indices of segments that leave another ring on the wrong side, crossing none."""
    solids = np.array([Polygon(ring) for ring in rings])
    outer = _outer(solids)
    spots = shapely.points(np.array([ring[0] for ring in rings]))
    inside, around = shapely.STRtree(solids).query(spots, predicate="within")
    lost = np.setdiff1d(np.arange(len(rings)), np.append(inside[around == outer], outer))
    eaten = around != outer
    pairs = [(int(ring), outer) for ring in lost]
    pairs += zip(inside[eaten].tolist(), around[eaten].tolist(), strict=True)
    starts = ends - np.diff(ends, prepend=0)
    found = [
        starts[jumper] + _nearest_to(solids[ring], lines[starts[jumper] : ends[jumper]])
        for ring, jumper in pairs
    ]
    return np.concatenate([np.empty(0, dtype=np.int64), *found])


def _nearest_to(solid: Polygon, lines: Lines) -> Ints:
    off = shapely.distance(lines, solid)
    return np.flatnonzero(off <= off.min() + LEAST_TOLERANCE)
