"""The Pegs environment: a peg board for the bench, round pegs in some holes of a lattice."""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import number, positive, whole
from vinefab.maps.generators.generated_map import (
    SeveralStartOptions,
    box,
    check_seed,
    check_shares,
    directions,
    generated_map,
    rounded,
    start_zones,
)
from vinefab.model.map import Map, Start

_STREAM = 1501
_LATTICES = ("square", "hexagonal")


@dataclass(frozen=True, slots=True, kw_only=True)
class PegsOptions(SeveralStartOptions):
    """Options that instances of one Pegs environment share: the board and how it is filled.

    Parameters
    ----------
    lattice
        ``square``, or ``hexagonal``: every second row has one hole less and stands half a pitch
        to the side.
    columns, rows
        Holes in the lowest row, and rows.
    pitch_mm
        Distance between neighbouring holes.
    edge_mm
        Distance from the outer holes to the sides of the board.
    diameter_mm
        A peg's diameter; a peg is a regular polygon with its corners on this circle.
    sides
        A peg's number of sides.
    filled
        Share, 0 to 1, of the holes that hold a peg, of those that the starts leave free.
    jitter_mm
        Pegs stand off their holes by at most this, in any direction.
    start_clearance_mm
        Least distance from every possible starting position to pegs and sides; holes where a peg
        would stand nearer stay empty.

    Raises
    ------
    BadInputError
        If a value is out of range, pegs would touch each other or the sides, or the starting
        places do not fit.
    """

    lattice: str = "square"
    columns: int = 12
    rows: int = 12
    pitch_mm: float = 40.0
    edge_mm: float = 30.0
    diameter_mm: float = 14.0
    sides: int = 16
    filled: float = 0.45
    jitter_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.lattice not in _LATTICES:
            raise BadInputError("lattice", self.lattice, " or ".join(_LATTICES))
        whole("columns", self.columns, 1, 1000)
        whole("rows", self.rows, 1, 1000)
        positive("pitch_mm", self.pitch_mm, 1e4)
        positive("diameter_mm", self.diameter_mm, self.pitch_mm)
        whole("sides", self.sides, 3, 100)
        if self.diameter_mm < 0.02 * self.sides:
            raise BadInputError("diameter_mm", self.diameter_mm, f"at least {0.02 * self.sides:g}")
        check_shares(self, "filled")
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
    return generated_map(
        "pegs",
        seed,
        options,
        bounds=box(*options.size_mm),
        obstacles=_pegs(child(seed, _STREAM), options, starts),
        starts=starts,
    )


def _pegs(
    rng: np.random.Generator, options: PegsOptions, starts: tuple[Start, ...]
) -> tuple[Polygon, ...]:
    rows = []
    for row in range(options.rows):
        odd = options.lattice == "hexagonal" and row % 2 == 1
        x_mm = (np.arange(options.columns - odd) + 0.5 * odd) * options.pitch_mm
        rows.append(np.column_stack([x_mm, np.full(len(x_mm), row * options.row_pitch_mm)]))
    holes_mm = options.edge_mm + np.concatenate(rows)
    # Drawn for every hole, used or not, so that more pegs do not move the others.
    order, far, way = rng.random((3, len(holes_mm)))
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
    corners_mm = rounded(middles_mm[chosen, None] + peg_mm)
    return tuple(Polygon(corners) for corners in corners_mm)
