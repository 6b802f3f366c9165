"""What one point of the search is worth."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.growth.atlas import Atlas
from vinefab.growth.batch import Block, Launches
from vinefab.growth.options import GrowthOptions
from vinefab.model.checked import Floats
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.optimize.objective import INVALID_FITNESS, objective
from vinefab.optimize.settings import EvaluationSettings, PartSettings, RunSettings
from vinefab.optimize.space import Space
from vinefab.optimize.timing import Stopwatch, Work
from vinefab.tasks.composite import composite
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import Poses, Site, poses_on, score_designs
from vinefab.tasks.ground import Ground
from vinefab.tasks.reach import Reach
from vinefab.tasks.registry import make_task
from vinefab.tasks.sliding import Sliding
from vinefab.tasks.task import Outcome, Task, outcomes

Penalty = Callable[[Design], float]
"""How far a design is from one that can be made: 0 when it can, else above 0."""


@runtime_checkable
class Inspector(Protocol):
    """A penalty that can also look at a design in full, which takes longer."""

    def passes(self, design: Design) -> bool:
        """Return whether no rule at all forbids to make a design."""
        ...


TRAINING, FINAL, MAPS = 1411, 1412, 1414
"""Streams of the seeds that poses, and maps for a generation, are drawn from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One point of the search, evaluated.

    Parameters
    ----------
    design
        The design at the point; None when there is none.
    score
        Its score; None without a design.
    penalty
        Its penalty.
    fitness
        What it is worth to the optimizer.
    problem
        Why there is no design, or an empty string.
    """

    design: Design | None = None
    score: Score | None = None
    penalty: float = 0.0
    fitness: float = INVALID_FITNESS
    problem: str = ""


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
    """

    sites: tuple[Site, ...]
    atlas: Atlas
    space: Space
    task: Task
    growth: GrowthOptions
    evaluation: EvaluationSettings
    penalty: Penalty | None
    brief: Brief

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

    def evaluate(self, x: Floats, poses: Poses) -> tuple[list[Candidate], Work]:
        """Return what points are worth; a point that is no design is a result, not an error.

        Points do not influence each other: whoever evaluates them, in whatever parts, finds the
        same.

        Parameters
        ----------
        x
            The points, shape (m, d).
        poses
            For each map, the poses to grow from.

        Returns
        -------
        candidates
            In the order of the points.
        work
            The processor time that it took.
        """
        watch = Stopwatch()
        found = [self._unscored(row) for row in x]
        there = [index for index, candidate in enumerate(found) if candidate.design is not None]
        designs = [candidate.design for candidate in found if candidate.design is not None]
        making_s = watch.lap_s()
        task = TimedTask(self.task)
        launches = self.launches(poses)
        scores = score_designs(designs, self.sites, launches, task, self.growth)
        grown_s = watch.lap_s()
        for index, score in zip(there, scores, strict=True):
            found[index] = self._scored(found[index], score)
        scoring_s = task.spent_s + watch.lap_s()
        return found, Work(making_s, grown_s - task.spent_s, scoring_s)

    def launches(self, poses: Poses) -> Launches:
        """Return the places that robots grow from.

        Raises
        ------
        BadInputError
            If a pose is inside an obstacle or outside the bounds.
        """
        return Launches.of(self.atlas, poses)

    def _unscored(self, x: Floats) -> Candidate:
        """Return the design at a point with its penalty, or why there is none."""
        try:
            design = self.space.design(x)
            penalty = 0.0 if self.penalty is None else self.penalty(design)
        except BadInputError as error:
            return Candidate(problem=str(error))
        return Candidate(design=design, penalty=penalty)

    def _scored(self, candidate: Candidate, score: Score) -> Candidate:
        return replace(candidate, score=score, fitness=self.fitness(score, candidate.penalty))

    def composite(self, score: Score) -> float:
        """Return the number that a run weighs a score's evaluations into."""
        if self.evaluation.composite == "single":
            return score.composite["mean"]
        weighed = composite(score.scores, self.evaluation.reference_deviation)
        return weighed[self.evaluation.composite]

    def fitness(self, score: Score, penalty: float) -> float:
        """Return what a design with a score and a penalty is worth to the optimizer."""
        return objective(
            self.composite(score),
            penalty,
            lowest=self.lowest,
            weight=self.evaluation.penalty_weight,
        )

    @property
    def lowest(self) -> float:
        """The fitness that designs have at least which can be made."""
        return min(0.0, self.task.lowest)


class TimedTask:
    """A task that counts the processor time it takes; not for several threads.

    Parameters
    ----------
    task
        The task.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.spent_s = 0.0

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    @property
    def lowest(self) -> float:
        """The task's lowest score."""
        return self.task.lowest

    def evaluate(self, deployment: Deployment, ground: Ground) -> Outcome:
        """Return what the task finds."""
        watch = Stopwatch()
        found = self.task.evaluate(deployment, ground)
        self.spent_s += watch.lap_s()
        return found

    def evaluate_block(self, block: Block, grounds: Sequence[Ground]) -> list[Outcome]:
        """Return what the task finds for every growth of a block."""
        watch = Stopwatch()
        found = outcomes(self.task, block, grounds)
        self.spent_s += watch.lap_s()
        return found


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
