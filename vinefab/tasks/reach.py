"""The reach task: how much of the free space, or of some targets, the deployed body comes to."""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from pydantic import BeforeValidator
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import UnfitInputError
from vinefab.core.table import Table
from vinefab.core.validation import LARGEST_MM, SMALLEST, Floats, Ints
from vinefab.growth.batch import Batch, GrowthBlock, Launches
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.target import (
    Branches,
    Target,
    TargetsResult,
    check_targets,
    targets_given,
)
from vinefab.tasks.areas import BodyCover, CellGrid, Chains, Cover, TargetCover
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import (
    Outcome,
    Task,
    TaskOutcomes,
    are_many,
    concatenated_outcomes,
    one_by_one,
)

QUARTER_SEGMENTS = 32
"""Sides of the polygon that stands for a quarter of a round end: it has 0.04 % less area."""


Distance = Annotated[float, Ge(SMALLEST), Le(LARGEST_MM), Unit("mm")]


NEAR_MM = 80.0
"""Falloff of targets where none is given, chosen by measurement (`docs/files.md`)."""

NEAR_SHARE = 0.5
"""What a target counts that is missed by a hair: three near misses are worth less than two hits."""


class Reach(Table):
    """Share of the free space within a buffer of the body (paper, Fig. 4), or of given targets.

    ``exact`` areas are by polygons, for a score that is reported; ``fast`` ones on cells of free
    space (`FreeArea.reached_mm2` states the error), a hundred times faster, for searching; taken
    only where the map is not too large for such a buffer.
    """

    name: ClassVar[str] = "reach"
    lowest: ClassVar[float] = 0.0

    buffer_mm: Annotated[
        Distance, Doc("largest distance from the body's centreline that counts as reached")
    ] = 40.0
    area: Annotated[
        Literal["auto", "exact", "fast"], Doc("how areas are found; auto: fast in a search")
    ] = "auto"
    targets: Annotated[
        tuple[Target, ...],
        BeforeValidator(targets_given),
        Doc(
            "[[x, y], ...] or tables with name, point_mm or area_mm, and tolerance_mm, in place of "
            "those of the maps: where there are any, the score is the share of them that is "
            "touched, plus something for nearness, and `buffer_mm` and `area` have no effect"
        ),
    ] = ()
    falloff_mm: Annotated[
        float | None,
        Ge(0),
        Le(LARGEST_MM),
        Unit("mm"),
        Doc(
            "beyond its tolerance a target counts less and less, and nothing so much farther; 0: "
            f"nothing. Default: {NEAR_MM:g}"
        ),
    ] = None
    reached_by: Annotated[
        Literal["body", "tip"],
        Doc("body: any point of a centreline; tip: the tip of a branch"),
    ] = "body"

    def goals(self, of_map: Sequence[Target]) -> tuple[Target, ...]:
        """Return the targets that count on a map: its own, or those of the map."""
        return self.targets or tuple(of_map)

    def for_search(self) -> "Reach":
        """Return the task with fast areas, unless its parameters say how to measure them."""
        return self.changed(area="fast") if self.area == "auto" else self

    def check_map(self, world: Map, context: MapContext) -> None:
        """Raise `BadInputError` where a target is not in the free space of a map."""
        key = "task.targets[{}]" if self.targets else "targets[{}]"
        check_targets(world, self.goals(context.targets), key)

    def cover(self, context: MapContext) -> Cover:
        """Return the measure of the targets that several robots reach together."""
        targets = self.goals(context.targets)
        if not targets:
            return BodyCover(
                grid=CellGrid.of(context.edges_mm, self.buffer_mm), radius_mm=self.buffer_mm
            )
        tips = self.reached_by == "tip"
        return TargetCover(
            targets_mm=np.array([target.middle_mm for target in targets]),
            away_mm=lambda chains: nearest_mm(chains, targets, tips=tips),
            tolerance_mm=np.array([target.tolerance_mm for target in targets]),
        )

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the share, 0 to 1, and as terms what was reached and the grown length."""
        if self.goals(context.targets):
            summed_mm = np.array([float(deployment.grown_mm.sum())])
            return self._of_targets(Chains.of(deployment), summed_mm, context).one(0)
        raster = context.raster(self.buffer_mm) if self.area == "fast" else None
        if raster is None:
            deployed = np.flatnonzero(deployment.deployed)
            chains = [deployment.chain_mm(int(branch)).tolist() for branch in deployed]
            reached_mm2 = context.free_area_mm2(near_chains(chains, self.buffer_mm))
        else:
            (reached_mm2,) = raster.reached_mm2(Chains.of(deployment)).tolist()
        grown_mm = float(deployment.grown_mm.sum())
        return _outcomes(np.array([reached_mm2]), np.array([grown_mm]), context).one(0)

    def parts(self, score: float, terms: Mapping[str, float]) -> dict[str, float]:
        """Return the share of the targets that is touched, and the score earned by nearness."""
        if TOUCHED not in terms:
            return {"area reached": score}
        touched = terms[TOUCHED] / terms[TARGETS]
        return {"targets touched": touched, "nearness to the others": score - touched}

    def evaluate_block(self, block: GrowthBlock, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return the outcome of `evaluate` for every growth of a block."""
        if any(self.goals(context.targets) for context in contexts):
            return concatenated_outcomes(
                [
                    self._of_targets(*_bodies_of(block, *part), contexts[part[0]])
                    for part in block.by_terrain()
                ]
            )
        if self.area != "fast":
            if not are_many(block, contexts):
                return one_by_one(self, block, contexts)
            return concatenated_outcomes(
                [self._of_bodies(block, *part, contexts[part[0]]) for part in block.by_terrain()]
            )
        parts = list[TaskOutcomes]()
        for part in block.by_terrain():
            context = contexts[part[0]]
            raster = context.raster(self.buffer_mm)
            if raster is None:
                return one_by_one(self, block, contexts)
            chains, grown_mm = _bodies_of(block, *part)
            parts.append(_outcomes(raster.reached_mm2(chains), grown_mm, context))
        return concatenated_outcomes(parts)

    def _of_bodies(
        self, block: GrowthBlock, _terrain: int, one: int, two: int, context: MapContext
    ) -> TaskOutcomes:
        """Return the outcomes of `evaluate` for the growths ``one .. two - 1``, on one map."""
        growth, branches = block.growth, np.arange(block.branch[one], block.branch[two])
        of_growth = np.repeat(np.arange(one, two), np.diff(block.branch[one : two + 1]))
        first = block.room[of_growth] + growth.first_point[branches + of_growth]
        count = np.diff(growth.first_point)[branches + of_growth]
        out = np.flatnonzero(count)
        line_first = np.concatenate([[0], np.cumsum(count[out])])
        at = np.repeat(first[out] - line_first[:-1], count[out]) + np.arange(line_first[-1])
        lines_mm = growth.points[at]
        near = shapely.buffer(
            shapely.linestrings(lines_mm, indices=np.repeat(np.arange(len(out)), count[out])),
            self.buffer_mm,
            quad_segs=QUARTER_SEGMENTS,
        )
        begins = np.searchsorted(of_growth[out], np.arange(one, two + 1))
        reached_mm2 = context.rows.areas_mm2(near, begins, lines_mm, line_first, self.buffer_mm)
        for index in np.flatnonzero(np.isnan(reached_mm2)).tolist():
            union = shapely.union_all(near[begins[index] : begins[index + 1]])
            reached_mm2[index] = context.free_area_mm2(union)
        return _outcomes(reached_mm2, _sums(growth.grown, block.branch[one : two + 1]), context)

    def _of_targets(self, chains: Chains, grown_mm: Floats, context: MapContext) -> TaskOutcomes:
        """Return the share of the targets that is touched, and as terms how many and how near."""
        targets = self.goals(context.targets)
        away_mm = nearest_mm(chains, targets, tips=self.reached_by == "tip")
        away_mm = np.minimum(away_mm, context.diagonal_mm)
        beyond_mm = away_mm - np.array([target.tolerance_mm for target in targets])
        touched = beyond_mm <= 0.0
        counted = touched.astype(np.float64)
        falloff_mm = self.falloff_mm
        if falloff_mm is None:
            near = NEAR_SHARE * np.clip(1.0 - beyond_mm / NEAR_MM, 0.0, 1.0)
            counted = np.where(touched, 1.0, near)
        elif falloff_mm > 0.0:
            counted = np.clip(1.0 - beyond_mm / falloff_mm, 0.0, 1.0)
        terms = {
            TARGETS: np.full(len(touched), float(len(targets))),
            TOUCHED: touched.sum(axis=1).astype(np.float64),
            "farthest_mm": away_mm.max(axis=1),
            "grown_mm": grown_mm,
        }
        return TaskOutcomes(counted.mean(axis=1), terms)


