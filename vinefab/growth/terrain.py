"""Terrain: the free space of a map as walls, for each body radius."""

import math
from collections.abc import Iterator, Sequence
from threading import RLock
from typing import NamedTuple, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import Ints32, WallArrays
from vinefab.maps.passages import Rings, linked, rings_of, without_notches
from vinefab.model.map import Map, Pose

T = TypeVar("T")

GRID = 2.0**-40
"""Coordinates are rounded to the map's size (a power of two) times this: 1e-9 mm for a metre.

Rounding in this way (snap rounding) puts every vertex either on a wall, as a corner of it, or at
least half a grid step away from it. Needle gaps and overlaps that come from rounding alone are gone
after it, and touching has one meaning everywhere.
"""

SNAP = 1e-9
"""A start outside by up to this share of the map's size is moved onto the nearest wall."""

WARM_UP_QUERIES = 64
"""So many queries of prepared polygons build their index (one is not enough for GEOS 3.14)."""

_BUILD_LOCK = RLock()
"""Threads share terrains; no thread may rebuild or drop the terrain that another one builds."""

MOST_RADII = 64
"""Walls are kept for so many radii, then the oldest are dropped: memory stays bounded."""


class Terrain:
    """The free space of one map as walls; immutable.

    Notes
    -----
    Build it once per map with `Terrain.of` and use it for all growths on that map. Walls for
    another body radius are built when first needed, and kept.
    """

    __slots__ = ("_free", "_walls", "corners", "grid_mm", "world")

    def __init__(self, world: Map) -> None:
        self.world = world
        self.corners = world.wall_count
        # A power of two, for exact scaling.
        largest = max(abs(value) for value in world.bounds.bounds)
        self.grid_mm = float(GRID * 2.0 ** math.ceil(math.log2(largest)))
        self._free: dict[float, BaseGeometry] = {0.0: _prepared(free_space(world, self.grid_mm))}
        self._walls: dict[float, WallArrays] = {}

    @classmethod
    def of(cls, world: Map) -> "Terrain":
        """Return the terrain of a map: bounds minus obstacles, snap-rounded."""
        return cls(world)

    @property
    def tolerance_mm(self) -> float:
        """Distances up to this count as touching: a quarter of the coordinates' grid."""
        return 0.25 * self.grid_mm

    def free_space(self, radius_mm: float = 0.0) -> BaseGeometry:
        """Return the free space of the centreline of a body of some radius, as polygons."""
        with _BUILD_LOCK:
            if radius_mm not in self._free:
                shrunk, walls = shrunk_free_space(self._free[0.0], radius_mm, self.grid_mm)
                _make_room(self._free)
                _make_room(self._walls)
                self._walls[radius_mm] = walls
                self._free[radius_mm] = _prepared(shrunk)
            return self._free[radius_mm]

    def walls(self, radius_mm: float = 0.0) -> WallArrays:
        """Return the walls that a body of some radius meets, indexed, read-only."""
        with _BUILD_LOCK:
            free = self.free_space(radius_mm)
            if radius_mm not in self._walls:
                _make_room(self._walls)
                self._walls[radius_mm] = indexed_walls(free, self.grid_mm)
            return self._walls[radius_mm]

    def keep_only(self, radii_mm: Sequence[float]) -> None:
        """Drop the walls of other radii: each takes about half a megabyte."""
        with _BUILD_LOCK:
            for kept in (self._free, self._walls):
                for radius_mm in kept.keys() - {0.0, *radii_mm}:
                    del kept[radius_mm]

    def contains(self, x_mm: float, y_mm: float, radius_mm: float = 0.0) -> bool:
        """Tell whether a point is in free space; a point on a wall is."""
        return self._snapped(x_mm, y_mm, radius_mm, self._snap_mm) is not None

    def have_room(self, points_mm: Floats, radius_mm: float) -> NDArray[np.bool_]:
        """Tell where branches of some radius can start exactly as they stand, shape (n,).

        Parameters
        ----------
        points_mm
            Their bases, shape (n, 2).
        """
        free = self.free_space(radius_mm)
        have: NDArray[np.bool_] = shapely.contains_xy(free, points_mm)
        outside = np.flatnonzero(~have)
        lines = shapely.shortest_line(free, shapely.points(points_mm[outside]))
        have[outside] = shapely.length(lines) <= self.tolerance_mm
        return have if not free.is_empty else np.zeros_like(have)

    def is_free(self, pose: Pose, radius_mm: float = 0.0) -> bool:
        """Tell whether a robot can start from a pose."""
        return self.contains(pose.x_mm, pose.y_mm, radius_mm)

    def start_mm(self, pose: Pose) -> tuple[float, float]:
        """Return the base (mm) of a robot started at a pose: there, or on the wall next to it.

        Raises
        ------
        BadInputError
            If the pose is inside an obstacle or outside the bounds.
        """
        x_mm, y_mm = pose.x_mm, pose.y_mm
        snapped = self._snapped(x_mm, y_mm, 0.0, self._snap_mm)
        if snapped is None:
            inside = self.world.bounds.covers(Point(x_mm, y_mm))
            where = "inside an obstacle" if inside else "outside the bounds"
            raise BadInputError(
                "pose",
                f"({x_mm:g}, {y_mm:g}) mm, {where}",
                f"a place in the free space of map {self.world.name}",
            )
        return snapped

    def starts_mm(self, poses: Sequence[Pose]) -> Floats:
        """Return the bases of robots started at some poses, shape (n, 2); see `start_mm`."""
        points = np.array([(pose.x_mm, pose.y_mm) for pose in poses]).reshape(-1, 2)
        inside = shapely.contains_xy(self.free_space(), points)
        for index in np.flatnonzero(~inside).tolist():
            points[index] = self.start_mm(poses[index])
        return points

    @property
    def _snap_mm(self) -> float:
        return SNAP / GRID * self.grid_mm

    def _snapped(
        self, x_mm: float, y_mm: float, radius_mm: float, within_mm: float
    ) -> tuple[float, float] | None:
        """Return a point if it is free, the nearest free one if within a distance, or None."""
        free = self.free_space(radius_mm)
        if shapely.contains_xy(free, x_mm, y_mm):
            return x_mm, y_mm
        if free.is_empty:
            return None
        line = shapely.shortest_line(free, Point(x_mm, y_mm))
        if line.length > within_mm:
            return None
        nearest_x_mm, nearest_y_mm = line.coords[0]
        return float(nearest_x_mm), float(nearest_y_mm)


