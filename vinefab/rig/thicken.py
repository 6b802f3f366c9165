"""Walls thinner than a printer can print are made just thick enough."""

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.rig.clean import Pieces, pieces_of, thin_parts

_STEPS = 4
_CRUMB_SHARE = 0.02


def patches_for(pieces: Pieces, width_mm: float) -> tuple[Pieces, BaseGeometry]:
    """Return where polygons are thinner than a width, and what to add to make them that wide.

    The thin parts are shrunk in small steps; what vanishes in a step is their middle line, to
    within that step, and is grown to the full width. A thin wall so becomes at least as thick as
    the width, and at most a quarter thicker. Tips of sharp corners are left as they are, see
    `thin_parts`.

    Parameters
    ----------
    pieces
        Polygons that do not overlap.
    width_mm
        Least width.

    Returns
    -------
    Pieces, BaseGeometry
        The thin parts, and the polygons to be joined to the pieces (empty when there are none).
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
