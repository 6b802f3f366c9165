"""The front of a run with several objectives as designs, JSON, text and a figure."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.jsontext import json_text
from vinefab.core.validation import Floats
from vinefab.growth.simulator import grow
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import ORIGIN_GROWTH, ORIGIN_RECIPE, Design
from vinefab.model.files.design_toml import design_text
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.pages.colours import INK, LEVEL_COLOURS, SOFT
from vinefab.pages.drawing import draw_deployment, draw_map, draw_targets, legend_entries
from vinefab.pages.figure import house_style, png_bytes, svg_bytes
from vinefab.pages.label_places import write_labels
from vinefab.search.costs import COSTS
from vinefab.search.front import LEAST_BEND, feasible_points, knee, minimized, non_dominated
from vinefab.search.record.result import RunResult
from vinefab.search.run import training_maps
from vinefab.search.settings import RunSettings, targets_mm
from vinefab.search.space import Space


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontData:
    """The data of the chart."""

    further: str  # name of the further objective that it is drawn over
    is_line: bool  # whether there is no third objective, so that the front is a line
    evaluated: Floats  # its value and fitness in the search, on training poses, shape (m, 2)
    front: Floats  # the same on fresh poses, for the front from its cheap end on, (k, 2)
    task: str  # name of the score
    targets_mm: Floats = field(default_factory=lambda: np.empty((0, 2)))  # drawn on maps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontRobot:
    """One design of the front, deployed."""

    deployment: Deployment
    widths_mm: tuple[float, ...]  # lay-flat width of each level, as drawn
    title: str


def front_figure(data: FrontData, world: Map, robots: Mapping[int, FrontRobot]) -> Figure:
    """Return the chart of a front with robots below it."""
    with house_style():
        columns = max(2, len(robots))
        figure = Figure(figsize=(2.6 * columns, 6.4), layout="constrained")
        grid = figure.add_gridspec(2, columns, height_ratios=(1.25, 1.0))
        chart = figure.add_subplot(grid[0, :])
        _chart(chart, data)
        for column, (place, robot) in enumerate(robots.items()):
            axes = figure.add_subplot(grid[1, column])
            _robot(axes, world, robot, _label(place))
            draw_targets(axes, data.targets_mm)
        _explain(figure, figure.axes[1:])
        _number(chart, data, robots)
    return figure


def _explain(figure: Figure, plans: Sequence[Axes]) -> None:
    """Explain below the plans, once, what the symbols on all of them mean."""
    found: dict[str, Artist] = {}
    for axes in plans:
        for words, handle in legend_entries(axes):
            found.setdefault(re.sub(r" \(.*\)$", "", words), handle)
    figure.legend(
        list(found.values()), list(found), loc="outside lower center", ncols=5, fontsize=8
    )


def _label(place: int) -> str:
    return str(place + 1)


def _chart(axes: Axes, data: FrontData) -> None:
    axes.plot(
        data.evaluated[:, 0],
        data.evaluated[:, 1],
        "x",
        color=SOFT,
        markersize=3.0,
        alpha=0.45,
        label="in the search, on training poses",
        rasterized=True,
    )
    axes.step(
        data.front[:, 0],
        data.front[:, 1],
        "-o" if data.is_line else "o",
        where="post",
        color=LEVEL_COLOURS[0],
        markersize=5.5,
        label="the front, scored again on fresh poses",
    )
    axes.set_xlabel(_axis_text(data.further))
    axes.set_ylabel(f"{data.task} score (simulated)")
    # Above the chart: points may lie anywhere in it.
    axes.legend(
        fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.0,
        title="Scores of one kind compare with each other only:", title_fontsize=8,
        alignment="left",
    )  # fmt: skip
    axes.spines[["top", "right"]].set_visible(False)


def _number(axes: Axes, data: FrontData, robots: Mapping[int, FrontRobot]) -> None:
    """Write the numbers of the robots that are drawn at their points; all else is drawn."""
    words, places = [_label(place) for place in robots], data.front[list(robots)]
    steps = np.repeat(data.front, 2, axis=0)
    corners = np.column_stack([steps[1:, 0], steps[:-1, 1]])
    lines = [corners] if data.is_line else []
    write_labels(axes, places, words, [INK] * len(words), size_pt=11.0, mark_pt=4.0, lines=lines)


def _axis_text(name: str) -> str:
    if name not in COSTS:
        return f"{name} score (simulated)"
    unit = f" ({COSTS[name].unit})" if COSTS[name].unit else ""
    return name.replace("_", " ") + unit


def _robot(axes: Axes, world: Map, robot: FrontRobot, label: str) -> None:
    draw_map(axes, world)
    draw_deployment(axes, robot.deployment, robot.widths_mm)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"{label}: {robot.title}", fontsize=8)


FRONT_SCHEMA = "vinefab/front-1"
MOST_ROBOTS = 4
"""Most designs of the front that are drawn, the knee among them if there is one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontMember:
    """One design of a front."""

    design: Design  # named after the run, with its place on the front
    score: Score  # on fresh poses
    fitness: float  # on fresh poses
    further: tuple[float, ...]  # values of the run's further objectives, in their order
    penalty: float  # 0 if manufacturable, or not checked, and within the limits
    is_knee: bool  # against the run's `front_axis`; a front may have no knee


