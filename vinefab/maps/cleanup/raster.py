"""Grids of cells, free or solid, made into maps of clean polygons."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, number, positive
from vinefab.maps.cleanup.cell_walls import Mask, boundary_loops
from vinefab.maps.cleanup.straighten import LEAST_TOLERANCE, Straightened, straighten
from vinefab.maps.generators.generated_map import rounded
from vinefab.maps.poses import roomiest_start
from vinefab.model.map import Map, Pose, Start

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
            return rounded(moved)

        return shapely.transform(polygon, place)

    def cell_at(self, pose: Pose) -> tuple[int, int]:
        """Return row (from the lowest) and column of the cell that holds a position."""
        x, y = pose.x_mm - self.x_mm, pose.y_mm - self.y_mm
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        column = (cosine * x + sine * y) / self.cell_mm
        row = (-sine * x + cosine * y) / self.cell_mm
        return int(np.floor(row)), int(np.floor(column))


@dataclass(frozen=True, slots=True, kw_only=True)
class RasterOptions:
    """How cells become polygons.

    Parameters
    ----------
    simplify_mm
        Largest distance between the walls and the boundary of the cells; one cell when None, at
        least 0.75 of a cell. Kept but for the rounding to 1e-4 mm.
    least_obstacle_mm2
        Obstacles smaller than this are left out; 0 keeps every cell.
    start
        Where robots start; found (the roomiest place) when None. The free region that holds it
        is the one that is kept.
    """

    simplify_mm: float | None = None
    least_obstacle_mm2: float = 0.0
    start: Pose | None = None

    def __post_init__(self) -> None:
        if self.simplify_mm is not None:
            positive("simplify_mm", self.simplify_mm)
        number("least_obstacle_mm2", self.least_obstacle_mm2, 0.0, 1e14, "mm2")


def raster_map(
    name: str,
    free: Mask,
    placement: GridPlacement,
    options: RasterOptions,
    facts: Mapping[str, object],
) -> Map:
    """Return the map of one connected free region in a grid of cells.

    The region is the largest one, or the one with the start. Its outer boundary is the map's
    bounds and every solid island in it is an obstacle. Solid cells around it are not drawn as an
    obstacle in a box: a robot cannot tell, and a printed rig needs walls around the free space,
    not a plate as large as the image.
    """
    tolerance_mm = placement.cell_mm if options.simplify_mm is None else options.simplify_mm
    least_mm = LEAST_TOLERANCE * placement.cell_mm
    if tolerance_mm < least_mm * (1.0 - 1e-9):
        raise BadInputError(
            "simplify_mm", tolerance_mm, f"at least {least_mm:.6g} mm, 0.75 of a cell"
        )
    region, corner, left_out = _region(free, placement, options.start)
    islands = _Islands.of(region, options.least_obstacle_mm2 / placement.cell_mm**2)
    result = straighten(islands.loops, max(tolerance_mm / placement.cell_mm, LEAST_TOLERANCE))
    walls = placement.to_map(shapely.transform(result.polygon, lambda cells: cells + corner))
    return Map(
        name=name,
        bounds=Polygon(walls.exterior),
        obstacles=tuple(Polygon(ring) for ring in walls.interiors),
        starts=(_start(walls, options.start, tolerance_mm),),
        environment="raster",
        facts={
            **facts,
            "simplify_mm": tolerance_mm,
            **left_out,
            **islands.facts(placement.cell_mm),
            **_outcome(result, region, placement.cell_mm),
        },
    )


@dataclass(frozen=True, slots=True)
class _Islands:
    """The loops of a region, without the holes around what is too small."""

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
    """Return the region that counts, cropped, its lower left corner in cells, and the rest."""
    labels, count = ndimage.label(free)
    if count == 0:
        raise BadInputError("image", "no free cell", "at least one free cell")
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    wanted = int(sizes.argmax()) if start is None else _label_at(labels, placement, start)
    rows, columns = ndimage.find_objects(labels, max_label=wanted)[wanted - 1]
    left_out: dict[str, object] = {
        "free_regions_left_out": count - 1,
        "free_area_left_out_mm2": float(sizes.sum() - sizes[wanted]) * placement.cell_mm**2,
    }
    corner = np.array([columns.start, rows.start], dtype=np.float64)
    region = np.asarray(labels[rows, columns] == wanted, dtype=np.bool_)
    return region, corner, left_out


def _label_at(labels: NDArray[np.integer[Any]], placement: GridPlacement, start: Pose) -> int:
    row, column = placement.cell_at(start)
    inside = 0 <= row < labels.shape[0] and 0 <= column < labels.shape[1]
    label = int(labels[row, column]) if inside else 0
    if label == 0:
        raise BadInputError("start", f"({start.x_mm:g}, {start.y_mm:g}) mm", "a free cell")
    return label


def _start(free: Polygon, start: Pose | None, tolerance_mm: float) -> Start:
    if start is None:
        return roomiest_start(free, tolerance_mm)
    if not shapely.intersects_xy(free, start.x_mm, start.y_mm):
        raise BadInputError(
            "start",
            f"({start.x_mm:g}, {start.y_mm:g}) mm",
            f"a place farther than {tolerance_mm:g} mm from walls",
        )
    return Start(pose=start)


def _outcome(result: Straightened, region: Mask, cell_mm: float) -> dict[str, object]:
    rings = 1 + len(result.polygon.interiors)
    return {
        "walls": int(shapely.get_num_coordinates(result.polygon)) - rings,
        "deviation_mm": result.deviation * cell_mm,
        "free_area_of_cells_mm2": float(region.sum()) * cell_mm**2,
        "free_area_of_walls_mm2": result.polygon.area * cell_mm**2,
    }
