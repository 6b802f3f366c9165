"""Free space on a grid of coordinates: as polygons, and as walls, wedges and vertices."""

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats, Ints
from vinefab.model.map import Map

Shapes = NDArray[np.object_]

APART = 8.0
"""Shapes that are so many grid steps apart cannot touch each other by rounding."""


def free_space(world: Map, grid_mm: float) -> BaseGeometry:
    """Return bounds minus obstacles, snap-rounded.

    Subtracting many polygons from one takes time that grows with the square of their number,
    because every hole is looked for in every polygon. Obstacles that stand alone, clear of the
    bounds and of each other, are therefore made holes directly; only the others are subtracted.
    """
    obstacles = np.array(world.obstacles, dtype=object)
    alone = _stand_alone(world, obstacles, APART * grid_mm)
    # Only obstacles that meet are merged one with another: much faster on scattered ones.
    solid = shapely.disjoint_subset_union_all(obstacles[~alone])
    free = shapely.difference(world.bounds, solid, grid_size=grid_mm)
    return _with_holes(free, _rounded(obstacles[alone], grid_mm))


def _stand_alone(world: Map, obstacles: Shapes, apart_mm: float) -> NDArray[np.bool_]:
    """Tell which obstacles are plain, inside the bounds and clear of all else, shape (n,)."""
    bounds = world.bounds
    edge = bounds.boundary
    shapely.prepare(bounds)
    shapely.prepare(edge)
    alone: NDArray[np.bool_] = shapely.contains_properly(bounds, obstacles)
    alone &= ~shapely.dwithin(edge, obstacles, apart_mm)
    alone &= shapely.get_num_interior_rings(obstacles) == 0
    # Parts of one obstacle that are nearly as close as the grid are left to exact rounding.
    alone &= shapely.minimum_clearance(obstacles) > apart_mm
    pairs = shapely.STRtree(obstacles).query(obstacles, "dwithin", apart_mm)
    alone &= np.bincount(pairs[0], minlength=len(obstacles)) == 1
    return alone


def _rounded(obstacles: Shapes, grid_mm: float) -> Shapes:
    """Return the outlines of obstacles without holes, with rounded coordinates."""
    rings = shapely.remove_repeated_points(shapely.get_exterior_ring(obstacles))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    outlines: Shapes = np.empty(len(rings), dtype=object)
    shapely.linearrings(np.round(points / grid_mm) * grid_mm, indices=ring, out=outlines)
    return outlines


def _with_holes(free: BaseGeometry, holes: Shapes) -> BaseGeometry:
    """Return polygons with more holes, each cut into the polygon that it lies in."""
    if len(holes) == 0:
        return free
    parts = shapely.get_parts(free)
    inside, part = shapely.STRtree(parts).query(shapely.get_point(holes, 0), "intersects")
    for index in np.unique(part):
        shell = shapely.get_exterior_ring(parts[index])
        old = shapely.get_rings(parts[index])[1:]
        parts[index] = shapely.polygons(shell, np.append(old, holes[inside[part == index]]))
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(list(parts))


class FreeSpaceWalls(NamedTuple):
    """Walls of a free space; see `vinefab.growth.arrays.WallArrays` for the columns."""

    # wall, link: the walls and how they hang together; the last column of ``WallArrays.link`` is
    # not here
    wall: Floats
    link: Ints
    # vertex, vertex_point: the vertices that a body can wrap around
    vertex: Floats
    vertex_point: Ints


class _Rings(NamedTuple):
    """Corners of all rings one after the other: their ring, and their neighbours in it."""

    corner: Floats
    ring: Ints
    before: Ints
    after: Ints


def walls_of(free: BaseGeometry, tolerance_mm: float) -> FreeSpaceWalls:
    """Return the walls of a free space."""
    rings = _rings(free)
    place, count = _places(rings.corner)
    straight = (_bulge(rings) <= tolerance_mm) & (count[place] == 1)
    # A needle keeps its flat corner: without it, it would have no inside.
    straight &= np.bincount(rings.ring, weights=~straight)[rings.ring] >= 3
    if straight.any():
        rings = _linked(rings.corner[~straight], rings.ring[~straight])
        place, count = _places(rings.corner)
    wall = _wall_rows(rings)
    follower = _followers(wall, place, rings.after, count)
    ahead = np.empty_like(follower)
    ahead[follower] = np.arange(len(follower))
    link = np.column_stack([ahead, follower, place, place[rings.after]])
    vertex, owner = _vertices(wall, follower)
    return FreeSpaceWalls(wall, link, vertex, link[owner, 3])


