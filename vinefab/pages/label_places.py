"""Labels beside places of a picture, so that none lies on another and few on what is drawn."""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.pages.colours import SOFT

_FAR_PT = (1.5, 4.0, 8.0, 13.0, 19.0, 26.0, 34.0, 44.0, 58.0, 76.0)
"""Gaps tried between a place and its label."""

_ANGLES = np.arange(16) * np.pi / 8.0 + np.pi / 4.0
_LEADER_PT = 9.0
"""From this gap on a line leads to the label."""

_WIDE, _HIGH = 0.62, 1.0  # of a letter, as shares of the font's size


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


def write_labels(  # noqa: PLR0913  options by keyword
    axes: Axes,
    places: Floats,
    words: Sequence[str],
    colours: Sequence[str],
    *,
    size_pt: float,
    mark_pt: float = 3.0,
    lines: Sequence[Floats] = (),
) -> None:
    """Write a label beside each place of axes that are else complete: their layout is read.

    Parameters
    ----------
    places, lines
        In the axes' own units, shape (n, 2) and (k, 2) each.
    """
    if not words:
        return
    axes.get_figure(root=True).draw_without_rendering()  # type: ignore[union-attr]
    points = 72.0 / axes.get_figure(root=True).dpi  # type: ignore[union-attr]

    def on_page(values: Floats) -> Floats:
        return np.asarray(axes.transData.transform(values) * points)

    at = on_page(np.asarray(places, dtype=float))
    wide = [[_WIDE * size_pt * len(text) + 1.0, _HIGH * size_pt] for text in words]
    x0, y0, x1, y1 = (float(end) * points for end in axes.get_window_extent().extents)
    middles = label_middles(
        at,
        np.array(wide),
        mark_pt=mark_pt,
        lines_pt=[on_page(line) for line in lines],
        page_pt=(x0 - 12.0, y0, x1 + 12.0, y1 + 8.0),
    )
    for place, offset, size, text, colour in zip(
        places, middles - at, wide, words, colours, strict=True
    ):
        gap = float(np.hypot(*np.maximum(np.abs(offset) - np.array(size) / 2.0, 0.0)))
        leader = {"arrowstyle": "-", "color": SOFT, "lw": 0.5, "shrinkA": 0, "shrinkB": mark_pt}
        axes.annotate(
            text,
            tuple(place),
            xytext=tuple(offset),
            textcoords="offset points",
            fontsize=size_pt,
            color=colour,
            path_effects=[Stroke(linewidth=0.25 * size_pt, foreground="white"), Normal()],
            ha="center",
            va="center",
            zorder=9,
            arrowprops=leader if gap > _LEADER_PT else None,
        )