def _make_room(kept: dict[float, T]) -> None:
    """Drop the oldest radius, but never the bare centreline."""
    while len(kept) >= MOST_RADII:
        del kept[next(radius_mm for radius_mm in kept if radius_mm > 0.0)]


def _prepared(free: BaseGeometry) -> BaseGeometry:
    """Return the polygons with an index for fast point queries."""
    shapely.prepare(free)
    if not free.is_empty:
        # GEOS builds its indices not here but after some queries within the polygons' box. Two
        # threads that come first at the same time both build them, and free each other's memory.
        corners = np.resize(shapely.get_coordinates(free), (WARM_UP_QUERIES, 2))
        shapely.contains_xy(free, corners)
        shapely.shortest_line(free, shapely.points(corners))
    return free


Shapes = NDArray[np.object_]

APART = 8.0
"""Distance in grid steps at which shapes cannot touch each other by rounding."""

ARC_SEGMENTS_PER_QUARTER = 16
"""Rounded corners of inflated bodies: within 0.0012 radii of the true arc."""

MOST_AT_ONCE = 20_000
"""A free space with more corners is shrunk piece by piece. At once it takes time that grows with
the square of their number: seconds up to here, hours for 100,000."""

CROWDED = 8.0
"""Walls nearer to each other than this many steps of the coordinates' grid are crowded: far more
than rounding, than the tolerance of touching, and than leaving out flat corners can move a wall."""

FEW_CORNERS = 1_000
"""The clearance of obstacles with no more corners is measured as a whole."""

MANY_NOTCHES = 200
"""Fewer cost little, and stay."""

