"""Terrain: the free space of a map as walls, for each body radius."""

import math
from collections.abc import Sequence
from threading import RLock
from typing import TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.growth.arrays import WallArrays
from vinefab.growth.free_space import free_space, indexed_walls, shrunk_free_space
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
