"""Several robots on one bed: each where it takes the least room, on a grid, without collisions.

A robot covers the cells of a grid that it comes near; a place is free where none of its cells is
taken. Which places are free follows, for all places at once, from the correlation of the two
grids. Robots may lie in each other's arms, which boxes around them would not allow.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.fabrication.job.placement import BedPlacement, place_contours
from vinefab.model.outline import Contour

Cells = NDArray[np.bool_]

APART_MM = 8.0
"""Film left between two robots: for their heat, and for marks (assumed)."""

CELL_MM = 2.0
MOST_CELLS = 400_000
TURNS = 24
"""So many turns of each robot are tried."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stamp:
    """The cells that a robot takes in one turn."""

    turn_rad: float  # the turn
    low_mm: tuple[float, float]  # lower left corner of the turned robot's box
    size_mm: tuple[float, float]  # width and height of the box
    cells: Cells  # taken cells, the box's corner ``rim`` cells from the array's corner


class _Bed:
    """The cells of the bed that are taken."""

    def __init__(self, room_mm: tuple[float, float]) -> None:
        self.room_mm = room_mm
        self.cell_mm = max(CELL_MM, math.sqrt(room_mm[0] * room_mm[1] / MOST_CELLS))
        self.near_mm = APART_MM / 2.0 + self.cell_mm * math.sqrt(0.5)
        self.rim = math.ceil(self.near_mm / self.cell_mm) + 1
        shape = [math.ceil(side / self.cell_mm) + 2 * self.rim for side in reversed(room_mm)]
        self.taken: Cells = np.zeros(shape, dtype=np.bool_)
        self.used_mm = (0.0, 0.0)

    def stamp(self, robot: shapely.Polygon, turn_rad: float) -> _Stamp:
        """Return the cells that come nearer to a robot than half the distance kept."""
        turned = shapely.affinity.rotate(robot, turn_rad, origin=(0, 0), use_radians=True)
        x0, y0, x1, y1 = turned.bounds
        near = shapely.buffer(turned, self.near_mm, quad_segs=4)
        counts = [math.ceil(side / self.cell_mm) + 2 * self.rim for side in (x1 - x0, y1 - y0)]
        across, up = (
            low + (np.arange(count) - self.rim + 0.5) * self.cell_mm
            for low, count in zip((x0, y0), counts, strict=True)
        )
        x, y = np.meshgrid(across, up)
        shapely.prepare(near)
        return _Stamp(
            turn_rad=turn_rad,
            low_mm=(x0, y0),
            size_mm=(x1 - x0, y1 - y0),
            cells=np.asarray(shapely.contains_xy(near, x, y)),
        )

    def best(self, stamp: _Stamp) -> tuple[float, int, int] | None:
        """Return how much of the bed is used with the robot in its best free place, and that."""
        last = [
            math.floor((room - size) / self.cell_mm + 1e-9)
            for room, size in zip(self.room_mm, stamp.size_mm, strict=True)
        ]
        if min(last) < 0:
            return None
        shape = self.taken.shape
        hits = np.fft.irfft2(
            np.fft.rfft2(self.taken) * np.conj(np.fft.rfft2(stamp.cells, s=shape)), s=shape
        )
        free = hits[: last[1] + 1, : last[0] + 1] < 0.5
        rows, columns = np.nonzero(free)
        if not len(rows):
            return None
        wide = np.maximum(self.used_mm[0], columns * self.cell_mm + stamp.size_mm[0])
        high = np.maximum(self.used_mm[1], rows * self.cell_mm + stamp.size_mm[1])
        # The film used, then how far from the corner: ties go to the place nearest to it.
        used = wide * high + 1e-3 * (rows + columns)
        first = int(np.argmin(used))
        return float(used[first]), int(rows[first]), int(columns[first])

    def put(self, stamp: _Stamp, row: int, column: int) -> None:
        """Take the cells of a robot."""
        high, wide = stamp.cells.shape
        self.taken[row : row + high, column : column + wide] |= stamp.cells[
            : self.taken.shape[0] - row, : self.taken.shape[1] - column
        ]
        self.used_mm = (
            max(self.used_mm[0], column * self.cell_mm + stamp.size_mm[0]),
            max(self.used_mm[1], row * self.cell_mm + stamp.size_mm[1]),
        )


def nest(
    robots: Sequence[tuple[Contour, ...]], room_mm: tuple[float, float], corner_mm: float
) -> list[BedPlacement | None]:
    """Return where robots lie on the bed, None for those that find no room."""
    if len(robots) == 1:
        return [place_contours(robots[0], room_mm, corner_mm)]
    shapes = [_shape(contours) for contours in robots]
    rows = range(len(robots))
    # The largest first: small ones find room between its branches. Long ones first where that
    # leaves some without a place: what is nearly as long as the bed has few places.
    orders = (
        sorted(rows, key=lambda row: (-shapes[row].area, row)),
        sorted(rows, key=lambda row: (-_long_mm(shapes[row]), row)),
    )
    found: list[BedPlacement | None] = []
    for order in orders:
        tried = _nested(shapes, order, room_mm, corner_mm)
        if not found or _count(tried) > _count(found):
            found = tried
        if None not in found:
            break
    return found


def _nested(
    shapes: Sequence[shapely.Polygon],
    order: Sequence[int],
    room_mm: tuple[float, float],
    corner_mm: float,
) -> list[BedPlacement | None]:
    """Return where robots lie that are placed in an order."""
    bed = _Bed(room_mm)
    stamps: dict[bytes, list[_Stamp]] = {}
    found: list[BedPlacement | None] = [None] * len(shapes)
    for row in order:
        key = shapes[row].wkb
        if key not in stamps:
            turns = np.arange(TURNS) * math.tau / TURNS
            stamps[key] = [bed.stamp(shapes[row], turn) for turn in turns.tolist()]
        found[row] = _put(bed, stamps[key], corner_mm)
    return found


def _count(placements: Sequence[BedPlacement | None]) -> int:
    return sum(placement is not None for placement in placements)


def _long_mm(shape: shapely.Polygon) -> float:
    """Return the length of a robot: the longer side of the least box around it, turned freely."""
    x, y = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))[:3].T
    return float(np.hypot(np.diff(x), np.diff(y)).max())


def _put(bed: _Bed, stamps: list[_Stamp], corner_mm: float) -> BedPlacement | None:
    tries = [(best, stamp) for stamp in stamps if (best := bed.best(stamp)) is not None]
    if not tries:
        return None
    (_, row, column), stamp = min(tries, key=lambda found: found[0][0])
    bed.put(stamp, row, column)
    return BedPlacement(
        angle_rad=math.remainder(stamp.turn_rad, math.tau),
        dx_mm=corner_mm + column * bed.cell_mm - stamp.low_mm[0],
        dy_mm=corner_mm + row * bed.cell_mm - stamp.low_mm[1],
        width_mm=stamp.size_mm[0],
        height_mm=stamp.size_mm[1],
        fits=True,
    )


def _shape(contours: tuple[Contour, ...]) -> shapely.Polygon:
    """Return a robot with all its paths as one shape, a little too large."""
    lines = [_closed(contour) for contour in contours]
    body = shapely.Polygon(contours[0].flattened_mm(0.05))
    around = body if body.is_valid else body.convex_hull
    return shapely.union_all([around, *lines]).buffer(0.06, quad_segs=4)


def _closed(contour: Contour) -> shapely.LineString:
    points: Floats = contour.flattened_mm(0.05)
    return shapely.LineString(points)
