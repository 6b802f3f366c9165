"""A design deployed on families of maps from many poses, and the measures of each deployment."""

import math
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import LineString

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.hashing import sha256_of
from vinefab.core.limits import MOST_SEED, deg, rad
from vinefab.core.plain_text import counted, one_line
from vinefab.core.progress import each
from vinefab.core.registry import with_parameters
from vinefab.core.validation import Floats, whole
from vinefab.core.view import Data, Number, Origin, Picture, Rows, Section, document
from vinefab.growth.batch import GROWTHS_PER_CALL, Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthChoice, GrowthOptions, growth_text
from vinefab.growth.plan import Plans
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.maps.poses import draw_poses, spread_notes
from vinefab.model.deployment import STUCK_STOPS, Deployment, Stop
from vinefab.model.design import Design, design_text
from vinefab.model.files.run_context import RunContext, map_fingerprint, package_versions
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.model.target import TargetsResult
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    ALERT,
    COLUMN_PT,
    HEAT_COLOURS,
    INK,
    SOFT,
    TICK_PT,
    Ink,
    Page,
    Panel,
    Raster,
    blended,
    jitter,
    page_of,
    page_of_rows,
    plan_panel,
    series_colour,
    upright,
)
from vinefab.pages.plan import (
    BODY_IS_LINE,
    STOP_WORDS,
    body_cells,
    deployment_plan,
    draw_map,
    draw_pose,
    page_bytes,
)
from vinefab.prediction.deploy import stayed_text
from vinefab.prediction.measures import (
    Measure,
    MeasureTable,
    measured_shapes,
    measures_with,
    worst_pressures_of,
)
from vinefab.tasks import make_task
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.evaluate import (
    Poses,
    PreparedMap,
    map_weights,
    poses_on,
    score_design,
    trunks_with_room,
)
from vinefab.tasks.reach import design_touches, task_targets
from vinefab.tasks.task import Task, check_on_map, score_parts

FIRST_UNSEEN = 10_000_000
"""Maps for predictions have seeds from here on, out of the way of those that designs train on."""

MOST_MAPS = 10_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapFamily:
    """Maps that are evaluated together."""

    label: str  # what reports call them
    worlds: tuple[Map, ...]  # the maps


def map_families(given: Sequence[Map], unseen: MapFamily | None) -> tuple[MapFamily, ...]:
    """Return the families to predict for."""
    if not given and unseen is None:
        raise BadInputError("--maps", None, "map files, or --environment for unseen maps")
    label = "the map given" if len(given) == 1 else f"the {len(given)} maps given"
    families = [MapFamily(label=label, worlds=tuple(given))] if given else []
    return (*families, *([unseen] if unseen else []))


def unseen_maps(
    environment: str, count: int, seed: int, parameters: Mapping[str, object] | None = None
) -> MapFamily:
    """Generate maps of an environment that no design was trained on."""
    whole("--count", count, 1, MOST_MAPS)
    whole("--seed", seed, 0, MOST_SEED)
    kind = ENVIRONMENTS[environment]
    options = with_parameters(kind.options, environment, parameters or {})
    first = FIRST_UNSEEN + MOST_MAPS * seed
    numbers = each("maps", range(count))
    worlds = tuple(kind.generate(first + index, options) for index in numbers)
    return MapFamily(label=counted(count, f"unseen {environment} map"), worlds=worlds)


