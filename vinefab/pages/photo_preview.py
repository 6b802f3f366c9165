"""A rectified photo with the walls that were read from it drawn over it."""

import numpy as np
from shapely import Polygon

from vinefab.core.plain_text import counted, one_line
from vinefab.maps.importers.photo_map import PhotoMap
from vinefab.pages.colours import ALERT, INK
from vinefab.pages.panel import Ink, Page, page_of, photo, plan_panel, round_length_mm

_LONGEST_PT = 648.0
_WALLS, _MARKERS = ALERT, "#0a7d32"


def photo_preview(imported: PhotoMap) -> Page:
    """Return a picture by which a person sees whether walls lie where the photo has them."""
    view, world = imported.view, imported.world
    rows, columns = view.pixels.shape[:2]
    right, low = view.to_map(np.array([(columns, rows)]))[0].tolist()
    box = (view.left_mm, low, right, view.top_mm)
    panel = plan_panel(box, _LONGEST_PT)
    panel.add(photo(view.pixels, box), 0.0)
    panel.polygons([world.bounds, *world.obstacles], Ink(line=_WALLS), rank=3.0)
    squares = [Polygon(corners) for corners in imported.markers_mm]
    panel.polygons(squares, Ink(line=_MARKERS), rank=4.0)
    for start in world.starts[:1]:
        dot = Ink(fill=_WALLS, line="#ffffff", width_pt=1.0)
        panel.marks([(start.pose.x_mm, start.pose.y_mm)], "o", 6.0, dot, rank=5.0)
    bar = round_length_mm((box[2] - box[0]) / 5.0)
    x, y = (box[0] + box[2] - bar) / 2.0, box[1] + 0.04 * (box[3] - box[1])
    for colour, width_pt in (("#ffffff", 6.0), (INK, 3.0)):
        panel.line([(x, y), (x + bar, y)], Ink(line=colour, width_pt=width_pt, butt=True), rank=6.0)
    height = f", as seen {imported.height_mm:g} mm up" if imported.height_mm else ""
    markers = ", markers green" if squares else ""
    panel.title = (
        f"{one_line(world.name)}: {counted(len(world.obstacles), 'obstacle')}{height};\n"
        f"walls red{markers}, start a dot; the bar is {bar:g} mm"
    )
    return page_of(panel)
