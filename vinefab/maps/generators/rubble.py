"""The Rubble environment: a collapsed building, broken slabs of many sizes that lie one way."""

import math
from typing import Annotated

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from numpy.typing import NDArray
from pydantic import model_validator
from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import Floats, number, positive
from vinefab.maps.generators.generated_map import (
    COORDINATE_GRID_MM,
    Length,
    SeveralStartOptions,
    Share,
    box,
    canonical,
    check_seed,
    generated_map,
    start_zones,
)
from vinefab.model.map import Map, Start

_DEEPEST = 0.35


class RubbleOptions(SeveralStartOptions):
    """Options that instances of one Rubble environment share."""

    size_mm: Annotated[Length, Doc("width and height of the bounds")] = 500.0
    cover: Annotated[
        float,
        Ge(0),
        Le(0.8),
        Doc(
            "share of the bounds that slabs cover: at least nine tenths of this; the last slab may "
            "go beyond"
        ),
    ] = 0.28
    slab_min_mm: Annotated[Length, Doc("least length of a slab")] = 14.0
    slab_max_mm: Annotated[Length, Doc("largest length of a slab")] = 170.0
    exponent: Annotated[
        float,
        Ge(0),
        Le(5),
        Doc("of lengths: slabs twice as long are `2 ** exponent` times as rare"),
    ] = 1.5
    thickness_min: Annotated[
        float, Ge(0.05), Le(0.8), Doc("least thickness of a slab, as a share of its length")
    ] = 0.18
    thickness_max: Annotated[float, Ge(0.05), Le(0.8), Doc("largest one, likewise")] = 0.6
    raggedness: Annotated[
        Share, Doc("0: slabs end straight; 1: ends are broken off at a slant")
    ] = 0.7
    direction_deg: Annotated[
        float,
        Ge(-360),
        Le(360),
        Unit("deg"),
        Doc("in which slabs lie, counter-clockwise from +x"),
    ] = 25.0
    direction_spread_deg: Annotated[
        float, Ge(0), Le(90), Unit("deg"), Doc("most that a slab lies off that; 90: no preference")
    ] = 30.0
    leaning: Annotated[
        Share,
        Doc(
            "share of the slabs that lean on another or stick out of a side, where a place for "
            "that is found"
        ),
    ] = 0.35
    passage_mm: Annotated[
        Length,
        Doc(
            "width that stays passable: slabs that do not lean on each other are at least this "
            "apart; only the corner between a slab and the one it leans on is narrower"
        ),
    ] = 18.0

    @model_validator(mode="after")
    def _fits(self) -> "RubbleOptions":
        number("slab_min_mm", self.slab_min_mm, max(0.5, 2e-3 * self.size_mm), self.size_mm, "mm")
        number("slab_max_mm", self.slab_max_mm, self.slab_min_mm, 0.5 * self.size_mm, "mm")
        number("thickness_max", self.thickness_max, self.thickness_min, 0.8)
        positive("passage_mm", self.passage_mm, 0.2 * self.size_mm)
        self.check_starts((self.size_mm, self.size_mm), 0.5 * self.passage_mm)
        return self


def power_law(rng: np.random.Generator, limits: tuple[float, float], exponent: float) -> float:
    """Draw a length from a power law between limits."""
    low, high = limits
    share = rng.random()
    power = 1.0 - exponent
    if abs(power) < 1e-9:
        return float(low * (high / low) ** share)
    return float((low**power + share * (high**power - low**power)) ** (1.0 / power))


