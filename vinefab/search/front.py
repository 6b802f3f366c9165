"""The front of a run with several objectives: its designs, its file, its table and its picture."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.codec import Record
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.core.view import Number, Rows
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.design import design_text
from vinefab.model.files.run_context import RunContext
from vinefab.model.inputs import PICTURE_ENDS
from vinefab.model.map import Map
from vinefab.pages.panel import (
    INK,
    LEVEL_COLOURS,
    SOFT,
    Ink,
    Page,
    Panel,
    Primitive,
    ends_of,
    page_of_rows,
    plan_panel,
)
from vinefab.pages.plan import draw_deployment, draw_map, draw_targets, page_bytes
from vinefab.search.finalists import LEAST_BEND, feasible_points, knee, minimized, non_dominated
from vinefab.search.free_space import space_of
from vinefab.search.record.generations import Finalist
from vinefab.search.record.result import RunResult
from vinefab.search.run import training_maps
from vinefab.search.settings import RunSettings, run_task
from vinefab.search.space import COSTS
from vinefab.tasks.reach import task_targets

FRONT_FILE = "front.json"


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
    space, names = space_of(settings.space, settings.build), settings.further_objectives
    scores = {
        other.name: np.array([f.score.composite[other.name] for f in finalists])
        for other in settings.other_tasks
    }
    costs = minimized(np.array([f.x for f in finalists]), scores, space, names)
    signs = np.array([1.0 if name in COSTS else -1.0 for name in names])
    along = costs[:, names.index(settings.front_axis)]
    rows = np.flatnonzero(non_dominated(fitness, costs))
    rows = rows[np.argsort(along[rows], kind="stable")]
    bend, kept = knee(fitness[rows], along[rows]), RunContext.of(result.best).kept
    return tuple(
        FrontMember(
            x=finalists[row].x,
            design=finalists[row].design.changed(
                name=f"{settings.name}_{place + 1:02}", origin={**kept, "front": place + 1}
            ),
            score=finalists[row].score,
            fitness=float(fitness[row]),
            penalty=finalists[row].penalty,
            further=tuple((signs * costs[row]).tolist()),
            is_knee=place == bend,
        )
        for place, row in enumerate(rows.tolist())
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontObjective:
    """An objective of a front."""

    name: str
    better: Literal["smaller", "larger"]
    unit: str  # empty: none

    @classmethod
    def named(cls, name: str) -> "FrontObjective":
        """Return a task or a cost as an objective."""
        if name in COSTS:
            return cls(name=name, better="smaller", unit=COSTS[name].unit)
        return cls(name=name, better="larger", unit="")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontDesign:
    """A design of a front in numbers."""

    design: str  # its name, and that of its file
    values: Mapping[str, float]  # by objective
    composite: Mapping[str, float]
    evaluations: int
    penalty: float
    knee: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontFile(Record):
    """The front that a run ended with, as in its ``front.json``."""

    schema: ClassVar[str] = "vinefab/front-2"
    run: str  # its id
    knee: str | None  # name of the design at the knee
    objectives: tuple[FrontObjective, ...]
    designs: tuple[FrontDesign, ...]  # the cheapest first

    def __post_init__(self) -> None:
        names = {one.name for one in self.objectives}
        for design in self.designs:
            if design.values.keys() != names:
                raise ValueError(f"design {design.design} has other objectives than the front")

    @classmethod
    def of(
        cls, members: Sequence[FrontMember], result: RunResult, settings: RunSettings
    ) -> "FrontFile":
        """Return a front in numbers."""
        names = (settings.task.name, *settings.further_objectives)
        return cls(
            run=result.run_id,
            knee=next((member.design.name for member in members if member.is_knee), None),
            objectives=tuple(map(FrontObjective.named, settings.objectives)),
            designs=tuple(
                FrontDesign(
                    design=member.design.name,
                    values=dict(zip(names, (member.fitness, *member.further), strict=True)),
                    composite=member.score.composite,
                    evaluations=len(member.score.evaluations),
                    penalty=member.penalty,
                    knee=member.is_knee,
                )
                for member in members
            ),
        )


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
    document = FrontFile.of(members, result, settings).json_text()
    write_text(out / FRONT_FILE, document, force=force)
    figure = front_picture(members, result, settings, training_maps(settings)[0])
    for suffix in PICTURE_ENDS:
        write_bytes(out / f"front{suffix}", page_bytes(figure, suffix), force=force)
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
    """Return the front as a chart, with a few of its robots on a training map.

    The robots are spread over the front, the knee included; their numbers stand at their points.
    """
    most_robots = 4  # most designs of the front that are drawn, the knee among them if there is one
    places = np.linspace(0, len(members) - 1, min(most_robots, len(members))).round().astype(int)
    bends = [place for place, member in enumerate(members) if member.is_knee]
    chosen = sorted({*places.tolist(), *bends})
    if len(chosen) > most_robots:
        inner = [place for place in chosen[1:-1] if place not in bends]
        chosen.remove(min(inner, key=lambda place: abs(place - bends[0])))
    terrain, options = Terrain.of(world), settings.growth.at_one_angle
    targets, side_pt = task_targets(run_task(settings), world), 165.0
    plans, explained = list[Panel](), dict[str, Primitive]()
    for place in chosen:
        design = members[place].design
        deployment = grow_on(design, terrain, world.starts[0].pose, options)
        plan = plan_panel(world.bounds.bounds, side_pt)
        draw_map(plan, world)
        draw_deployment(plan, deployment, options.drawn_widths_mm(deployment.tree))
        draw_targets(plan, targets)
        plan.x_name = plan.y_name = ""
        plan.x_ticks = plan.y_ticks = ()
        plan.title = f"{place + 1}: {design.name}{' (knee)' if members[place].is_knee else ''}"
        # Once for all plans, what the symbols on them mean, without the counts of each.
        for words, symbol in plan.legend.items():
            explained.setdefault(re.sub(r" \(.*\)$", "", words), symbol)
        plan.legend_shown = False
        plans.append(plan)
    width_pt = max(2, len(chosen)) * (side_pt + 14.0) - 60.0
    chart = _front_chart(members, result, settings, chosen, width_pt)
    levels_first = sorted(explained.items(), key=lambda entry: (entry[0][:5] != "level", entry[0]))
    return page_of_rows([[chart], plans], dict(levels_first))


def _front_chart(
    members: Sequence[FrontMember],
    result: RunResult,
    settings: RunSettings,
    chosen: Sequence[int],
    width_pt: float,
) -> Panel:
    """Return fitness over the first further objective: in the search, and of the front."""
    lowest = min(finalist.fitness for finalist in result.finalists)
    space, axis = space_of(settings.space, settings.build), settings.front_axis
    _, fitness, costs = feasible_points(result.history, min(-1e3, lowest), space, [axis])
    cost = costs[:, 0] if axis in COSTS else -costs[:, 0]
    penalty = np.concatenate([generation.penalty for generation in result.history])
    valid = np.isfinite(cost)
    if len(penalty) == len(cost):
        valid &= penalty == 0.0
    evaluated = np.column_stack([cost[valid], fitness[valid]])
    place = settings.further_objectives.index(axis)
    front = np.array([(member.further[place], member.fitness) for member in members])
    every = np.vstack([evaluated, front])
    (x0, x1), (y0, y1) = ends_of(every[:, 0]), ends_of(every[:, 1])
    known = COSTS.get(axis)
    unit = " score (simulated)" if known is None else f" ({known.unit})" if known.unit else ""
    chart = Panel(
        box=(x0, y0, x1, y1),
        width_pt=width_pt,
        height_pt=190.0,
        x_name=axis.replace("_", " ") + unit,
        y_name=f"{settings.task.name} score (simulated)",
        title="Scores of one kind compare with each other only.",
        frame=True,
    )
    cross = Ink(line=SOFT, width_pt=0.7, line_alpha=0.45)
    chart.marks(evaluated, "x", 3.0, cross, label="in the search, on training poses")
    lines = list[Floats]()
    if len(settings.objectives) == 2:  # without a third objective the front is a line
        steps = np.repeat(front, 2, axis=0)
        lines = [np.column_stack([steps[1:, 0], steps[:-1, 1]])]
        chart.line(lines[0], Ink(line=LEVEL_COLOURS[0], width_pt=1.5))
    label = "the front, scored again on fresh poses"
    chart.marks(front, "o", 5.5, Ink(fill=LEVEL_COLOURS[0]), label=label)
    numbers, inks = [str(place + 1) for place in chosen], [INK] * len(chosen)
    chart.write_labels(front[list(chosen)], numbers, inks, size_pt=11.0, mark_pt=4.0, lines=lines)
    return chart
