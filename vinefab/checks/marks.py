"""Well-known text that marks the places of findings, in the flat layout."""

from collections.abc import Iterable

import numpy as np
import shapely

from vinefab.geometry.layout import FlatLayout

Point = tuple[float, float]
_DECIMALS = 3


def mark_point(at_mm: Point) -> str:
    """Return a point.

    >>> mark_point((1.0, 2.00004))
    'POINT (1 2)'
    """
    return _text(shapely.Point(at_mm))


def mark_line(start_mm: Point, end_mm: Point) -> str:
    """Return a line between two places, such as the ends of a gap; a point where they coincide."""
    if np.allclose(start_mm, end_mm, rtol=0.0, atol=10.0**-_DECIMALS):
        return mark_point(start_mm)
    return _text(shapely.LineString([start_mm, end_mm]))


def mark_branches(layout: FlatLayout, branches: Iterable[int]) -> str:
    """Return the centre lines of some branches, by index."""
    rows = list(branches)
    ends = np.stack([layout.start_mm[rows], layout.end_mm[rows]], axis=1)
    return _text(shapely.MultiLineString(ends.tolist()))


def middle_mm(layout: FlatLayout, branch: int) -> Point:
    """Return the middle of a branch."""
    x, y = (layout.start_mm[branch] + layout.end_mm[branch]) / 2.0
    return float(x), float(y)


def place_mm(layout: FlatLayout, branch: int, *, at_tip: bool = False) -> Point:
    """Return where a branch begins, or its tip."""
    x, y = layout.end_mm[branch] if at_tip else layout.start_mm[branch]
    return float(x), float(y)


def _text(geometry: shapely.Geometry) -> str:
    return str(shapely.to_wkt(geometry, rounding_precision=_DECIMALS))
