"""Terrain: the free space of a map as walls, for each body radius."""

import math
from collections.abc import Sequence
from threading import RLock
from typing import NamedTuple, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import UnfitInputError
from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import WallArrays
from vinefab.maps.passages import Rings, linked, rings_of, without_notches
from vinefab.model.map import Map, Pose

T = TypeVar("T")

GRID = 2.0**-40
"""Coordinates are rounded to the map's size (a power of two) times this: 1e-9 mm for a metre.

Rounding in this way (snap rounding) puts every vertex either on a wall, as a corner of it, or at
least half a grid step away from it. Needle gaps and overlaps that come from rounding alone are gone
after it, and touching has one meaning everywhere.
"""


_BUILD_LOCK = RLock()
"""Threads share terrains; no thread may rebuild or drop the terrain that another one builds."""

MOST_RADII = 64
"""Walls are kept for so many radii, then the oldest are dropped: memory stays bounded."""

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


WALLS_PER_PIECE = 32
"""Walls that are thickened together: few, because each meets all others that are near it."""

NOTCH_SHARE = 0.1
"""Of a body's radius: sharp notches with so wide a mouth are filled before the free space shrinks.

It moves the boundary by 0.00125 radii at most, as much as rounded corners are off.
"""


class Terrain:
    """The free space of one map as walls; immutable.

    Notes
    -----
    Build it once per map with `Terrain.of` and use it for all growths on that map. Walls for
    another body radius are built when first needed, and kept.
    """

    __slots__ = ("_free", "_rings", "_walls", "corners", "grid_mm", "world")

    def __init__(self, world: Map) -> None:
        self.world = world
        self.corners = world.wall_count
        # A power of two, for exact scaling.
        largest = max(abs(value) for value in world.bounds.bounds)
        self.grid_mm = float(GRID * 2.0 ** math.ceil(math.log2(largest)))
        self._free: dict[float, BaseGeometry] = {0.0: free_space(world, self.grid_mm)}
        self._rings: Rings | None = None  # of the bare free space
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
        # So many queries of prepared polygons build their index (one is not enough for GEOS 3.14).
        warm_up_queries = 64
        with _BUILD_LOCK:
            self._shrink(radius_mm)
            free = self._free[radius_mm]
            if not shapely.is_prepared(free):
                shapely.prepare(free)
                if not free.is_empty:
                    # GEOS builds its indices not here but after some queries within the polygons'
                    # box. Two threads that come first at the same time both build them, and free
                    # each other's memory.
                    corners = np.resize(shapely.get_coordinates(free), (warm_up_queries, 2))
                    shapely.contains_xy(free, corners)
                    shapely.shortest_line(free, shapely.points(corners))
            return free

    def walls(self, radius_mm: float = 0.0) -> WallArrays:
        """Return the walls that a body of some radius meets, indexed, read-only."""
        with _BUILD_LOCK:
            self._shrink(radius_mm)
            if radius_mm not in self._walls:
                _make_room(self._walls)
                self._walls[radius_mm] = indexed_walls(self._free[radius_mm], self.grid_mm)
            return self._walls[radius_mm]

    def _shrink(self, radius_mm: float) -> None:
        """Build the free space and the walls for a radius, where there are none yet."""
        if radius_mm not in self._free:
            bare = self._free[0.0]
            self._rings = self._rings or rings_of(bare)
            found = shrunk_free_space(bare, radius_mm, self.grid_mm, self._rings)
            _make_room(self._free)
            _make_room(self._walls)
            self._free[radius_mm], self._walls[radius_mm] = found

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
            problem = f"({x_mm:g}, {y_mm:g}) mm is {where} of map {self.world.name!r}"
            raise UnfitInputError("pose", problem, "move it into free space")
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
        # A start outside by up to this share of the map's size is moved onto the nearest wall.
        snap = 1e-9
        return snap / GRID * self.grid_mm

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