def numbered_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return names that are all different: equal ones get a number."""
    total, seen = Counter(names), Counter[str]()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if total[name] > 1 else name)
    return tuple(found)


def names_apart(designs: Sequence[Design]) -> tuple[str, ...]:
    """Return names of designs that are all different: equal ones get their folder, or a number.

    The winners of several runs have one name, and the run's folder says which it is.
    """
    numbered = numbered_names([design.name for design in designs])
    found = list[str]()
    for design, usual in zip(designs, numbered, strict=True):
        folders = [one.folder for one in designs if one.name == design.name]
        places = {folder.resolve() for folder in folders if folder is not None}
        if design.folder is None or len(places) < len(folders) or len(folders) == 1:
            found.append(usual)
            continue
        above = Path(os.path.commonpath([str(place) for place in places]))
        place = design.folder.resolve()
        where = place.relative_to(above).as_posix() if place != above else place.name
        found.append(f"{design.name} ({one_line(where)})")
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionPlan:
    """How often, and by which rules, a design is deployed."""

    poses: int = 3  # poses per map, drawn from the ranges of the maps' starts
    seed: int = 0  # seed of the poses; map ``i`` of a family gets ``seed + i``
    options: GrowthOptions = field(default_factory=GrowthOptions)  # the growth model's choices
    anchoring: Anchoring = field(default_factory=Anchoring)  # how anchoring is scored
    task: Task | None = None  # whose score is a measure too
    tip_speed_mm_s: float | None = None  # for the flow of air; None: no flow is named


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedFamily:
    """A family made ready: its maps with their poses."""

    label: str  # what reports call it
    maps: tuple[PreparedMap, ...]  # the maps
    poses: Poses  # for each map, the poses
    atlas: TerrainSet = field(init=False)  # their terrains, joined once for all deployments

    def __post_init__(self) -> None:
        atlas = TerrainSet([prepared_map.terrain for prepared_map in self.maps])
        object.__setattr__(self, "atlas", atlas)

    @classmethod
    def of(cls, family: MapFamily, plan: PredictionPlan) -> "PreparedFamily":
        """Return a family made ready, with its poses drawn."""
        maps = tuple(PreparedMap.of(world) for world in each("maps prepared", family.worlds))
        if plan.task is not None:
            for prepared in maps:
                check_on_map(plan.task, prepared.world, prepared.context)
        seeds = [plan.seed + index for index in range(len(maps))]
        repeats = plan.options.draws
        poses = poses_on(maps, plan.poses, seeds, repeats=repeats)
        return cls(label=family.label, maps=maps, poses=poses)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each map; maps of one name are told apart by a number."""
        return numbered_names([prepared_map.world.name for prepared_map in self.maps])

    @property
    def launch_names(self) -> list[str]:
        """The name of the map of each deployment."""
        names = self.names
        return [name for name, places in zip(names, self.poses, strict=True) for _ in places]

    @property
    def distinct(self) -> "PreparedFamily":
        """The same with every pose once: all deployments have the same contacts."""
        return self.with_poses(tuple(tuple(dict.fromkeys(places)) for places in self.poses))

    def with_poses(self, poses: Poses) -> "PreparedFamily":
        """Return the same maps with other poses; their terrains are not joined again."""
        other = replace(self, poses=poses)
        object.__setattr__(other, "atlas", self.atlas)
        return other

    def launches(self) -> Launches:
        """Return every pose of every map as launches of a batch."""
        return Launches.of(self.atlas, self.poses)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FamilyDeployments:
    """A design's deployments on one family of maps."""

    prepared: PreparedFamily
    # deployments, unpressed: map by map, pose by pose, and the same where no pressure stops them;
    # grown again when asked for
    deployments: Sequence[Deployment]
    unpressed: Sequence[Deployment]
    outcomes: MeasureTable  # one row of measures for each
    map_of: tuple[int, ...]  # index of the map of each

    def prepared_map(self, index: int) -> PreparedMap:
        """Return the map of one deployment."""
        return self.prepared.maps[self.map_of[index]]

    def aimed(self, task: Task | None = None) -> Iterator[tuple[Deployment, Map]]:
        """Yield each deployment with its map; none where no map and no task has targets."""
        if any(task_targets(task, prepared.world) for prepared in self.prepared.maps):
            for index, deployment in enumerate(self.deployments):
                yield deployment, self.prepared_map(index).world


