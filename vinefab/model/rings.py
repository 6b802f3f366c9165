"""Corners of polygons ring by ring, and polygons without their narrow notches."""

from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats, Ints


class Rings(NamedTuple):
    """Corners of all rings, concatenated: their ring, and their neighbours in it."""

    corner: Floats
    ring: Ints
    before: Ints
    after: Ints


def rings_of(free: BaseGeometry) -> Rings:
    """Return the corners of polygons, what is inside on the left."""
    polygons = shapely.get_parts(shapely.orient_polygons(free))
    rings = shapely.get_rings(polygons)
    corner, owner = shapely.get_coordinates(rings, return_index=True)
    # Every ring repeats its first corner at its end.
    closing = np.append(owner[1:] != owner[:-1], True)[: len(owner)]
    # Adding zero turns -0.0 into 0.0, so that equal places have equal bytes.
    return linked(corner[~closing] + 0.0, owner[~closing])


def linked(corner: Floats, ring: Ints) -> Rings:
    """Return corners with their neighbours; ``ring`` rises."""
    index = np.arange(len(ring))
    first = np.searchsorted(ring, ring, side="left")
    last = np.searchsorted(ring, ring, side="right") - 1
    before = np.where(index == first, last, index - 1)
    after = np.where(index == last, first, index + 1)
    return Rings(corner, ring, before.astype(np.int64), after.astype(np.int64))


def without_notches(free: BaseGeometry, mouth_mm: float, at_least: int = 1) -> BaseGeometry:
    """Return a free space less its sharp notches whose mouths are no wider than some length.

    Side by side, narrow notches cost time that grows with the square of their number, because each
    thickened wall meets all others that are near it. Fewer than ``at_least`` stay as they are.
    """
    rings = walls = rings_of(free)
    corners: shapely.STRtree | None = None
    while len(notch := _notches(walls, mouth_mm)) >= max(at_least, 1):
        at_least = 1
        corners = corners or shapely.STRtree(np.asarray(shapely.points(rings.corner)))
        around = np.stack([walls.before[notch], notch, walls.after[notch]], axis=1)
        filled = shapely.polygons(walls.corner[around])
        # Its own three corners are in it; what holds another one stays open.
        count = np.bincount(corners.query(filled, "intersects")[0], minlength=len(notch))
        if not (count <= 3).any():
            break
        kept = np.delete(np.arange(len(walls.ring)), notch[count <= 3])
        walls = linked(walls.corner[kept], walls.ring[kept])
    return free if walls is rings else _as_polygons(walls, free)


def _notches(rings: Rings, mouth_mm: float) -> Ints:
    """Return corners of less than a right angle of free space; no two are neighbours."""
    back, on = rings.corner[rings.before] - rings.corner, rings.corner[rings.after] - rings.corner
    sharp = (np.sum(back * on, axis=1) > 0.0) & (np.hypot(*(back - on).T) <= mouth_mm)
    sharp &= on[:, 0] * back[:, 1] - on[:, 1] * back[:, 0] > 0.0
    sharp &= ~sharp[rings.before]
    # A ring of five could be left with two.
    return np.flatnonzero(sharp & (np.bincount(rings.ring)[rings.ring] > 5))


def _as_polygons(rings: Rings, free: BaseGeometry) -> BaseGeometry:
    """Return rings as the polygons that they had in a free space."""
    _, part = shapely.get_rings(shapely.get_parts(free), return_index=True)
    lines = np.asarray(shapely.linearrings(rings.corner, indices=rings.ring))
    first = np.searchsorted(part, np.unique(part))
    polygons = [shapely.polygons(shell, holes) for shell, *holes in np.split(lines, first[1:])]
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