def free_space(world: Map, grid_mm: float) -> BaseGeometry:
    """Return bounds minus obstacles, snap-rounded.

    Subtracting many polygons from one takes time that grows with the square of their number,
    because every hole is searched for in every polygon. Obstacles that stand alone, clear of the
    bounds and of each other, are therefore made holes directly; only the others are subtracted.
    """
    return _without(world.bounds, np.array(world.obstacles, dtype=object), grid_mm)


def shrunk_free_space(
    free: BaseGeometry, radius_mm: float, grid_mm: float, rings: Rings | None = None
) -> tuple[BaseGeometry, WallArrays]:
    """Return where the centreline of a body of some radius may be, snap-rounded, and its walls."""
    free = without_notches(free, NOTCH_SHARE * radius_mm, MANY_NOTCHES, rings)
    if shapely.get_num_coordinates(free) > MOST_AT_ONCE:
        shrunk = shrunk_piecewise(free, radius_mm, grid_mm)
        return shrunk, indexed_walls(shrunk, grid_mm)
    buffered = shapely.buffer(free, -radius_mm, quad_segs=ARC_SEGMENTS_PER_QUARTER)
    # Where nothing is nearly as close as the grid, snap rounding moves corners and no more: then
    # moving them gives the same polygons in a tenth of the time.
    found = _moved_onto_grid(buffered, grid_mm)
    if found is not None:
        moved, rings = found
        walls = _walls_of(rings, grid_mm)
        place, is_crowded = walls.link[:, 2], walls.link[:, 4]
        if not is_crowded.any() and place.max(initial=-1) + 1 == len(place):
            return moved, walls
    shrunk = shapely.set_precision(buffered, grid_mm)
    return shrunk, indexed_walls(shrunk, grid_mm)


def _moved_onto_grid(shape: BaseGeometry, grid_mm: float) -> tuple[BaseGeometry, Rings] | None:
    """Return polygons with rounded corners, and `rings_of` them; None if corners get close.

    They come in the order of snap rounding, which begins every ring at its second corner.
    """
    rings, part = shapely.get_rings(shapely.get_parts(shape), return_index=True)
    if len(rings) == 0:
        return None
    count = shapely.get_num_coordinates(rings)
    last = np.cumsum(count) - 1
    after = np.arange(1, last[-1] + 2)
    after[last] = last - count + 2
    x, y = np.floor(shapely.get_coordinates(shape) / grid_mm + 0.5)[after].T.copy()
    apart = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(y))) >= APART
    apart[last[:-1]] = True  # there the next ring begins
    if not apart.all():
        return None
    corners = np.column_stack([x, y]) * grid_mm
    # Inside lies on the left, as in `rings_of`; every ring repeats its first corner at its end.
    turned = shapely.is_ccw(rings) == (np.diff(part, prepend=-1) == 0)
    ring = np.repeat(np.arange(len(count)), count - 1)
    step = np.arange(len(ring)) - np.repeat(np.cumsum(count - 1) - count + 1, count - 1)
    begin = np.where(turned, last, last - count + 1)
    at = begin[ring] + np.where(turned, -1, 1)[ring] * step
    return shapely.set_coordinates(shape, corners), linked(corners[at] + 0.0, ring)


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
    if not alone.any():
        return free
    rings = shapely.remove_repeated_points(shapely.get_exterior_ring(obstacles[alone]))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    holes: Shapes = np.empty(len(rings), dtype=object)
    shapely.linearrings(np.round(points / grid_mm) * grid_mm, indices=ring, out=holes)
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


def indexed_walls(free: BaseGeometry, grid_mm: float) -> WallArrays:
    """Return the walls of a free space with their grid index, read-only."""
    return _walls_of(rings_of(free), grid_mm)


