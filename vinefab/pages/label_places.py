"""Labels beside places of a picture, so that none lies on another and few on what is drawn."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.validation import Floats

_FAR_PT = (1.5, 4.0, 8.0, 13.0, 19.0, 26.0, 34.0, 44.0, 58.0, 76.0)
"""Gaps tried between a place and its label."""

_ANGLES = np.arange(16) * np.pi / 8.0 + np.pi / 4.0


def label_middles(
    places_pt: Floats,
    sizes_pt: Floats,
    *,
    mark_pt: float = 3.0,
    lines_pt: Sequence[Floats] = (),
    page_pt: tuple[float, float, float, float] | None = None,
) -> Floats:
    """Return where the middles of labels lie, shape (n, 2), all in points.

    Parameters
    ----------
    places_pt
        What the labels are beside, shape (n, 2).
    sizes_pt
        Width and height of each label, shape (n, 2).
    mark_pt
        Half the side of the mark at each place, which no label covers either.
    lines_pt
        Lines that labels keep off where there is room elsewhere, shape (k, 2) each.
    page_pt
        Left, lower, right and upper end of where labels may lie.
    """
    taken = list(_boxes(places_pt, np.full((len(places_pt), 2), 2.0 * mark_pt)))
    lines = shapely.STRtree([shapely.LineString(line) for line in lines_pt if len(line) > 1])
    page = shapely.box(*page_pt) if page_pt else None
    middles = np.empty_like(places_pt, dtype=float)
    far, angle = (grid.ravel() for grid in np.meshgrid(_FAR_PT, _ANGLES, indexing="ij"))
    towards = np.column_stack([np.cos(angle), np.sin(angle)])
    for row, (place, size) in enumerate(zip(places_pt, sizes_pt, strict=True)):
        spots = place + towards * (mark_pt + far[:, None] + size / 2.0)
        boxes = _boxes(spots, np.tile(size, (len(spots), 1)))
        cost = far + 40.0 * shapely.area(shapely.intersection(boxes, shapely.union_all(taken)))
        box, line = lines.query(boxes)
        crossed = shapely.length(shapely.intersection(boxes[box], lines.geometries[line]))
        cost += 0.8 * np.bincount(box, crossed, minlength=len(boxes))
        if page is not None:
            cost += 1000.0 * ~shapely.covers(page, boxes)
        best = int(cost.argmin())
        middles[row] = spots[best]
        taken.append(boxes[best])
    return middles


def _boxes(middles_pt: Floats, sizes_pt: Floats) -> NDArray[np.object_]:
    low, high = middles_pt - sizes_pt / 2.0, middles_pt + sizes_pt / 2.0
    return np.asarray(shapely.box(*low.T, *high.T))
