"""What one point of the search is worth."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import accumulate, pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.growth.batch import BLOCK, Batch, Block, Launches, TerrainSet, Workspace
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import MOST_BRANCHES, Design
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.search.design_batch import DesignBatch, planned_batch
from vinefab.search.evaluation import Evaluations, objective
from vinefab.search.parallel.executor import Executor, SerialExecutor, WorkUnit, in_work_units
from vinefab.search.record.timing import Stopwatch, Work
from vinefab.search.settings import EvaluationSettings, PartSettings, RunSettings
from vinefab.search.space import Space
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import Poses, PreparedMap, composites, poses_on, scores_of
from vinefab.tasks.reach import Reach
from vinefab.tasks.shipped_tasks import make_task
from vinefab.tasks.task import HeadOnPenalty, Task, TaskOutcomes, concatenated_outcomes, outcomes

Penalty = Callable[[Design], float]
"""How far a design is from one that can be made: 0 when it can, else above 0."""


@runtime_checkable
class FullCheck(Protocol):
    """A penalty that can also look at a design in full, which takes longer."""

    def passes(self, design: Design) -> bool:
        """Return whether no rule at all forbids to make a design."""
        ...


SHARE_LEFT, LEAST_BLOCK = 1.5, 32
"""Growths done in one go: what is left over so many times the workers, so that nobody has to wait
long for the last one, but enough to forget the handing over, unless somebody would get none."""

TRAINING, FINAL, MAPS = 1411, 1412, 1414
"""Streams of the seeds that poses, and maps for a generation, are drawn from."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvaluatorSpec:
    """What a trial is made of: little enough to be sent to another computer."""

    # settings, maps: the run
    settings: RunSettings
    maps: tuple[Map, ...]
    penalty: Penalty | None  # none in a run that does not ask for designs that can be made


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluator:
    """Everything that an evaluation needs, the same for all points of a run."""

    sites: tuple[PreparedMap, ...]  # the maps
    atlas: TerrainSet  # their walls together
    space: Space  # what points stand for
    task: Task  # what final states are worth
    growth: GrowthOptions  # how robots grow
    evaluation: EvaluationSettings  # how scores become a fitness
    penalty: Penalty | None  # none in a run that does not ask for designs that can be made
    brief: EvaluatorSpec  # what it was made of
    # body radius per level of the deepest designs; one 0 for bare centrelines
    radii_mm: tuple[float, ...]
    idle: list[Workspace] = field(default_factory=list)  # memory for growing that nobody uses now
    # launches made ready, with the poses that they are of
    ready: list[tuple[Poses, Launches]] = field(default_factory=list)

    @classmethod
    def of(cls, settings: RunSettings, maps: Sequence[Map], penalty: Penalty | None) -> "Evaluator":
        """Return the trial of a run."""
        if not maps:
            raise BadInputError("maps", "none", "at least one map")
        if settings.evaluation.fabricable and penalty is None:
            raise BadInputError(
                "evaluation.fabricable", "true, without a penalty", "false, or a penalty function"
            )
        space = Space(settings.space, settings.build)
        if len(space) == 0:
            raise BadInputError("space", "every variable fixed", "at least one with a range")
        evaluation = settings.evaluation
        if evaluation.maps_per_generation > len(maps):
            key, allowed = "evaluation.maps_per_generation", f"at most the {len(maps)} maps"
            raise BadInputError(key, evaluation.maps_per_generation, allowed)
        sites = tuple(PreparedMap.of(_with_range(world, evaluation.pose_range)) for world in maps)
        used = penalty if evaluation.fabricable else None
        return cls(
            sites=sites,
            atlas=TerrainSet([site.terrain for site in sites]),
            space=space,
            task=_search_task(settings.task, evaluation.head_on_weight),
            growth=settings.growth,
            evaluation=evaluation,
            penalty=used,
            brief=EvaluatorSpec(settings=settings, maps=tuple(maps), penalty=used),
            radii_mm=_radii_mm(space, settings.growth),
        )

    def poses(self, seed: int, stream: int, generation: int, count: int) -> Poses:
        """Draw the poses of one generation: the same for all its points."""
        seeds = [
            int(child(seed, stream, generation, index).integers(2**62))
            for index in range(len(self.sites))
        ]
        return poses_on(self.sites, count, seeds)

    def training_poses(self, seed: int, generation: int) -> Poses:
        """Draw what all points of a generation meet: poses on all maps, or on some of them."""
        draw = generation if self.evaluation.redraw else 0
        poses = self.poses(seed, TRAINING, draw, self.evaluation.poses_per_map)
        wanted = self.evaluation.maps_per_generation
        if self.evaluation.composite == "single":
            wanted = 1
        if wanted == 0:
            return poses
        taken = child(seed, MAPS, draw).permutation(len(poses))[:wanted]
        return tuple(places if index in taken else () for index, places in enumerate(poses))

    def evaluate(self, x: Floats, poses: Poses) -> tuple[Evaluations, Work]:
        """Return what points are worth, and the processor time that it took; see `begin`."""
        return self.begin(x, poses, SerialExecutor())()

    def rehearse(self, poses: Poses) -> None:
        """Evaluate the middle of the space for nothing: compiled code is loaded when first used."""
        self.evaluate(np.full((1, len(self.space)), 0.5), poses)

    def begin(
        self, x: Floats, poses: Poses, crew: Executor
    ) -> Callable[[], tuple[Evaluations, Work]]:
        """Have a crew find what points are worth; a point that is no design is a result too.

        Points do not influence each other: whoever evaluates them, in whatever parts, finds the
        same. The larger designs are begun first, so that nobody has to wait long in the end.

        Parameters
        ----------
        x
            The points, shape (m, d), m at least 1.

        Returns
        -------
        Callable
            Helps with the work and waits for it, and gives what was found in the order of the
            points, and the processor time that it took.
        """
        watch = Stopwatch()
        fleet, launches = self.space.fleet(x), self.launches(poses)
        order = np.argsort(-fleet.sizes, kind="stable")
        rows = order[fleet.sizes[order] <= MOST_BRANCHES]
        growing = self._growing(fleet.part(rows), launches, crew.count) if len(rows) else []
        making = self._making(x, crew.count)
        planning = Work(growth_s=watch.lap_s())
        done = crew.begin([*making, *growing])

        def finish() -> tuple[Evaluations, Work]:
            done()
            grown = (
                concatenated_outcomes([piece.result[0] for piece in growing]) if growing else None
            )
            found = Evaluations.of(len(x), len(launches), rows, grown)
            if making:
                penalty = np.concatenate([piece.result[0] for piece in making])
                found = found.with_penalties(penalty)
            spent = [piece.result[1] for piece in making] + [piece.result[1] for piece in growing]
            return found, Work.total([planning, *spent])

        return finish

    def _making(self, x: Floats, workers: int) -> list[WorkUnit[tuple[Floats, Work]]]:
        """Return the work of finding penalties: NaN where a point is no design, or not to them."""
        if self.penalty is None:
            return []
        parts = in_work_units(x, math.ceil(len(x) / (4 * workers)))
        return [WorkUnit(partial(_penalties, part, self.space, self.penalty)) for part in parts]

    def _growing(
        self, fleet: DesignBatch, launches: Launches, workers: int
    ) -> list[WorkUnit[tuple[TaskOutcomes, Work]]]:
        """Return the work of growing and scoring designs, in the order of a batch."""
        builds = {depth: self.space.build_of(depth) for depth in set(fleet.depth.tolist())}
        plans = planned_batch(fleet, builds, self.radii_mm)
        batch = Batch(plans, launches, self.growth, self.idle)
        grounds = [site.context for site in self.sites]

        def grown(first: int, size: int) -> tuple[TaskOutcomes, Work]:
            watch = Stopwatch()

            def work(block: Block) -> tuple[TaskOutcomes, Work]:
                growth_s = watch.lap_s()
                found = outcomes(self.task, block, grounds)
                return found, Work(growth_s=growth_s, scoring_s=watch.lap_s())

            return batch.worked(first, size, work)

        ends = accumulate(block_sizes(len(batch), workers), initial=0)
        return [WorkUnit(partial(grown, one, two - one)) for one, two in pairwise(ends)]

    def score(self, found: Evaluations, row: int, poses: Poses) -> Score:
        """Return what was found of one point that is a design as a score."""
        one = TaskOutcomes(found.score[row], {name: v[row] for name, v in found.terms.items()})
        (score,) = scores_of(one, self.task, self.sites, self.launches(poses))
        return score

    def launches(self, poses: Poses) -> Launches:
        """Return the places that robots grow from, at once if they were made ready."""
        for known, launches in self.ready:
            if known is poses:
                return launches
        return Launches.of(self.atlas, poses)

    def make_ready(self, several: Iterable[Poses]) -> None:
        """Make the places ready that robots grow from next, in place of those that were."""
        self.ready[:] = [(poses, Launches.of(self.atlas, poses)) for poses in several]

    def composites(self, scores: Floats) -> Floats:
        """Return the numbers that a run weighs evaluations into, shape (m,)."""
        kind = self.evaluation.composite
        return composites(scores, kind, self.evaluation.reference_deviation)

    def fitness(self, composite: Floats, penalty: Floats) -> Floats:
        """Return what designs with a composite score and a penalty are worth to the optimizer."""
        weight = self.evaluation.penalty_weight
        return objective(composite, penalty, lowest=self.lowest, weight=weight)

    @property
    def lowest(self) -> float:
        """The fitness that designs have at least which can be made."""
        return min(0.0, self.task.lowest)


