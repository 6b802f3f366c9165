"""Panels on axes of Matplotlib: the same shapes, colours and signs, in the panel's own units."""

from typing import Any

import numpy as np
from matplotlib import patheffects, pyplot
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from vinefab.core.validation import Floats
from vinefab.pages.panel import (
    OPEN_SIGNS,
    SIGNS,
    Ink,
    Marks,
    Panel,
    Primitive,
    Raster,
    Shape,
    Words,
)

_SAME_SCALE = 1e-3


def plot_panel(panel: Panel, ax: Axes | None = None, *, legend: bool = True) -> Axes:
    """Draw a panel on axes and return them.

    Parameters
    ----------
    ax
        The axes; None: new ones in a figure of the panel's size.
    legend
        Whether to explain the signs below.
    """
    if ax is None:
        points = 72.0
        size = (panel.width_pt + 90.0) / points, (panel.height_pt + 90.0) / points
        _, ax = pyplot.subplots(figsize=size, layout="constrained")
    for place, primitive in enumerate(panel.primitives):
        _draw(ax, primitive, 1.0 + 1e-4 * place)
    x0, y0, x1, y1 = panel.box
    ax.set(xlim=(x0, x1), ylim=(y0, y1), xlabel=panel.x_name, ylabel=panel.y_name)
    across, up = panel.width_pt / (x1 - x0), panel.height_pt / (y1 - y0)
    if abs(across - up) < _SAME_SCALE * across:
        ax.set_aspect("equal")
    for ticks, write in ((panel.x_ticks, ax.set_xticks), (panel.y_ticks, ax.set_yticks)):
        if ticks is not None:
            write([value for value, _ in ticks], [words for _, words in ticks])
    ax.set_title(panel.title, color=panel.title_colour, loc="left", fontsize="medium")
    if legend and panel.legend_shown and panel.legend:
        signs = [_symbol(primitive, words) for words, primitive in panel.legend.items()]
        ax.legend(handles=signs, loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize="small")
    return ax


def _draw(ax: Axes, primitive: Primitive, rank: float) -> None:
    if isinstance(primitive, Shape):
        chains = [chain for chain in primitive.chains if len(chain) > 1]
        if chains:
            path = Path.make_compound_path(*(_path(c, closed=primitive.closed) for c in chains))
            patch = PathPatch(path, **_painted(primitive.ink), zorder=rank, clip_on=True)
            patch.set_capstyle("butt" if primitive.ink.butt else "round")
            ax.add_patch(patch)
    elif isinstance(primitive, Marks):
        if len(primitive.points):
            ax.add_line(Line2D(*primitive.points.T, **_signed(primitive), zorder=rank))
    elif isinstance(primitive, Raster):
        x0, y0, x1, y1 = primitive.box
        ax.imshow(primitive.pixels, extent=(x0, x1, y0, y1), zorder=rank, aspect="auto")
    else:
        _write(ax, primitive, rank)


def _write(ax: Axes, words: Words, rank: float) -> None:
    text = ax.annotate(
        words.text.replace("$", r"\$"),
        xy=words.at,
        xytext=words.shift_pt,
        textcoords="offset points",
        fontsize=words.size_pt,
        color=words.colour,
        ha={"start": "left", "middle": "center", "end": "right"}[words.anchor],
        va="center",
        rotation=90.0 if words.turned else 0.0,
        weight="bold" if words.bold else "normal",
        zorder=rank,
        annotation_clip=True,
    )
    if words.halo:
        text.set_path_effects([patheffects.withStroke(linewidth=2.0, foreground="white")])


def _path(points: Floats, *, closed: bool) -> Path:
    if not closed:
        return Path(points)
    ring = np.vstack([points, points[:1]])
    codes = [Path.MOVETO, *[Path.LINETO] * (len(points) - 1), Path.CLOSEPOLY]
    return Path(ring, codes)


def _painted(ink: Ink) -> dict[str, Any]:
    """Return colours and line of a patch."""
    wide = ink.width_pt if ink.line else 0.0
    dash = tuple(one / max(wide, 1e-9) for one in ink.dash_pt)
    return {
        "facecolor": to_rgba(ink.fill, ink.fill_alpha) if ink.fill else "none",
        "edgecolor": to_rgba(ink.line, ink.line_alpha) if ink.line else "none",
        "linewidth": wide,
        "linestyle": (0.0, dash) if dash and wide else "solid",
    }


def _signed(marks: Marks) -> dict[str, Any]:
    """Return the sign of a line of points."""
    ink, is_open = marks.ink, marks.sign in OPEN_SIGNS
    marker: Any = "o"
    size_pt = marks.size_pt
    if marks.sign != "o":
        corners = SIGNS[marks.sign] * (1.0, -1.0)  # its y runs down
        marker = _path(corners, closed=not is_open)
        size_pt *= 2.0 * float(np.abs(corners).max())
    return {
        "linestyle": "none",
        "marker": marker,
        "markersize": size_pt,
        "markerfacecolor": to_rgba(ink.fill, ink.fill_alpha) if ink.fill else "none",
        "markeredgecolor": to_rgba(ink.line, ink.line_alpha) if ink.line else "none",
        "markeredgewidth": ink.width_pt if ink.line else 0.0,
    }


def _symbol(primitive: Primitive, words: str) -> Artist:
    """Return the entry of a primitive in the legend."""
    if isinstance(primitive, Marks):
        return Line2D([], [], **_signed(primitive), label=words)
    ink = primitive.ink if isinstance(primitive, Shape) else Ink()
    if isinstance(primitive, Shape) and primitive.closed:
        return Patch(**_painted(ink), label=words)
    return Line2D([], [], color=ink.line or "black", linewidth=ink.width_pt, label=words)