def _bodies_of(block: GrowthBlock, _terrain: int, one: int, two: int) -> tuple[Chains, Floats]:
    """Return the bodies of growths ``one .. two - 1`` and their grown lengths."""
    growth, first = block.growth, block.branch[one]
    chains = Chains(
        growth.points,
        growth.first_point[first + one : block.branch[two] + two],
        block.branch[one : two + 1] - first,
        block.room[one : two + 1],
        block.at_bend,
    )
    return chains, _sums(growth.grown, block.branch[one : two + 1])


def near_chains(chains: Sequence[Sequence[Sequence[float]]], buffer_mm: float) -> BaseGeometry:
    """Return the area within a distance of some lines.

    Notes
    -----
    One line after the other and then together: buffering them all as one shape takes minutes where
    hundreds of them cross each other, instead of a tenth of a second.
    """
    lines = [shapely.LineString(chain) for chain in chains]
    return shapely.union_all(shapely.buffer(lines, buffer_mm, quad_segs=QUARTER_SEGMENTS))


def _outcomes(reached_mm2: Floats, grown_mm: Floats, context: MapContext) -> TaskOutcomes:
    share = np.minimum(1.0, reached_mm2 / context.area_mm2)
    return TaskOutcomes(share, {"reached_mm2": reached_mm2, "grown_mm": grown_mm})


