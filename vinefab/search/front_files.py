"""The front of a run with several objectives as designs, JSON, text and a figure."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.jsontext import json_text
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.core.view import Number, Rows
from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_text
from vinefab.model.files.run_context import RunContext
from vinefab.model.map import Map
from vinefab.model.target import Target
from vinefab.pages.charts import ends_of
from vinefab.pages.colours import INK, LEVEL_COLOURS, SOFT
from vinefab.pages.page_png import page_png
from vinefab.pages.page_svg import page_svg
from vinefab.pages.panel import Ink, Page, Panel, Primitive, page_of_rows, plan_panel
from vinefab.pages.plan import draw_deployment, draw_map, draw_targets
from vinefab.search.costs import COSTS
from vinefab.search.front import LEAST_BEND, feasible_points, knee, minimized, non_dominated
from vinefab.search.record.generations import Finalist
from vinefab.search.record.result import RunResult
from vinefab.search.run import training_maps
from vinefab.search.settings import RunSettings, run_task
from vinefab.search.space import Space
from vinefab.tasks.targets import task_targets


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontData:
    """The data of the chart."""

    further: str  # name of the further objective that it is drawn over
    is_line: bool  # whether there is no third objective, so that the front is a line
    evaluated: Floats  # its value and fitness in the search, on training poses, shape (m, 2)
    front: Floats  # the same on fresh poses, for the front from its cheap end on, (k, 2)
    task: str  # name of the score
    targets: tuple[Target, ...] = ()  # drawn on maps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontRobot:
    """One design of the front, deployed."""

    deployment: Deployment
    widths_mm: tuple[float, ...]  # lay-flat width of each level, as drawn
    title: str


def front_figure(data: FrontData, world: Map, robots: Mapping[int, FrontRobot]) -> Page:
    """Return the chart of a front with robots below it."""
    side_pt = 165.0
    columns = max(2, len(robots))
    plans, explained = list[Panel](), dict[str, Primitive]()
    for place, robot in robots.items():
        plan = plan_panel(world.bounds.bounds, side_pt)
        draw_map(plan, world)
        draw_deployment(plan, robot.deployment, robot.widths_mm)
        draw_targets(plan, data.targets)
        plan.x_name = plan.y_name = ""
        plan.x_ticks = plan.y_ticks = ()
        plan.title = f"{place + 1}: {robot.title}"
        # Once for all plans, what the symbols on them mean, without the counts of each.
        for words, symbol in plan.legend.items():
            explained.setdefault(re.sub(r" \(.*\)$", "", words), symbol)
        plan.legend_shown = False
        plans.append(plan)
    chart = _chart(data, columns * (side_pt + 14.0) - 60.0)
    # Numbers of the robots that are drawn stand at their points.
    steps = np.repeat(data.front, 2, axis=0)
    corners = np.column_stack([steps[1:, 0], steps[:-1, 1]])
    numbers = [str(place + 1) for place in robots]
    chart.write_labels(
        data.front[list(robots)], numbers, [INK] * len(numbers), size_pt=11.0, mark_pt=4.0,
        lines=[corners] if data.is_line else [],
    )  # fmt: skip
    levels_first = sorted(explained.items(), key=lambda entry: (entry[0][:5] != "level", entry[0]))
    return page_of_rows([[chart], plans], dict(levels_first))


def _chart(data: FrontData, width_pt: float) -> Panel:
    every = np.vstack([data.evaluated, data.front])
    (x0, x1), (y0, y1) = ends_of(every[:, 0]), ends_of(every[:, 1])
    chart = Panel(
        box=(x0, y0, x1, y1),
        width_pt=width_pt,
        height_pt=190.0,
        x_name=_axis_text(data.further),
        y_name=f"{data.task} score (simulated)",
        title="Scores of one kind compare with each other only.",
        frame=True,
    )
    cross = Ink(line=SOFT, width_pt=0.7, line_alpha=0.45)
    chart.marks(data.evaluated, "x", 3.0, cross, label="in the search, on training poses")
    colour = LEVEL_COLOURS[0]
    if data.is_line:
        steps = np.repeat(data.front, 2, axis=0)
        line = np.column_stack([steps[1:, 0], steps[:-1, 1]])
        chart.line(line, Ink(line=colour, width_pt=1.5))
    label = "the front, scored again on fresh poses"
    chart.marks(data.front, "o", 5.5, Ink(fill=colour), label=label)
    return chart


def _axis_text(name: str) -> str:
    if name not in COSTS:
        return f"{name} score (simulated)"
    unit = f" ({COSTS[name].unit})" if COSTS[name].unit else ""
    return name.replace("_", " ") + unit


FRONT_SCHEMA = "vinefab/front-1"
MOST_ROBOTS = 4
"""Most designs of the front that are drawn, the knee among them if there is one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontMember(Finalist):
    """One design of a front, named after the run, with its place on the front."""

    further: tuple[float, ...]  # values of the run's further objectives, in their order
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
            x=finalists[row].x,
            design=_named(finalists[row].design, settings, result, place + 1),
            score=finalists[row].score,
            fitness=float(fitness[row]),
            penalty=finalists[row].penalty,
            further=tuple((signs * costs[row]).tolist()),
            is_knee=place == bend,
        )
        for place, row in enumerate(rows.tolist())
    )


def _named(design: Design, settings: RunSettings, result: RunResult, place: int) -> Design:
    origin = {**RunContext.of(result.best).kept, "front": place}
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
    write_bytes(out / "front.svg", page_svg(figure), force=force)
    write_bytes(out / "front.png", page_png(figure), force=force)
    return members


def front_table(members: Sequence[FrontMember], settings: RunSettings) -> Rows:
    """Return a front, a row per design, the cheapest first."""
    further = settings.further_objectives
    units = (COSTS[name].unit if name in COSTS else "" for name in further)
    broken = "not manufacturable" if settings.evaluation.fabricable else "beyond the limits"
    knee = ""
    if not any(member.is_knee for member in members):
        low = f"no point lies {LEAST_BEND:.0%} above the line between the ends"
        why = "fewer than three designs" if len(members) < 3 else low
        knee = f"; no knee against {settings.front_axis}: {why}"
    return Rows(
        caption=f"front of {counted(len(members), 'design')} (simulated){knee}",
        headings=("design", settings.task.name,
                  *(f"{name}, {unit}" if unit else name
                    for name, unit in zip(further, units, strict=True)), ""),
        rows=tuple(
            (
                member.design.name,
                Number(member.fitness, form=".4f"),
                *(Number(value, form=".0f" if name in COSTS else ".4f")
                  for name, value in zip(further, member.further, strict=True)),
                ", ".join(["knee"] * member.is_knee + [broken] * (member.penalty != 0.0)),
            )
            for member in members
        ),
    )  # fmt: skip


def front_picture(
    members: Sequence[FrontMember], result: RunResult, settings: RunSettings, world: Map
) -> Page:
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
        targets=task_targets(run_task(settings), world),
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
            deployment=grow_on(members[place].design, terrain, world.starts[0].pose, options),
            widths_mm=options.drawn_widths_mm(members[place].design.build.widths_mm),
            title=members[place].design.name + (" (knee)" if members[place].is_knee else ""),
        )
        for place in chosen
    }
