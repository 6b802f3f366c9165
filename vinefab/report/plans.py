"""Plans: a map, a robot deployed on it, and the sheet for the laser."""

from collections.abc import Iterable

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.patheffects import Normal, Stroke
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.model.deployment import Deployment, Stop
from vinefab.model.finding import Finding
from vinefab.model.job import Job, Operation
from vinefab.model.map import Map, Pose
from vinefab.report.colours import INK, ROCK, ROCK_EDGE, SOFT, level_colour
from vinefab.report.figure import house_style, plan_axes
from vinefab.report.stopwords import STOP_WORDS
from vinefab.report.view import Box, bounds_in, longer_mm, robot_view, rock_in

TIP_MARKERS = {Stop.FULL_LENGTH: "o", Stop.HEAD_ON: "X", Stop.CORNER: "^"}
MANY_TIPS = 100
"""From so many branches on, markers and lines are drawn finer."""

OPERATION_COLOURS = {
    Operation.MARK: "#000000",
    Operation.WELD: "#0000FF",
    Operation.WELDCUT: "#FF00FF",
    Operation.CUT: "#FF0000",
    Operation.REG: "#F36926",
    Operation.DOC: "#0C96D9",
}


def map_plan(world: Map, *, longest_in: float = 6.5) -> Figure:
    """Return a plan of a map with its starts."""
    with house_style():
        figure, axes = plan_axes(world.bounds.bounds, longest_in)
        draw_map(axes, world)
        for start in world.starts:
            draw_pose(axes, start.pose, max(world.size_mm))
    return figure


def deployment_plan(
    world: Map,
    deployment: Deployment,
    widths_mm: tuple[float, ...],
    *,
    longest_in: float = 6.5,
    legend: bool = True,
    named: bool = False,
) -> Figure:
    """Return a plan of a robot deployed on a map.

    Parameters
    ----------
    world, deployment
        What to draw.
    widths_mm
        Lay-flat width of each level; the body is drawn as wide as it inflates, 2 w / pi.
    longest_in
        Length of the longer side on paper.
    legend
        Whether to explain colours and markers.
    named
        Whether to write every branch's id beside it.
    """
    with house_style():
        box = robot_view(world, deployment)
        figure, axes = plan_axes(box, longest_in)
        draw_map(axes, world, box)
        draw_deployment(axes, deployment, widths_mm)
        draw_pose(axes, deployment.pose, longer_mm(box))
        if box != world.bounds.bounds:
            size = " x ".join(f"{side:g}" for side in world.size_mm)
            axes.set_title(f"part of {world.name}, {size} mm", fontsize=8, color=SOFT)
        if named:
            _draw_names(axes, deployment, longer_mm(box))
        if legend:
            draw_legend(axes)
    return figure


def draw_map(axes: Axes, world: Map, box: Box | None = None) -> None:
    """Draw the bounds and the obstacles of a map, or those in and around a box of it."""
    box = box or world.bounds.bounds
    fill(axes, rock_in(world, box), face=ROCK, edge=ROCK_EDGE)
    fill(axes, [bounds_in(world, box)], face="none", edge=INK)


def draw_deployment(axes: Axes, deployment: Deployment, widths_mm: tuple[float, ...]) -> None:
    """Draw body, centreline, contacts and tips of a deployment, coloured by level."""
    levels = deployment.tree.level
    size = 0.5 if len(levels) > MANY_TIPS else 1.0
    # Leaves first, so that the trunk lies on top; the legend says the trunk first.
    for level in range(int(levels.max()), 0, -1):
        members = np.flatnonzero((levels == level) & deployment.deployed)
        chains = [deployment.chain_mm(int(branch)) for branch in members]
        colour, rank = level_colour(level), 20 - level
        lines = [shapely.LineString(chain) for chain in chains if len(chain) > 1]
        body = shapely.union_all(shapely.buffer(lines, widths_mm[level - 1] / np.pi, quad_segs=8))
        fill(axes, [body], face=colour, edge=colour, alpha=0.3, rank=3)
        width_pt = size * max(1.0, 2.2 - 0.3 * level)
        axes.add_collection(
            LineCollection(chains, colors=colour, linewidths=width_pt, zorder=4 + rank / 100)
        )
        count = f"{len(members)} of {np.count_nonzero(levels == level)}"
        axes.plot([], [], color=colour, lw=2.4, label=f"level {level} ({count})", zorder=level)
    _draw_contacts(axes, deployment, size)
    _draw_tips(axes, deployment, size)


