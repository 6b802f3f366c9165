"""Plans: a map, a robot deployed on it, and the sheet for the laser."""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vinefab.model.deployment import Deployment
from vinefab.model.finding import Finding
from vinefab.model.job import Job, Operation
from vinefab.model.map import Map
from vinefab.report.colours import SOFT
from vinefab.report.drawing import (
    draw_deployment,
    draw_legend,
    draw_map,
    draw_names,
    draw_pose,
    fill,
)
from vinefab.report.figure import house_style, plan_axes
from vinefab.report.view import longer_mm, robot_view

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
            draw_names(axes, deployment, longer_mm(box))
        if legend:
            draw_legend(axes)
    return figure


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
