"""Grids of cells, free or solid, made into maps of straight walls."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints, number, positive
from vinefab.maps.cleanup.cell_walls import (
    CORNER_CUT,
    FEWEST_CORNERS,
    CellWalls,
    Mask,
    boundary_loops,
    corners_between,
    unit,
)
from vinefab.maps.generators.generated_map import rounded_points
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.poses import roomiest_start
from vinefab.model.map import Map, Pose, Start

_STRAIGHT = 1.05
"""In cells: the middles of a straight wall's cell edges lie up to 0.5 to both of its sides, so a
chord between two of them may have others 1 beside it and still all belong to one wall."""

_SMALL_CELLS = 20.0
"""Smaller loops are split more finely: a pillar has no straight walls."""

_SHARP = float(np.cos(np.radians(115.0)))


def _split_loops(loops: list[Floats], tolerance: Floats) -> CellWalls:
    """Return loops as fitted walls without needless breaks."""
    # Each begins at an extreme, where it surely has a corner.
    far = np.array([1.0, 0.618])
    turned = [np.roll(loop, -int(np.argmin(loop @ far)), axis=0) for loop in loops]
    rough = _split(turned, tolerance)
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


def _breaks(loop: Floats, kept: Floats) -> Ints:
    """Return the indices of the midpoints kept, and what else must be a break."""
    # Twice a midpoint is whole, and no midpoint comes twice: a number names each exactly.
    weights = np.array([2.0, 2.0**27])
    names = loop @ weights
    order = np.argsort(names)
    breaks = np.sort(order[np.searchsorted(names[order], kept @ weights)])
    # The tip of a thin wall is split on both of its sides: it has an end, not a needle's point.
    ahead = unit(np.roll(loop[breaks], -1, axis=0) - loop[breaks])
    turn = np.sum(ahead * np.roll(ahead, 1, axis=0), axis=1)
    sharp = breaks[turn < _SHARP]
    both = np.concatenate([breaks[turn >= _SHARP], sharp - 1, sharp + 1]) % len(loop)
    breaks = np.unique(np.append(both, 0))
    if len(breaks) >= FEWEST_CORNERS:
        return breaks
    evenly = np.arange(FEWEST_CORNERS) * len(loop) // FEWEST_CORNERS
    return np.unique(np.append(breaks, evenly))


_LEAST_TOLERANCE = 0.75
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
    own = list[float]()  # small and thin loops have tolerances of their own
    for loop in rough:
        size = float(np.ptp(loop, axis=0).max())
        thickness = 2.0 * float(Polygon(loop).area) / len(loop)
        least = min(tolerance, _SMALL_SHARE * size, _THIN_SHARE * thickness)
        own.append(max(_LEAST_TOLERANCE, least))
    walls = _split_loops(rough, np.array(own))
    while _refine(walls, fixed):
        pass
    return Straightened(_polygon(_rings(walls, fixed)), float(walls.deviation().max()))


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
    found = [np.empty(0, dtype=np.int64)]
    for ring, jumper in pairs:
        off = shapely.distance(lines[starts[jumper] : ends[jumper]], solids[ring])
        found.append(starts[jumper] + np.flatnonzero(off <= off.min() + _LEAST_TOLERANCE))
    return np.concatenate(found)


MOST_OBSTACLES, MANY_EDGES, MOST_EDGES = 5000, 300_000, 4_000_000
"""Most obstacles of a grid whose walls have many cell edges, and most edges of any: beyond, a grid
is noise, which takes minutes to straighten and which no robot can be planned in."""

LEAST_CELL_MM = 0.01
LARGEST_CELL_MM = 1e6
"""Cells outside this range are not those of a map in millimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridPlacement:
    """Where a grid of cells lies in the map."""

    cell_mm: float  # width of a cell, at least 0.01
    # x_mm, y_mm: map position of the lower left corner of the lowest left cell
    x_mm: float = 0.0
    y_mm: float = 0.0
    turn_rad: float = 0.0  # by how much the grid is turned about that corner, counter-clockwise

    def __post_init__(self) -> None:
        number("cell_mm", self.cell_mm, LEAST_CELL_MM, LARGEST_CELL_MM, "mm")
        number("x_mm", self.x_mm, -1e7, 1e7, "mm")
        number("y_mm", self.y_mm, -1e7, 1e7, "mm")
        number("turn", self.turn_rad, -7.0, 7.0, "rad")

    def to_map(self, polygon: Polygon) -> Polygon:
        """Return a polygon in cells as one in map coordinates, rounded to 1e-4 mm."""
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        rotation = self.cell_mm * np.array([[cosine, sine], [-sine, cosine]])

        def place(points: Floats) -> Floats:
            moved = points @ rotation + np.array([self.x_mm, self.y_mm])
            return rounded_points(moved)

        return shapely.transform(polygon, place)

    def cell_at(self, pose: Pose) -> tuple[int, int]:
        """Return row (from the lowest) and column of the cell that holds a position."""
        x, y = pose.x_mm - self.x_mm, pose.y_mm - self.y_mm
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        column = (cosine * x + sine * y) / self.cell_mm
        row = (-sine * x + cosine * y) / self.cell_mm
        return int(np.floor(row)), int(np.floor(column))


