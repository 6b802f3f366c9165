"""Walls thinner than a printer can print are made just thick enough."""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.rig.options import GRID_MM

Pieces = NDArray[np.object_]
"""Polygons that do not overlap, shape (n,)."""

_ROUNDS = 5
_MITRE_LIMIT = 5.0


def pieces_of(*shapes: BaseGeometry | Pieces) -> Pieces:
    """Return all polygons of geometries; points and lines left over by an overlay are dropped."""
    parts = np.concatenate([shapely.get_parts(shape) for shape in shapes])
    parts = shapely.get_parts(parts[shapely.get_dimensions(parts) == 2])
    return np.asarray(parts[~shapely.is_empty(parts)], dtype=object)


def snapped_union(*shapes: BaseGeometry | Pieces) -> Pieces:
    """Return the union's polygons on the grid `GRID_MM`; where two edges meet is a corner."""
    return pieces_of(shapely.union_all(pieces_of(*shapes), grid_size=GRID_MM))


def vanishes(pieces: Pieces, width_mm: float) -> NDArray[np.bool_]:
    """Tell which polygons are nowhere thicker than a width."""
    if width_mm <= 0.0:
        return np.zeros(len(pieces), dtype=bool)
    eroded = shapely.buffer(pieces, -0.5 * width_mm, join_style="mitre", quad_segs=1)
    return np.asarray(shapely.is_empty(eroded), dtype=bool)


def without_slivers(pieces: Pieces, width_mm: float) -> tuple[Pieces, int]:
    """Drop the polygons that are nowhere thicker than a width; also return how many."""
    gone = vanishes(pieces, width_mm)
    return pieces[~gone], int(gone.sum())


def without_slits(pieces: Pieces, width_mm: float) -> tuple[Pieces, int]:
    """Fill the holes that are nowhere wider than a width; also return how many."""
    filled = 0
    result = pieces.copy()
    for index in np.flatnonzero(shapely.get_num_interior_rings(pieces) > 0):
        rings = np.asarray(pieces[index].interiors, dtype=object)
        narrow = vanishes(np.asarray(shapely.polygons(rings), dtype=object), width_mm)
        if narrow.any():
            result[index] = Polygon(pieces[index].exterior, list(rings[~narrow]))
            filled += int(narrow.sum())
    return result, filled


def touching_points(pieces: Pieces) -> NDArray[np.float64]:
    """Return the corners, shape (n, 2), at which rings meet themselves or each other."""
    rings = shapely.get_rings(pieces)
    coordinates, ring = shapely.get_coordinates(rings, return_index=True)
    first = np.ones(len(ring), dtype=bool)  # a ring's last corner repeats its first: leave it out
    first[1:] = ring[1:] != ring[:-1]
    unique, count = np.unique(coordinates[~first], axis=0, return_counts=True)
    return np.asarray(unique[count > 1], dtype=np.float64)


def bridged(pieces: Pieces, within: BaseGeometry, radius_mm: float) -> tuple[Pieces, int]:
    """Join what touches in a single point by a small octagon there.

    Two solids that share only an upright edge are no printable body, and a file of triangles
    cannot say on which side each belongs: four triangles meet at one edge.
    """
    mended = 0
    for _ in range(_ROUNDS):
        points = touching_points(pieces)
        if not len(points):
            break
        patches = shapely.MultiPoint(points).buffer(radius_mm, quad_segs=2).intersection(within)
        pieces = snapped_union(pieces, patches)
        mended += len(points)
    return pieces, mended


def thin_parts(pieces: Pieces, width_mm: float) -> Pieces:
    """Return the parts of polygons that are thinner than a width.

    They are what an opening (shrink, then grow back) loses. Sharp corners lose their tips too:
    what is smaller than twice the width squared is not counted, which is a tip below 12 degrees.
    """
    # Less a step of the grid: a wall of just the width is thick enough, however it was snapped.
    half_mm = max(0.5 * width_mm - GRID_MM, 0.25 * width_mm)
    # Growing back a hair more keeps rounding errors along the edges out of the difference.
    opened = shapely.buffer(
        shapely.buffer(pieces, -half_mm, join_style="mitre", mitre_limit=_MITRE_LIMIT),
        1.001 * half_mm,
        join_style="mitre",
        mitre_limit=_MITRE_LIMIT,
    )
    lost = pieces_of(shapely.difference(pieces, opened))
    return lost[shapely.area(lost) > 2.0 * width_mm**2]


_STEPS = 4
_CRUMB_SHARE = 0.02


def patches_for(pieces: Pieces, width_mm: float) -> tuple[Pieces, BaseGeometry]:
    """Return where polygons are thinner than a width, and what to add to make them that wide.

    The thin parts are shrunk in small steps; what vanishes in a step is their middle line, to
    within that step, and is grown to the full width. A thin wall so becomes at least as thick as
    the width, and at most a quarter thicker. Tips of sharp corners are left as they are, see
    `thin_parts`.
    """
    thin = thin_parts(pieces, width_mm)
    step_mm = 0.5 * width_mm / _STEPS
    hair_mm = 0.01 * width_mm
    left, patches = thin, []
    for _ in range(_STEPS + 1):
        # A hair more and back again: what is left with hardly any width counts as vanished.
        shrunk = shapely.buffer(left, -(step_mm + hair_mm), join_style="mitre")
        inner = pieces_of(shapely.buffer(shrunk, hair_mm, join_style="mitre"))
        regrown = shapely.buffer(shapely.union_all(inner), 1.02 * step_mm, join_style="mitre")
        middle = pieces_of(shapely.difference(left, regrown))
        # The first steps leave crumbs in the corners: a disc around each would bulge out.
        middle = middle[shapely.area(middle) > _CRUMB_SHARE * width_mm**2]
        patches += list(shapely.buffer(middle, 0.5 * width_mm, join_style="mitre", mitre_limit=1.5))
        left = inner
    grown = shapely.union_all(patches) if patches else Polygon()
    return thin, shapely.union_all(pieces_of(grown))
