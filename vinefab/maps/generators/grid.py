"""The Grid environment: a high number of convex polygons, one per cell of a regular grid.

The paper (section 2.2.1) describes the environment but does not publish its generator; this one
is vinefab's own.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Annotated

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from numpy.typing import NDArray
from pydantic import model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints, number, whole
from vinefab.maps.generators.generated_map import (
    Length,
    SeveralStartOptions,
    Share,
    box,
    check_seed,
    directions,
    generated_map,
    rounded_points,
    start_zones,
)
from vinefab.model.map import Map

_STREAM = 1101
_DEEPEST = 0.8


class GridOptions(SeveralStartOptions):
    """Options that instances of one Grid environment share."""

    size_mm: Annotated[
        Length, Doc("width of the bounds; cells are square, so it also gives the height")
    ] = 500.0
    columns: Annotated[int, Ge(1), Le(1000), Doc("cells side by side; each holds one obstacle")] = 6
    rows: Annotated[int, Ge(1), Le(1000), Doc("rows of cells")] = 6
    filled: Annotated[
        Share, Doc("share of the cells that hold an obstacle; each cell is drawn by itself")
    ] = 1.0
    corners_min: Annotated[int, Ge(3), Le(100), Doc("least corners of an obstacle")] = 4
    corners_max: Annotated[int, Ge(3), Le(100), Doc("most corners of an obstacle")] = 7
    radius_min: Annotated[
        float, Ge(0.01), Le(0.5), Doc("least circumscribed radius, as a share of the cell's width")
    ] = 0.28
    radius_max: Annotated[float, Ge(0.01), Le(0.5), Doc("largest one, likewise")] = 0.38
    irregularity: Annotated[
        Share, Doc("0: corners evenly spaced around the circle; 1: any two may nearly meet")
    ] = 0.5
    concavity: Annotated[
        Share,
        Doc(
            "0: obstacles are convex; above, up to 1: corners of those with four or more are drawn "
            "towards the middle, each by a random share up to 0.8 of this"
        ),
    ] = 0.0
    jitter: Annotated[
        Share, Doc("share of the room left in its cell that an obstacle may be off the middle")
    ] = 0.8
    gap_mm: Annotated[
        float,
        Ge(0),
        Le(1e6),
        Unit("mm"),
        Doc("least distance between two obstacles; half of it is kept to the bounds"),
    ] = 8.0

    @model_validator(mode="after")
    def _fits(self) -> "GridOptions":
        whole("corners_max", self.corners_max, self.corners_min, 100)
        number("radius_max", self.radius_max, self.radius_min, 0.5)
        least_radius_mm = 0.01  # per corner: below, decimals would merge corners
        if self.cell_mm * self.radius_min < least_radius_mm * self.corners_max:
            least_mm = least_radius_mm * self.corners_max * self.columns / self.radius_min
            raise BadInputError(
                "size_mm", self.size_mm, f"at least {least_mm:.4g} for such corners"
            )
        most_mm = self.cell_mm * (1.0 - 2.0 * self.radius_max)
        number("gap_mm", self.gap_mm, 0.0, most_mm, f"mm (radius_max leaves {most_mm:.4g})")
        self.check_starts((self.size_mm, self.height_mm))
        return self

    @property
    def cell_mm(self) -> float:
        """Width and height of one cell."""
        return self.size_mm / self.columns

    @property
    def height_mm(self) -> float:
        """Height of the bounds."""
        return self.cell_mm * self.rows

    @property
    def passage_mm(self) -> float:
        """Diameter of a round body that gets everywhere: half the gap, as kept to the sides."""
        return 0.5 * self.gap_mm


def grid_map(seed: int, options: GridOptions | None = None) -> Map:
    """Generate one instance of a Grid environment.

    Obstacles are valid polygons, convex unless ``concavity`` is set, at least ``gap_mm`` apart, so
    the free space is connected; every possible starting position has ``start_clearance_mm`` to
    all walls. An obstacle that would stand too close to a start is drawn again, and left out if
    that does not help (``facts["left_out"]`` counts these).

    Examples
    --------
    >>> world = grid_map(7)
    >>> len(world.obstacles), world.size_mm
    (36, (500.0, 500.0))
    """
    options = options or GridOptions()
    check_seed(seed)
    starts = options.lower_starts(options.size_mm)
    cells = [(column, row) for row in range(options.rows) for column in range(options.columns)]
    if options.filled < 1.0:
        draws = [child(seed, _STREAM, row, column, 2).random() for column, row in cells]
        cells = [cell for cell, draw in zip(cells, draws, strict=True) if draw < options.filled]
    drawn = _polygons([next(_draws(seed, cell, options)) for cell in cells], cells, options)
    keep_out = start_zones(starts)
    draws_per_cell = 60
    for index in np.flatnonzero(shapely.distance(drawn, keep_out) < options.start_clearance_mm):
        again = islice(_draws(seed, cells[index], options), 1, draws_per_cell)
        tries = (_polygons([numbers], [cells[index]], options)[0] for numbers in again)
        clear = (
            one for one in tries if shapely.distance(one, keep_out) >= options.start_clearance_mm
        )
        drawn[index] = next(clear, None)
    obstacles = [polygon for polygon in drawn.tolist() if polygon is not None]
    return generated_map(
        "grid",
        seed,
        options,
        bounds=box(options.size_mm, options.height_mm),
        obstacles=obstacles,
        starts=starts,
        left_out=len(cells) - len(obstacles),
    )


_Cell = tuple[int, int]
"""Column and row."""


def _draws(seed: int, cell: _Cell, options: GridOptions) -> Iterator[Floats]:
    """Yield the random numbers, 0 to 1, of one obstacle after another for the same cell.

    They are a radius, an offset of the angle of each corner, a turn, an offset of the middle in x
    and y, and for concave obstacles a pull for each corner.
    """
    rng = child(seed, _STREAM, cell[1], cell[0])
    pulls = child(seed, _STREAM, cell[1], cell[0], 1) if options.concavity > 0.0 else None
    while True:
        count = int(rng.integers(options.corners_min, options.corners_max + 1))
        numbers = rng.random(count + 4)
        yield numbers if pulls is None else np.concatenate([numbers, pulls.random(count)])


def _polygons(
    draws: Sequence[Floats], cells: Sequence[_Cell], options: GridOptions
) -> NDArray[np.object_]:
    """Return a polygon for each cell, made from its random numbers."""
    polygons = np.empty(len(draws), dtype=object)
    lengths, places = np.array([len(numbers) for numbers in draws], dtype=int), np.array(cells)
    for length in np.unique(lengths):
        same = np.flatnonzero(lengths == length)
        numbers = np.array([draws[index] for index in same.tolist()])
        polygons[same] = shapely.polygons(_corners(numbers, places[same], options))
    return polygons


def _corners(numbers: Floats, cells: Ints, options: GridOptions) -> Floats:
    """Return corners on a circle, shape (n, corners, 2): strictly convex for any angles."""
    rows, length = numbers.shape
    count = (length - 4) // (1 if options.concavity == 0.0 else 2)
    span = options.radius_max - options.radius_min
    radius_mm = options.cell_mm * (options.radius_min + span * numbers[:, 0])
    # 0.9: below 1, so that adjacent corners never coincide.
    wander = 0.9 * options.irregularity * (numbers[:, 1 : count + 1] - 0.5)
    turn = numbers[:, count + 1, None]
    angles_rad = 2.0 * math.pi * (turn + (np.arange(count) + wander) / count)
    room_mm = np.maximum(0.0, 0.5 * (options.cell_mm - options.gap_mm) - radius_mm)
    way = 2.0 * numbers[:, count + 2 : count + 4] - 1.0
    middle_mm = (cells + 0.5) * options.cell_mm + options.jitter * room_mm[:, None] * way
    far_mm = np.repeat(radius_mm[:, None], count, axis=1)
    # With four corners none is more than half a turn from the next, so any pull is possible.
    if count > 3 and length > count + 4:
        far_mm *= 1.0 - _DEEPEST * options.concavity * numbers[:, count + 4 :]
    round_mm = far_mm[:, :, None] * directions(angles_rad)
    return rounded_points(middle_mm[:, None] + round_mm).reshape(rows, count, 2)