def _walls_of(rings: Rings, grid_mm: float) -> WallArrays:
    """Return the walls of a free space from its rings."""
    place, count = _places(rings.corner)
    straight = (_bulge_mm(rings) <= grid_mm) & (count[place] == 1)
    if straight.any():
        # A needle keeps its flat corner: without it, it would have no inside.
        straight &= np.bincount(rings.ring, weights=~straight)[rings.ring] >= 3
        rings = linked(rings.corner[~straight], rings.ring[~straight])
        place, count = _places(rings.corner)
    x, y = _columns(rings.corner)
    end_x, end_y = x[rings.after], y[rings.after]
    span_x, span_y = end_x - x, end_y - y
    length = np.hypot(span_x, span_y)
    wall = _Walls(x, y, span_x / length, span_y / length, length, end_x, end_y)
    follower = _followers(wall, place, rings.after, count)
    before = np.empty_like(follower)
    before[follower] = np.arange(len(follower))
    end_place = place[rings.after]
    box, shape = _grid_over(wall)
    wall_first, wall_item = _listed(shape, *_cells_of_walls(wall, box, shape))
    lists = wall_first, wall_item
    start_cell = _cell(x, y, box, shape)
    crowded = _crowded(wall, rings, (place, end_place), lists, start_cell, CROWDED * grid_mm)
    owner, solid_x, solid_y = _vertices(wall, follower)
    vertex_cell = _cell(wall.end_x[owner], wall.end_y[owner], box, shape)
    vertex_first, order = _listed(shape, np.arange(len(owner)), vertex_cell)
    owner = owner[order]
    arrays = WallArrays(
        wall=np.column_stack(wall[:5]),
        link=np.column_stack([before, follower, place, end_place, crowded]).astype(np.int32),
        vertex=np.column_stack([end_x[owner], end_y[owner]]),
        solid=np.column_stack([solid_x[order], solid_y[order]]),
        vertex_point=end_place[owner].astype(np.int32),
        box=box,
        shape=shape,
        wall_first=wall_first.astype(np.int32),
        wall_item=wall_item.astype(np.int32),
        vertex_first=vertex_first.astype(np.int32),
    )
    for array in arrays:
        array.setflags(write=False)
    return arrays


class _Walls(NamedTuple):
    """Walls as columns, each in one piece: rows of a few numbers take several times as long.

    Start, unit tangent, length and end, mm, shape (n,) each.
    """

    x: Floats
    y: Floats
    t_x: Floats
    t_y: Floats
    length: Floats
    end_x: Floats
    end_y: Floats


def _columns(points: Floats) -> tuple[Floats, Floats]:
    return points[:, 0].copy(), points[:, 1].copy()


def _places(corner: Floats) -> tuple[Ints, Ints]:
    """Return the number of each corner's place and how many corners share each place."""
    if len(corner) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    # As np.unique over rows, at a third of its time.
    x, y = _columns(corner)
    order = np.lexsort((y, x))
    differs = (np.diff(x[order]) != 0.0) | (np.diff(y[order]) != 0.0)
    place = np.empty(len(corner), dtype=np.int64)
    place[order] = np.concatenate([[0], np.cumsum(differs)])
    return place, np.bincount(place).astype(np.int64)


def _bulge_mm(rings: Rings) -> Floats:
    """Return the distance of each corner from the line between its neighbours."""
    x, y = _columns(rings.corner)
    back_x, back_y = x - x[rings.before], y - y[rings.before]
    on_x, on_y = back_x[rings.after], back_y[rings.after]
    chord = np.hypot(back_x + on_x, back_y + on_y)
    turns_back = back_x * on_x + back_y * on_y <= 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        out = np.abs(back_x * on_y - back_y * on_x) / chord
    return np.where(turns_back, np.inf, out)


def _followers(wall: _Walls, place: Ints, after: Ints, count: Ints) -> Ints:
    """Return the wall that bounds the same wedge of free space at each wall's end.

    Within a ring it is the next wall. Where rings touch, the free space falls into several wedges,
    and the follower is the first wall met on turning clockwise, through the free side, from the
    wall's own reverse.
    """
    follower = after.copy()
    if count.max(initial=0) < 2:
        return follower
    tangent = np.column_stack([wall.t_x, wall.t_y])
    for shared in np.flatnonzero(count > 1):
        leaving = np.flatnonzero(place == shared)
        for arriving in np.flatnonzero(place[after] == shared):
            back = -tangent[arriving]
            cosine = tangent[leaving] @ back
            sine = tangent[leaving, 0] * back[1] - tangent[leaving, 1] * back[0]
            clockwise = np.arctan2(sine, cosine) % (2.0 * np.pi)
            # A wall that goes back exactly along this one closes a whole turn, not none.
            clockwise[clockwise == 0.0] = 2.0 * np.pi
            follower[arriving] = leaving[np.argmin(clockwise)]
    return follower