def deploy_family(
    design: Design, prepared: PreparedFamily, plan: PredictionPlan
) -> FamilyDeployments:
    """Deploy a design from every pose on a family of maps and measure every deployment."""
    plans, launches = Plans.of([design], plan.options), prepared.launches()
    batch = Batch(plans, launches, plan.options)
    deployments = batch.regrown()
    # What growth to every tip needs is known only where no pressure stops it.
    unpressed = deployments
    if plan.options.pressure_stop and design.build.pressure_kpa > 0.0:
        free = plan.options.changed(pressure_stop=False)
        unpressed = Batch(Plans.of([design], free), launches, free).regrown()
    measures = measures_with(plan.task)
    columns = np.empty((len(deployments), len(measures)))
    terrain = launches.terrain.tolist()
    contexts = [prepared_map.context for prepared_map in prepared.maps]
    done = 0
    for rows in batch.each(
        lambda block: measured_shapes(block, design, contexts, plan.anchoring, plan.task)
    ):
        columns[done : done + len(rows), :-2] = rows
        done += len(rows)
    one_by_one, first = iter(unpressed), 0
    while some := list(islice(one_by_one, GROWTHS_PER_CALL)):
        columns[first : first + len(some), -2:] = worst_pressures_of(some).T
        first += len(some)
    names = prepared.names
    outcomes = MeasureTable(
        label=prepared.label,
        map_names=tuple(names[index] for index in terrain),
        poses=launches.poses,
        values={m.key: columns[:, i].copy() for i, m in enumerate(measures)},
        measures=measures,
    )
    return FamilyDeployments(
        prepared=prepared,
        deployments=deployments,
        unpressed=unpressed,
        outcomes=outcomes,
        map_of=tuple(terrain),
    )


def deployment_notes(
    prepared: Sequence[PreparedFamily], plan: PredictionPlan, named: Mapping[str, Design]
) -> tuple[str, ...]:
    """Return notes for the user on the number of deployments of designs, and their starts.

    Parameters
    ----------
    named
        The designs by the first words of their notes; nothing for one alone.
    """
    worlds = [place.world for family in prepared for place in family.maps]
    notes = spread_notes(worlds, plan.poses, repeats=plan.options.draws)
    for name, design in named.items():
        left = [
            has_room
            for family in prepared
            for has_room in trunks_with_room(design, family.maps, family.poses, plan.options)
        ]
        notes += [f"{name}{note}" for note in stayed_text(left, design, plan.options)]
    return tuple(notes)


def typical(outcomes: MeasureTable, shares: Sequence[float], *keys: str) -> list[int]:
    """Return the deployments that stand at some shares of the order of measures, one by one."""
    order = np.lexsort([outcomes.values[key] for key in reversed(keys)])
    return [int(order[round(share * (len(order) - 1))]) for share in shares]


# --- A design's score on a task over maps and poses -----------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class ScorePlan:
    """What a design is to be tried at."""

    task: str | Task = "coverage"  # name of the task, or the task itself
    # parameters of a task that is named, where they differ from its defaults
    parameters: Mapping[str, object] = field(default_factory=dict)
    poses: int = 3  # poses drawn per map from the range around its starts
    seed: int = 0  # seed of the poses; map ``i`` gets ``seed + i``


def score_design_on_task(
    design: Design, maps: Sequence[Map], plan: ScorePlan, options: GrowthOptions | None = None
) -> Score:
    """Return a design's score, one evaluation per map and pose.

    Parameters
    ----------
    options
        The growth model's choices; those that the design was trained with if None.
    """
    if not maps:
        raise UnfitInputError("--maps", "there are none", "give at least one")
    options = options or GrowthChoice.of([design]).options
    task = plan.task
    if isinstance(task, str):
        task = make_task(task, plan.parameters)
    prepared_maps = [PreparedMap.of(world) for world in maps]
    seeds = [plan.seed + index for index in range(len(prepared_maps))]
    varied = options.draws
    poses = poses_on(prepared_maps, plan.poses, seeds, repeats=varied)
    score = score_design(design, prepared_maps, poses, task, options)
    terrains = TerrainSet([prepared.terrain for prepared in prepared_maps])
    stayed = stayed_text(trunks_with_room(design, prepared_maps, poses, options), design, options)
    # What earned and cost how much of it.
    evaluations = tuple(
        replace(each, parts=score_parts(task, each.score, each.terms)) for each in score.evaluations
    )
    names = tuple(evaluations[0].parts)
    table = np.array([[each.parts[name] for name in names] for each in evaluations])
    weights = map_weights([len(places) for places in poses])
    means = np.average(table, axis=0, weights=weights).tolist() if names else []
    return replace(
        score,
        evaluations=evaluations,
        parts=dict(zip(names, means, strict=True)),
        growth=options.content,
        grown=growth_text(options, [design]),
        targets=design_touches(design, maps, Launches.of(terrains, poses), options, task),
        notes=(*spread_notes(maps, plan.poses, repeats=varied), *stayed),
    )


