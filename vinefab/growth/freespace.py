"""Bounds minus obstacles on a grid of coordinates, on maps of any size."""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.model.map import Map

Shapes = NDArray[np.object_]

APART = 8.0
"""Shapes that are so many grid steps apart cannot touch each other by rounding."""


def free_space(world: Map, grid_mm: float) -> BaseGeometry:
    """Return bounds minus obstacles, snap-rounded.

    Subtracting many polygons from one takes time that grows with the square of their number,
    because every hole is looked for in every polygon. Obstacles that stand alone, clear of the
    bounds and of each other, are therefore made holes directly; only the others are subtracted.

    Parameters
    ----------
    world
        The map.
    grid_mm
        Step that coordinates are rounded to.
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