def front_of(result: RunResult, settings: RunSettings) -> tuple[FrontMember, ...]:
    """Return the finalists that are non-dominated on fresh poses, the cheapest first.

    In a run without costs the one with the best score in the first other task is the first.
    """
    finalists = result.finalists
    fitness = np.array([finalist.fitness for finalist in finalists])
    space, names = Space(settings.space, settings.build), settings.further_objectives
    scores = {
        other.name: np.array([f.score.composite[other.name] for f in finalists])
        for other in settings.other_tasks
    }
    costs = minimized(np.array([f.x for f in finalists]), scores, space, names)
    signs = np.array([1.0 if name in COSTS else -1.0 for name in names])
    along = costs[:, names.index(settings.front_axis)]
    rows = np.flatnonzero(non_dominated(fitness, costs))
    rows = rows[np.argsort(along[rows], kind="stable")]
    bend = knee(fitness[rows], along[rows])
    return tuple(
        FrontMember(
            design=_named(finalists[row].design, settings, result, place + 1),
            score=finalists[row].score,
            fitness=float(fitness[row]),
            further=tuple((signs * costs[row]).tolist()),
            penalty=finalists[row].penalty,
            is_knee=place == bend,
        )
        for place, row in enumerate(rows.tolist())
    )


def _named(design: Design, settings: RunSettings, result: RunResult, place: int) -> Design:
    origin: dict[str, object] = {"run": result.run_id, "task": settings.task.name, "front": place}
    origin[ORIGIN_GROWTH] = settings.growth.content
    if result.recipe is not None:
        origin[ORIGIN_RECIPE] = result.recipe.origin
    return design.changed(name=f"{settings.name}_{place:02}", origin=origin)


def front_json(members: Sequence[FrontMember], result: RunResult, settings: RunSettings) -> str:
    """Return a front as JSON: ``vinefab/front-1``."""
    content = {
        "run": result.run_id,
        "knee": next((member.design.name for member in members if member.is_knee), None),
        "objectives": [
            {
                "name": name,
                "better": "smaller" if name in COSTS else "larger",
                "unit": COSTS[name].unit if name in COSTS else "",
            }
            for name in settings.objectives
        ],
        "designs": [
            {
                "design": member.design.name,
                settings.task.name: member.fitness,
                **dict(zip(settings.further_objectives, member.further, strict=True)),
                "composite": dict(member.score.composite),
                "evaluations": len(member.score.evaluations),
                "penalty": member.penalty,
                "knee": member.is_knee,
            }
            for member in members
        ],
    }
    return json_text(FRONT_SCHEMA, content)