# --- Sections on deployments: how measures are spread, some of them drawn, how branches ended -----


TOO_FINE = 400
"""Robots of more branches are drawn as pixels: as lines they would take megabytes."""

_NUMBER_HEADINGS = (
    "mean [95 % interval]", "deviation", "5 %", "median", "95 %", "least", "greatest",
)  # fmt: skip


def spread_pictures(named: Mapping[str, MeasureTable]) -> tuple[Picture, ...]:
    """Return the distribution of every measure that any of some tables has."""

    def chart(measure: Measure, shown: Mapping[str, Floats]) -> Picture:
        return Picture(
            image=lambda: page_svg(spread_chart(measure, shown)),
            caption=f"{_capital(measure.title)}: {measure.meaning} (simulated).",
        )

    every = (
        (m, {name: found.values[m.key] for name, found in named.items() if found.spread(m)})
        for m in next(iter(named.values())).measures
    )
    return tuple(chart(measure, shown) for measure, shown in every if shown)


def spread_blocks(families: Sequence[MeasureTable]) -> Iterator[Data | Section]:
    """Yield how every measure is spread over deployments, as charts and numbers."""
    every = [_every_deployment(outcomes) for outcomes in families]
    yield Data(
        lambda: {
            "fields": [
                {
                    "label": outcomes.label,
                    "maps": outcomes.map_count,
                    "spread": outcomes.spreads,
                    **document([table]),
                }
                for outcomes, table in zip(families, every, strict=True)
            ]
        }
    )
    tables = [
        Rows(
            caption=f"{_capital(outcomes.label)} (simulated)",
            headings=("measure", *_NUMBER_HEADINGS, "count"),
            rows=tuple(
                (measure.label, spread.shown(measure),
                 *(measure.of(getattr(spread, name)) for name in spread.NUMBERS[3:]), spread.count)
                for measure in outcomes.measures
                if (spread := outcomes.spread(measure)) is not None
            ),
        )
        for outcomes in families
    ]  # fmt: skip
    words = (
        "Line: mean. Bar below: from the 5th to the 95th percentile of the deployments. A mean's "
        "95 % interval is Student's over maps, because deployments on one map are alike (over "
        "poses where there is one map), with the degrees of freedom of scores, whose tails are "
        "long; the table has it."
    )
    counts = "; ".join(
        f"{outcomes.label}: {counted(len(outcomes), 'deployment')}" for outcomes in families
    )
    yield Section(
        title="Predictions",
        paragraphs=(f"{_capital(counts)} (simulated). {words}",),
        pictures=spread_pictures({outcomes.label: outcomes for outcomes in families}),
        tables=(*tables, *(replace(table, key="") for table in every)),
        folded=True,
    )


def _every_deployment(outcomes: MeasureTable) -> Rows:
    """Return the measures of every deployment, a row each."""
    place = partial(Number, form=".2f", decimals=2)
    # A robot that never emerged needs no pressure: there is no number then.
    return Rows(
        caption=f"Every deployment on {outcomes.label}",
        headings=("map", "x mm", "y mm", "heading deg", *(m.label for m in outcomes.measures)),
        rows=tuple(
            (name, place(pose.x_mm), place(pose.y_mm), place(deg(pose.heading_rad)),
             *(m.of(outcomes.values[m.key][index]) for m in outcomes.measures))
            for index, (name, pose) in enumerate(
                zip(outcomes.map_names, outcomes.poses, strict=True)
            )
        ),
        folded=True,
        key="deployments",
        keys=("map", "pose.x_mm", "pose.y_mm", "pose.heading_deg",
              *(m.key for m in outcomes.measures)),
    )  # fmt: skip