PAIRS_AT_ONCE = 1_000_000
"""Pairs of walls that are looked at together: about 100 MB."""

WALLS_PER_PIECE = 32
"""Walls that are thickened together: few, because each meets all others that are near it."""

NOTCH_SHARE = 0.1
"""Of a body's radius: sharp notches with so wide a mouth are filled before the free space shrinks.

It moves the boundary by 0.00125 radii at most, as much as rounded corners are off.
"""


def free_space(world: Map, grid_mm: float) -> BaseGeometry:
    """Return bounds minus obstacles, snap-rounded.

    Subtracting many polygons from one takes time that grows with the square of their number,
    because every hole is searched for in every polygon. Obstacles that stand alone, clear of the
    bounds and of each other, are therefore made holes directly; only the others are subtracted.
    """
    return _without(world.bounds, np.array(world.obstacles, dtype=object), grid_mm)


def shrunk_free_space(
    free: BaseGeometry, radius_mm: float, grid_mm: float
) -> tuple[BaseGeometry, WallArrays]:
    """Return where the centreline of a body of some radius may be, snap-rounded, and its walls."""
    free = without_notches(free, NOTCH_SHARE * radius_mm, MANY_NOTCHES)
    if shapely.get_num_coordinates(free) > MOST_AT_ONCE:
        shrunk = shrunk_piecewise(free, radius_mm, grid_mm)
        return shrunk, indexed_walls(shrunk, grid_mm)
    buffered = shapely.buffer(free, -radius_mm, quad_segs=ARC_SEGMENTS_PER_QUARTER)
    # Where nothing is nearly as close as the grid, snap rounding moves corners and no more: then
    # moving them gives the same polygons in a tenth of the time.
    moved = _moved_onto_grid(buffered, grid_mm)
    if moved is not None:
        walls = indexed_walls(moved, grid_mm)
        place, is_crowded = walls.link[:, 2], walls.link[:, 4]
        if not is_crowded.any() and place.max(initial=-1) + 1 == len(place):
            return moved, walls
    shrunk = shapely.set_precision(buffered, grid_mm)
    return shrunk, indexed_walls(shrunk, grid_mm)


def _moved_onto_grid(shape: BaseGeometry, grid_mm: float) -> BaseGeometry | None:
    """Return polygons with rounded corners, in the order of snap rounding; None if they get close.

    That begins every ring at its second corner.
    """
    count = shapely.get_num_coordinates(shapely.get_rings(shapely.get_parts(shape)))
    if len(count) == 0:
        return None
    after = np.arange(1, count.sum() + 1)
    last = np.cumsum(count) - 1
    after[last] = last - count + 2
    corners = np.floor(shapely.get_coordinates(shape) / grid_mm + 0.5)[after]
    apart = np.abs(np.diff(corners, axis=0)).max(axis=1) >= APART
    apart[last[:-1]] = True  # there the next ring begins
    return shapely.set_coordinates(shape, corners * grid_mm) if apart.all() else None


def shrunk_piecewise(
    free: BaseGeometry,
    radius_mm: float,
    grid_mm: float,
    segments: int = ARC_SEGMENTS_PER_QUARTER,
) -> BaseGeometry:
    """Return a free space less all that is near its walls, taken a few at a time and merged."""
    shrunk = list[BaseGeometry]()
    for part in shapely.get_parts(free):
        shell, *holes = shapely.get_rings(part)
        solid = np.array([shapely.Polygon(hole) for hole in holes], dtype=object)
        small = shapely.get_num_points(holes) <= WALLS_PER_PIECE
        large = solid[~small]
        outlines = [shell, *shapely.get_exterior_ring(large).tolist()]
        pieces = [piece for outline in outlines for piece in _pieces(outline)]
        near = [*solid[small], *pieces]
        grown = shapely.buffer(near, radius_mm, quad_segs=segments)
        merged = shapely.disjoint_subset_union_all([*grown, *large])
        shrunk.append(_without(shapely.Polygon(shell), shapely.get_parts(merged), grid_mm))
    places = shapely.get_parts(shrunk)
    return places[0] if len(places) == 1 else shapely.MultiPolygon([*places])


