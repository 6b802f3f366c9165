"""A rectified photo with the walls that were read from it drawn over it."""

import numpy as np
from matplotlib.figure import Figure
from shapely import Polygon

from vinefab.core.plain_text import counted, one_line
from vinefab.maps.importers.photo_map import PhotoMap
from vinefab.pages.colours import ALERT, INK
from vinefab.pages.drawing import fill_geometry
from vinefab.pages.figure import house_style, plan_axes

_LONGEST_IN = 9.0
_WALLS, _MARKERS = ALERT, "#0a7d32"


def photo_preview(imported: PhotoMap) -> Figure:
    """Return a picture by which a person sees whether walls lie where the photo has them."""
    view, world = imported.view, imported.world
    rows, columns = view.pixels.shape[:2]
    right, low = view.to_map(np.array([(columns, rows)]))[0]
    box = (view.left_mm, float(low), float(right), view.top_mm)
    with house_style():
        figure, axes = plan_axes(box, _LONGEST_IN)
        axes.imshow(view.pixels, extent=(box[0], box[2], box[1], box[3]), zorder=0)
        fill_geometry(axes, [world.bounds, *world.obstacles], face="none", edge=_WALLS, rank=3)
        squares = [Polygon(corners) for corners in imported.markers_mm]
        fill_geometry(axes, squares, face="none", edge=_MARKERS, rank=4)
        for start in world.starts[:1]:
            axes.plot(start.pose.x_mm, start.pose.y_mm, "o", color=_WALLS, mec="white", zorder=5)
        bar = _round_length((box[2] - box[0]) / 5.0)
        x, y = (box[0] + box[2] - bar) / 2.0, box[1] + 0.04 * (box[3] - box[1])
        axes.plot([x, x + bar], [y, y], color="white", lw=6, solid_capstyle="butt", zorder=6)
        axes.plot([x, x + bar], [y, y], color=INK, lw=3, solid_capstyle="butt", zorder=7)
        height = f", as seen {imported.height_mm:g} mm up" if imported.height_mm else ""
        markers = ", markers green" if squares else ""
        axes.set_title(
            f"{one_line(world.name)}: {counted(len(world.obstacles), 'obstacle')}{height}; "
            f"walls red{markers}, start a dot; the bar is {bar:g} mm",
            fontsize=9,
        )
    return figure


def _round_length(most_mm: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, ... that is not longer."""
    steps = [digit * 10.0**power for power in range(-3, 8) for digit in (1, 2, 5)]
    return max(step for step in steps if step <= max(most_mm, 1e-3))
