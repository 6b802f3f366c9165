"""Pages as PDF, through matplotlib: for drawings that are printed."""

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path

from vinefab.core.file_mark import ROOMY_GENERATOR
from vinefab.pages.figure import house_style
from vinefab.pages.panel import MIDDLE, OPEN_SIGNS, SIGNS, Ink, Marks, Page, Raster, Shape, Words


def page_pdf(page: Page) -> bytes:
    """Return a page as PDF; the same page gives the same bytes."""
    stream, wide, high = io.BytesIO(), page.width_pt, page.height_pt
    with house_style():
        figure = Figure(figsize=(wide / 72.0, high / 72.0))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.axis("off")
        rank = 0
        for layer in page.layers:
            clip = None
            if layer.window is not None:
                x, y, right, low = layer.window
                clip = Rectangle((x, y), right - x, low - y, transform=axes.transData)
            for primitive in layer.primitives:
                rank += 1
                if isinstance(primitive, Words):
                    _write(axes, primitive, rank)
                elif isinstance(primitive, Raster):
                    x0, y0, x1, y1 = primitive.box
                    image = axes.imshow(primitive.pixels, extent=(x0, x1, y1, y0), zorder=rank)
                    image.set_clip_path(clip)
                else:
                    for path, ink in _paths(primitive):
                        patch = _patch(path, ink, rank)
                        axes.add_patch(patch)
                        patch.set_clip_path(clip)
        axes.set(xlim=(0.0, wide), ylim=(high, 0.0), aspect="auto")
        metadata = {"CreationDate": None, "Creator": ROOMY_GENERATOR}
        figure.savefig(stream, format="pdf", metadata=metadata)
    return stream.getvalue()


def _paths(primitive: Shape | Marks) -> list[tuple[Path, Ink]]:
    """Return a primitive as one path and how it is painted."""
    if isinstance(primitive, Shape):
        chains = [chain for chain in primitive.chains if len(chain)]
        if primitive.closed:
            chains = [np.vstack([chain, chain[:1]]) for chain in chains]
        parts = [Path(chain, closed=primitive.closed) for chain in chains]
    elif primitive.sign == "o":
        ring = Path.unit_circle()
        places = primitive.size_pt / 2.0 * np.asarray(ring.vertices)
        parts = [Path(places + point, ring.codes) for point in primitive.points]
    else:
        corners = primitive.size_pt * SIGNS[primitive.sign]
        strokes = [np.vstack([corners, corners[:1]])]
        if primitive.sign in OPEN_SIGNS:
            strokes = [corners[:2], corners[3:]]
        parts = [Path(stroke + point) for point in primitive.points for stroke in strokes]
    return [(Path.make_compound_path(*parts), primitive.ink)] if parts else []


def _patch(path: Path, ink: Ink, rank: int) -> PathPatch:
    return PathPatch(
        path,
        fc=to_rgba(ink.fill, ink.fill_alpha) if ink.fill else "none",
        ec=to_rgba(ink.line, ink.line_alpha) if ink.line else "none",
        lw=ink.width_pt if ink.line else 0.0,
        ls=(0.0, tuple(part / ink.width_pt for part in ink.dash_pt)) if ink.dash_pt else "-",
        capstyle="butt" if ink.butt or ink.dash_pt else "round",
        joinstyle="round",
        zorder=rank,
    )


def _write(axes: Axes, words: Words, rank: int) -> None:
    x, y = words.at[0] + words.shift_pt[0], words.at[1] - words.shift_pt[1]
    low = MIDDLE * words.size_pt
    axes.text(
        x + low if words.turned else x,
        y if words.turned else y + low,
        words.text,
        fontsize=words.size_pt,
        color=words.colour,
        ha={"start": "left", "middle": "center", "end": "right"}[words.anchor],
        va="center" if words.turned else "baseline",
        rotation=90.0 if words.turned else 0.0,
        fontweight="bold" if words.bold else "normal",
        zorder=rank,
    )
