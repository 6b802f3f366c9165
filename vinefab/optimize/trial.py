"""What one point of the search is worth."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, chain, pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.growth.atlas import Atlas
from vinefab.growth.batch import BLOCK, Batch, Block, Launches
from vinefab.growth.options import GrowthOptions
from vinefab.growth.scratch import Scratch
from vinefab.model.checked import Floats, Ints
from vinefab.model.design import MOST_BRANCHES, Design
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.optimize.crew import Alone, Crew, Promise
from vinefab.optimize.fleet import Fleet
from vinefab.optimize.objective import objective
from vinefab.optimize.planting import planted
from vinefab.optimize.settings import EvaluationSettings, PartSettings, RunSettings
from vinefab.optimize.space import Space
from vinefab.optimize.timing import Stopwatch, Work
from vinefab.tasks.composite import composites
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import Poses, Site, poses_on, scores_of
from vinefab.tasks.reach import Reach
from vinefab.tasks.registry import make_task
from vinefab.tasks.sliding import Sliding
from vinefab.tasks.task import Outcomes, Task, joined, outcomes

Penalty = Callable[[Design], float]
"""How far a design is from one that can be made: 0 when it can, else above 0."""


@runtime_checkable
class Inspector(Protocol):
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
class Found:
    """What m points are worth, evaluation by evaluation, k of them; NaN where there is no design.

    Parameters
    ----------
    penalty
        How far each design is from one that can be made, shape (m,); 0 where there is no design.
    score
        The task's scores, shape (m, k).
    terms
        The numbers that scores are made of, each of shape (m, k).
    """

    penalty: Floats
    score: Floats
    terms: Mapping[str, Floats]

    @classmethod
    def joined(cls, parts: Sequence["Found"]) -> "Found":
        """Return several parts, at least one, as one."""
        # A part without any design does not know the terms.
        names = max((tuple(part.terms) for part in parts), key=len)
        gaps = [np.full(part.score.shape, np.nan) for part in parts]
        return cls(
            penalty=np.concatenate([part.penalty for part in parts]),
            score=np.concatenate([part.score for part in parts]),
            terms={
                name: np.concatenate(
                    [part.terms.get(name, gap) for part, gap in zip(parts, gaps, strict=True)]
                )
                for name in names
            },
        )

    def with_penalties(self, penalty: Floats) -> "Found":
        """Return the same with penalties; a point whose penalty is NaN is no design."""
        gone = np.isnan(penalty)
        if not gone.any():
            return replace(self, penalty=penalty)
        tables = {name: np.where(gone[:, None], np.nan, v) for name, v in self.terms.items()}
        return Found(
            penalty=np.where(gone, 0.0, penalty),
            score=np.where(gone[:, None], np.nan, self.score),
            terms=tables,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Brief:
    """What a trial is made of: little enough to be sent to another computer.

    Parameters
    ----------
    settings, maps
        The run.
    penalty
        None in a run that does not ask for designs that can be made.
    """

    settings: RunSettings
    maps: tuple[Map, ...]
    penalty: Penalty | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """Everything that an evaluation needs, the same for all points of a run.

    Parameters
    ----------
    sites
        The maps.
    atlas
        Their walls together.
    space
        What points stand for.
    task
        What final states are worth.
    growth
        How robots grow.
    evaluation
        How scores become a fitness.
    penalty
        None in a run that does not ask for designs that can be made.
    brief
        What it was made of.
    radii_mm
        Body radius per level of the deepest designs; one 0 for bare centrelines.
    idle
        Memory for growing that nobody uses now.
    """

    sites: tuple[Site, ...]
    atlas: Atlas
    space: Space
    task: Task
    growth: GrowthOptions
    evaluation: EvaluationSettings
    penalty: Penalty | None
    brief: Brief
    radii_mm: tuple[float, ...]
    idle: list[Scratch] = field(default_factory=list)

    @classmethod
    def of(cls, settings: RunSettings, maps: Sequence[Map], penalty: Penalty | None) -> "Trial":
        """Return the trial of a run.

        Raises
        ------
        BadInputError
            If there is no map or nothing to search, or the run asks for designs that can be made
            and nobody says which.
        """
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
        sites = tuple(Site.of(_with_range(world, evaluation.pose_range)) for world in maps)
        used = penalty if evaluation.fabricable else None
        return cls(
            sites=sites,
            atlas=Atlas([site.terrain for site in sites]),
            space=space,
            task=_search_task(settings.task, evaluation.head_on_weight),
            growth=settings.growth,
            evaluation=evaluation,
            penalty=used,
            brief=Brief(settings=settings, maps=tuple(maps), penalty=used),
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

    def evaluate(self, x: Floats, poses: Poses) -> tuple[Found, Work]:
        """Return what points are worth, and the processor time that it took; see `begin`."""
        return self.begin(x, poses, Alone())()

    def begin(self, x: Floats, poses: Poses, crew: Crew) -> Callable[[], tuple[Found, Work]]:
        """Have a crew find what points are worth; a point that is no design is a result too.

        Points do not influence each other: whoever evaluates them, in whatever parts, finds the
        same. The larger designs are begun first, so that nobody has to wait long in the end.

        Parameters
        ----------
        x
            The points, shape (m, d), m at least 1.
        poses
            For each map, the poses to grow from.
        crew
            Who does the work.

        Returns
        -------
        Callable
            Waits for the work, and gives what was found in the order of the points, and the
            processor time that it took.
        """
        watch = Stopwatch()
        making = self._penalties(x, crew)
        fleet = self.space.fleet(x)
        order = np.argsort(-fleet.sizes, kind="stable")
        there = order[fleet.sizes[order] <= MOST_BRANCHES]
        launches = self.launches(poses)
        parts = [part for part in (_in_two(there) if crew.count > 1 else [there]) if len(part)]
        growing = [self._grown(fleet.part(part), launches, crew) for part in parts]
        planning = Work(growth_s=watch.lap_s())

        def finish() -> tuple[Found, Work]:
            crew.wait([*making, *chain.from_iterable(growing)])
            penalty = [promise.result() for promise in making]
            grown = [[promise.result() for promise in blocks] for blocks in growing]
            shape = (len(x), len(launches))
            found = _found(shape, parts, [[found for found, _ in blocks] for blocks in grown])
            spent = [planning, *(work for _, work in (*penalty, *chain.from_iterable(grown)))]
            if penalty:
                found = found.with_penalties(np.concatenate([values for values, _ in penalty]))
            return found, Work.total(spent)

        return finish

    def _penalties(self, x: Floats, crew: Crew) -> list[Promise[tuple[Floats, Work]]]:
        """Have somebody find penalties; NaN where a point is no design, or not to the penalty."""
        if self.penalty is None:
            return []
        size = math.ceil(len(x) / (4 * crew.count))
        return [
            crew.submit(self._penalties_of, x[first : first + size])
            for first in range(0, len(x), size)
        ]

    def _penalties_of(self, x: Floats) -> tuple[Floats, Work]:
        watch = Stopwatch()
        penalty = np.zeros(len(x))
        if self.penalty is not None:
            for row, point in enumerate(x):
                try:
                    penalty[row] = self.penalty(self.space.design(point))
                except BadInputError:
                    penalty[row] = np.nan
        return penalty, Work(making_s=watch.lap_s())

    def _grown(
        self, fleet: Fleet, launches: Launches, crew: Crew
    ) -> list[Promise[tuple[Outcomes, Work]]]:
        """Have somebody grow and score designs, in the order of a batch."""
        builds = {depth: self.space.build_of(depth) for depth in set(fleet.depth.tolist())}
        plans = planted(fleet, builds, self.radii_mm)
        batch = Batch(plans, launches, self.growth, self.idle)
        grounds = [site.ground for site in self.sites]

        def grown(first: int, size: int) -> tuple[Outcomes, Work]:
            watch = Stopwatch()

            def work(block: Block) -> tuple[Outcomes, Work]:
                growth_s = watch.lap_s()
                found = outcomes(self.task, block, grounds)
                return found, Work(growth_s=growth_s, scoring_s=watch.lap_s())

            return batch.worked(first, size, work)

        ends = accumulate(block_sizes(len(batch), crew.count), initial=0)
        return [crew.submit(grown, one, two - one) for one, two in pairwise(ends)]

    def score(self, found: Found, row: int, poses: Poses) -> Score:
        """Return what was found of one point that is a design as a score."""
        one = Outcomes(found.score[row], {name: v[row] for name, v in found.terms.items()})
        (score,) = scores_of(one, self.task, self.sites, self.launches(poses))
        return score

    def launches(self, poses: Poses) -> Launches:
        """Return the places that robots grow from.

        Raises
        ------
        BadInputError
            If a pose is not free.
        """
        return Launches.of(self.atlas, poses)

    def composites(self, scores: Floats) -> Floats:
        """Return the numbers that a run weighs evaluations into, shape (m,).

        Parameters
        ----------
        scores
            Shape (m, k); NaN where there is no design.
        """
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

    Parameters
    ----------
    growths
        All of them.
    workers
        Who shares them.

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


def _in_two(rows: Ints) -> list[Ints]:
    """Return every fourth of some designs, and the others: those to plan while these are grown."""
    fourth = np.arange(len(rows)) % 4 == 0
    return [rows[fourth], rows[~fourth]]


def _found(
    shape: tuple[int, int], parts: Sequence[Ints], outcomes: Sequence[Sequence[Outcomes]]
) -> Found:
    """Return what was found of points, shape (m, k), where some of them are designs.

    Parameters
    ----------
    shape
        Number of points and of launches.
    parts
        The points of each batch, in its order.
    outcomes
        What the blocks of each batch are worth.
    """
    score, terms = np.full(shape, np.nan), dict[str, Floats]()
    for rows, blocks in zip(parts, outcomes, strict=True):
        found = joined(blocks)
        score[rows] = found.score.reshape(shape[1], -1).T
        for name, values in found.terms.items():
            table = terms.setdefault(name, np.full(shape, np.nan))
            table[rows] = values.reshape(shape[1], -1).T
    return Found(penalty=np.zeros(shape[0]), score=score, terms=terms)


def _search_task(settings: PartSettings, head_on_weight: float) -> Task:
    """Return a run's task; it measures areas fast unless the run says how to."""
    task = make_task(settings.name, settings.parameters)
    if isinstance(task, Coverage | Reach) and "area" not in settings.parameters:
        task = replace(task, area="fast")
    return Sliding(task=task, weight=head_on_weight) if head_on_weight > 0.0 else task


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