def _rings(free: BaseGeometry) -> _Rings:
    polygons = shapely.get_parts(shapely.orient_polygons(free))
    rings = shapely.get_rings(polygons)
    corner, owner = shapely.get_coordinates(rings, return_index=True)
    # Every ring repeats its first corner at its end.
    closing = np.append(owner[1:] != owner[:-1], True)[: len(owner)]
    # Adding zero turns -0.0 into 0.0, so that equal places have equal bytes.
    return _linked(corner[~closing] + 0.0, owner[~closing])


def _linked(corner: Floats, ring: Ints) -> _Rings:
    """Return corners with their neighbours; ``ring`` rises."""
    index = np.arange(len(ring))
    first = np.searchsorted(ring, ring, side="left")
    last = np.searchsorted(ring, ring, side="right") - 1
    before = np.where(index == first, last, index - 1)
    after = np.where(index == last, first, index + 1)
    return _Rings(corner, ring, before.astype(np.int64), after.astype(np.int64))


def _places(corner: Floats) -> tuple[Ints, Ints]:
    """Return the number of each corner's place and how many corners share each place."""
    if len(corner) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    _, place, count = np.unique(corner, axis=0, return_inverse=True, return_counts=True)
    return place.reshape(-1).astype(np.int64), count.astype(np.int64)


def _bulge(rings: _Rings) -> Floats:
    """Return how far each corner stands out from the line between its neighbours."""
    back = rings.corner - rings.corner[rings.before]
    on = rings.corner[rings.after] - rings.corner
    chord = np.hypot(*(back + on).T)
    turns_back = np.sum(back * on, axis=1) <= 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        out = np.abs(back[:, 0] * on[:, 1] - back[:, 1] * on[:, 0]) / chord
    return np.where(turns_back, np.inf, out)


def _wall_rows(rings: _Rings) -> Floats:
    start, end = rings.corner, rings.corner[rings.after]
    span = end - start
    length = np.hypot(span[:, 0], span[:, 1])
    return np.column_stack([start, span / length[:, None], length, end])


def _followers(wall: Floats, place: Ints, after: Ints, count: Ints) -> Ints:
    """Return the wall that bounds the same wedge of free space at each wall's end.

    Within a ring it is the next wall. Where rings touch, the free space falls into several wedges,
    and the follower is the first wall met on turning clockwise, through the free side, from the
    wall's own reverse.
    """
    follower = after.copy()
    for shared in np.flatnonzero(count > 1):
        leaving = np.flatnonzero(place == shared)
        for arriving in np.flatnonzero(place[after] == shared):
            back = -wall[arriving, 2:4]
            cosine = wall[leaving, 2:4] @ back
            sine = wall[leaving, 2] * back[1] - wall[leaving, 3] * back[0]
            clockwise = np.arctan2(sine, cosine) % (2.0 * np.pi)
            # A wall that goes back exactly along this one closes a whole turn, not none.
            clockwise[clockwise == 0.0] = 2.0 * np.pi
            follower[arriving] = leaving[np.argmin(clockwise)]
    return follower


def _vertices(wall: Floats, follower: Ints) -> tuple[Floats, Ints]:
    """Return the wrappable vertices and the walls that end at them."""
    t_in, t_out = wall[:, 2:4], wall[follower, 2:4]
    bend = t_in[:, 0] * t_out[:, 1] - t_in[:, 1] * t_out[:, 0]
    owner = np.flatnonzero(bend < 0.0)
    t_in, t_out = t_in[owner], t_out[owner]
    # The sum of the edges' directions is poor for a flat corner, that of the normals for a needle.
    between = t_out - t_in
    normals = np.column_stack([-(t_in + t_out)[:, 1], (t_in + t_out)[:, 0]])
    is_sharp = np.sum(t_in * t_out, axis=1) < 0.0
    solid = np.where(is_sharp[:, None], between, -normals)
    solid = solid / np.hypot(solid[:, 0], solid[:, 1])[:, None]
    return np.column_stack([wall[owner, 5:7], solid]), owner.astype(np.int64)