def _sums(values: Floats, first: Ints) -> Floats:
    """Return the sum of each range, added up as for a single deployment."""
    sums = [float(values[one:two].sum()) for one, two in itertools.pairwise(first.tolist())]
    return np.array(sums, dtype=np.float64)


# --- Targets: how near bodies come to them, and which are touched --------------------------------

TARGETS, TOUCHED = "targets", "targets_reached"
"""Terms of scores of targets: how many there are, and how many are touched."""


def nearest_mm(chains: Chains, targets: Sequence[Target], *, tips: bool = False) -> Floats:
    """Return the distances of targets from the bodies of several growths, shape (j, t).

    Parameters
    ----------
    tips
        Whether only tips count, instead of every point of a centreline. Where no branch came out
        the distance is infinite.
    """
    count = np.diff(chains.branch)
    growth = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(growth)) + growth  # every growth has one more entry than branches
    first = chains.room[growth] + chains.first_point[place]
    end = chains.room[growth] + chains.first_point[place + 1]
    away_mm = np.full((len(count), len(targets)), np.inf)
    branches = Branches(chains.points_mm, first, end)
    owner, gaps_mm = branches.gaps_mm(targets, tips=tips)
    owners, begin = np.unique(growth[owner], return_index=True)
    if len(owners):
        away_mm[owners] = np.minimum.reduceat(gaps_mm, begin, axis=0)
    return away_mm


def task_targets(task: Task | None, world: Map) -> tuple[Target, ...]:
    """Return the targets that count on a map: the task's own, or those of the map."""
    of_task: Callable[[Sequence[Target]], tuple[Target, ...]] | None
    of_task = getattr(_inner(task), "goals", None)
    return world.targets if of_task is None else of_task(world.targets)


def counts_targets(task: Task | None) -> bool:
    """Return whether a task is about targets, as it is taken to be where none is named."""
    return task is None or hasattr(_inner(task), "goals")


def _inner(task: Task | None) -> Task | None:
    """Return the task that others are wrapped around."""
    while (inside := getattr(task, "task", None)) is not None:
        task = inside
    return task


def check_targets_on(task: Task, worlds: Sequence[Map]) -> None:
    """Raise `BadInputError` where a task would count targets on some maps and areas on others."""
    if not counts_targets(task):
        return
    aimed = [bool(task_targets(task, world)) for world in worlds]
    if any(aimed) and not all(aimed):
        bare = worlds[aimed.index(False)].name
        remedy = "give it some, or give the task its own, which hold on all maps"
        raise UnfitInputError("maps", f"map {bare!r} has no targets, and others have", remedy)


def touched_targets(
    deployments: Iterable[tuple[Deployment, Map]], task: Task | None = None
) -> TargetsResult | None:
    """Return the targets that deployments touch; None where no map and no task has any.

    Targets of one name on several maps count as one.

    Parameters
    ----------
    deployments
        Each with its map.
    task
        Has its own targets, or says that only tips touch; None: the maps' targets, by bodies.
    """
    tips = getattr(_inner(task), "reached_by", "body") == "tip"
    aimed = ((one, task_targets(task, world)) for one, world in deployments)
    return TargetsResult.touched(aimed, tips=tips)


def design_touches(
    design: Design,
    worlds: Sequence[Map],
    launches: Launches,
    options: GrowthOptions,
    task: Task | None = None,
) -> TargetsResult | None:
    """Grow a design from every launch, and return which targets it touches; None without targets.

    Parameters
    ----------
    worlds
        One for each terrain of the launches.
    task
        As in `touched_targets`.
    """
    if not any(task_targets(task, world) for world in worlds):
        return None
    grown = Batch(Plans.of([design], options), launches, options, engine="auto").regrown()
    on = [worlds[index] for index in launches.terrain.tolist()]
    return touched_targets(zip(grown, on, strict=True), task)
