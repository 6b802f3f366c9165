"""A front of designs: what each is worth against what it costs, and how a few of them look."""

from collections.abc import Mapping
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vinefab.model.checked import Floats
from vinefab.model.deployment import Deployment
from vinefab.model.map import Map
from vinefab.report.colours import INK, LEVEL_COLOURS, SOFT
from vinefab.report.drawing import draw_deployment, draw_map
from vinefab.report.figure import house_style


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontData:
    """What the chart shows.

    Parameters
    ----------
    seen
        Cost and fitness of designs that the run evaluated, shape (m, 2).
    front
        Cost and score on fresh poses of the designs of the front, shape (k, 2), by rising cost.
    cost, unit
        Name of the cost and its unit.
    task
        Name of the score.
    """

    seen: Floats
    front: Floats
    cost: str
    unit: str
    task: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """One design of the front, deployed.

    Parameters
    ----------
    deployment
        Where it ended.
    widths_mm
        Lay-flat width of each level.
    title
        What it is called.
    """

    deployment: Deployment
    widths_mm: tuple[float, ...]
    title: str


def front_figure(data: FrontData, world: Map, robots: Mapping[int, Robot]) -> Figure:
    """Return the chart of a front with robots below it.

    Parameters
    ----------
    data
        The chart.
    world
        The map that the robots stand on.
    robots
        By their place on the front.
    """
    with house_style():
        columns = max(2, len(robots))
        figure = Figure(figsize=(2.6 * columns, 6.4), layout="constrained")
        grid = figure.add_gridspec(2, columns, height_ratios=(1.25, 1.0))
        chart = figure.add_subplot(grid[0, :])
        _chart(chart, data, robots)
        for column, (place, robot) in enumerate(robots.items()):
            axes = figure.add_subplot(grid[1, column])
            _robot(axes, world, robot, _label(place))
    return figure


def _label(place: int) -> str:
    return str(place + 1)


def _chart(axes: Axes, data: FrontData, robots: Mapping[int, Robot]) -> None:
    axes.plot(
        data.seen[:, 0],
        data.seen[:, 1],
        ".",
        color=SOFT,
        markersize=2.5,
        alpha=0.5,
        label="evaluated in the search",
        rasterized=True,
    )
    axes.step(
        data.front[:, 0],
        data.front[:, 1],
        "-o",
        where="post",
        color=LEVEL_COLOURS[0],
        markersize=4.5,
        label="front, on fresh poses",
    )
    for place in robots:
        axes.annotate(
            _label(place),
            data.front[place],
            xytext=(-5, 6),
            textcoords="offset points",
            ha="right",
            fontsize=10,
            fontweight="bold",
            color=INK,
        )
    unit = f" ({data.unit})" if data.unit else ""
    axes.set_xlabel(data.cost.replace("_", " ") + unit)
    axes.set_ylabel(f"{data.task} score (simulated)")
    axes.legend(fontsize=8, loc="lower right")
    axes.spines[["top", "right"]].set_visible(False)


def _robot(axes: Axes, world: Map, robot: Robot, label: str) -> None:
    draw_map(axes, world)
    draw_deployment(axes, robot.deployment, robot.widths_mm)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"{label}: {robot.title}", fontsize=8)
