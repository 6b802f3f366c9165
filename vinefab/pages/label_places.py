"""Labels beside places of a picture, so that none lies on another and few on what is drawn.

All in points. Every label of a picture asks one `Labels` for its place, one after the other.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats

_FAR_PT = (1.5, 4.0, 8.0, 13.0, 19.0, 26.0, 34.0, 44.0, 58.0, 76.0)
"""Gaps tried between a place and its label."""

_ANGLES = np.radians(45.0 + 22.5 * np.arange(16))

_TAKEN, _LINE, _OUTSIDE = 40.0, 0.8, 1000.0
"""Cost of each square point of what is taken, of each point of a line, of leaving the page."""

_BETWEEN_PT, _CLEAR_PT = 2.0, 1.0
"""Least gaps, where labels have ways: from label to label, and from a way to anything."""


class Labels:
    """The labels of one picture: each takes the cheapest place that is left."""

    def __init__(
        self,
        *,
        page_pt: tuple[float, float, float, float] | None = None,
        lines_pt: Sequence[Floats] = (),
        taken: Sequence[BaseGeometry] = (),
    ) -> None:
        """Begin with what labels keep off.

        Parameters
        ----------
        page_pt
            Left, lower, right and upper end of where labels may lie.
        lines_pt
            Lines that labels keep off where there is room elsewhere, shape (k, 2) each.
        taken
            What labels do not cover.
        """
        self.page = shapely.box(*page_pt) if page_pt else None
        # Stretch by stretch: a label meets few of them.
        ends = [np.stack([line[:-1], line[1:]], axis=1) for line in lines_pt if len(line) > 1]
        self.lines = shapely.STRtree([shapely.LineString(two) for line in ends for two in line])
        self.taken = list(taken)
        self.ways: list[BaseGeometry] = []

    def place(
        self, spots_pt: Floats, costs: Floats, size_pt: ArrayLike, *, line_cost: float = _LINE
    ) -> int:
        """Take the cheapest of some spots, shape (n, 2), for the middle of a label; return its row.

        Parameters
        ----------
        costs
            What each spot costs by itself, points.
        line_cost
            Cost of a point of the lines.
        """
        boxes = boxes_around(spots_pt, size_pt)
        x0, y0, x1, y1 = shapely.total_bounds(boxes).tolist()
        near = shapely.STRtree(self.taken).query(shapely.box(x0, y0, x1, y1))
        covered = shapely.union_all([self.taken[one] for one in sorted(near.tolist())])
        hidden = shapely.area(shapely.intersection(boxes, covered))
        cost = np.asarray(costs, dtype=np.float64) + _TAKEN * hidden
        box, line = self.lines.query(boxes)
        crossed = shapely.length(shapely.intersection(boxes[box], self.lines.geometries[line]))
        cost += line_cost * np.bincount(box, crossed, minlength=len(boxes))
        if self.page is not None:
            cost += _OUTSIDE * ~shapely.covers(self.page, boxes)
        best = int(cost.argmin())
        self.taken.append(boxes[best])
        return best

    def place_with_way(
        self,
        spots_pt: Floats,
        costs: Floats,
        size_pt: ArrayLike,
        ways: NDArray[np.object_],
        own: int,
    ) -> int | None:
        """Take the cheapest free spot of a label to which a way leads; return its row.

        Parameters
        ----------
        ways
            The way to each spot. No way meets a label or another way.
        own
            Row in what was taken at first of the sign that the label belongs to.

        Returns
        -------
        int or None
            None if no spot is free.
        """
        boxes = boxes_around(spots_pt, size_pt)
        free = ~shapely.intersects(boxes, self.taken[own])
        free &= ~_meet(boxes, self.taken, _BETWEEN_PT, own) & ~_meet(boxes, self.ways, _CLEAR_PT)
        free &= ~_meet(ways, self.taken, _CLEAR_PT, own) & ~_meet(ways, self.ways, _CLEAR_PT)
        if self.page is not None:
            free &= shapely.covers(self.page, boxes)
        if not free.any():
            return None
        best = int(np.where(free, costs, np.inf).argmin())
        self.taken.append(boxes[best])
        self.ways.append(ways[best])
        return best


def label_middles(
    places_pt: Floats,
    sizes_pt: Floats,
    *,
    mark_pt: float = 3.0,
    lines_pt: Sequence[Floats] = (),
    page_pt: tuple[float, float, float, float] | None = None,
) -> Floats:
    """Return where the middles of labels lie, shape (n, 2).

    Parameters
    ----------
    places_pt
        What the labels are beside, shape (n, 2).
    sizes_pt
        Width and height of each label, shape (n, 2).
    mark_pt
        Half the side of the mark at each place, which no label covers either.
    lines_pt, page_pt
        As of `Labels`.
    """
    marks = boxes_around(places_pt, (2.0 * mark_pt, 2.0 * mark_pt))
    labels = Labels(page_pt=page_pt, lines_pt=lines_pt, taken=list(marks))
    middles = np.empty_like(places_pt, dtype=float)
    far, towards = spots_around(_FAR_PT, _ANGLES)
    for row, (place, size) in enumerate(zip(places_pt, sizes_pt, strict=True)):
        spots = place + towards * (mark_pt + far[:, None] + size / 2.0)
        middles[row] = spots[labels.place(spots, far, size)]
    return middles


def spots_around(far_pt: Sequence[float], angles_rad: ArrayLike) -> tuple[Floats, Floats]:
    """Return every distance in every direction: distances, shape (n,), and units, shape (n, 2)."""
    far, angle = (
        grid.ravel() for grid in np.meshgrid(far_pt, np.asarray(angles_rad), indexing="ij")
    )
    return far, np.column_stack([np.cos(angle), np.sin(angle)])


def boxes_around(middles_pt: Floats, sizes_pt: ArrayLike) -> NDArray[np.object_]:
    """Return boxes around middles, shape (n, 2), of one size, shape (2,), or of one each."""
    half = np.asarray(sizes_pt) / 2.0
    return np.asarray(shapely.box(*(middles_pt - half).T, *(middles_pt + half).T))


def _meet(
    shapes: NDArray[np.object_], taken: Sequence[BaseGeometry], near_pt: float, but: int = -1
) -> NDArray[np.bool_]:
    """Return which shapes come near anything of a list, one entry of it apart."""
    inputs, met = shapely.STRtree(taken).query(shapes, predicate="dwithin", distance=near_pt)
    found = np.zeros(len(shapes), dtype=np.bool_)
    found[inputs[met != but]] = True
    return found
