"""A plan of where robots go on a map, over many poses."""

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from vinefab.model.heat import Heat
from vinefab.report.colours import ALERT, LEVEL_COLOURS
from vinefab.report.drawing import draw_map, draw_pose
from vinefab.report.figure import house_style, plan_axes

_HEAT = LinearSegmentedColormap.from_list(
    "heat", ["#fdf1dc", "#f6b65c", "#d9622b", "#8c2155", LEVEL_COLOURS[0]]
)
"""From light to dark, so that a grey print shows the same order."""


def heat_plan(heat: Heat) -> Figure:
    """Return a map with the share of the deployments that pass each place, and stuck tips."""
    with house_style():
        box = heat.world.bounds.bounds
        figure, axes = plan_axes(box, 7.0)
        rows, columns = heat.share.shape
        x, y = heat.low_mm
        extent = (x, x + columns * heat.cell_mm, y, y + rows * heat.cell_mm)
        shown = np.ma.masked_equal(100.0 * heat.share, 0.0)
        image = axes.imshow(
            shown, origin="lower", extent=extent, cmap=_HEAT, vmin=0.0, zorder=1.5,
            interpolation="nearest",
        )  # fmt: skip
        draw_map(axes, heat.world)
        for start in heat.world.starts:
            draw_pose(axes, start.pose, max(heat.world.size_mm))
        for number, spot in enumerate(heat.spots, start=1):
            place = (spot.x_mm, spot.y_mm)
            axes.plot(*place, "o", ms=9, mfc="none", mec=ALERT, mew=1.6, zorder=8)
            axes.annotate(
                f"{number}", place, xytext=(6, 5), textcoords="offset points", fontsize=9,
                color=ALERT, path_effects=[Stroke(linewidth=2.2, foreground="white"), Normal()],
                zorder=9,
            )  # fmt: skip
        bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
        bar.set_label("deployments whose body passes (%)")
        bar.outline.set_visible(False)
    return figure
