"""Traced loops made into one polygon of straight walls, none of them closed, opened or crossed."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from vinefab.core.validation import Floats, Ints
from vinefab.maps.cleanup.cell_walls import (
    CORNER_CUT,
    FEWEST_CORNERS,
    CellWalls,
    corners_between,
    unit,
)

_STRAIGHT = 1.05
"""In cells: the middles of a straight wall's cell edges lie up to 0.5 to both of its sides, so a
chord between two of them may have others 1 beside it and still all belong to one wall."""

_SMALL_CELLS = 20.0
"""Smaller loops are split more finely: a pillar has no straight walls."""

_SHARP = float(np.cos(np.radians(115.0)))


def split_loops(loops: list[Floats], tolerance: Floats) -> CellWalls:
    """Return loops as fitted walls, freed of needless breaks."""
    rough = _split([_from_extreme(loop) for loop in loops], tolerance)
    walls = _split(_from_best_corner(rough), tolerance)
    walls.divide()
    walls.merge()
    walls.settle()
    return walls


def _split(loops: list[Floats], tolerance: Floats) -> CellWalls:
    """Split loops where chords between their midpoints bend, beginning at their first."""
    closed = [np.vstack([loop, loop[:1]]) for loop in loops]
    owner = np.repeat(np.arange(len(loops)), [len(loop) for loop in closed])
    lines = shapely.linestrings(np.concatenate(closed), indices=owner)
    size = np.array([np.ptp(loop, axis=0).max() for loop in loops])
    coarse = np.where(size > _SMALL_CELLS, _STRAIGHT, 0.0)
    allowed = np.maximum(tolerance - CORNER_CUT, coarse)
    kept = shapely.simplify(lines, allowed, preserve_topology=False)
    first = np.cumsum([0, *(len(loop) for loop in loops[:-1])])
    breaks = [
        start + _breaks(loop, shapely.get_coordinates(line)[:-1])
        for start, loop, line in zip(first, loops, kept, strict=True)
    ]
    walls = CellWalls(
        midpoints=np.concatenate(loops),
        first=first,
        tolerance=tolerance,
        breaks=np.concatenate(breaks),
        holds=np.zeros(sum(len(part) for part in breaks), dtype=np.int64),
    )
    walls.settle()
    return walls


def _from_best_corner(walls: CellWalls) -> list[Floats]:
    """Return loops turned to begin between two long walls that meet at a clear angle.

    Where a loop begins it has a corner for good, so that must be a true one.
    """
    weight = np.minimum(walls.sizes, walls.sizes[walls.before]) * walls.turns_rad()
    openings = np.append(walls.opening, len(weight))
    ends = np.append(walls.first, len(walls.midpoints))
    loops = []
    for low, high, begin, end in zip(openings[:-1], openings[1:], ends[:-1], ends[1:], strict=True):
        best = low + int(np.argmax(weight[low:high]))
        loops.append(np.roll(walls.midpoints[begin:end], begin - walls.breaks[best], axis=0))
    return loops


def _from_extreme(loop: Floats) -> Floats:
    """Return a loop turned to begin where it surely has a corner."""
    return np.roll(loop, -int(np.argmin(loop @ np.array([1.0, 0.618]))), axis=0)


def _breaks(loop: Floats, kept: Floats) -> Ints:
    """Return the indices of the midpoints kept, and what else must be a break."""
    # Twice a midpoint is whole, and no midpoint comes twice: a number names each exactly.
    weights = np.array([2.0, 2.0**27])
    names = loop @ weights
    order = np.argsort(names)
    breaks = _blunted(loop, np.sort(order[np.searchsorted(names[order], kept @ weights)]))
    if len(breaks) >= FEWEST_CORNERS:
        return breaks
    evenly = np.arange(FEWEST_CORNERS) * len(loop) // FEWEST_CORNERS
    return np.unique(np.append(breaks, evenly))


def _blunted(loop: Floats, breaks: Ints) -> Ints:
    """Split the tip of a thin wall on both of its sides: it has an end, not a needle's point."""
    ahead = unit(np.roll(loop[breaks], -1, axis=0) - loop[breaks])
    turn = np.sum(ahead * np.roll(ahead, 1, axis=0), axis=1)
    sharp = breaks[turn < _SHARP]
    both = np.concatenate([breaks[turn >= _SHARP], sharp - 1, sharp + 1]) % len(loop)
    return np.unique(np.append(both, 0))


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


def _rings(walls: CellWalls, fixed: list[Floats]) -> list[Floats]:
    return [*np.split(walls.corners, walls.opening[1:]), *fixed]


def _polygon(rings: list[Floats]) -> Polygon:
    outer = _outer(np.array([Polygon(ring) for ring in rings]))
    return Polygon(rings[outer], [ring for index, ring in enumerate(rings) if index != outer])


def _outer(solids: Lines) -> int:
    return int(np.argmax(shapely.area(solids)))


def _refine(walls: CellWalls, fixed: list[Floats]) -> bool:
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