def slab(rng: np.random.Generator, length_mm: float, options: RubbleOptions) -> Floats:
    """Return the corners of a slab around the origin: strictly convex, counter-clockwise.

    It is a tapered bar with a broken end at both sides: six corners, four if not ragged.
    """
    low, high = options.thickness_min, options.thickness_max
    thick_mm = length_mm * (low + (high - low) * rng.random())
    ends = [_end(rng, thick_mm, options.raggedness) for _ in range(2)]
    right = np.array([0.5 * length_mm, 0.0]) + ends[0]
    left = -(np.array([0.5 * length_mm, 0.0]) + ends[1])
    spread_rad = math.radians(options.direction_spread_deg)
    turn = math.radians(options.direction_deg) + spread_rad * (2.0 * rng.random() - 1.0)
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(np.concatenate([right, left]) @ turned)


def _end(rng: np.random.Generator, thick_mm: float, raggedness: float) -> Floats:
    """Return the corners of a right end, from below, relative to the middle of a straight one."""
    taper = 0.2
    half_mm = 0.5 * thick_mm * (1.0 - taper * rng.random())
    back_low, back_high, tip = rng.random(3)
    if raggedness == 0.0:
        return np.array([(0.0, -half_mm), (0.0, half_mm)])
    # Above 0, so that the tip stays a corner.
    deep_mm = _DEEPEST * raggedness * thick_mm * (0.1 + 0.9 * np.array([back_low, back_high]))
    return np.array([(-deep_mm[0], -half_mm), (0.0, half_mm * (tip - 0.5)), (-deep_mm[1], half_mm)])


def way_to_contact(mover: Floats, host: Floats, way: Floats) -> float:
    """Return the distance that a convex polygon can move until a contact; infinity if never.

    Parameters
    ----------
    mover, host
        Corners, shape (n, 2); apart from each other.
    """
    ahead = _shortest_way(mover, host, way)
    return min(ahead, _shortest_way(host, mover, -way))