def block_sizes(growths: int, workers: int) -> list[int]:
    """Return how many growths to do in one go, block after block, larger ones first.

    Examples
    --------
    >>> block_sizes(375, workers=2)
    [125, 84, 56, 37, 32, 32, 9]
    >>> block_sizes(20, workers=4)
    [5, 5, 5, 5]
    """
    least = min(LEAST_BLOCK, math.ceil(growths / workers))
    sizes, left = list[int](), growths
    while left > 0:
        share = math.ceil(left / (SHARE_LEFT * workers))
        sizes.append(min(max(share, least), BLOCK, left))
        left -= sizes[-1]
    return sizes


def _radii_mm(space: Space, growth: GrowthOptions) -> tuple[float, ...]:
    """Return the body's radius on each level of the deepest designs, as plans have it."""
    if growth.body == "centerline":
        return (0.0,)
    deepest = space.build_of(int(space.settings.levels.high))
    return tuple(width_mm / math.pi for width_mm in deepest.widths_mm)


def _penalties(x: Floats, space: Space, penalty: Penalty) -> tuple[Floats, Work]:
    """Return the penalties of points, NaN where there is no design, and the time that it took."""
    watch = Stopwatch()
    found = np.zeros(len(x))
    for row, point in enumerate(x):
        try:
            found[row] = penalty(space.design(point))
        except BadInputError:
            found[row] = np.nan
    return found, Work(making_s=watch.lap_s())


def _search_task(settings: PartSettings, head_on_weight: float) -> Task:
    """Return a run's task; it measures areas fast unless the run says how to."""
    task = make_task(settings.name, settings.parameters)
    if isinstance(task, Coverage | Reach) and "area" not in settings.parameters:
        task = replace(task, area="fast")
    return HeadOnPenalty(task=task, weight=head_on_weight) if head_on_weight > 0.0 else task


def _with_range(world: Map, share: float) -> Map:
    """Return a map whose starts give a share of their range."""
    if share == 1.0:
        return world
    starts = [
        replace(
            start,
            spread_x_mm=share * start.spread_x_mm,
            spread_y_mm=share * start.spread_y_mm,
            spread_heading_rad=min(math.tau, share * start.spread_heading_rad),
        )
        for start in world.starts
    ]
    return replace(world, starts=tuple(starts))
