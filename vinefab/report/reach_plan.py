"""Plans of what robots reach, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from vinefab.model.deployment import Deployment
from vinefab.model.map import Map
from vinefab.report.colours import INK, LEVEL_COLOURS, level_colour
from vinefab.report.drawing import draw_map, draw_pose, fill
from vinefab.report.figure import house_style


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """One plan.

    Parameters
    ----------
    title
        What it shows.
    world
        The map.
    deployments
        Robots on it, drawn together.
    buffer_mm
        Distance from their bodies that is shaded; 0: none.
    """

    title: str
    world: Map
    deployments: tuple[Deployment, ...]
    buffer_mm: float = 0.0


def reach_plan(panels: Sequence[Panel], columns: int = 2) -> Figure:
    """Return plans in rows.

    Parameters
    ----------
    panels
        At least one.
    columns
        Plans in a row.
    """
    rows = -(-len(panels) // columns)
    with house_style():
        figure = Figure(figsize=(4.2 * columns, 4.4 * rows), layout="constrained")
        places = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, panel in zip(places, panels, strict=False):
            _draw(axes, panel)
        for axes in places[len(panels) :]:
            axes.set_axis_off()
    return figure


def _draw(axes: Axes, panel: Panel) -> None:
    if panel.buffer_mm > 0.0:
        lines = [chain for robot in panel.deployments for chain in _chains(robot)]
        near = shapely.union_all(
            shapely.buffer([shapely.LineString(line) for line in lines], panel.buffer_mm)
        )
        reached = shapely.intersection(near, panel.world.free_space)
        fill(axes, [reached], face=LEVEL_COLOURS[5], edge="none", alpha=0.45, rank=0.5)
    draw_map(axes, panel.world)
    for robot in panel.deployments:
        _draw_robot(axes, robot)
    draw_pose(axes, panel.deployments[0].pose, max(panel.world.size_mm))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(panel.title, fontsize=9, color=INK)


def _draw_robot(axes: Axes, robot: Deployment) -> None:
    for level in range(int(robot.tree.level.max()), 0, -1):
        members = np.flatnonzero((robot.tree.level == level) & robot.deployed)
        chains = [robot.chain_mm(int(branch)) for branch in members]
        width_pt = max(0.6, 2.2 - 0.4 * level)
        axes.add_collection(
            LineCollection(
                chains, colors=level_colour(level), linewidths=width_pt, zorder=4.2 - 0.1 * level
            )
        )


def _chains(robot: Deployment) -> list[list[list[float]]]:
    return [robot.chain_mm(int(branch)).tolist() for branch in np.flatnonzero(robot.deployed)]
