"""Chambers and passages carved out of solid rock."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.environments.ground import DECIMALS, canonical
from vinefab.model.checked import Floats

_DISC_POINTS = 20


def chamber(middle_mm: Floats, radii_mm: Floats) -> Polygon:
    """Return a closed outline with a radius for each of evenly spaced directions."""
    angles = np.arange(len(radii_mm)) * 2.0 * math.pi / len(radii_mm)
    round_mm = radii_mm[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return Polygon(middle_mm + round_mm)


def passage(path_mm: Floats, widths_mm: Floats) -> BaseGeometry:
    """Return a tube along a path: discs as wide as asked at its points, joined by their hulls.

    Parameters
    ----------
    path_mm
        Shape (n, 2), n at least 2.
    widths_mm
        Shape (n,).
    """
    angles = np.arange(_DISC_POINTS) * 2.0 * math.pi / _DISC_POINTS
    disc = np.column_stack([np.cos(angles), np.sin(angles)])
    # A polygon around the disc, not in it: the passage is nowhere narrower than asked.
    radii_mm = 0.5 * widths_mm / math.cos(math.pi / _DISC_POINTS)
    discs = path_mm[:, None] + radii_mm[:, None, None] * disc
    pairs = np.concatenate([discs[:-1], discs[1:]], axis=1)
    return shapely.union_all(shapely.convex_hull(shapely.multipoints(pairs)))


def carved(
    parts: Sequence[BaseGeometry], room: Polygon, detail_mm: float, least_rock_mm2: float
) -> Polygon:
    """Return the cave that overlapping parts make together.

    Parameters
    ----------
    parts
        Each overlaps the rest within the room, so that all are connected.
    room
        Convex; what reaches out of it is not carved.
    detail_mm
        Corners of the walls are left out as far as the walls move by at most this.
    least_rock_mm2
        Smaller islands of rock are carved away too.
    """
    grid_mm = 10.0**-DECIMALS
    solid = shapely.union_all(np.array(parts), grid_size=grid_mm)
    pieces = canonical(shapely.intersection(solid, room, grid_size=grid_mm))
    outer, *holes = shapely.get_rings(max(pieces, key=lambda piece: piece.area))
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (outer, *holes)]
    while True:
        walls, *rocks = [_plainer(ring, detail_mm) for ring in rings]
        cave = Polygon(walls, [rock for rock in rocks if _area(rock) >= least_rock_mm2])
        if cave.is_valid:
            return canonical(cave)[0]
        # Walls that nearly touch may cross when both move; with less detail lost they do not.
        detail_mm *= 0.5


def _area(ring_mm: Floats) -> float:
    x, y = ring_mm.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


def _plainer(ring_mm: Floats, detail_mm: float) -> Floats:
    """Return a ring with fewer corners, none of those left out farther than this from it.

    Douglas and Peucker's method on the two halves between the first corner and the one farthest
    from it. Libraries begin elsewhere from one version to the next.
    """
    closed = np.concatenate([ring_mm, ring_mm[:1]])
    middle = int(np.argmax(np.hypot(*(ring_mm - ring_mm[0]).T)))
    keep = np.zeros(len(closed), dtype=np.bool_)
    keep[[0, middle]] = True
    todo = [(0, middle), (middle, len(ring_mm))]
    while todo:
        first, last = todo.pop()
        off = _off_line(closed[first : last + 1])
        worst = int(np.argmax(off))
        if off[worst] > detail_mm:
            keep[first + worst] = True
            todo += [(first, first + worst), (first + worst, last)]
    return np.asarray(closed[keep])


def _off_line(points_mm: Floats) -> Floats:
    """Return how far points are from the straight piece between the first and the last."""
    along = points_mm[-1] - points_mm[0]
    away = points_mm - points_mm[0]
    share = np.clip(away @ along / (along @ along), 0.0, 1.0)
    return np.asarray(np.hypot(*(away - share[:, None] * along).T))
