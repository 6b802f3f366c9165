"""Map contexts: what tasks need of a map, computed once per map."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import UnfitInputError
from vinefab.core.front_door import imported_later
from vinefab.core.validation import Floats, Ints, frozen_floats
from vinefab.model.map import Map
from vinefab.model.target import Target
from vinefab.tasks.areas import TOUCHING_MM, FreeArea, SightLines, WallCells

if TYPE_CHECKING:
    from vinefab.tasks import union_kernel
else:
    union_kernel = imported_later("vinefab.tasks.union_kernel")

GRID = 2.0**-43
"""Corners are rounded to the map's size (a power of two) times this, 6e-11 mm for half a metre:
points that differ by rounding alone merge; others lie much farther apart."""

CLOSED = 2.0**-43
"""An outline that is open by more than this share of the map's size is not taken."""

RUN = 8
"""As in the kernel."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeRows:
    """Edges of a free space that are not level, row by row of the plane."""

    edges: Floats  # lower end, upper end, x per y and step; see the kernel
    first: Ints  # where the edges of each row begin, with the total at the end
    box: Floats  # lower end and height of the rows, mm
    size_mm: float  # the map's size, a power of two

    @classmethod
    def of(cls, edges_mm: Floats) -> "FreeRows":
        """Return the rows of directed edges with the free space on their left, shape (e, 2, 2)."""
        size_mm = float(2.0 ** np.ceil(np.log2(np.abs(edges_mm).max())))
        ends = _rounded(edges_mm, size_mm)
        ends = ends[ends[:, 0, 1] != ends[:, 1, 1]]
        up = ends[:, 1, 1] > ends[:, 0, 1]
        ends = np.where(up[:, None, None], ends, ends[:, ::-1])
        run = ends[:, 1] - ends[:, 0]
        edges = np.column_stack([ends.reshape(-1, 4), run[:, 0] / run[:, 1], 1.0 - 2.0 * up])
        edges_per_row = 8  # edges of the free space are listed in rows of about so many
        rows = max(1, len(edges) // edges_per_row)
        low_mm, high_mm = edges[:, 1].min(), edges[:, 3].max()
        box = np.array([low_mm, (high_mm - low_mm) / rows])
        begin, end = (
            np.clip(((y - box[0]) / box[1]).astype(np.int64), 0, rows - 1)
            for y in (edges[:, 1], edges[:, 3])
        )
        count = end - begin + 1
        which = np.repeat(np.arange(len(edges)), count)
        row = begin[which] + np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        order = np.argsort(row, kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=rows))])
        return cls(edges=edges[which[order]], first=first, box=box, size_mm=size_mm)

    def areas_mm2(
        self, polygons: NDArray[np.object_], begins: Ints, lines: Floats, line_first: Ints,
        radius_mm: float,
    ) -> Floats:  # fmt: skip
        """Return the area within the free space of unions of polygons, shape (j,).

        NaN where rounding left an outline open, which is very rare.

        Parameters
        ----------
        polygons
            What is within about a distance of each line.
        begins
            Where the polygons of each union begin, with the total at the end, shape (j + 1,).
        lines, line_first
            Corners of the lines, mm, and where those of each begin, with the total at the end.
        radius_mm
            The distance.
        """
        rings, owner = shapely.get_rings(polygons, return_index=True)
        corners, which = shapely.get_coordinates(rings, return_index=True)
        ring = np.searchsorted(which, np.arange(len(rings) + 1))
        polygon = np.searchsorted(owner, np.arange(len(polygons) + 1))
        together = int(np.diff(begins).max(initial=0))
        # The edges of each polygon are filled up to whole runs.
        most = int(np.diff(ring[polygon[begins]]).max(initial=0)) // RUN + together + 1
        out = np.zeros((len(begins), 4))
        out[:, 0] = begins
        union_kernel.union_areas(
            _rounded(corners, self.size_mm), ring, polygon, lines, line_first, radius_mm,
            self.edges, self.first, self.box,
            np.empty((most * RUN, 6)),
            np.empty(together + 1, dtype=np.int64),
            np.empty((together, 4)),
            np.empty((most, 3)),
            np.empty((2 * (most * RUN + len(self.edges)) + 1, 2)),
            out,
        )  # fmt: skip
        areas_mm2, open_mm, open_mm2 = out[:-1, 1:].T
        closed_mm = CLOSED * self.size_mm
        closed = (np.abs(open_mm) <= closed_mm) & (np.abs(open_mm2) <= closed_mm * self.size_mm)
        return np.where(closed, areas_mm2, np.nan)


def _rounded(points_mm: Floats, size_mm: float) -> Floats:
    grid_mm = GRID * size_mm
    return np.round(points_mm / grid_mm) * grid_mm


Key = TypeVar("Key")
Part = TypeVar("Part")


_MARGIN = 1e-6
"""Walls are listed in cells that they miss by this share of a cell: far above rounding."""

MOST_EDGES_AT_ONCE = 5_000
"""The free space of a map with more edges is cut into tiles where areas in it are measured, so that
the time of each follows what is near, not the whole map."""

EDGES_PER_TILE = 512
"""Tiles are halved down to about so many edges, where halves have fewer."""

_BUILD_LOCK = Lock()
"""Threads share contexts, and only one may build or drop a cached part at a time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapContext:
    """The free space of a map, prepared for many evaluations."""

    free: BaseGeometry  # free space: Polygon or MultiPolygon
    area_mm2: float  # its area
    diagonal_mm: float  # diagonal of the bounds' box, the length that lengths are compared with
    # edges of the free space with solid on their right, shape (e, 2, 2): edge, end, x and y
    edges_mm: Floats
    targets: tuple[Target, ...] = ()  # of the map
    _rasters: dict[tuple[float, bool], FreeArea | None] = field(default_factory=dict)
    _sight_lines: dict[float, SightLines | None] = field(default_factory=dict)
    _cells: dict[str, WallCells] = field(default_factory=dict)
    _tiles: dict[str, shapely.STRtree] = field(default_factory=dict)
    _rows: dict[str, FreeRows] = field(default_factory=dict)

    @classmethod
    def of(cls, world: Map, free: BaseGeometry | None = None) -> "MapContext":
        """Return the context of a map; ``free`` is its free space where that is known."""
        free = world.free_space if free is None else free
        if not free.area > 0.0:
            raise UnfitInputError(
                f"map {world.name!r}", "obstacles fill it", "leave free space in it"
            )
        return cls(
            free=free,
            area_mm2=free.area,
            diagonal_mm=math.hypot(*world.size_mm),
            edges_mm=_edges_mm(free),
            targets=world.targets,
        )

    @property
    def without_targets(self) -> "MapContext":
        """The same without targets; what is cached is cached for both."""
        return replace(self, targets=())

    def free_area_mm2(self, shape: BaseGeometry) -> float:
        """Return the area of a shape's part in free space."""
        if len(self.edges_mm) <= MOST_EDGES_AT_ONCE:
            return float(shapely.intersection(shape, self.free).area)
        shapely.prepare(shape)
        tiles = _cached(self._tiles, "all", lambda: shapely.STRtree(_tiles(self.free)))
        near = tiles.geometries[tiles.query(shape, "intersects")]
        whole = shapely.contains_properly(shape, near)
        parts = shapely.intersection(shape, near[~whole])
        return float(shapely.area(near[whole]).sum() + shapely.area(parts).sum())

    def raster(self, radius_mm: float, *, walls: bool = True) -> FreeArea | None:
        """Return the raster for a radius, cached; None if it would be too large."""

        def build() -> FreeArea | None:
            if walls:
                return FreeArea.of(self.edges_mm, radius_mm)
            # The edges of a box that holds every disc about a point of the map.
            x_min, y_min, x_max, y_max = self.free.bounds
            reach_mm = 1.01 * radius_mm
            box = (x_min - reach_mm, y_min - reach_mm, x_max + reach_mm, y_max + reach_mm)
            return FreeArea.of(_edges_mm(shapely.box(*box)), radius_mm)

        return _cached(self._rasters, (radius_mm, walls), build)

    def sight_lines(self, radius_mm: float) -> SightLines | None:
        """Return the lines of sight for a radius, cached; None if they would be too many."""
        return _cached(
            self._sight_lines, radius_mm, lambda: SightLines.of(self.edges_mm, radius_mm)
        )

    @property
    def rows(self) -> FreeRows:
        """The edges row by row, for exact areas of many growths; cached."""
        return _cached(self._rows, "all", lambda: FreeRows.of(self.edges_mm))

    @property
    def cells(self) -> WallCells:
        """The edges by cells, about as many as there are edges; cached."""

        def build() -> WallCells:
            walls_mm = self.edges_mm.reshape(-1, 4)
            size_mm = np.ptp(self.edges_mm, axis=(0, 1))
            even_mm = math.sqrt(float(size_mm.prod()) / len(walls_mm))
            side_mm = max(even_mm, float(size_mm.max()) / len(walls_mm))
            while True:
                reach_mm = _MARGIN * side_mm + 2.0 * TOUCHING_MM
                cells = WallCells.of(walls_mm, side_mm, reach_mm)
                if cells is not None:
                    return cells
                side_mm *= 2.0

        return _cached(self._cells, "all", build)