def _vertices(wall: _Walls, follower: Ints) -> tuple[Ints, Floats, Floats]:
    """Return the walls that end at vertices to wrap around, and the unit vectors into solid."""
    out_x, out_y = wall.t_x[follower], wall.t_y[follower]
    owner = np.flatnonzero(wall.t_x * out_y - wall.t_y * out_x < 0.0)
    in_x, in_y, out_x, out_y = wall.t_x[owner], wall.t_y[owner], out_x[owner], out_y[owner]
    # The sum of the edges' directions is poor for a flat corner, that of the normals for a needle.
    is_sharp = in_x * out_x + in_y * out_y < 0.0
    solid_x = np.where(is_sharp, out_x - in_x, in_y + out_y)
    solid_y = np.where(is_sharp, out_y - in_y, -(in_x + out_x))
    size = np.hypot(solid_x, solid_y)
    return owner, solid_x / size, solid_y / size


# --- Grid index: a ray or a sweep tests only the walls and vertices near it ---------------------

MARGIN = 1e-6
"""Walls are entered in cells that they miss by up to this share of a cell.

It is far above rounding and above the tolerance of touching, so that a ray along a cell's edge or
through its corner finds all that it touches in the cells that it crosses.
"""


def _grid_over(wall: _Walls) -> tuple[Floats, Ints]:
    """Return ``box`` and ``shape`` (see `WallArrays`) of a grid with about one cell per wall.

    It reaches half a cell beyond the walls, so that a body that lies along the outermost one, which
    rounding may place just outside, is still in it.
    """
    count = len(wall.x)
    if count == 0:
        return np.array([0.0, 0.0, 1.0, 1.0]), np.array([1, 1])
    low_x, low_y = float(wall.x.min()), float(wall.y.min())
    width, height = float(wall.x.max()) - low_x, float(wall.y.max()) - low_y
    cell = max(math.sqrt(width * height / count), max(width, height) / (4.0 * count))
    box = np.array([low_x - 0.5 * cell, low_y - 0.5 * cell, cell, 1.0 / cell])
    return box, np.array([int(width / cell) + 2, int(height / cell) + 2])


def _along(places_mm: Floats, axis: int, box: Floats, shape: Ints) -> Ints:
    """Return the column (axis 0) or row (axis 1) of places; those outside count as the nearest."""
    number = ((places_mm - box[axis]) * box[3]).astype(np.int64)
    return np.asarray(np.clip(number, 0, shape[axis] - 1))


def _cell(x_mm: Floats, y_mm: Floats, box: Floats, shape: Ints) -> Ints:
    return np.asarray(_along(y_mm, 1, box, shape) * shape[0] + _along(x_mm, 0, box, shape))


def _cells_of_walls(wall: _Walls, box: Floats, shape: Ints) -> tuple[Ints, Ints]:
    """Return (wall, cell) pairs for every cell that a wall touches within the margin."""
    side = box[2]
    margin = MARGIN * side
    first = _along(np.minimum(wall.x, wall.end_x) - margin, 0, box, shape)
    last = _along(np.maximum(wall.x, wall.end_x) + margin, 0, box, shape)
    item, column = _expanded(first, last)
    # The lowest and highest y of each wall within each of its columns.
    x, y = wall.x[item], wall.y[item]
    dx, dy = wall.end_x[item] - x, wall.end_y[item] - y
    edge = box[0] + column * side
    # Upright walls are taken whole: dividing by their width would lose them.
    upright = np.abs(dx) < 1e-3 * side
    dx[upright] = 1.0
    one = np.clip((edge - margin - x) / dx, 0.0, 1.0)
    two = np.clip((edge + side + margin - x) / dx, 0.0, 1.0)
    one[upright], two[upright] = 0.0, 1.0
    one, two = y + one * dy, y + two * dy
    pair, row = _expanded(
        _along(np.minimum(one, two) - margin, 1, box, shape),
        _along(np.maximum(one, two) + margin, 1, box, shape),
    )
    return item[pair], row * shape[0] + column[pair]