def beside_walls(rings: Shapes, radius_mm: float) -> BaseGeometry:
    """Return all that is near some rings."""
    if shapely.get_num_coordinates(rings).sum() <= MOST_AT_ONCE:
        return shapely.buffer(shapely.MultiLineString(list(rings)), radius_mm)
    pieces = [piece for ring in rings for piece in _pieces(ring)]
    return shapely.union_all(shapely.buffer(pieces, radius_mm))


def _pieces(ring: BaseGeometry) -> list[BaseGeometry]:
    """Return a ring's walls, a few to a line."""
    corners = shapely.get_coordinates(ring)
    firsts = range(0, len(corners) - 1, WALLS_PER_PIECE)
    return [shapely.LineString(corners[at : at + WALLS_PER_PIECE + 1]) for at in firsts]


def _without(bounds: BaseGeometry, obstacles: Shapes, grid_mm: float) -> BaseGeometry:
    """Return bounds minus obstacles, snap-rounded; see `free_space`."""
    alone = _stand_alone(bounds, obstacles, APART * grid_mm)
    # Only obstacles that meet are merged one with another: much faster on scattered ones.
    solid = shapely.disjoint_subset_union_all(obstacles[~alone])
    free = shapely.difference(bounds, solid, grid_size=grid_mm)
    holes = _rounded(obstacles[alone], grid_mm)
    if len(holes) == 0:
        return free
    parts = shapely.get_parts(free)
    inside, part = shapely.STRtree(parts).query(shapely.get_point(holes, 0), "intersects")
    for index in np.unique(part):
        shell = shapely.get_exterior_ring(parts[index])
        old = shapely.get_rings(parts[index])[1:]
        parts[index] = shapely.polygons(shell, np.append(old, holes[inside[part == index]]))
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(list(parts))


def _stand_alone(bounds: BaseGeometry, obstacles: Shapes, apart_mm: float) -> NDArray[np.bool_]:
    """Return the mask of plain obstacles inside the bounds and clear of all else, shape (n,)."""
    edge = bounds.boundary
    shapely.prepare(bounds)
    shapely.prepare(edge)
    alone: NDArray[np.bool_] = shapely.contains_properly(bounds, obstacles)
    alone &= ~shapely.dwithin(edge, obstacles, apart_mm)
    alone &= shapely.get_num_interior_rings(obstacles) == 0
    # Parts of one obstacle that are nearly as close as the grid are left to exact rounding.
    alone &= _are_wide(obstacles, apart_mm)
    pairs = shapely.STRtree(obstacles).query(obstacles, "dwithin", apart_mm)
    alone &= np.bincount(pairs[0], minlength=len(obstacles)) == 1
    return alone


def _are_wide(obstacles: Shapes, apart_mm: float) -> NDArray[np.bool_]:
    """Return the mask of the obstacles without corners or walls closer to each other."""
    few = shapely.get_num_coordinates(obstacles) <= FEW_CORNERS
    wide = np.ones(len(obstacles), dtype=np.bool_)
    wide[few] = shapely.minimum_clearance(obstacles[few]) > apart_mm
    # That measures every corner against every wall of a jagged outline.
    for index in np.flatnonzero(~few):
        walls = rings_of(obstacles[index])
        ends = np.stack([walls.corner, walls.corner[walls.after]], axis=1)
        lines = np.asarray(shapely.linestrings(ends))
        corner, wall = shapely.STRtree(lines).query(
            shapely.points(walls.corner), "dwithin", apart_mm
        )
        own = (wall == corner) | (wall == walls.before[corner])
        wide[index] = own.all() and (shapely.length(lines) > apart_mm).all()
    return wide


def _rounded(obstacles: Shapes, grid_mm: float) -> Shapes:
    """Return the outlines of obstacles without holes, with rounded coordinates."""
    rings = shapely.remove_repeated_points(shapely.get_exterior_ring(obstacles))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    outlines: Shapes = np.empty(len(rings), dtype=object)
    shapely.linearrings(np.round(points / grid_mm) * grid_mm, indices=ring, out=outlines)
    return outlines


