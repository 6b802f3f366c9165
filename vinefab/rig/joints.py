"""Dovetails in the plate that join neighbouring tiles."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.model.checked import Floats

TAB_DEPTH_MM = 8.0
_NECK_HALF_MM = 4.0
_END_HALF_MM = 6.5
_FREE_MM = 2.0
_SPAN_PER_TAB_MM = 90.0
_STEP_MM = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Seam:
    """The straight cut between two neighbouring tiles.

    Parameters
    ----------
    upright
        Whether it runs along y; the tile that gets the tabs is then the left one, else the lower.
    at_mm
        Its x when upright, else its y.
    low_mm, high_mm
        Where it begins and ends along its direction.
    """

    upright: bool
    at_mm: float
    low_mm: float
    high_mm: float


def tabs_of(seam: Seam, plate: BaseGeometry, solids: shapely.STRtree) -> list[Polygon]:
    """Return the tabs of a seam: dovetails that reach over it to the right or upwards.

    A tab stands only where the plate is whole around it and nothing stands on it: a socket under
    an obstacle would have to be bridged in the air by the printer. Where there is no such place,
    there is no tab.

    Parameters
    ----------
    seam
        The cut.
    plate
        Outline of the whole plate, prepared for speed.
    solids
        Everything that stands on the plate.
    """
    margin_mm = TAB_DEPTH_MM + _END_HALF_MM + _FREE_MM  # clear of the joints of crossing seams
    low, high = seam.low_mm + margin_mm, seam.high_mm - margin_mm
    if high < low:
        return []
    count = max(1, round((high - low) / _SPAN_PER_TAB_MM))
    ends = np.linspace(low, high, count + 1)
    chosen = []
    for left, right in pairwise(ends):
        gap = _END_HALF_MM + _FREE_MM if count > 1 else 0.0
        places = np.arange(np.ceil(left + gap), right - gap + 1e-9, _STEP_MM)
        places = places[np.argsort(np.abs(places - 0.5 * (left + right)), kind="stable")]
        free = places[_is_free(seam, places, plate, solids)]
        chosen += [_tab(seam, float(at)) for at in free[:1]]
    return chosen


def socket_of(tab: Polygon, clearance_mm: float) -> Polygon:
    """Return what the other tile must leave open for a tab."""
    return tab.buffer(clearance_mm, join_style="mitre")


def _is_free(
    seam: Seam, places: Floats, plate: BaseGeometry, solids: shapely.STRtree
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    half = _END_HALF_MM + _FREE_MM
    low, high = places - half, places + half
    near = np.full_like(places, seam.at_mm - TAB_DEPTH_MM)
    far = np.full_like(places, seam.at_mm + TAB_DEPTH_MM + _FREE_MM)
    corners = (near, low, far, high) if seam.upright else (low, near, high, far)
    boxes = shapely.box(*corners)
    free = np.asarray(shapely.contains_properly(plate, boxes), dtype=bool)
    free[np.unique(solids.query(boxes, predicate="intersects")[0])] = False
    return free


def _tab(seam: Seam, along_mm: float) -> Polygon:
    at, end = seam.at_mm, seam.at_mm + TAB_DEPTH_MM
    corners = [
        (at, along_mm - _NECK_HALF_MM),
        (end, along_mm - _END_HALF_MM),
        (end, along_mm + _END_HALF_MM),
        (at, along_mm + _NECK_HALF_MM),
    ]
    return Polygon(corners if seam.upright else [(y, x) for x, y in corners])
