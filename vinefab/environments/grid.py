"""The Grid environment: a high number of convex polygons, one per cell of a regular grid.

The paper (section 2.2.1) describes the environment but does not publish its generator; this one
is vinefab's own.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.environments.ground import box, rounded, start_zone, upward_start
from vinefab.model.checked import number, positive, whole
from vinefab.model.map import Map, Start

_STREAM = 1101
_DRAWS_PER_CELL = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class GridOptions:
    """What instances of one Grid environment have in common.

    Parameters
    ----------
    size_mm
        Width of the bounds. Cells are square, so the height is ``size_mm * rows / columns``.
    columns, rows
        Cells; each holds one obstacle.
    corners_min, corners_max
        Range of an obstacle's number of corners, both ends possible.
    radius_min, radius_max
        Range of an obstacle's circumscribed radius, as a share of the cell's width.
    irregularity
        0: corners evenly spaced around the circle; 1: any two may nearly meet.
    jitter
        Share, 0 to 1, of the room left in its cell that an obstacle may be off the middle.
    gap_mm
        Least distance between two obstacles; half of it is kept to the bounds.
    starts
        Starting places, evenly spread along the lower side; one stands in its middle.
    start_clearance_mm
        Least distance from every possible starting position to obstacles and bounds.
    start_spread_x_mm, start_spread_y_mm, start_spread_heading_deg
        Half-widths of the ranges from which poses are drawn; the middle heading is straight up.

    Raises
    ------
    BadInputError
        If a value is out of range, the obstacles do not fit in their cells with the gap, or the
        starting places do not fit between the sides.
    """

    size_mm: float = 500.0
    columns: int = 6
    rows: int = 6
    corners_min: int = 4
    corners_max: int = 7
    radius_min: float = 0.28
    radius_max: float = 0.38
    irregularity: float = 0.5
    jitter: float = 0.8
    gap_mm: float = 8.0
    starts: int = 1
    start_clearance_mm: float = 15.0
    start_spread_x_mm: float = 10.0
    start_spread_y_mm: float = 0.0
    start_spread_heading_deg: float = 30.0

    def __post_init__(self) -> None:
        self._check_obstacles()
        self._check_starts()

    @property
    def cell_mm(self) -> float:
        """Width and height of one cell."""
        return self.size_mm / self.columns

    @property
    def height_mm(self) -> float:
        """Height of the bounds."""
        return self.cell_mm * self.rows

    def _check_obstacles(self) -> None:
        positive("size_mm", self.size_mm, 1e6)
        whole("columns", self.columns, 1, 1000)
        whole("rows", self.rows, 1, 1000)
        whole("corners_min", self.corners_min, 3, 100)
        whole("corners_max", self.corners_max, self.corners_min, 100)
        number("radius_min", self.radius_min, 0.01, 0.5)
        number("radius_max", self.radius_max, self.radius_min, 0.5)
        number("irregularity", self.irregularity, 0.0, 1.0)
        number("jitter", self.jitter, 0.0, 1.0)
        most_mm = self.cell_mm * (1.0 - 2.0 * self.radius_max)
        number("gap_mm", self.gap_mm, 0.0, most_mm, f"mm (radius_max leaves {most_mm:.4g})")

    def _check_starts(self) -> None:
        whole("starts", self.starts, 1, 1000)
        number("start_clearance_mm", self.start_clearance_mm, 0.0, self.size_mm, "mm")
        number("start_spread_x_mm", self.start_spread_x_mm, 0.0, self.size_mm, "mm")
        number("start_spread_y_mm", self.start_spread_y_mm, 0.0, self.size_mm, "mm")
        number("start_spread_heading_deg", self.start_spread_heading_deg, 0.0, 180.0, "deg")
        half_x_mm = self.start_spread_x_mm + self.start_clearance_mm
        high_mm = 2.0 * (self.start_spread_y_mm + self.start_clearance_mm)
        if 2.0 * half_x_mm > self.size_mm / self.starts or high_mm > self.height_mm:
            raise BadInputError(
                "start_clearance_mm",
                self.start_clearance_mm,
                "so much that the starting places, with their spreads, fit between the sides",
            )


def grid_map(seed: int, options: GridOptions | None = None) -> Map:
    """Make one instance of a Grid environment.

    Obstacles are valid convex polygons at least ``gap_mm`` apart, so the free space is connected;
    every possible starting position has ``start_clearance_mm`` to all walls. An obstacle that
    would stand too close to a start is drawn again, and left out if that does not help
    (``facts["left_out"]`` counts these).

    Parameters
    ----------
    seed
        At least 0; the same seed and options give the same map on any machine.
    options
        What to make; the defaults when None.

    Returns
    -------
    Map
        ``environment`` is ``grid``; ``facts`` hold the options.

    Examples
    --------
    >>> world = grid_map(7)
    >>> len(world.obstacles), world.size_mm
    (36, (500.0, 500.0))
    """
    options = options or GridOptions()
    whole("seed", seed, 0, 2**63 - 1)
    starts = _starts(options)
    keep_out = shapely.union_all([start_zone(start) for start in starts])
    drawn = [
        _obstacle(child(seed, _STREAM, row, column), (column, row), options, keep_out)
        for row in range(options.rows)
        for column in range(options.columns)
    ]
    obstacles = tuple(polygon for polygon in drawn if polygon is not None)
    return Map(
        name=f"grid_{seed}",
        bounds=box(options.size_mm, options.height_mm),
        obstacles=obstacles,
        starts=starts,
        environment="grid",
        seed=seed,
        facts={**asdict(options), "left_out": len(drawn) - len(obstacles)},
    )


def _starts(options: GridOptions) -> tuple[Start, ...]:
    spreads = (
        options.start_spread_x_mm,
        options.start_spread_y_mm,
        math.radians(options.start_spread_heading_deg),
    )
    y_mm = options.start_clearance_mm + options.start_spread_y_mm
    pitch_mm = options.size_mm / options.starts
    return tuple(
        upward_start((index + 0.5) * pitch_mm, y_mm, spreads) for index in range(options.starts)
    )


def _obstacle(
    rng: np.random.Generator,
    cell: tuple[int, int],
    options: GridOptions,
    keep_out: BaseGeometry,
) -> Polygon | None:
    """Draw the obstacle of one cell (column, row); None if the start leaves no room for one."""
    for _ in range(_DRAWS_PER_CELL):
        polygon = _convex_polygon(rng, cell, options)
        if shapely.distance(polygon, keep_out) >= options.start_clearance_mm:
            return polygon
    return None


def _convex_polygon(
    rng: np.random.Generator, cell: tuple[int, int], options: GridOptions
) -> Polygon:
    """Draw a polygon with its corners on a circle: strictly convex whatever the angles are."""
    count = int(rng.integers(options.corners_min, options.corners_max + 1))
    radius_mm = options.cell_mm * rng.uniform(options.radius_min, options.radius_max)
    # 0.9: below 1, so that neighbouring corners never meet.
    wander = 0.9 * options.irregularity * rng.uniform(-0.5, 0.5, count)
    angles_rad = 2.0 * math.pi * (rng.uniform() + (np.arange(count) + wander) / count)
    room_mm = max(0.0, 0.5 * (options.cell_mm - options.gap_mm) - radius_mm)
    off_mm = options.jitter * room_mm * rng.uniform(-1.0, 1.0, 2)
    middle_mm = (np.array(cell) + 0.5) * options.cell_mm + off_mm
    round_mm = radius_mm * np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
    return Polygon(rounded(middle_mm + round_mm))