def _shortest_way(points: Floats, corners: Floats, way: Floats) -> float:
    """Return the shortest distance along ``way`` from any point to any edge."""
    edges = np.roll(corners, -1, axis=0) - corners
    from_points = corners - points[:, None]
    slope = way[0] * edges[:, 1] - way[1] * edges[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (from_points[..., 0] * edges[:, 1] - from_points[..., 1] * edges[:, 0]) / slope
        place = (from_points[..., 0] * way[1] - from_points[..., 1] * way[0]) / slope
    meets = (slope != 0.0) & (far >= 0.0) & (place >= 0.0) & (place <= 1.0)
    return float(np.where(meets, far, np.inf).min())


_TRIES = 150
_SIDES = 4
_BITE = 0.15
"""Depth by which a leaning slab overlaps its host, as a share of the root of its area."""


class Pile:
    """Placed slabs, with a search for room for more."""

    def __init__(self, options: RubbleOptions, keep_out: BaseGeometry) -> None:
        self.options, self.keep_out = options, keep_out
        self.keep_out_mm = max(options.start_clearance_mm, options.passage_mm)
        self._count = 0
        self._corners_mm: list[Floats] = []
        self._polygons: NDArray[np.object_] = np.empty(64, dtype=object)
        self._middles_mm = np.zeros((64, 2))
        self._radii_mm = np.zeros(64)

    @property
    def polygons(self) -> NDArray[np.object_]:
        """The slabs, in the order of their placement; some overlap, some cross the bounds."""
        return self._polygons[: self._count]

    def add(self, rng: np.random.Generator, slab_mm: Floats, *, leaning: bool) -> bool:
        """Place a slab where there is room; return whether there is."""
        for lean in (True, False) if leaning else (False,):
            for _ in range(_TRIES):
                host, off_mm = self._draw_place(rng, slab_mm, lean=lean)
                if off_mm is not None and self._place_at(slab_mm + off_mm, host):
                    return True
        return False

    def _draw_place(
        self, rng: np.random.Generator, slab_mm: Floats, *, lean: bool
    ) -> tuple[int, Floats | None]:
        """Draw a host and an offset; hosts -4 .. -1 are the sides, -5 is none."""
        if not lean:
            return -_SIDES - 1, self._amid(rng, slab_mm)
        host = int(rng.integers(-_SIDES, self._count))
        deepest_in_side = 0.4
        if host < 0:
            side = host + _SIDES  # 0 and 2: left and right
            off_mm = self._amid(rng, slab_mm)
            axis = side % 2
            low, high = float(slab_mm[:, axis].min()), float(slab_mm[:, axis].max())
            deep_mm = (high - low) * (0.05 + (deepest_in_side - 0.05) * rng.random())
            off_mm[axis] = -low - deep_mm if side < 2 else self.options.size_mm - high + deep_mm
            return host, off_mm
        return host, self._on_slab(rng, slab_mm, host)

    def _amid(self, rng: np.random.Generator, slab_mm: Floats) -> Floats:
        low = self.options.passage_mm - slab_mm.min(axis=0)
        high = self.options.size_mm - self.options.passage_mm - slab_mm.max(axis=0)
        return np.asarray(low + rng.random(2) * (high - low))

    def _on_slab(self, rng: np.random.Generator, slab_mm: Floats, host: int) -> Floats | None:
        """Return an offset that slides a slab against another until they overlap slightly."""
        turn = 2.0 * math.pi * rng.random()
        way = np.array([math.cos(turn), math.sin(turn)])
        aside = self._radii_mm[host] * (2.0 * rng.random() - 1.0) * np.array([-way[1], way[0]])
        far_mm = self._radii_mm[host] + _radius(slab_mm) + 1.0
        begin_mm = self._middles_mm[host] + aside - far_mm * way
        contact_mm = way_to_contact(slab_mm + begin_mm, self._corners_mm[host], way)
        if not math.isfinite(contact_mm):
            return None
        bite_mm = _BITE * math.sqrt(Polygon(slab_mm).area)
        return np.asarray(begin_mm + (contact_mm + bite_mm) * way)

    def _place_at(self, slab_mm: Floats, host: int) -> bool:
        """Place a slab if it touches nothing but its host; return whether it does."""
        polygon = Polygon(slab_mm)
        gaps_mm = np.concatenate([slab_mm.min(axis=0), self.options.size_mm - slab_mm.max(axis=0)])
        if -_SIDES <= host < 0:
            gaps_mm[host + _SIDES] = np.inf
        if (gaps_mm < self.options.passage_mm - 1e-9).any():
            return False
        middle_mm = slab_mm.mean(axis=0)
        radius_mm = _radius(slab_mm - middle_mm)
        away_mm = np.hypot(*(self._middles_mm[: self._count] - middle_mm).T)
        near = away_mm < self._radii_mm[: self._count] + radius_mm + self.options.passage_mm
        if host >= 0:
            near[host] = False
        if (shapely.distance(self.polygons[near], polygon) < self.options.passage_mm).any():
            return False
        if shapely.distance(polygon, self.keep_out) < self.keep_out_mm:
            return False
        if host >= 0:
            # Neither a mere touch nor most of the slab.
            shared_mm2 = shapely.intersection(polygon, self._polygons[host]).area
            if not 0.1 * _BITE**2 * polygon.area < shared_mm2 < 0.5 * polygon.area:
                return False
        if self._count == len(self._polygons):
            self._polygons = np.concatenate([self._polygons, np.empty(self._count, dtype=object)])
            self._middles_mm = np.concatenate([self._middles_mm, np.zeros((self._count, 2))])
            self._radii_mm = np.concatenate([self._radii_mm, np.zeros(self._count)])
        self._polygons[self._count] = polygon
        self._middles_mm[self._count] = middle_mm
        self._radii_mm[self._count] = radius_mm
        self._corners_mm.append(slab_mm)
        self._count += 1
        return True


def _radius(slab_mm: Floats) -> float:
    return float(np.hypot(*slab_mm.T).max())


_STREAM = 1401
_NEAR = 0.03
_ROUNDS = 4


def rubble_map(seed: int, options: RubbleOptions | None = None) -> Map:
    """Generate one instance of a Rubble environment.

    Slabs that lean on each other are one obstacle. A round body ``passage_mm`` wide can go from
    every possible starting position to everywhere it fits (why: see `Pile`).

    Parameters
    ----------
    seed
        At least 0; the same seed and options give the same map on any machine, as far as GEOS
        finds the same distances and crossings of lines to 1e-4 mm.

    Returns
    -------
    Map
        ``environment`` is ``rubble``; ``facts`` hold the options, the number of slabs and the
        share of the bounds that they cover.

    Examples
    --------
    >>> rubble_map(2).free_space.geom_type
    'Polygon'
    """
    options = options or RubbleOptions()
    check_seed(seed)
    starts = options.lower_starts(options.size_mm, 0.5 * options.passage_mm)
    pile = _pile(child(seed, _STREAM), options, starts)
    obstacles = canonical(_solid(pile, options))
    covered = sum(polygon.area for polygon in obstacles) / options.size_mm**2
    shortfall = 0.1
    if covered < (1.0 - shortfall) * options.cover:
        raise BadInputError(
            "cover", options.cover, f"at most about {covered:.2f} with such slabs and passages"
        )
    return generated_map(
        "rubble",
        seed,
        options,
        bounds=box(options.size_mm, options.size_mm),
        obstacles=obstacles,
        starts=starts,
        slabs=len(pile.polygons),
        covered=round(covered, 4),
    )


def _solid(pile: Pile, options: RubbleOptions) -> BaseGeometry:
    """Return the union of the slabs, clipped to the bounds."""
    slabs = shapely.union_all(pile.polygons, grid_size=COORDINATE_GRID_MM)
    bounds = box(options.size_mm, options.size_mm)
    return shapely.intersection(slabs, bounds, grid_size=COORDINATE_GRID_MM)


def _pile(rng: np.random.Generator, options: RubbleOptions, starts: tuple[Start, ...]) -> Pile:
    """Return slabs placed as far as there is room.

    Further rounds replace what is lost to overlaps and beyond the sides.
    """
    pile, wanted_mm2 = Pile(options, start_zones(starts)), options.cover * options.size_mm**2
    for _ in range(_ROUNDS):
        missing_mm2 = wanted_mm2 - _solid(pile, options).area
        if missing_mm2 <= _NEAR * wanted_mm2 or not _add_slabs(rng, pile, missing_mm2, options):
            break
    return pile


def _add_slabs(
    rng: np.random.Generator, pile: Pile, area_mm2: float, options: RubbleOptions
) -> bool:
    """Add slabs from the largest to the smallest; return whether more may fit."""
    misses = 0
    most_misses = 12  # slabs in a row without a place until the bounds count as full
    for corners in _slabs(rng, area_mm2, options):
        found = pile.add(rng, corners, leaning=bool(rng.random() < options.leaning))
        misses = 0 if found else misses + 1
        if misses == most_misses:
            return False
    return True


def _slabs(rng: np.random.Generator, missing_mm2: float, options: RubbleOptions) -> list[Floats]:
    """Return slabs with this total area, the largest first."""
    limits = options.slab_min_mm, options.slab_max_mm
    slabs: list[Floats] = []
    areas_mm2: list[float] = []
    most_slabs = 4000
    while missing_mm2 > 0.0:
        length_mm = power_law(rng, limits, options.exponent)
        slabs.append(slab(rng, length_mm, options))
        areas_mm2.append(Polygon(slabs[-1]).area)
        missing_mm2 -= areas_mm2[-1]
        if len(slabs) > most_slabs:
            raise BadInputError(
                "slab_min_mm",
                options.slab_min_mm,
                f"more, so that at most {most_slabs} slabs are needed",
            )
    order = np.argsort(-np.array(areas_mm2), kind="stable")
    return [slabs[index] for index in order.tolist()]