def _cached(parts: dict[Key, Part], key: Key, build: Callable[[], Part]) -> Part:
    """Return the part cached under a key, built once; beyond the limit the oldest is dropped."""
    # Rasters and lines of sight are kept for so many radii, then the oldest are dropped.
    most_kept_radii = 4
    with _BUILD_LOCK:
        if key not in parts:
            while len(parts) >= most_kept_radii:
                parts.pop(next(iter(parts)))
            parts[key] = build()
        return parts[key]


def _edges_mm(free: BaseGeometry) -> Floats:
    """Return the directed edges of polygons, holes clockwise, shape (e, 2, 2)."""
    parts = [part for part in shapely.get_parts(free) if part.geom_type == "Polygon"]
    rings = shapely.get_rings(shapely.orient_polygons(parts))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    real = (ring[:-1] == ring[1:]) & (points[:-1] != points[1:]).any(axis=1)
    edges = np.stack([points[:-1], points[1:]], axis=1)[real]
    flat = frozen_floats("edges_mm", edges.reshape(-1, 4), 4)
    return flat.reshape(-1, 2, 2)


def _tiles(free: BaseGeometry) -> list[BaseGeometry]:
    """Return polygons in parts with few edges each, that have no area in common."""
    corners = shapely.get_num_coordinates(free)
    if corners <= EDGES_PER_TILE:
        return [free]
    x_min, y_min, x_max, y_max = free.bounds
    x, y = 0.5 * (x_min + x_max), 0.5 * (y_min + y_max)
    if x_max - x_min > y_max - y_min:
        boxes = (x_min, y_min, x, y_max), (x, y_min, x_max, y_max)
    else:
        boxes = (x_min, y_min, x_max, y), (x_min, y, x_max, y_max)
    halves = [shapely.clip_by_rect(free, *box) for box in boxes]  # quick, but may cross itself
    halves = [
        half if half.is_valid else shapely.intersection(free, shapely.box(*box))
        for half, box in zip(halves, boxes, strict=True)
    ]
    if shapely.get_num_coordinates(halves).sum() > 1.5 * corners:  # most edges cross the line
        return [free]
    return [tile for half in halves for tile in _tiles(half)]
