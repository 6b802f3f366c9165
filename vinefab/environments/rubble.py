"""The Rubble environment: a collapsed building, broken slabs of many sizes that lie one way."""

import math
from dataclasses import asdict, dataclass

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.environments.ground import DECIMALS, box, canonical
from vinefab.environments.pile import Pile, PileRules
from vinefab.environments.slabs import SlabKind, power_law, slab
from vinefab.environments.starts import all_zones, check_starts, lower_starts
from vinefab.model.checked import Floats, number, positive, whole
from vinefab.model.map import Map, Start

_STREAM = 1401
_MOST_SLABS = 4000
_HOPELESS = 12
"""So many slabs in a row without a place are proof enough that it is full."""
_SHORTFALL = 0.1
_NEAR = 0.03
_ROUNDS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class RubbleOptions:
    """What instances of one Rubble environment have in common.

    Parameters
    ----------
    size_mm
        Width and height of the bounds.
    cover
        Share of the bounds that slabs cover: at least nine tenths of this; the last slab put down
        may go beyond.
    slab_min_mm, slab_max_mm
        Range of a slab's length.
    exponent
        Lengths follow a power law: slabs twice as long are ``2 ** exponent`` times as rare.
    thickness_min, thickness_max
        Range of a slab's thickness, as a share of its length.
    raggedness
        0: slabs end straight; 1: ends are broken off at a slant.
    direction_deg
        Direction in which slabs lie, counter-clockwise from +x.
    direction_spread_deg
        Most that a slab lies off that; 90 is no preference.
    leaning
        Share, 0 to 1, of the slabs that lean on another or stick out of a side, where a place
        for that is found.
    passage_mm
        Width that stays passable: slabs that do not lean on each other are at least this apart.
        Only the corner between a slab and the one it leans on is narrower.
    starts
        Starting places, evenly spread along the lower side; one stands in its middle.
    start_clearance_mm
        Least distance from every possible starting position to walls.
    start_spread_x_mm, start_spread_y_mm, start_spread_heading_deg
        Half-widths of the ranges from which poses are drawn; the middle heading is straight up.

    Raises
    ------
    BadInputError
        If a value is out of range.
    """

    size_mm: float = 500.0
    cover: float = 0.28
    slab_min_mm: float = 14.0
    slab_max_mm: float = 170.0
    exponent: float = 1.5
    thickness_min: float = 0.18
    thickness_max: float = 0.6
    raggedness: float = 0.7
    direction_deg: float = 25.0
    direction_spread_deg: float = 30.0
    leaning: float = 0.35
    passage_mm: float = 18.0
    starts: int = 1
    start_clearance_mm: float = 15.0
    start_spread_x_mm: float = 10.0
    start_spread_y_mm: float = 0.0
    start_spread_heading_deg: float = 30.0

    def __post_init__(self) -> None:
        positive("size_mm", self.size_mm, 1e6)
        number("cover", self.cover, 0.0, 0.8)
        number("slab_min_mm", self.slab_min_mm, max(0.5, 2e-3 * self.size_mm), self.size_mm, "mm")
        number("slab_max_mm", self.slab_max_mm, self.slab_min_mm, 0.5 * self.size_mm, "mm")
        number("exponent", self.exponent, 0.0, 5.0)
        number("thickness_min", self.thickness_min, 0.05, 0.8)
        number("thickness_max", self.thickness_max, self.thickness_min, 0.8)
        for name in ("raggedness", "leaning"):
            number(name, getattr(self, name), 0.0, 1.0)
        number("direction_deg", self.direction_deg, -360.0, 360.0, "deg")
        number("direction_spread_deg", self.direction_spread_deg, 0.0, 90.0, "deg")
        positive("passage_mm", self.passage_mm, 0.2 * self.size_mm)
        whole("starts", self.starts, 1, 1000)
        check_starts(self, (self.size_mm, self.size_mm), self.starts, 0.5 * self.passage_mm)

    @property
    def slab_kind(self) -> SlabKind:
        """How its slabs look."""
        return SlabKind(
            thickness=(self.thickness_min, self.thickness_max),
            direction_rad=math.radians(self.direction_deg),
            direction_spread_rad=math.radians(self.direction_spread_deg),
            raggedness=self.raggedness,
        )


