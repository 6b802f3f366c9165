"""The Cave environment: a series of interconnected closed passages in solid rock.

The paper (section 2.2.1) describes the environment but does not publish its generator; this one
is vinefab's own.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
import shapely
from annotated_types import Ge, Le
from pydantic import model_validator
from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import Floats, number
from vinefab.maps.generators.generated_map import (
    COORDINATE_GRID_MM,
    Length,
    Share,
    StartOptions,
    StartSpread,
    box,
    canonical,
    check_seed,
    directions,
    generated_map,
    signed_area_mm2,
    start_zone,
)
from vinefab.model.map import Map, Start

_CANDIDATES = 12


def links(rng: np.random.Generator, points: Floats, extra: float) -> list[tuple[int, int]]:
    """Return pairs of points to connect: the minimum spanning tree, and some shortcuts.

    Shortcuts are edges of the Gabriel graph: no other point lies in the circle between the two.
    """
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    nearest, gap = np.zeros(len(distance), dtype=np.int64), distance[0].copy()
    gap[0] = np.inf
    tree = set()
    for _ in range(len(distance) - 1):
        new = int(np.argmin(gap))
        tree.add((min(new, int(nearest[new])), max(new, int(nearest[new]))))
        closer = (distance[new] < gap) & np.isfinite(gap)
        nearest[closer], gap[closer] = new, distance[new][closer]
        gap[new] = np.inf
    one, other = np.triu_indices(len(distance), 1)
    detour = distance[one] ** 2 + distance[other] ** 2
    detour[np.arange(len(one)), one] = detour[np.arange(len(one)), other] = np.inf
    clear = detour.min(axis=1) >= distance[one, other] ** 2
    pairs = zip(one[clear].tolist(), other[clear].tolist(), strict=True)
    possible = [pair for pair in pairs if pair not in tree]
    chosen = rng.random(len(possible)) < extra
    return sorted(tree) + [pair for pair, take in zip(possible, chosen, strict=True) if take]


def passage(path_mm: Floats, widths_mm: Floats) -> BaseGeometry:
    """Return a tube along a path: discs of these widths at its points, joined by their hulls."""
    disc_points = 20
    angles = np.arange(disc_points) * 2.0 * math.pi / disc_points
    disc = directions(angles)
    # A polygon around the disc, not in it: the passage is nowhere narrower than this.
    radii_mm = 0.5 * widths_mm / math.cos(math.pi / disc_points)
    discs = path_mm[:, None] + radii_mm[:, None, None] * disc
    pairs = np.concatenate([discs[:-1], discs[1:]], axis=1)
    return shapely.union_all(shapely.convex_hull(shapely.multipoints(pairs)))


def _carved(
    parts: Sequence[BaseGeometry], room: Polygon, detail_mm: float, least_rock_mm2: float
) -> Polygon:
    """Return the largest connected union of parts within a room, with simplified walls."""
    solid = shapely.union_all(np.array(parts), grid_size=COORDINATE_GRID_MM)
    pieces = canonical(shapely.intersection(solid, room, grid_size=COORDINATE_GRID_MM))
    outer, *holes = shapely.get_rings(max(pieces, key=lambda piece: piece.area))
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (outer, *holes)]
    while True:
        walls, *rocks = [_simplified(ring, detail_mm) for ring in rings]
        kept = [rock for rock in rocks if abs(signed_area_mm2(rock)) >= least_rock_mm2]
        cave = Polygon(walls, kept)
        if cave.is_valid:
            return canonical(cave)[0]
        # Simplified walls that nearly touch may cross: simplify less.
        detail_mm *= 0.5


def _simplified(ring_mm: Floats, detail_mm: float) -> Floats:
    """Return a ring simplified by Douglas and Peucker's method to within ``detail_mm``.

    It is split at the first corner and the one farthest from it. Libraries begin elsewhere from
    one version to the next, which would change maps.
    """
    closed = np.concatenate([ring_mm, ring_mm[:1]])
    middle = int(np.argmax(np.hypot(*(ring_mm - ring_mm[0]).T)))
    keep = np.zeros(len(closed), dtype=np.bool_)
    keep[[0, middle]] = True
    todo = [(0, middle), (middle, len(ring_mm))]
    while todo:
        first, last = todo.pop()
        along = closed[last] - closed[first]
        away = closed[first : last + 1] - closed[first]
        share = np.clip(away @ along / (along @ along), 0.0, 1.0)
        off = np.hypot(*(away - share[:, None] * along).T)
        worst = int(np.argmax(off))
        if off[worst] > detail_mm:
            keep[first + worst] = True
            todo += [(first, first + worst), (first + worst, last)]
    return np.asarray(closed[keep])


_STREAM = 1301


class CaveOptions(StartOptions):
    """Options that instances of one Cave environment share."""

    size_mm: Annotated[Length, Doc("width and height of the bounds")] = 500.0
    chambers: Annotated[int, Ge(1), Le(200), Doc("chambers that the passages connect")] = 12
    chamber_radius_min_mm: Annotated[Length, Doc("least mean radius of a chamber")] = 22.0
    chamber_radius_max_mm: Annotated[Length, Doc("largest mean radius of a chamber")] = 42.0
    passage_width_min_mm: Annotated[
        Length, Doc("least width of a passage; none is narrower, to 1 mm in 500")
    ] = 22.0
    passage_width_max_mm: Annotated[Length, Doc("largest width of a passage")] = 38.0
    loops: Annotated[
        Share,
        Doc(
            "share of the possible shortcuts that are open besides the passages that connect "
            "everything; 0: no islands of rock, unless passages happen to meet"
        ),
    ] = 0.4
    wander: Annotated[
        Share, Doc("0: passages are straight; 1: they swing aside by a quarter of their length")
    ] = 0.5
    roughness: Annotated[Share, Doc("0: smooth walls; 1: radius and width vary by half")] = 0.5
    margin_mm: Annotated[Length, Doc("rock left between cave and bounds")] = 10.0
    start_spread_x_mm: StartSpread = 5.0

    @model_validator(mode="after")
    def _fits(self) -> "CaveOptions":
        for name in ("chamber_radius", "passage_width"):
            least_mm, most_mm = getattr(self, f"{name}_min_mm"), getattr(self, f"{name}_max_mm")
            number(f"{name}_max_mm", most_mm, least_mm, 1e6, "mm")
        if self.reach_mm >= 0.25 * self.size_mm:
            raise BadInputError(
                "size_mm",
                self.size_mm,
                f"above {4 * self.reach_mm:g}, for such chambers and margin",
            )
        number("passage_width_min_mm", self.passage_width_min_mm, 0.005 * self.size_mm, 1e6, "mm")
        room_mm = self.size_mm - 2.0 * self.floor_mm
        self.check_starts((room_mm, room_mm), 0.5 * self.passage_width_min_mm)
        return self

    @property
    def reach_mm(self) -> float:
        """Least distance from the middle of a chamber to the bounds."""
        widest_mm = max(self.chamber_radius_max_mm, 0.5 * self.passage_width_max_mm)
        return self.margin_mm + widest_mm

    @property
    def passage_mm(self) -> float:
        """Diameter of a round body that reaches every chamber from the start."""
        return self.passage_width_min_mm - 2.0 * self.detail_mm

    @property
    def floor_mm(self) -> float:
        """Width of the solid rock along the bounds, and the tolerance of the walls."""
        return self.margin_mm + 2.0 * self.detail_mm

    @property
    def detail_mm(self) -> float:
        """Tolerance to which walls are simplified."""
        return 0.001 * self.size_mm


def cave_map(seed: int, options: CaveOptions | None = None) -> Map:
    """Generate one instance of a Cave environment.

    Chambers are spread over the bounds and connected by winding passages; everything else is
    rock: one obstacle with the cave as its hole, and an obstacle for every island of rock that
    passages run around, unless it is smaller than half a passage's width squared. All of the cave
    is connected, and every possible starting position has ``start_clearance_mm``, and at least
    half the least width of a passage, to the rock.

    Parameters
    ----------
    seed
        At least 0; the same seed and options give the same map on any machine, as far as GEOS
        finds the same crossings of lines to 1e-4 mm.

    Examples
    --------
    >>> cave_map(3).free_space.geom_type
    'Polygon'
    """
    options = options or CaveOptions()
    check_seed(seed)
    (start,) = options.lower_starts(options.size_mm, 0.5 * options.passage_width_min_mm)
    start = replace(start, pose=replace(start.pose, y_mm=start.pose.y_mm + options.floor_mm))
    cave = _cave(child(seed, _STREAM), options, start)
    bounds = box(options.size_mm, options.size_mm)
    rocks = [Polygon(bounds.exterior, [cave.exterior])]
    rocks += [Polygon(ring) for ring in cave.interiors]
    return generated_map(
        "cave",
        seed,
        options,
        bounds=bounds,
        obstacles=[canonical(rock)[0] for rock in rocks],
        starts=(start,),
    )


def _cave(rng: np.random.Generator, options: CaveOptions, start: Start) -> Polygon:
    low, high = options.reach_mm, options.size_mm - options.reach_mm
    entry = np.array([start.pose.x_mm, start.pose.y_mm])
    mouth = np.array([entry[0], np.clip(entry[1] + options.passage_width_max_mm, low, high)])
    points = [mouth]
    for _ in range(options.chambers):
        candidates = rng.uniform(low, high, (_CANDIDATES, 2))
        off = np.linalg.norm(candidates[:, None] - np.array(points), axis=2).min(axis=1)
        points.append(candidates[int(np.argmax(off))])
    middles = np.array(points)
    entrance = start_zone(start).buffer(options.start_clearance_mm + 2.0 * options.detail_mm)
    to_mouth = entry + np.linspace(0.0, 1.0, 8)[:, None] * (mouth - entry)
    parts = [entrance, passage(to_mouth, _widths(rng, options, 8))]
    chamber_points = 48
    angles = np.arange(chamber_points) * 2.0 * math.pi / chamber_points
    for middle in middles:
        radius_mm = rng.uniform(options.chamber_radius_min_mm, options.chamber_radius_max_mm)
        uneven = 1.0 + 0.5 * options.roughness * _waves(rng, chamber_points, 1.0)
        parts.append(Polygon(middle + (radius_mm * uneven)[:, None] * directions(angles)))
    for one, other in links(rng, middles, options.loops):
        path = _winding(rng, options, middles[one], middles[other])
        parts.append(passage(path, _widths(rng, options, len(path))))
    near, far = options.margin_mm, options.size_mm - options.margin_mm
    room = shapely.box(near, near, far, far)
    return _carved(parts, room, options.detail_mm, (0.5 * options.passage_width_min_mm) ** 2)


def _widths(rng: np.random.Generator, options: CaveOptions, count: int) -> Floats:
    width_mm = rng.uniform(options.passage_width_min_mm, options.passage_width_max_mm)
    uneven = width_mm * (1.0 + 0.5 * options.roughness * _waves(rng, count, 0.5))
    return np.asarray(np.maximum(uneven, options.passage_width_min_mm))


def _winding(
    rng: np.random.Generator, options: CaveOptions, first_mm: Floats, last_mm: Floats
) -> Floats:
    """Return a winding path between two places, shape (n, 2)."""
    along = last_mm - first_mm
    count = 4 + int(math.hypot(*along) / (0.5 * options.passage_width_min_mm))
    share = np.linspace(0.0, 1.0, count)
    swing = 0.25 * options.wander * np.sin(math.pi * share) * _waves(rng, count, 0.5)
    side = np.array([-along[1], along[0]])
    path = first_mm + share[:, None] * along + swing[:, None] * side
    near, far = options.reach_mm, options.size_mm - options.reach_mm
    return np.asarray(np.clip(path, near, far))


def _waves(rng: np.random.Generator, count: int, turns: float) -> Floats:
    """Return smooth noise within -1 .. 1, periodic when ``turns`` is a whole number."""
    phase, strength = rng.uniform(0.0, 2.0 * math.pi, 4), rng.uniform(0.2, 1.0, 4)
    place = np.linspace(0.0, 2.0 * math.pi * turns, count, endpoint=turns % 1.0 != 0.0)
    waves = strength * np.sin(place[:, None] * np.arange(2, 6) + phase)
    return np.asarray(waves.sum(axis=1) / strength.sum())
