"""The Pegs environment: a peg board for the bench, round pegs in some holes of a lattice."""

import math
from typing import Annotated, Literal

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from pydantic import model_validator
from shapely import Polygon
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import SMALLEST, number, positive
from vinefab.maps.generators.generated_map import (
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

_STREAM = 1501


class PegsOptions(SeveralStartOptions):
    """Options that instances of one Pegs environment share: the board and how it is filled.

    Holes where a peg would stand nearer to a start than its clearance stay empty.
    """

    lattice: Annotated[
        Literal["square", "hexagonal"],
        Doc("hexagonal: every second row has one hole less and stands half a pitch to the side"),
    ] = "square"
    columns: Annotated[int, Ge(1), Le(1000), Doc("holes in the lowest row")] = 12
    rows: Annotated[int, Ge(1), Le(1000), Doc("rows of holes")] = 12
    pitch_mm: Annotated[
        float, Ge(SMALLEST), Le(1e4), Unit("mm"), Doc("distance between neighbouring holes")
    ] = 40.0
    edge_mm: Annotated[
        float, Ge(0), Le(1e4), Unit("mm"), Doc("from the outer holes to the sides of the board")
    ] = 30.0
    diameter_mm: Annotated[
        float,
        Ge(SMALLEST),
        Le(1e4),
        Unit("mm"),
        Doc("of pegs: regular polygons with their corners on a circle of this size"),
    ] = 14.0
    sides: Annotated[int, Ge(3), Le(100), Doc("corners of a peg")] = 16
    filled: Annotated[
        Share, Doc("share of the holes that hold a peg, of those that the starts leave free")
    ] = 0.45
    jitter_mm: Annotated[
        float, Ge(0), Le(1e4), Unit("mm"), Doc("most that pegs stand off their holes, anywhere")
    ] = 0.0

    @model_validator(mode="after")
    def _fits(self) -> "PegsOptions":
        positive("diameter_mm", self.diameter_mm, self.pitch_mm)
        if self.diameter_mm < 0.02 * self.sides:
            raise BadInputError("diameter_mm", self.diameter_mm, f"at least {0.02 * self.sides:g}")
        most_mm = 0.5 * (self.pitch_mm - self.diameter_mm)
        number("jitter_mm", self.jitter_mm, 0.0, most_mm, f"mm (the pitch leaves {most_mm:.4g})")
        least_mm = 0.5 * self.diameter_mm + self.jitter_mm
        number("edge_mm", self.edge_mm, least_mm, 1e4, "mm")
        if self.passage_mm <= 0.01:
            raise BadInputError(
                "diameter_mm",
                self.diameter_mm,
                "less, so that pegs touch neither each other nor the sides",
            )
        self.check_starts(self.size_mm)
        return self

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the board."""
        width_mm = (self.columns - 1) * self.pitch_mm + 2.0 * self.edge_mm
        return width_mm, (self.rows - 1) * self.row_pitch_mm + 2.0 * self.edge_mm

    @property
    def row_pitch_mm(self) -> float:
        """Distance between rows."""
        return self.pitch_mm * (1.0 if self.lattice == "square" else math.sqrt(0.75))

    @property
    def passage_mm(self) -> float:
        """Least distance between two pegs, and between a peg and a side, to 1e-4 mm."""
        reach_mm = 0.5 * self.diameter_mm + self.jitter_mm
        return min(self.pitch_mm - 2.0 * reach_mm, self.edge_mm - reach_mm)


def pegs_map(seed: int, options: PegsOptions | None = None) -> Map:
    """Generate one instance of a Pegs environment.

    Pegs keep `PegsOptions.passage_mm` to each other and to the sides, so the free space is
    connected; every possible starting position has ``start_clearance_mm`` to all walls.

    Examples
    --------
    >>> pegs_map(0).size_mm
    (500.0, 500.0)
    """
    options = options or PegsOptions()
    check_seed(seed)
    starts = options.lower_starts(options.size_mm[0])
    rows = []
    for row in range(options.rows):
        odd = options.lattice == "hexagonal" and row % 2 == 1
        x_mm = (np.arange(options.columns - odd) + 0.5 * odd) * options.pitch_mm
        rows.append(np.column_stack([x_mm, np.full(len(x_mm), row * options.row_pitch_mm)]))
    holes_mm = options.edge_mm + np.concatenate(rows)
    # Drawn for every hole, used or not, so that more pegs do not move the others.
    order, far, way = child(seed, _STREAM).random((3, len(holes_mm)))
    angle_rad = 2.0 * math.pi * way
    off_mm = (options.jitter_mm * np.sqrt(far))[:, None] * directions(angle_rad)
    middles_mm = holes_mm + off_mm
    near_mm = options.start_clearance_mm + 0.5 * options.diameter_mm
    away_mm = shapely.distance(shapely.points(middles_mm), start_zones(starts))
    possible = np.flatnonzero(away_mm >= near_mm)
    count = round(options.filled * len(possible))
    chosen = np.sort(possible[np.argsort(order[possible], kind="stable")[:count]])
    # Turned by half a step: flat sides face along the axes.
    angles_rad = 2.0 * math.pi * (np.arange(options.sides) + 0.5) / options.sides
    peg_mm = 0.5 * options.diameter_mm * directions(angles_rad)
    corners_mm = rounded_points(middles_mm[chosen, None] + peg_mm)
    return generated_map(
        "pegs",
        seed,
        options,
        bounds=box(*options.size_mm),
        obstacles=[Polygon(corners) for corners in corners_mm],
        starts=starts,
    )