class FreeSpaceWalls(NamedTuple):
    """Walls of a free space; see `vinefab.growth.arrays.WallArrays` for the columns.

    Here ``wall`` has two more, end x and end y, and ``link`` has not got the last one.
    """

    # wall, link: the walls and how they hang together
    wall: Floats
    link: Ints
    # vertex, vertex_point: the vertices that a body can wrap around, x, y and ``solid``
    vertex: Floats
    vertex_point: Ints


def indexed_walls(free: BaseGeometry, grid_mm: float) -> WallArrays:
    """Return the walls of a free space with their grid index, read-only."""
    return indexed(walls_of(free, grid_mm), CROWDED * grid_mm)


def walls_of(free: BaseGeometry, tolerance_mm: float) -> FreeSpaceWalls:
    """Return the walls of a free space."""
    rings = rings_of(free)
    place, count = _places(rings.corner)
    straight = (_bulge(rings) <= tolerance_mm) & (count[place] == 1)
    # A needle keeps its flat corner: without it, it would have no inside.
    straight &= np.bincount(rings.ring, weights=~straight)[rings.ring] >= 3
    if straight.any():
        rings = linked(rings.corner[~straight], rings.ring[~straight])
        place, count = _places(rings.corner)
    start, end = rings.corner, rings.corner[rings.after]
    span = end - start
    length = np.hypot(span[:, 0], span[:, 1])
    wall = np.column_stack([start, span / length[:, None], length, end])
    follower = _followers(wall, place, rings.after, count)
    ahead = np.empty_like(follower)
    ahead[follower] = np.arange(len(follower))
    link = np.column_stack([ahead, follower, place, place[rings.after]])
    vertex, owner = _vertices(wall, follower)
    return FreeSpaceWalls(wall, link, vertex, link[owner, 3])


def _places(corner: Floats) -> tuple[Ints, Ints]:
    """Return the number of each corner's place and how many corners share each place."""
    if len(corner) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    # As np.unique over rows, at a third of its time.
    x, y = corner[:, 0], corner[:, 1]
    order = np.lexsort((y, x))
    differs = (np.diff(x[order]) != 0.0) | (np.diff(y[order]) != 0.0)
    place = np.empty(len(corner), dtype=np.int64)
    place[order] = np.concatenate([[0], np.cumsum(differs)])
    return place, np.bincount(place).astype(np.int64)


def _bulge(rings: Rings) -> Floats:
    """Return the distance of each corner from the line between its neighbours."""
    back = rings.corner - rings.corner[rings.before]
    on = rings.corner[rings.after] - rings.corner
    chord = np.hypot(*(back + on).T)
    turns_back = np.sum(back * on, axis=1) <= 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        out = np.abs(back[:, 0] * on[:, 1] - back[:, 1] * on[:, 0]) / chord
    return np.where(turns_back, np.inf, out)


def _followers(wall: Floats, place: Ints, after: Ints, count: Ints) -> Ints:
    """Return the wall that bounds the same wedge of free space at each wall's end.

    Within a ring it is the next wall. Where rings touch, the free space falls into several wedges,
    and the follower is the first wall met on turning clockwise, through the free side, from the
    wall's own reverse.
    """
    follower = after.copy()
    for shared in np.flatnonzero(count > 1):
        leaving = np.flatnonzero(place == shared)
        for arriving in np.flatnonzero(place[after] == shared):
            back = -wall[arriving, 2:4]
            cosine = wall[leaving, 2:4] @ back
            sine = wall[leaving, 2] * back[1] - wall[leaving, 3] * back[0]
            clockwise = np.arctan2(sine, cosine) % (2.0 * np.pi)
            # A wall that goes back exactly along this one closes a whole turn, not none.
            clockwise[clockwise == 0.0] = 2.0 * np.pi
            follower[arriving] = leaving[np.argmin(clockwise)]
    return follower


