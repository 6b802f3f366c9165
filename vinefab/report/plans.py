"""Plans: a map, a robot deployed on it, and the sheet for the laser."""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.model.deployment import Deployment, Stop
from vinefab.model.finding import Finding
from vinefab.model.job import Job, Operation
from vinefab.model.map import Map
from vinefab.report.figure import INK, LEVEL_COLOURS, ROCK, ROCK_EDGE, SOFT, house_style, plan_axes

TIP_MARKERS = {Stop.FULL_LENGTH: "o", Stop.HEAD_ON: "X", Stop.CORNER: "^"}
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
            _draw_pose(axes, start.pose.x_mm, start.pose.y_mm, start.pose.heading_rad, world)
    return figure


def deployment_plan(
    world: Map,
    deployment: Deployment,
    widths_mm: tuple[float, ...],
    *,
    longest_in: float = 6.5,
    legend: bool = True,
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
    """
    with house_style():
        figure, axes = plan_axes(world.bounds.bounds, longest_in)
        draw_map(axes, world)
        draw_deployment(axes, deployment, widths_mm)
        pose = deployment.pose
        _draw_pose(axes, pose.x_mm, pose.y_mm, pose.heading_rad, world)
        if legend:
            # Levels are drawn leaves first, so that the trunk lies on top; people read trunk first.
            handles, labels = axes.get_legend_handles_labels()
            order = sorted(
                range(len(labels)), key=lambda i: (not labels[i].startswith("level"), labels[i])
            )
            axes.legend(
                [handles[i] for i in order],
                [labels[i] for i in order],
                loc="upper center",
                bbox_to_anchor=(0.5, -0.09),
                ncols=4,
                fontsize=8,
            )
    return figure


def draw_map(axes: Axes, world: Map) -> None:
    """Draw the bounds and the obstacles of a map."""
    _fill(axes, shapely.box(*world.bounds.bounds) - world.bounds, ROCK, ROCK_EDGE)
    for obstacle in world.obstacles:
        _fill(axes, obstacle, ROCK, ROCK_EDGE)
    _fill(axes, world.bounds, "none", INK)


def draw_deployment(axes: Axes, deployment: Deployment, widths_mm: tuple[float, ...]) -> None:
    """Draw body, centreline, contacts and tips of a deployment, coloured by level."""
    levels = deployment.tree.level
    for level in range(int(levels.max()), 0, -1):
        members = np.flatnonzero((levels == level) & deployment.deployed)
        chains = [deployment.chain_mm(int(branch)) for branch in members]
        colour = LEVEL_COLOURS[(level - 1) % len(LEVEL_COLOURS)]
        lines = [shapely.LineString(chain) for chain in chains if len(chain) > 1]
        body = shapely.union_all(shapely.buffer(lines, widths_mm[level - 1] / np.pi, quad_segs=8))
        _fill(axes, body, colour, "none", alpha=0.25)
        axes.add_collection(LineCollection(chains, colors=colour, linewidths=1.4, zorder=4))
        axes.plot([], [], color=colour, label=f"level {level}")
    _draw_contacts(axes, deployment)
    _draw_tips(axes, deployment)


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
        _fill(axes, shapely.box(*box), "#fbfcfd", SOFT)
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


def _draw_contacts(axes: Axes, deployment: Deployment) -> None:
    contacts = [deployment.contacts_mm(branch) for branch in range(len(deployment.tree))]
    points = np.concatenate(contacts) if contacts else np.empty((0, 2))
    if len(points):
        axes.plot(*points.T, "s", color=INK, markersize=2.6, zorder=5, label="contact")


def _draw_tips(axes: Axes, deployment: Deployment) -> None:
    tips, stops = deployment.tips_mm, deployment.stop[deployment.deployed]
    for stop, marker in TIP_MARKERS.items():
        here = tips[stops == stop]
        if len(here):
            label = f"{stop.label} ({len(here)})"
            axes.plot(*here.T, marker, color=INK, markersize=4, zorder=6, mfc="white", label=label)
    lost = int(np.count_nonzero(~deployment.deployed))
    if lost:
        axes.plot([], [], " ", label=f"not_deployed ({lost})")


def _draw_pose(axes: Axes, x_mm: float, y_mm: float, heading_rad: float, world: Map) -> None:
    reach = 0.035 * max(world.size_mm)
    axes.annotate(
        "",
        (x_mm + reach * np.cos(heading_rad), y_mm + reach * np.sin(heading_rad)),
        (x_mm, y_mm),
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.4},
        zorder=7,
    )
    axes.plot(x_mm, y_mm, "o", color=INK, markersize=4, zorder=7)


def _fill(axes: Axes, shape: BaseGeometry, face: str, edge: str, alpha: float = 1.0) -> None:
    for polygon in shapely.get_parts(shape):
        if isinstance(polygon, Polygon) and not polygon.is_empty:
            rings = [polygon.exterior, *polygon.interiors]
            path = Outline.make_compound_path(
                *(Outline(ring.coords, closed=True) for ring in rings)
            )
            axes.add_patch(PathPatch(path, fc=face, ec=edge, lw=0.7, alpha=alpha))