def deployment_picture(
    design: Design,
    world: Map,
    deployment: Deployment,
    options: GrowthOptions,
    *,
    whole: bool = False,
    touched: TargetsResult | None = None,
) -> bytes:
    """Return a deployment on its map, as pixels where lines would take megabytes.

    Parameters
    ----------
    whole
        Whether to show the whole map even where the robot takes a part of it. A robot that hardly
        grew is shown with the map that stopped it anyway.
    touched
        As in `deployment_plan`.
    """
    widths_mm = options.drawn_widths_mm(deployment.tree)
    whole = whole or bool(deployment.grown_mm.sum() < 0.2 * deployment.tree.total_length_mm)
    plan = deployment_plan(
        world, deployment, widths_mm, longest_pt=COLUMN_PT, whole=whole, touched=touched
    )
    return _page_bytes(plan, design)


_COUNT = re.compile(r" \(\d+( of \d+)?\)$")


def deployment_pictures(
    design: Design, deployed: Sequence[tuple[Map, Deployment]], options: GrowthOptions
) -> tuple[bytes, ...]:
    """Return deployments on their whole maps for one row: the first has the legend for all."""
    widths_mm = options.drawn_widths_mm(design.tree)
    panels = [
        panel
        for world, deployment in deployed
        for panel in deployment_plan(
            world, deployment, widths_mm, longest_pt=COLUMN_PT, whole=True
        ).panels
    ]
    legend = {  # how many there are differs from map to map
        _COUNT.sub("", words): entry for panel in panels for words, entry in panel.legend.items()
    }
    for panel in panels:
        panel.legend_shown = False
    plans = [page_of_rows([[panel]], None if number else legend)
             for number, panel in enumerate(panels)]  # fmt: skip
    return tuple(_page_bytes(plan, design) for plan in plans)


def _page_bytes(plan: Page, design: Design) -> bytes:
    return page_bytes(plan, ".png" if design.branch_count > TOO_FINE else ".svg", dpi=130)