def rubble_map(seed: int, options: RubbleOptions | None = None) -> Map:
    """Make one instance of a Rubble environment.

    Slabs that lean on each other are one obstacle. A round body ``passage_mm`` wide can go from
    every possible starting position to everywhere it fits (why: see `vinefab.environments.pile`).

    Parameters
    ----------
    seed
        At least 0; the same seed and options give the same map on any machine, as far as GEOS
        finds the same distances and crossings of lines to 1e-4 mm.
    options
        What to make; the defaults when None.

    Returns
    -------
    Map
        ``environment`` is ``rubble``; ``facts`` hold the options, the number of slabs and the
        share of the bounds that they cover.

    Raises
    ------
    BadInputError
        If so much cover does not fit with such passages.

    Examples
    --------
    >>> rubble_map(2).free_space.geom_type
    'Polygon'
    """
    options = options or RubbleOptions()
    whole("seed", seed, 0, 2**63 - 1)
    starts = lower_starts(options, options.size_mm, options.starts, 0.5 * options.passage_mm)
    pile = _pile(child(seed, _STREAM), options, starts)
    obstacles = canonical(_solid(pile, options))
    covered = sum(polygon.area for polygon in obstacles) / options.size_mm**2
    if covered < (1.0 - _SHORTFALL) * options.cover:
        raise BadInputError(
            "cover", options.cover, f"at most about {covered:.2f} with such slabs and passages"
        )
    facts = {"slabs": len(pile.polygons), "covered": round(covered, 4)}
    return Map(
        name=f"rubble_{seed}",
        bounds=box(options.size_mm, options.size_mm),
        obstacles=obstacles,
        starts=starts,
        environment="rubble",
        seed=seed,
        facts={**asdict(options), **facts},
    )


def _solid(pile: Pile, options: RubbleOptions) -> BaseGeometry:
    """Return the slabs as far as they lie within the bounds; those that lean are one piece."""
    grid_mm = 10.0**-DECIMALS
    slabs = shapely.union_all(pile.polygons, grid_size=grid_mm)
    bounds = box(options.size_mm, options.size_mm)
    return shapely.intersection(slabs, bounds, grid_size=grid_mm)


def _pile(rng: np.random.Generator, options: RubbleOptions, starts: tuple[Start, ...]) -> Pile:
    """Return slabs put down as far as there is room.

    More follow where much is lost to overlaps and to what sticks out of the sides.
    """
    rules = PileRules(
        size_mm=options.size_mm,
        passage_mm=options.passage_mm,
        keep_out=all_zones(starts),
        keep_out_mm=max(options.start_clearance_mm, options.passage_mm),
    )
    pile, wanted_mm2 = Pile(rules), options.cover * options.size_mm**2
    for _ in range(_ROUNDS):
        missing_mm2 = wanted_mm2 - _solid(pile, options).area
        if missing_mm2 <= _NEAR * wanted_mm2 or not _put_down(rng, pile, missing_mm2, options):
            break
    return pile


def _put_down(
    rng: np.random.Generator, pile: Pile, area_mm2: float, options: RubbleOptions
) -> bool:
    """Add slabs from the largest to the smallest; return whether there may be room for more."""
    misses = 0
    for corners in _slabs(rng, area_mm2, options):
        found = pile.add(rng, corners, leaning=bool(rng.random() < options.leaning))
        misses = 0 if found else misses + 1
        if misses == _HOPELESS:
            return False
    return True


def _slabs(rng: np.random.Generator, missing_mm2: float, options: RubbleOptions) -> list[Floats]:
    """Return slabs that together have this area, the largest first."""
    limits = options.slab_min_mm, options.slab_max_mm
    slabs: list[Floats] = []
    areas_mm2: list[float] = []
    while missing_mm2 > 0.0:
        length_mm = power_law(rng, limits, options.exponent)
        slabs.append(slab(rng, length_mm, options.slab_kind))
        areas_mm2.append(Polygon(slabs[-1]).area)
        missing_mm2 -= areas_mm2[-1]
        if len(slabs) > _MOST_SLABS:
            raise BadInputError(
                "slab_min_mm", options.slab_min_mm, f"more: below {_MOST_SLABS} slabs cover so much"
            )
    order = np.argsort(-np.array(areas_mm2), kind="stable")
    return [slabs[index] for index in order.tolist()]
