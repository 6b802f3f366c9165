"""Plans: a map, a robot deployed on it, and the sheet for the laser."""

from matplotlib.figure import Figure

from vinefab.model.deployment import Deployment
from vinefab.model.map import Map
from vinefab.report.colours import SOFT
from vinefab.report.drawing import (
    draw_deployment,
    draw_legend,
    draw_map,
    draw_names,
    draw_pose,
)
from vinefab.report.figure import house_style, plan_axes
from vinefab.report.view import longer_mm, robot_view


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
    named: bool = False,
    whole: bool = False,
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
    named
        Whether to write every branch's id beside it.
    whole
        Whether to show the whole map, however small the robot is on it.
    """
    with house_style():
        box = world.bounds.bounds if whole else robot_view(world, deployment)
        figure, axes = plan_axes(box, longest_in)
        draw_map(axes, world, box)
        draw_deployment(axes, deployment, widths_mm)
        draw_pose(axes, deployment.pose, longer_mm(box))
        if box != world.bounds.bounds:
            size = " x ".join(f"{side:g}" for side in world.size_mm)
            axes.set_title(f"part of {world.name}, {size} mm", fontsize=8, color=SOFT)
        if named:
            draw_names(axes, deployment, longer_mm(box))
        draw_legend(axes)
    return figure