def _vertices(wall: Floats, follower: Ints) -> tuple[Floats, Ints]:
    """Return the wrappable vertices and the walls that end at them."""
    t_in, t_out = wall[:, 2:4], wall[follower, 2:4]
    bend = t_in[:, 0] * t_out[:, 1] - t_in[:, 1] * t_out[:, 0]
    owner = np.flatnonzero(bend < 0.0)
    t_in, t_out = t_in[owner], t_out[owner]
    # The sum of the edges' directions is poor for a flat corner, that of the normals for a needle.
    between = t_out - t_in
    normals = np.column_stack([-(t_in + t_out)[:, 1], (t_in + t_out)[:, 0]])
    is_sharp = np.sum(t_in * t_out, axis=1) < 0.0
    solid = np.where(is_sharp[:, None], between, -normals)
    solid = solid / np.hypot(solid[:, 0], solid[:, 1])[:, None]
    return np.column_stack([wall[owner, 5:7], solid]), owner.astype(np.int64)


# --- Grid index: a ray or a sweep tests only the walls and vertices near it ---------------------

MARGIN = 1e-6
"""Walls are entered in cells that they miss by up to this share of a cell.

It is far above rounding and above the tolerance of touching, so that a ray along a cell's edge or
through its corner finds all that it touches in the cells that it crosses.
"""


class _Grid(NamedTuple):
    """Lower left corner, cell side (mm), cells per mm, columns and rows."""

    x_mm: float
    y_mm: float
    cell_mm: float
    per_mm: float
    columns: int
    rows: int


def indexed(walls: FreeSpaceWalls, near_mm: float) -> WallArrays:
    """Return the walls with their grid index, all arrays read-only."""
    grid = _grid_over(walls.wall)
    wall_first, wall_item = _listed(grid, *_cells_of_walls(grid, walls.wall))
    crowded = np.zeros(len(walls.wall), dtype=np.int64)
    for owner, place in _lists_at_starts(grid, walls.wall, wall_first):
        crowded[_crowded(walls, owner, wall_item[place].astype(np.int64), near_mm)] = 1
    cell = _row(grid, walls.vertex[:, 1]) * grid.columns + _column(grid, walls.vertex[:, 0])
    vertex_first, order = _listed(grid, np.arange(len(walls.vertex)), cell)
    arrays = WallArrays(
        wall=np.ascontiguousarray(walls.wall[:, :5]),
        link=np.column_stack([walls.link, crowded]).astype(np.int32),
        vertex=np.ascontiguousarray(walls.vertex[order, :2]),
        solid=np.ascontiguousarray(walls.vertex[order, 2:]),
        vertex_point=walls.vertex_point[order].astype(np.int32),
        box=np.array([grid.x_mm, grid.y_mm, grid.cell_mm, grid.per_mm]),
        shape=np.array([grid.columns, grid.rows], dtype=np.int64),
        wall_first=wall_first,
        wall_item=wall_item,
        vertex_first=vertex_first,
    )
    for array in arrays:
        array.setflags(write=False)
    return arrays


def _grid_over(wall: Floats) -> _Grid:
    """Return a grid with about one cell per wall.

    It reaches half a cell beyond the walls, so that a body that lies along the outermost one, which
    rounding may place just outside, is still in it.
    """
    if len(wall) == 0:
        return _Grid(0.0, 0.0, 1.0, 1.0, 1, 1)
    low, high = wall[:, :2].min(axis=0), wall[:, :2].max(axis=0)
    width, height = (high - low).tolist()
    cell = max(np.sqrt(width * height / len(wall)), max(width, height) / (4.0 * len(wall)))
    columns, rows = int(width / cell) + 2, int(height / cell) + 2
    corner = low - 0.5 * cell
    return _Grid(float(corner[0]), float(corner[1]), float(cell), 1.0 / float(cell), columns, rows)


def _column(grid: _Grid, x_mm: Floats) -> Ints:
    column = np.floor((x_mm - grid.x_mm) * grid.per_mm)
    return np.clip(column, 0, grid.columns - 1).astype(np.int64)


def _row(grid: _Grid, y_mm: Floats) -> Ints:
    row = np.floor((y_mm - grid.y_mm) * grid.per_mm)
    return np.clip(row, 0, grid.rows - 1).astype(np.int64)