def write_front(
    result: RunResult, settings: RunSettings, out: Path, *, force: bool = False
) -> tuple[FrontMember, ...]:
    """Write the designs of a front, ``front.json`` and its picture; return the designs."""
    members = front_of(result, settings)
    if result.recipe is not None:
        result.recipe.write(out / "front")
    for member in members:
        path = out / "front" / f"{member.design.name}.toml"
        write_text(path, design_text(member.design), force=force)
    write_text(out / "front.json", front_json(members, result, settings), force=force)
    figure = front_picture(members, result, settings, training_maps(settings)[0])
    write_bytes(out / "front.svg", svg_bytes(figure), force=force)
    write_bytes(out / "front.png", png_bytes(figure), force=force)
    return members


def front_lines(members: Sequence[FrontMember], settings: RunSettings) -> list[str]:
    """Return a front as lines for the user, one per design."""
    names = [settings.task.name, *settings.further_objectives]
    count = f"{len(members)} design{'s' if len(members) > 1 else ''}"
    lines = [f"front of {count} (simulated): {', '.join(names)}"]
    for member in members:
        further = "  ".join(
            f"{value:10.0f} {COSTS[name].unit}" if name in COSTS else f"{value:8.4f}"
            for name, value in zip(settings.further_objectives, member.further, strict=True)
        )
        note = "  knee" if member.is_knee else ""
        broken = "not manufacturable" if settings.evaluation.fabricable else "beyond the limits"
        violations = "" if member.penalty == 0.0 else f"  {broken}"
        lines.append(f"  {member.design.name}  {member.fitness:8.4f}  {further}{note}{violations}")
    if not any(member.is_knee for member in members):
        low = f"no point lies {LEAST_BEND:.0%} above the line between the ends"
        why = "fewer than three designs" if len(members) < 3 else low
        lines.append(f"  no knee against {settings.front_axis}: {why}")
    return lines


def front_picture(
    members: Sequence[FrontMember], result: RunResult, settings: RunSettings, world: Map
) -> Figure:
    """Return the front as a chart, with a few of its robots on a training map."""
    lowest = min(finalist.fitness for finalist in result.finalists)
    space, axis = Space(settings.space, settings.build), settings.front_axis
    _, fitness, costs = feasible_points(result.history, min(-1e3, lowest), space, [axis])
    cost = costs[:, 0] if axis in COSTS else -costs[:, 0]
    penalty = np.concatenate([generation.penalty for generation in result.history])
    valid = np.isfinite(cost)
    if len(penalty) == len(cost):
        valid &= penalty == 0.0
    place = settings.further_objectives.index(axis)
    data = FrontData(
        evaluated=np.column_stack([cost[valid], fitness[valid]]),
        front=np.array([(member.further[place], member.fitness) for member in members]),
        further=axis,
        is_line=len(settings.objectives) == 2,
        task=settings.task.name,
        targets_mm=targets_mm(settings),
    )
    return front_figure(data, world, _robots(members, settings, world))


def _robots(
    members: Sequence[FrontMember], settings: RunSettings, world: Map
) -> dict[int, FrontRobot]:
    """Return deployments of a few designs, spread over the front, the knee included."""
    places = np.linspace(0, len(members) - 1, min(MOST_ROBOTS, len(members))).round().astype(int)
    bends = [place for place, member in enumerate(members) if member.is_knee]
    chosen = sorted({*places.tolist(), *bends})
    if len(chosen) > MOST_ROBOTS:
        inner = [place for place in chosen[1:-1] if place not in bends]
        chosen.remove(min(inner, key=lambda place: abs(place - bends[0])))
    terrain, options = Terrain.of(world), settings.growth.at_one_angle
    return {
        place: FrontRobot(
            deployment=grow(members[place].design, terrain, world.starts[0].pose, options),
            widths_mm=options.drawn_widths_mm(members[place].design.build.widths_mm),
            title=members[place].design.name + (" (knee)" if members[place].is_knee else ""),
        )
        for place in chosen
    }
