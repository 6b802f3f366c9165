"""Chambers and passages carved out of solid rock."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.environments.ground import rounded
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
    whole = shapely.intersection(shapely.union_all(np.array(parts)), room)
    pieces = [part for part in shapely.get_parts(whole) if isinstance(part, Polygon)]
    plain = shapely.simplify(max(pieces, key=lambda piece: piece.area), detail_mm)
    rings = shapely.get_rings(plain)
    rocks = [ring for ring in rings[1:] if Polygon(ring).area >= least_rock_mm2]
    return shapely.transform(Polygon(rings[0], rocks), rounded)
