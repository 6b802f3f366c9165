"""Maps, starts and legends, drawn into matplotlib's axes: for rigs and the charts of studies."""

from collections.abc import Iterable

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.model.deployment import Stop
from vinefab.model.map import Map, Pose
from vinefab.pages.colours import INK, ROCK, ROCK_EDGE, START
from vinefab.pages.map_view import (
    Box,
    StartMark,
    bounds_in,
    rock_in,
    start_marks,
)

TIP_MARKERS = {Stop.FULL_LENGTH: "o", Stop.HEAD_ON: "X", Stop.CORNER: "^", Stop.PRESSURE: "s"}

_FOOT_IN = 0.58
"""Room below a plan for the axis, before the legend begins."""

RANGE_LABEL = "range of starts"

BODY_IS_LINE = "Bodies are lines: this growth model gives them no width"

MANY_TIPS = 100
"""From so many branches on, markers and lines are drawn finer."""


def draw_map(axes: Axes, world: Map, box: Box | None = None) -> None:
    """Draw the bounds and the obstacles of a map, or those in and around a box of it.

    So are the ranges of its starts. Axes without limits of their own are set to show it.
    """
    box = box or world.bounds.bounds
    fill_geometry(axes, rock_in(world, box), face=ROCK, edge=ROCK_EDGE)
    fill_geometry(axes, [bounds_in(world, box)], face="none", edge=INK)
    for mark in start_marks(world, box):
        draw_start_range(axes, mark)
    axes.autoscale_view()


def draw_start_range(axes: Axes, mark: StartMark) -> None:
    """Draw where poses are drawn from: all dashed, what is free filled, headings as a fan.

    The pose itself is `draw_pose`.
    """
    if mark.fan is not None:
        fill_geometry(axes, [mark.fan], face=START, edge="none", alpha=0.28, rank=2.6)
    if mark.whole is None:
        axes.plot([], [], color=START, label=RANGE_LABEL if mark.fan is not None else "")
        return
    free = [piece for piece in mark.free if isinstance(piece, Polygon)]
    fill_geometry(axes, free, face=START, edge="none", alpha=0.28, rank=2.5)
    for piece in mark.free:
        if not isinstance(piece, Polygon):
            points = shapely.get_coordinates(piece)
            axes.plot(*points.T, color=START, lw=4.0, alpha=0.55, zorder=2.5)
    for line in shapely.get_rings(mark.whole) if isinstance(mark.whole, Polygon) else [mark.whole]:
        points = shapely.get_coordinates(line)
        axes.plot(*points.T, color=START, lw=0.9, ls=(0, (4, 3)), zorder=2.7, label=RANGE_LABEL)


def draw_legend(axes: Axes) -> None:
    """Explain, below a plan, everything on it that has a label."""
    entries = legend_entries(axes)
    labels = [words for words, _ in entries]
    width_in, height_in = axes.get_figure(root=True).get_size_inches()  # type: ignore[union-attr]
    axes.legend(
        [symbol for _, symbol in entries],
        labels,
        loc="upper center",
        bbox_to_anchor=(0.5, -_FOOT_IN / max(0.5, height_in - 0.9)),
        ncols=max(1, min(4, int(width_in / (0.55 + 0.063 * max(map(len, labels)))))),
        fontsize=8,
    )


def legend_entries(axes: Axes) -> list[tuple[str, Artist]]:
    """Return what is to be explained and its symbol, levels first; of several starts, the first."""
    handles, labels = axes.get_legend_handles_labels()
    first: dict[str, Artist] = dict(zip(reversed(labels), reversed(handles), strict=True))
    if RANGE_LABEL in first:  # areas and fans are filled, with or without a dashed edge
        first[RANGE_LABEL] = Patch(fc=to_rgba(START, 0.28), ec=START, ls="--", lw=0.9)
    return sorted(first.items(), key=lambda entry: (not entry[0].startswith("level"), entry[0]))


def draw_pose(axes: Axes, pose: Pose, view_mm: float) -> None:
    """Draw a start in a plan of some size: a dot, and an arrow where the trunk is launched."""
    reach = 0.055 * view_mm
    towards = np.array([np.cos(pose.heading_rad), np.sin(pose.heading_rad)])
    base = np.array([pose.x_mm, pose.y_mm])
    axes.annotate(
        "",
        tuple(base + reach * towards),
        tuple(base),
        arrowprops={
            "arrowstyle": "-|>",
            "color": INK,
            "linewidth": 1.8,
            "shrinkA": 0,
            "mutation_scale": 15,
        },
        zorder=7,
    )
    axes.plot(*base, "o", color=INK, markersize=5, mec="white", mew=0.8, zorder=7, label="start")


def fill_geometry(
    axes: Axes,
    shapes: Iterable[BaseGeometry],
    *,
    face: str,
    edge: str,
    alpha: float = 1.0,
    rank: float = 1.0,
) -> None:
    """Fill polygons, holes left open, as one path: thousands of them stay quick and small."""
    parts = shapely.get_parts(list(shapes))
    polygons = [part for part in parts if isinstance(part, Polygon) and not part.is_empty]
    rings = [ring for part in polygons for ring in (part.exterior, *part.interiors)]
    if rings:
        path = Outline.make_compound_path(*(Outline(ring.coords, closed=True) for ring in rings))
        # A thin face keeps a full edge: the edge is what a grey print shows.
        inside = face if face == "none" else to_rgba(face, alpha)
        axes.add_patch(PathPatch(path, fc=inside, ec=edge, lw=0.7, zorder=rank))