def _cells_of_walls(grid: _Grid, wall: Floats) -> tuple[Ints, Ints]:
    """Return (wall, cell) pairs for every cell that a wall touches within the margin."""
    margin = MARGIN * grid.cell_mm
    left = np.minimum(wall[:, 0], wall[:, 5])
    right = np.maximum(wall[:, 0], wall[:, 5])
    first, last = _column(grid, left - margin), _column(grid, right + margin)
    item, column = _expanded(first, last)
    low, high = _heights(grid, wall[item], column, margin)
    pair, row = _expanded(_row(grid, low - margin), _row(grid, high + margin))
    return item[pair], row * grid.columns + column[pair]


def _heights(grid: _Grid, wall: Floats, column: Ints, margin: float) -> tuple[Floats, Floats]:
    """Return the lowest and highest y of each wall within its column."""
    x, y = wall[:, 0], wall[:, 1]
    dx, dy = wall[:, 5] - x, wall[:, 6] - y
    edge = grid.x_mm + column * grid.cell_mm
    # Upright walls are taken whole: dividing by their width would lose them.
    upright = np.abs(dx) < 1e-3 * grid.cell_mm
    width = np.where(upright, 1.0, dx)
    one = np.where(upright, 0.0, np.clip((edge - margin - x) / width, 0.0, 1.0))
    two = np.where(upright, 1.0, np.clip((edge + grid.cell_mm + margin - x) / width, 0.0, 1.0))
    return np.minimum(y + one * dy, y + two * dy), np.maximum(y + one * dy, y + two * dy)


def _lists_at_starts(grid: _Grid, wall: Floats, first: Ints32) -> Iterator[tuple[Ints, Ints]]:
    """Yield (wall, place in the list of items) for all walls in the cell of each wall's start.

    They come in batches that bound the memory.
    """
    cell = _row(grid, wall[:, 1]) * grid.columns + _column(grid, wall[:, 0])
    begin, end = first[cell].astype(np.int64), first[cell + 1].astype(np.int64)
    batch = np.cumsum(end - begin) // PAIRS_AT_ONCE
    for some in np.split(np.arange(len(cell)), np.flatnonzero(np.diff(batch)) + 1):
        owner, place = _expanded(begin[some], end[some] - 1)
        yield some[owner], place


def _crowded(walls: FreeSpaceWalls, owner: Ints, other: Ints, near_mm: float) -> NDArray[np.bool_]:
    """Return the mask of walls near another one, except at a join, given pairs to look at.

    Walls do not cross, so what comes nearest is an end of one of the two.
    """
    start, end = walls.link[:, 2], walls.link[:, 3]
    # Columns, each in one piece: rows of two numbers take three times as long.
    x, y, t_x, t_y, length = np.ascontiguousarray(walls.wall[:, :5].T)
    r_x, r_y = x[owner] - x[other], y[owner] - y[other]
    aside = np.abs(r_x * t_y[other] - r_y * t_x[other])
    few = np.flatnonzero(aside <= near_mm)
    owner, other = owner[few], other[few]
    apart = (start[other] != start[owner]) & (end[other] != start[owner])
    along = r_x[few] * t_x[other] + r_y[few] * t_y[other]
    near = apart & (along >= -near_mm) & (along <= length[other] + near_mm)
    crowded = np.zeros(len(start), dtype=np.bool_)
    if near.any():
        crowded[other[near]] = True
        crowded |= np.isin(start, start[owner[near]]) | np.isin(end, start[owner[near]])
    return crowded


def _expanded(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Return (index, value) for all values of each range ``first .. last``, both included."""
    count = last - first + 1
    index = np.repeat(np.arange(len(first)), count)
    within = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    return index, first[index] + within


def _listed(grid: _Grid, item: Ints, cell: Ints) -> tuple[Ints32, Ints32]:
    """Return where each cell's items begin, and the items cell by cell in rising order."""
    order: NDArray[np.int64] = np.argsort(cell, kind="stable")
    counts = np.bincount(cell, minlength=grid.columns * grid.rows)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return first, item[order].astype(np.int32)