def deployment_section(
    design: Design,
    deployed: Sequence[tuple[str, Map, Deployment]],
    ended: Sequence[tuple[str, Sequence[Deployment]]],
    options: GrowthOptions,
) -> Section:
    """Return pictures of deployments, and how all branches ended."""
    is_wide = options.drawn_widths_mm(design.tree).any()
    drawn = "Bodies are drawn as wide as they inflate." if is_wide else f"{BODY_IS_LINE}."
    return Section(
        title="Deployments",
        paragraphs=(
            f"Growth model: {growth_text(options, [design])}. Planar and supported; branches do "
            f"not push on each other. {drawn}",
        ),
        pictures=tuple(
            Picture(
                image=partial(deployment_picture, design, world, deployment, options),
                caption=f"{words} (simulated).",
            )
            for words, world, deployment in deployed
        ),
        tables=tuple(stop_table(label, deployments) for label, deployments in ended),
        folded=True,
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def stop_table(label: str, deployments: Sequence[Deployment]) -> Rows:
    """Return how the branches of some deployments ended, a row for each level."""
    found = [(one.tree.level, one.stop, one.grown_mm / one.tree.length_mm) for one in deployments]
    levels, stops, shares = (np.concatenate(column) for column in zip(*found, strict=True))
    # Stops that only some rules of growth have are shown where they occur.
    met = [stop for stop in Stop if stop <= Stop.PRESSURE or (stops == stop).any()]
    rows = list[tuple[str, ...]]()
    for level in range(1, int(levels.max()) + 1):
        ended, grown = stops[levels == level], shares[levels == level]
        stuck = grown[np.isin(ended, STUCK_STOPS)]
        rows.append(
            (
                str(level),
                *(f"{100 * np.mean(ended == stop):.1f} %" for stop in met),
                f"{100 * np.median(stuck):.0f} %" if len(stuck) else "-",
            )
        )
    return Rows(
        caption=f"{_capital(label)}: how {counted(len(stops), 'branch')} of "
        f"{counted(len(deployments), 'deployment')} ended "
        "(simulated)",
        headings=("level", *(STOP_WORDS[stop] for stop in met), "grown when stuck (median)"),
        rows=tuple(rows),
    )


ENOUGH_FOR_BARS = 20
"""Fewer values are shown one by one."""

_PITCH, _TALLEST = 1.3, 0.62
"""From row to row, and the tallest bar of a row: what is left holds its name."""


def spread_chart(measure: Measure, values: Mapping[str, Floats]) -> Page:
    """Return the distribution of a measure over deployments, a row for each family."""
    known = {name: column[np.isfinite(column)] for name, column in values.items()}
    everything = np.concatenate(list(known.values()))
    low, high = float(everything.min()), float(everything.max())
    pad = 0.04 * (high - low) or 0.04 * abs(high) or 1.0
    panel = Panel(
        box=(low - pad, (len(known) - 1) * _PITCH + 0.2, high + pad, -1.0),
        width_pt=205.0,
        height_pt=16.0 + 88.0 * len(known),
        x_name=measure.label,
        frame=True,
        y_grid=False,
    )
    ticks: dict[float, str] = {}
    bins = 24
    for row, (name, column) in enumerate(known.items()):
        base, colour, most = row * _PITCH, series_colour(row), 0
        if len(column) >= ENOUGH_FOR_BARS and high > low:
            counts, edges = np.histogram(column, bins=bins, range=(low, high))
            most = int(counts.max())
            tops = base - _TALLEST * counts / most
            sides = zip(edges[:-1].tolist(), edges[1:].tolist(), tops.tolist(), strict=True)
            panel.bars([(x0, base, x1, top) for x0, x1, top in sides], colour, 0.35)
            ticks |= {base: "0", base - _TALLEST: str(most)}
        else:
            dots = np.column_stack([column, base - 0.3 - 0.18 * jitter(len(column))])
            panel.marks(dots, "o", 4.0, Ink(fill=colour, fill_alpha=0.55))
        p05, p95 = np.percentile(column, [5.0, 95.0]).tolist()
        thick = Ink(line=colour, width_pt=4.0, butt=True)
        panel.line([(p05, base + 0.08), (p95, base + 0.08)], thick)
        upright(panel, float(column.mean()), (base - 0.66, base + 0.13), INK, 1.6)
        panel.words((low - pad, base - 0.84), name, TICK_PT, colour=SOFT)
    panel.y_ticks = list(ticks.items())
    panel.y_name = "deployments" if ticks else ""
    return page_of(panel)


# --- Where a design grows on one map: many deployments from varied poses, laid on each other ------


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckSpot:
    """A place where branches get stuck repeatedly."""

    # x_mm, y_mm: mean position of the stuck tips
    x_mm: float
    y_mm: float
    percent: float  # share of the deployments that had a branch stuck there


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeatMap:
    """How often deployed bodies pass each place of a map."""

    world: Map  # the map
    low_mm: tuple[float, float]  # lower left corner of the raster
    cell_mm: float  # side of its cells
    # share of the deployments whose body covers each cell, shape (rows, columns), row 0 at the
    # bottom, 0 to 1
    share: Floats
    deployments: int  # how many there were
    spots: tuple[StuckSpot, ...]  # where branches got stuck, the most frequent first
    spread: str  # how far the poses differ, as text

    def __post_init__(self) -> None:
        if self.share.ndim != 2 or not ((self.share >= 0.0) & (self.share <= 1.0)).all():
            raise BadInputError("share", self.share.shape, "shares from 0 to 1 in rows and columns")
        self.share.setflags(write=False)

    def percent_passed(self, least: float = 0.0) -> float:
        """Return the share of the free space that more than a share of the deployments cover.

        Bodies lie in free space, so that covered cells are free ones up to a cell's width.
        """
        passed_mm2 = float((self.share > least).sum()) * self.cell_mm**2
        return min(100.0, 100.0 * passed_mm2 / self.world.free_space.area)


POSES = 200


LEAST_SPREAD_MM, LEAST_SPREAD_DEG = 10.0, 15.0
"""Poses vary by so much where a map gives its starts no range [assumed]."""

SPOT_SHARE = 0.03
"""Tips within cells of this share of the map's longer side count as one place."""

MOST_SPOTS = 8


def heat_map_of(
    design: Design, prepared_map: PreparedMap, trials: PredictionPlan, poses: int = POSES
) -> HeatMap:
    """Return where a design grows on a map from varied poses."""
    world = prepared_map.world
    # The default range of poses where the map gives none.
    spread: dict[str, Any] = {
        "spread_x_mm": LEAST_SPREAD_MM,
        "spread_y_mm": LEAST_SPREAD_MM,
        "spread_heading_rad": rad(LEAST_SPREAD_DEG),
    }
    starts = tuple(one if one.has_spread else replace(one, **spread) for one in world.starts)
    varied = replace(world, starts=starts)
    drawn = draw_poses(varied, poses, trials.seed)
    launches = Launches.of(TerrainSet([prepared_map.terrain]), [drawn])
    batch = Batch(Plans.of([design], trials.options), launches, trials.options)
    deployments = batch.deployments()
    x_min, y_min, x_max, y_max = world.bounds.bounds
    cells = 320  # cells along the longer side of the map
    low_mm, cell_mm = (x_min, y_min), max(world.size_mm) / cells
    shape = math.ceil((y_max - y_min) / cell_mm), math.ceil((x_max - x_min) / cell_mm)
    passed = np.zeros(shape)
    for deployment in deployments:
        passed += body_cells(deployment, deployment.tree.width_mm, low_mm, cell_mm, shape)
    start = varied.starts[0]
    where = f"{start.spread_x_mm:g} mm across, {start.spread_y_mm:g} mm along the map"
    if start.area is not None:
        kind = "line" if isinstance(start.area, LineString) else "area"
        where = f"from the free part of the start's {kind}"
    return HeatMap(
        world=world,
        low_mm=low_mm,
        cell_mm=cell_mm,
        share=passed / len(deployments),
        deployments=len(deployments),
        spots=stuck_spots(deployments, SPOT_SHARE * max(world.size_mm)),
        spread=f"{where} and {deg(start.spread_heading_rad):g} degrees either way",
    )


def stuck_spots(deployments: Sequence[Deployment], apart_mm: float) -> tuple[StuckSpot, ...]:
    """Return the places where branches are stuck in most deployments.

    The tip with most other deployments' tips around it makes the first place, and takes those
    with it; then the next.
    """
    found = [
        (tip, number)
        for number, deployment in enumerate(deployments)
        for tip in deployment.tips_mm[np.isin(deployment.stop[deployment.deployed], STUCK_STOPS)]
    ]
    tips = np.array([tip for tip, _ in found]).reshape(-1, 2)
    owner = np.array([number for _, number in found], dtype=np.int64)
    points = np.asarray(shapely.points(tips))
    near = shapely.STRtree(points).query(points, "dwithin", apart_mm)
    around = [near[1][near[0] == index] for index in range(len(tips))]
    left = np.ones(len(tips), dtype=np.bool_)
    spots: list[StuckSpot] = []
    while left.any() and len(spots) < MOST_SPOTS:
        counts = [len(np.unique(owner[a[left[a]]])) if left[i] else 0 for i, a in enumerate(around)]
        place = around[int(np.argmax(counts))]
        members = place[left[place]]
        x_mm, y_mm = tips[members].mean(axis=0).tolist()
        share = 100.0 * len(np.unique(owner[members])) / len(deployments)
        spots.append(StuckSpot(x_mm=x_mm, y_mm=y_mm, percent=share))
        left[members] = False
    return tuple(spots)


def heat_blocks(heat: HeatMap) -> Iterator[Data | Section]:
    """Yield where robots go on one map, and where they get stuck."""
    often, ever = heat.percent_passed(0.5), heat.percent_passed()
    yield Data(
        {
            "heat": {
                "map": heat.world.name,
                "deployments": heat.deployments,
                "cell_mm": round(heat.cell_mm, 2),
                "ever_passed_percent": round(ever, 1),
                "mostly_passed_percent": round(often, 1),
            }
        }
    )
    number = partial(Number, form=".1f", decimals=1)
    words = (
        f"{counted(heat.deployments, 'deployment')} on {heat.world.name}, poses drawn "
        f"{heat.spread} (uniform; "
        f"simulated). Some body covers {ever:.1f} % of the free space; more than half of the "
        f"deployments cover {often:.1f} %. The raster's cells are {heat.cell_mm:.2f} mm."
    )
    yield Section(
        title="Where it goes and where it gets stuck",
        paragraphs=(words, *([] if heat.spots else ["No branch got stuck on this map."])),
        pictures=(
            Picture(
                image=lambda: page_svg(heat_plan(heat)),
                caption=f"{heat.world.name}: share of the deployments whose body passes each "
                "place, and rings where branches get stuck, numbered as in the table (simulated).",
            ),
        ),
        tables=(
            Rows(
                caption="Where branches stop head-on or in a corner most often (simulated)",
                headings=("place", "x mm", "y mm", "% of deployments"),
                rows=tuple(
                    (place, number(spot.x_mm), number(spot.y_mm), number(spot.percent))
                    for place, spot in enumerate(heat.spots, start=1)
                ),
                key="heat.stuck",
                keys=("", "x_mm", "y_mm", "percent"),
            ),
        ),
        folded=True,
    )


def heat_plan(heat: HeatMap) -> Page:
    """Return a map with the share of the deployments that pass each place, and stuck tips."""
    panel = plan_panel(heat.world.bounds.bounds)
    rows, columns = heat.share.shape
    x, y = heat.low_mm
    most = 100.0 * float(heat.share.max()) or 1.0
    shares = np.where(heat.share > 0.0, 100.0 * heat.share / most, np.nan)
    extent = (x, y, x + columns * heat.cell_mm, y + rows * heat.cell_mm)
    panel.add(Raster(extent, blended(shares[::-1], HEAT_COLOURS)), 0.5)
    panel.bar = ("deployments whose body passes (%)", 0.0, most, HEAT_COLOURS)
    draw_map(panel, heat.world)
    for start in heat.world.starts:
        draw_pose(panel, start.pose, max(heat.world.size_mm))
    places = np.array([(spot.x_mm, spot.y_mm) for spot in heat.spots]).reshape(-1, 2)
    if len(places):
        label = "branches get stuck here, numbered as in the table"
        panel.marks(places, "o", 9.0, Ink(line=ALERT, width_pt=1.6), rank=8.0, label=label)
        numbers = [str(number) for number in range(1, len(places) + 1)]
        panel.write_labels(places, numbers, [ALERT] * len(places), size_pt=9.0, mark_pt=5.0)
    return page_of(panel)


# --- What it takes to get a result again ----------------------------------------------------------


def origin_of(
    command: str,
    designs: Sequence[Design],
    profile: LaserProfile | None,
    families: Sequence[MapFamily],
) -> Origin:
    """Return where a result comes from."""
    inputs = {f"design {d.name}": sha256_of(design_text(d).encode())[:12] for d in designs}
    if profile is not None:
        inputs[f"recipe {profile.recipe.name}"] = sha256_of(repr(profile).encode())[:12]
        if any(design.build.pieces is not None for design in designs):
            bond = repr(profile.recipe.lap)  # only robots in pieces have laps
            inputs[f"bond of recipe {profile.recipe.name}"] = sha256_of(bond.encode())[:12]
    worlds = [world for family in families for world in family.worlds]
    for design in designs:
        if seen := RunContext.of(design).seen_words(worlds):
            inputs[f"training of {design.name}"] = seen
    most_named = 12  # maps of a family are listed one by one up to so many
    for family in families:
        prints = [map_fingerprint(world) for world in family.worlds]
        if len(prints) <= most_named:
            inputs |= {
                f"map {index}: {world.name}": found
                for index, (world, found) in enumerate(zip(family.worlds, prints, strict=True), 1)
            }
        else:
            inputs[family.label] = sha256_of("".join(prints).encode())[:12]
    return Origin(command=command, inputs=inputs, versions=package_versions())