def _crowded(
    wall: _Walls, rings: Rings, places: tuple[Ints, Ints], lists: tuple[Ints, Ints], cell: Ints,
    near_mm: float,
) -> NDArray[np.bool_]:  # fmt: skip
    """Return the mask of walls near another one, except at a join.

    Walls do not cross, so what comes nearest is an end of one of the two: each wall's start is held
    against the walls in its cell.

    Parameters
    ----------
    places
        Of each wall's start and end.
    lists
        Where the walls of each cell begin in the list of them, and that list.
    cell
        Of each wall's start.
    """
    (place, end_place), (first, item) = places, lists
    crowded = np.zeros(len(cell), dtype=np.bool_)
    starts = np.flatnonzero(_are_mixed(wall, rings, first, item, near_mm)[cell])
    begin, end = first[cell[starts]], first[cell[starts] + 1]
    pairs_at_once = 1_000_000  # pairs of walls that are looked at together: about 100 MB
    batch = np.cumsum(end - begin) // pairs_at_once
    for some in np.split(np.arange(len(starts)), np.flatnonzero(np.diff(batch)) + 1):
        owner, listed = _expanded(begin[some], end[some] - 1)
        owner, other = starts[some[owner]], item[listed]
        r_x, r_y = wall.x[owner] - wall.x[other], wall.y[owner] - wall.y[other]
        aside = np.abs(r_x * wall.t_y[other] - r_y * wall.t_x[other])
        few = np.flatnonzero(aside <= near_mm)
        owner, other = owner[few], other[few]
        apart = (place[other] != place[owner]) & (end_place[other] != place[owner])
        along = r_x[few] * wall.t_x[other] + r_y[few] * wall.t_y[other]
        near = apart & (along >= -near_mm) & (along <= wall.length[other] + near_mm)
        if near.any():
            crowded[other[near]] = True
            at = place[owner[near]]
            crowded |= np.isin(place, at) | np.isin(end_place, at)
    return crowded


def _are_mixed(
    wall: _Walls, rings: Rings, first: Ints, item: Ints, near_mm: float
) -> NDArray[np.bool_]:
    """Return the mask of cells with more than one smooth stretch of a ring.

    A chain that turns by less than 2 rad in all ends no nearer to its beginning than half its
    length: with walls of some length, nothing along it is near anything else.
    """
    count = np.diff(first)
    if len(item) == 0 or wall.length.min() <= 4.0 * near_mm:
        return count > 0
    before_x, before_y = wall.t_x[rings.before], wall.t_y[rings.before]
    turn = np.abs(
        np.arctan2(
            before_x * wall.t_y - before_y * wall.t_x, before_x * wall.t_x + before_y * wall.t_y
        )
    )
    turned = np.cumsum(turn) + 4.0 * rings.ring  # two rings are never one stretch
    some = np.flatnonzero(count)
    here = turned[item]
    spread = np.maximum.reduceat(here, first[some]) - np.minimum.reduceat(here, first[some])
    mixed = np.zeros(len(count), dtype=np.bool_)
    mixed[some] = spread > 2.0 - 1e-6
    return mixed


def _expanded(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Return (index, value) for all values of each range ``first .. last``, both included."""
    count = last - first + 1
    ends = np.cumsum(count)
    index = np.repeat(np.arange(len(first)), count)
    return index, np.arange(len(index)) + np.repeat(first - ends + count, count)


def _listed(shape: Ints, item: Ints, cell: Ints) -> tuple[Ints, Ints]:
    """Return where each cell's items begin, and the items cell by cell in rising order."""
    cells = int(shape.prod())
    # Numbers of two bytes are sorted in one pass.
    short = cell.astype(np.uint16) if cells <= 2**16 else cell
    order = np.argsort(short, kind="stable")
    first = np.zeros(cells + 1, dtype=np.int64)
    np.cumsum(np.bincount(cell, minlength=cells), out=first[1:])
    return first, item[order]
