"""Maps, robots, starts and legends, drawn into plans."""

from collections.abc import Iterable

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Map, Pose
from vinefab.pages.colours import INK, ROCK, ROCK_EDGE, SOFT, START, level_colour
from vinefab.pages.figure import house_style, plan_axes
from vinefab.pages.label_places import write_labels
from vinefab.pages.map_view import (
    STOP_WORDS,
    Box,
    StartMark,
    bounds_in,
    longer_mm,
    lost_places,
    robot_view,
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


def draw_deployment(axes: Axes, deployment: Deployment, widths_mm: tuple[float, ...]) -> None:
    """Draw body, centreline, contacts and tips of a deployment, coloured by level.

    Parameters
    ----------
    widths_mm
        Lay-flat width of each level; 0 where the body is a line.
    """
    levels = deployment.tree.level
    size = 0.5 if len(levels) > MANY_TIPS else 1.0
    # Leaves first, so that the trunk lies on top; the legend says the trunk first.
    for level in range(int(levels.max()), 0, -1):
        members = np.flatnonzero((levels == level) & deployment.deployed)
        chains = [deployment.chain_mm(int(branch)) for branch in members]
        colour, rank = level_colour(level), 20 - level
        lines = [shapely.LineString(chain) for chain in chains if len(chain) > 1]
        if radius_mm := widths_mm[level - 1] / np.pi:
            body = shapely.union_all(shapely.buffer(lines, radius_mm, quad_segs=8))
            fill_geometry(axes, [body], face=colour, edge=colour, alpha=0.3, rank=3)
        width_pt = size * max(1.0, 2.2 - 0.3 * level)
        axes.add_collection(
            LineCollection(chains, colors=colour, linewidths=width_pt, zorder=4 + rank / 100)
        )
        count = f"{len(members)} of {np.count_nonzero(levels == level)}"
        axes.plot([], [], color=colour, lw=2.4, label=f"level {level} ({count})", zorder=level)
    if not any(widths_mm):
        axes.plot([], [], color=SOFT, lw=1.2, label="body: a line without width")
    _draw_contacts(axes, deployment, size)
    _draw_tips(axes, deployment, size)


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


def _draw_contacts(axes: Axes, deployment: Deployment, size: float) -> None:
    contacts = [deployment.contacts_mm(branch) for branch in range(len(deployment.tree))]
    points = np.concatenate(contacts) if contacts else np.empty((0, 2))
    if len(points):
        label = f"contact ({len(points)})"
        axes.plot(*points.T, "D", color=INK, markersize=3.0 * size, mew=0, zorder=5, label=label)


def _draw_tips(axes: Axes, deployment: Deployment, size: float) -> None:
    tips, stops = deployment.tips_mm, deployment.stop[deployment.deployed]
    for stop, marker in TIP_MARKERS.items():
        here = tips[stops == stop]
        if len(here):
            # Open for what grew as planned, solid for what a wall stopped: seen before it is read.
            full = stop == Stop.FULL_LENGTH
            axes.plot(
                *here.T,
                marker,
                color=INK,
                markersize=4.5 * size if full else 4.0 + 2.5 * size,
                mfc="white" if full else INK,
                mec=INK if full else "white",
                mew=0.8 * size,
                zorder=6 if full else 6.5,
                label=f"{STOP_WORDS[stop]} ({len(here)})",
            )
    lost = int(np.count_nonzero(~deployment.deployed))
    if lost:
        axes.plot(
            *np.array([place.at_mm for place in lost_places(deployment)]).T,
            "o",
            color=INK,
            markersize=9.0 * size,
            mfc="none",
            mew=0.9 * size,
            zorder=6.2,
            label=f"{STOP_WORDS[Stop.NOT_DEPLOYED]} ({lost})",
        )


def draw_names(axes: Axes, deployment: Deployment) -> None:
    """Write every branch's id beside the middle of its last stretch; axes are else complete."""
    tree, out = deployment.tree, np.flatnonzero(deployment.deployed).tolist()
    # Branches that share their fate lie on each other: one label has the ids of all of them.
    together: dict[tuple[float, ...], list[int]] = {}
    for branch in out:
        ends = tuple(np.round(deployment.chain_mm(branch)[-2:].ravel(), 2).tolist())
        together.setdefault(ends, []).append(branch)
    shared = list(together.values())
    write_labels(
        axes,
        np.array([deployment.chain_mm(some[0])[-2:].mean(axis=0) for some in shared]),
        [", ".join(tree.ids[branch] for branch in some) for some in shared],
        [level_colour(int(tree.level[some[0]])) for some in shared],
        size_pt=6.5 if len(tree) <= MANY_TIPS else 4.5,
        mark_pt=1.5,
        lines=[deployment.chain_mm(branch) for branch in out],
    )


def draw_targets(axes: Axes, targets_mm: Floats) -> None:
    """Draw points that robots are to reach as crossed circles, shape (t, 2)."""
    if not len(targets_mm):
        return
    for marker, size, label in (("o", 7.0, "target"), ("+", 9.0, "")):
        axes.plot(
            *targets_mm.T,
            marker,
            color=INK,
            markersize=size,
            fillstyle="none",
            mew=1.1,
            zorder=6,
            label=label,
        )


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


def map_plan(world: Map, *, targets_mm: Floats | None = None, longest_in: float = 6.5) -> Figure:
    """Return a plan of a map with its starts, and with targets, shape (t, 2), if there are any."""
    with house_style():
        figure, axes = plan_axes(world.bounds.bounds, longest_in)
        draw_map(axes, world)
        for start in world.starts:
            draw_pose(axes, start.pose, max(world.size_mm))
        if targets_mm is not None:
            draw_targets(axes, targets_mm)
        if world.starts or targets_mm is not None:
            draw_legend(axes)
    return figure


def deployment_plan(  # noqa: PLR0913  options by keyword
    world: Map,
    deployment: Deployment,
    widths_mm: tuple[float, ...],
    *,
    longest_in: float = 6.5,
    named: bool = False,
    whole: bool = False,
    targets_mm: Floats | None = None,
) -> Figure:
    """Return a plan of a robot deployed on a map, with targets, shape (t, 2), if there are any."""
    with house_style():
        box = world.bounds.bounds if whole else robot_view(world, deployment)
        figure, axes = plan_axes(box, longest_in)
        draw_map(axes, world, box)
        draw_deployment(axes, deployment, widths_mm)
        draw_pose(axes, deployment.pose, longer_mm(box))
        if targets_mm is not None:
            draw_targets(axes, targets_mm)
        if box != world.bounds.bounds:
            size = " x ".join(f"{side:g}" for side in world.size_mm)
            axes.set_title(f"part of {world.name}, {size} mm", fontsize=8, color=SOFT)
        draw_legend(axes)
        if named:
            draw_names(axes, deployment)
    return figure