def draw_legend(axes: Axes) -> None:
    """Explain, below a plan, everything on it that has a label."""
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda i: (not labels[i].startswith("level"), labels[i]))
    width_in = axes.get_figure(root=True).get_figwidth()  # type: ignore[union-attr]
    axes.legend(
        [handles[i] for i in order],
        [labels[i] for i in order],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.09),
        ncols=max(1, min(4, int(width_in / (0.55 + 0.063 * max(map(len, labels)))))),
        fontsize=8,
    )


def job_plan(job: Job, findings: tuple[Finding, ...] = ()) -> Figure:
    """Return a plan of the sheet: every path in its operation's colour, starts and directions.

    Parameters
    ----------
    job
        The sheet.
    findings
        Not used for placing anything; listed in the title when some block the export.
    """
    with house_style():
        box = (0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
        figure, axes = plan_axes(box, 9.0)
        fill(axes, [shapely.box(*box)], face="#fbfcfd", edge=SOFT)
        named: set[Operation] = set()
        for number, path in enumerate(job.paths, start=1):
            points = path.contour.flattened_mm(0.05)
            if path.contour.closed:
                points = np.vstack([points, points[:1]])
            colour = OPERATION_COLOURS[path.operation]
            label = path.operation.layer if path.operation not in named else None
            named.add(path.operation)
            axes.plot(points[:, 0], points[:, 1], color=colour, linewidth=0.9, label=label)
            axes.plot(*points[0], marker="o", color=colour, markersize=3.5)
            _draw_direction(axes, points, colour)
            if path.operation.is_machined:
                axes.annotate(
                    str(number),
                    points[0],
                    fontsize=8,
                    color=colour,
                    xytext=(4, 4),
                    textcoords="offset points",
                )
        blocking = sum(finding.blocks for finding in findings)
        title = f"{job.name}: numbers give the order, dots the start of each path"
        axes.set_title(f"{title}; {blocking} blocking findings" if blocking else title, fontsize=9)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    return figure


def _draw_direction(axes: Axes, points: np.ndarray, colour: str) -> None:
    middle = len(points) // 2
    if len(points) < 3:
        return
    axes.annotate(
        "",
        points[middle + 1] if middle + 1 < len(points) else points[-1],
        points[middle],
        arrowprops={"arrowstyle": "->", "color": colour},
    )


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
        axes.plot([], [], " ", label=f"{STOP_WORDS[Stop.NOT_DEPLOYED]} ({lost})")


def _draw_names(axes: Axes, deployment: Deployment, view_mm: float) -> None:
    """Write every branch's id beside the middle of its last stretch."""
    tree, names = deployment.tree, deployment.tree.ids
    # Branches that share their fate lie on each other: their ids stand one after the other.
    together: dict[tuple[int, ...], list[int]] = {}
    for branch in np.flatnonzero(deployment.deployed).tolist():
        middle = deployment.chain_mm(branch)[-2:].mean(axis=0)
        cell = np.round(middle / (0.02 * view_mm)).astype(int).tolist()
        together.setdefault((int(tree.level[branch]), *cell), []).append(branch)
    for (level, *_), branches in together.items():
        first, last = deployment.chain_mm(branches[0])[-2:]
        angle = np.arctan2(*(last - first)[::-1])
        axes.annotate(
            ", ".join(names[branch] for branch in branches),
            tuple((first + last) / 2),
            xytext=(-7.0 * np.sin(angle), 7.0 * np.cos(angle)),
            textcoords="offset points",
            fontsize=6.5 if len(tree) <= MANY_TIPS else 4.5,
            color=level_colour(level),
            path_effects=[Stroke(linewidth=1.6, foreground="white"), Normal()],
            ha="center",
            va="center",
            zorder=8,
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


def fill(
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