def raster_map(
    name: str,
    free: Mask,
    placement: GridPlacement,
    options: ImportOptions,
    facts: Mapping[str, object],
) -> Map:
    """Return the map of one connected free region in a grid of cells.

    The region is the largest one, or the one with the start. Its outer boundary is the map's
    bounds and every solid island in it is an obstacle. Solid cells around it are not drawn as an
    obstacle in a box: a robot cannot tell, and a printed rig needs walls around the free space,
    not a plate as large as the image.

    Parameters
    ----------
    options
        Walls lie within ``simplify_mm`` of the boundary of the cells, by default one cell, at least
        0.75 of a cell; kept but for the rounding to 1e-4 mm.
    """
    tolerance_mm = placement.cell_mm if options.simplify_mm is None else options.simplify_mm
    positive("simplify_mm", tolerance_mm)
    least_mm2 = number("least_obstacle_mm2", options.least_obstacle_mm2 or 0.0, 0.0, 1e14, "mm2")
    least_mm = _LEAST_TOLERANCE * placement.cell_mm
    if tolerance_mm < least_mm * (1.0 - 1e-9):
        raise BadInputError(
            "simplify_mm", tolerance_mm, f"at least {least_mm:.6g} mm, 0.75 of a cell"
        )
    region, corner, left_out = _region(free, placement, options.start)
    islands = _Islands.of(region, least_mm2 / placement.cell_mm**2)
    obstacles = len(islands.loops) - 1
    edges = sum(len(loop) for loop in islands.loops)
    if edges > MOST_EDGES or (edges > MANY_EDGES and obstacles > MOST_OBSTACLES):
        raise BadInputError(
            "image",
            f"{counted(obstacles, 'obstacle')} with {edges} cell edges, as of noise",
            f"at most {MOST_OBSTACLES} obstacles where there are more than {MANY_EDGES} edges, and "
            f"{MOST_EDGES} edges; leave small ones out (--least-obstacle-mm2), or smooth the image "
            "with a median filter",
        )
    result = straighten(islands.loops, max(tolerance_mm / placement.cell_mm, _LEAST_TOLERANCE))
    walls = placement.to_map(shapely.transform(result.polygon, lambda cells: cells + corner))
    rings = 1 + len(result.polygon.interiors)
    if (pose := options.start) is None:
        start = roomiest_start(walls, shapely.maximum_inscribed_circle(walls, tolerance_mm))
    elif shapely.intersects_xy(walls, pose.x_mm, pose.y_mm):
        start = Start(pose=pose)
    else:
        allowed = f"a place farther than {tolerance_mm:g} mm from walls"
        raise BadInputError("start", f"({pose.x_mm:g}, {pose.y_mm:g}) mm", allowed)
    return Map(
        name=name,
        bounds=Polygon(walls.exterior),
        obstacles=tuple(Polygon(ring) for ring in walls.interiors),
        starts=(start,),
        environment="raster",
        facts={
            **facts,
            "simplify_mm": tolerance_mm,
            **left_out,
            **islands.facts(placement.cell_mm),
            "walls": int(shapely.get_num_coordinates(result.polygon)) - rings,
            "deviation_mm": result.deviation * placement.cell_mm,
            "free_area_of_cells_mm2": float(region.sum()) * placement.cell_mm**2,
            "free_area_of_walls_mm2": result.polygon.area * placement.cell_mm**2,
        },
    )


@dataclass(frozen=True, slots=True)
class _Islands:
    """The loops of a region without those of obstacles that are too small."""

    loops: list[Floats]
    dropped_cells2: list[float]

    @classmethod
    def of(cls, region: Mask, least_cells2: float) -> "_Islands":
        loops = boundary_loops(region)
        # The shoelace formula on midpoints misses half a cell: the four corners cut off.
        areas = [float(Polygon(loop).area) + 0.5 for loop in loops]
        outer = int(np.argmax(areas))
        kept = [index == outer or area >= least_cells2 for index, area in enumerate(areas)]
        return cls(
            [loop for loop, keep in zip(loops, kept, strict=True) if keep],
            [area for area, keep in zip(areas, kept, strict=True) if not keep],
        )

    def facts(self, cell_mm: float) -> dict[str, object]:
        return {
            "obstacles_left_out": len(self.dropped_cells2),
            "largest_obstacle_left_out_mm2": cell_mm**2 * max(self.dropped_cells2, default=0.0),
            "traced_cell_edges": sum(len(loop) for loop in self.loops),
        }


def _region(
    free: Mask, placement: GridPlacement, start: Pose | None
) -> tuple[Mask, Floats, dict[str, object]]:
    """Return the selected region, cropped, its lower left corner in cells, and what is left out.

    The labels of all cells are freed here: they take four times as much as the cells.
    """
    labels, count = scipy.ndimage.label(free)
    if count == 0:
        raise BadInputError("image", "no free cell", "at least one free cell")
    # Row by row: `bincount` copies what it counts as 8-byte integers.
    sizes = np.zeros(count + 1, dtype=np.int64)
    for cells in labels:
        np.add.at(sizes, cells, 1)
    sizes[0] = 0
    wanted = int(sizes.argmax())
    if start is not None:
        row, column = placement.cell_at(start)
        inside = 0 <= row < labels.shape[0] and 0 <= column < labels.shape[1]
        wanted = int(labels[row, column]) if inside else 0
        if wanted == 0:
            place = f"({start.x_mm:g}, {start.y_mm:g}) mm"
            raise BadInputError("start", place, "a free cell")
    rows, columns = scipy.ndimage.find_objects(labels, max_label=wanted)[wanted - 1]
    left_out: dict[str, object] = {
        "free_regions_left_out": count - 1,
        "free_area_left_out_mm2": float(sizes.sum() - sizes[wanted]) * placement.cell_mm**2,
    }
    corner = np.array([columns.start, rows.start], dtype=np.float64)
    region = np.asarray(labels[rows, columns] == wanted, dtype=np.bool_)
    return region, corner, left_out
