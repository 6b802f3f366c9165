"""Evaluation of points: growth, score, penalty and fitness, in timed units of work on threads.

Results do not depend on the workers.
"""

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import accumulate, pairwise, product
from numbers import Real
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np

from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.foreign import broken, calling, is_own
from vinefab.core.plain_text import counted
from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints, whole
from vinefab.growth.batch import (
    GROWTHS_PER_CALL,
    Batch,
    GrowthBlock,
    Launches,
    TerrainSet,
    Workspace,
)
from vinefab.growth.options import GrowthOptions
from vinefab.maps.poses import spread_notes
from vinefab.model.design import MOST_BRANCHES, Design
from vinefab.model.finding import Finding
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.model.start import share_around
from vinefab.search.free_space import space_of
from vinefab.search.penalty_batch import BatchPenalty
from vinefab.search.settings import (
    EvaluationSettings,
    RunSettings,
    keys_of_other_task,
    make_other_task,
)
from vinefab.search.space import DesignBatch, DesignSpace
from vinefab.search.tree_batch import TreeBatch
from vinefab.tasks import make_task
from vinefab.tasks.evaluate import Conditions, PreparedMap, composites, poses_on, scores_of
from vinefab.tasks.reach import Reach, check_targets_on
from vinefab.tasks.task import (
    HeadOnPenalty,
    Task,
    TaskOutcomes,
    TaskWithOthers,
    check_on_map,
    concatenated_outcomes,
    outcomes,
    search_form,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Work(Record):
    """Processor time that some evaluations took, of all workers together, s."""

    making_s: float = 0.0  # building designs and computing their penalties
    growth_s: float = 0.0  # planning and growing
    scoring_s: float = 0.0  # scoring final states

    @classmethod
    def total(cls, parts: Iterable["Work"]) -> "Work":
        """Return the sum of several parts."""
        spent = [(one.making_s, one.growth_s, one.scoring_s) for one in parts]
        making_s, growth_s, scoring_s = map(sum, zip(*spent, strict=True))
        return cls(making_s=making_s, growth_s=growth_s, scoring_s=scoring_s)

    @property
    def worked_s(self) -> float:
        """Their sum."""
        return self.making_s + self.growth_s + self.scoring_s


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeSplit(Work):
    """How the time of one session was spent, with its `Work`, all in seconds."""

    workers: int = 1  # number of workers that evaluated points
    # parts of the session's time: loading compiled code, evaluating points, asking and telling the
    # optimizer, recording while no point is evaluated, the rest
    loading_s: float = 0.0
    evaluating_s: float = 0.0
    optimizer_s: float = 0.0
    store_s: float = 0.0
    other_s: float = 0.0
    beside_s: float = 0.0  # recording in parallel with evaluating; part of ``evaluating_s``
    processor_s: float = 0.0  # all processor time of this process

    @property
    def total_s(self) -> float:
        """Length of the session."""
        doing_s = self.evaluating_s + self.optimizer_s + self.store_s
        return self.loading_s + doing_s + self.other_s

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the session's time, and of the workers' time while points were evaluated.

        ``busy`` is the processor time of growing and scoring over the time of all workers while
        points were evaluated; ``making`` is that of designs and their penalties. On a computer
        under other load, workers wait for processors and are less busy; ``useful`` is the share
        of growing and scoring in the processor time that this process got.
        """
        total_s = max(self.total_s, 1e-9)
        room_s = max(self.workers * self.evaluating_s, 1e-9)
        return {
            "loading": self.loading_s / total_s,
            "evaluating": self.evaluating_s / total_s,
            "optimizer": self.optimizer_s / total_s,
            "store": self.store_s / total_s,
            "other": self.other_s / total_s,
            "beside": self.beside_s / total_s,
            "busy": (self.growth_s + self.scoring_s) / room_s,
            "growth": self.growth_s / room_s,
            "scoring": self.scoring_s / room_s,
            "making": self.making_s / room_s,
            "useful": (self.growth_s + self.scoring_s) / max(self.processor_s, self.worked_s, 1e-9),
        }

    @property
    def summary(self) -> str:
        """The split as one line for the user."""
        shares = {name: f"{100 * share:.0f} %" for name, share in self.shares.items()}
        workers = counted(self.workers, "worker")
        return (
            f"time: {self.total_s:.1f} s: loading compiled code {shares['loading']}, evaluating "
            f"{shares['evaluating']}, optimizer {shares['optimizer']}, recording {shares['store']} "
            f"(plus {shares['beside']} in parallel with evaluating); use of {workers} while "
            f"evaluating: growth {shares['growth']}, scoring {shares['scoring']}, penalties "
            f"{shares['making']}"
        )


class Ledger:
    """Adds up how time is spent while a session runs."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._began_s = time.perf_counter()
        self._process_s = time.process_time()
        self._spent_s = dict.fromkeys(
            ("loading_s", "evaluating_s", "optimizer_s", "store_s", "beside_s"), 0.0
        )
        self._is_evaluating = False
        self._work = Work()

    @property
    def worked_s(self) -> float:
        """Processor time of all workers so far."""
        return self._work.worked_s

    @contextmanager
    def spending(self, part: str) -> Iterator[None]:
        """Count the time of a block as ``loading``, ``evaluating``, ``optimizer`` or ``store``.

        A block within evaluating counts as ``beside``, except loading: no point is evaluated
        before it.
        """
        beside, began_s = self._is_evaluating, time.perf_counter()
        self._is_evaluating = beside or part == "evaluating"
        try:
            yield
        finally:
            self._is_evaluating = beside
            spent_s = time.perf_counter() - began_s
            if beside and part == "loading":
                self._spent_s["evaluating_s"] -= spent_s
            elif beside:
                part = "beside"
            self._spent_s[f"{part}_s"] += spent_s

    def add(self, work: Work) -> None:
        """Count the work of workers."""
        self._work = Work.total((self._work, work))

    def split(self) -> TimeSplit:
        """Return the split of the time spent so far."""
        total_s = time.perf_counter() - self._began_s
        spent_s = sum(self._spent_s.values()) - self._spent_s["beside_s"]
        other_s = max(0.0, total_s - spent_s)
        return TimeSplit(
            workers=self.workers,
            other_s=other_s,
            processor_s=time.process_time() - self._process_s,
            **self._spent_s,
            **asdict(self._work),
        )


class Stopwatch:
    """Measures the processor time of the current thread."""

    def __init__(self) -> None:
        self._mark_s = time.thread_time()

    def lap_s(self) -> float:
        """Return the processor time since the last lap, or since the start."""
        before_s, self._mark_s = self._mark_s, time.thread_time()
        return self._mark_s - before_s


_Result = TypeVar("_Result")


class WorkUnit(Generic[_Result]):
    """A function to call once, and its result."""

    __slots__ = ("_done", "_work")

    def __init__(self, work: Callable[[], _Result]) -> None:
        self._work = work
        self._done: list[_Result] = []

    def do(self) -> None:
        """Call the function."""
        self._done.append(self._work())

    @property
    def result(self) -> _Result:
        """The result; only after `do`."""
        return self._done[0]


class Executor:
    """Runs work units in the calling thread and in helper threads, if there are any.

    A caller that only waited would have to be woken at the end, and would take a processor from
    the helpers whenever it does something else meanwhile.
    """

    def __init__(self, helpers: ThreadPoolExecutor | None = None, count: int = 1) -> None:
        self.count = count
        self._helpers = helpers
        # Appending and popping are thread-safe.
        self._queue = deque[WorkUnit[Any]]()

    def begin(self, units: Sequence[WorkUnit[Any]]) -> Callable[[], None]:
        """Begin work units in the helpers; nothing else may begin before these are finished."""
        self._queue.extend(units)
        wanted = range(min(self.count, len(units)) - 1)
        helping = [self._helpers.submit(self._work_off) for _ in wanted] if self._helpers else []

        def finish() -> None:
            self._work_off()
            for helper in helping:
                helper.result()

        return finish

    def stop(self) -> None:
        """Drop the work units that have not begun."""
        self._queue.clear()

    def _work_off(self) -> None:
        """Run work units until none is left or one fails."""
        while self._queue:
            try:
                unit = self._queue.popleft()
            except IndexError:  # Another thread took the last one.
                return
            try:
                unit.do()
            except BaseException:
                self.stop()
                raise


_Rows = TypeVar("_Rows", Floats, Ints)


def in_work_units(x: _Rows, rows: int) -> Sequence[_Rows]:
    """Divide an array into parts of at most ``rows`` rows, at least one each."""
    size = max(1, rows)
    return [x[first : first + size] for first in range(0, len(x), size)]


_AS_DESIGNED = (
    "compensation none: the search grows designs as drawn, not as their flat angles deploy; score "
    "the winner to see that robot"
)

_SCORES_TARGETS = 'name = "reach" in [task] does'

INVALID_FITNESS = -1e6
"""Fitness of a point without a valid design or a finite score: below everything."""


def penalized_fitness(composite: Floats, penalty: Floats, lowest: float, weight: float) -> Floats:
    """Return the fitness of designs.

    Without a penalty it is the composite score. With one it is below every fitness without: the
    score is squeezed into the unit below the lowest possible score, so that it still orders
    designs that are not manufacturable, and the weighted penalty is subtracted.

    Parameters
    ----------
    composite
        Composite scores, shape (m,).
    penalty
        0 for a manufacturable design, else above 0; shape (m,).

    Examples
    --------
    >>> score, penalty = np.array([0.4, 0.4]), np.array([0.0, 1e-9])
    >>> penalized_fitness(score, penalty, lowest=-1.0, weight=1.0) < -1.0
    array([False,  True])
    """
    valid = np.isfinite(composite) & np.isfinite(penalty)
    score, excess = np.where(valid, composite, 0.0), np.where(valid, penalty, 0.0)
    below = lowest - 1.0 / (1.0 + np.maximum(0.0, score - lowest)) - weight * excess
    fitness = np.where(excess <= 0.0, score, np.maximum(INVALID_FITNESS, below))
    return np.where(valid, fitness, INVALID_FITNESS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluations:
    """Results of k evaluations of each of m points; NaN where a point has no valid design."""

    penalty: Floats  # shape (m,); 0 for designs that can win and where there is no design
    score: Floats  # the task's scores, shape (m, k)
    terms: Mapping[str, Floats]  # the task's terms, each of shape (m, k)

    @classmethod
    def of(
        cls, points: int, launches: int, rows: Ints, grown: TaskOutcomes | None
    ) -> "Evaluations":
        """Return the evaluations of points, of which some rows were grown, without penalties."""
        if grown is None:
            gap = np.full((points, launches), np.nan)
            return cls(penalty=np.zeros(points), score=gap, terms={})
        # One array for all: a separate array for every term would take four times as long.
        columns = (grown.score, *grown.terms.values())
        tables = np.full((len(columns), points, launches), np.nan)
        tables[:, rows] = np.reshape(columns, (len(columns), launches, -1)).swapaxes(1, 2)
        terms = dict(zip(grown.terms, tables[1:], strict=True))
        return cls(penalty=np.zeros(points), score=tables[0], terms=terms)

    @classmethod
    def concatenated(cls, parts: Sequence["Evaluations"]) -> "Evaluations":
        """Return several parts, at least one, as one."""
        # A part without any design has no terms.
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

    def reordered(self, rows: Ints) -> "Evaluations":
        """Return the evaluations of points in another order, or of some of them."""
        terms = {name: values[rows] for name, values in self.terms.items()}
        return Evaluations(penalty=self.penalty[rows], score=self.score[rows], terms=terms)

    def with_penalties(self, penalty: Floats) -> "Evaluations":
        """Return the same with penalties; a point with penalty NaN has no valid design."""
        invalid = np.isnan(penalty)
        if not invalid.any():
            return replace(self, penalty=penalty)
        terms = {name: np.where(invalid[:, None], np.nan, v) for name, v in self.terms.items()}
        return Evaluations(
            penalty=np.where(invalid, 0.0, penalty),
            score=np.where(invalid[:, None], np.nan, self.score),
            terms=terms,
        )


Penalty = Callable[[Design], float]
"""How far a design is from manufacturable: 0 if it is, else above 0."""


def penalty_at(penalty: Penalty, design: Design) -> float:
    """Return the penalty of a design; a user's own one is called through the boundary."""
    if is_own(penalty):
        return penalty(design)
    with calling("penalty", penalty):
        value = penalty(design)
    if isinstance(value, bool) or not isinstance(value, Real):
        raise broken("penalty", penalty, f"it returns {value!r:.60}, not a number")
    return float(value)


PenaltyOfBatch = Callable[[DesignBatch | TreeBatch], Floats]
"""The penalties of many designs, NaN for those that are not valid; shape (m,)."""


@runtime_checkable
class SpacePenalty(Protocol):
    """A penalty that is faster for many designs of one space than one by one."""

    def within(self, space: DesignSpace) -> PenaltyOfBatch:
        """Return the same penalty for batches of a space's designs."""
        ...


@runtime_checkable
class FullCheck(Protocol):
    """A penalty that can also run the full check of a design, which takes longer."""

    def passes(self, design: Design) -> bool:
        """Return whether no rule at all blocks a design."""
        ...


@runtime_checkable
class TableCheck(Protocol):
    """A full check that simulates nothing, fast enough for the best designs of a search."""

    def broken(self, design: Design) -> tuple[Finding, ...] | None:
        """Return the findings that forbid a design; None where only a simulation tells."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PenaltyWithLimits:
    """The penalty of the rules, where there is one, plus the excess over the space's limits."""

    rules: Penalty | None
    space: DesignSpace

    def __call__(self, design: Design) -> float:
        """Return the distance of a design from one that can win."""
        penalty = 0.0 if self.rules is None else penalty_at(self.rules, design)
        return penalty + float(self.space.limit_excess(self.space.batch_of(design))[0])

    def passes(self, design: Design) -> bool:
        """Return whether a design keeps the limits, and passes the full check if there is one."""
        if self.space.limit_excess(self.space.batch_of(design))[0] > 0.0:
            return False
        return self.rules.passes(design) if isinstance(self.rules, FullCheck) else True


SHARE_LEFT, LEAST_BLOCK = 1.5, 32
"""Growths per work unit: the remaining growths over this share of the workers, so that the last
unit is short; but enough to make the overhead negligible, unless a worker would get none."""


TRAINING, FINAL, MAPS, HALF_ANGLES, FRESH, EMERGENCE = 1411, 1412, 1414, 1415, 1416, 1417
"""Random streams of training poses, final poses, the choice of maps for a generation, the head-on
half-angles where they are drawn from a range, poses on fresh maps, and which children come out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvaluatorSpec:
    """What an evaluator is built from: small enough to be sent to another computer."""

    settings: RunSettings
    maps: tuple[Map, ...]
    penalty: Penalty | None = None  # needed where the settings ask for manufacturable designs
    task: Task | None = None  # the user's own task; None: the one that the settings name

    @property
    def search_task(self) -> Task:
        """The task in the form that the search evaluates, with the other objectives' tasks."""
        return self._together([search_form(task) for task in self.tasks])

    @property
    def approximates(self) -> bool:
        """Whether the search evaluates another form of a task."""
        return any(search_form(task) is not task for task in self.tasks)

    @property
    def reported_task(self) -> Task:
        """The task as it is: the scores that a run reports are those of ``vinefab score``."""
        return self._together(self.tasks)

    @property
    def tasks(self) -> list[Task]:
        """The task and the other objectives' tasks, without what the run adds to them."""
        named = self.settings.task
        task = make_task(named.name, named.parameters) if self.task is None else self.task
        return [task, *(make_other_task(other) for other in self.settings.other_tasks)]

    def _together(self, tasks: Sequence[Task]) -> Task:
        """Return one task for the task and the others, in the order of `tasks`."""
        weight = self.settings.evaluation.head_on_weight
        task, *others = (
            HeadOnPenalty(task=each, weight=weight) if weight > 0.0 else each for each in tasks
        )
        names = [other.name for other in self.settings.other_tasks]
        if not others:
            return task
        return TaskWithOthers(task=task, others=dict(zip(names, others, strict=True)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluator:
    """Everything that an evaluation needs, the same for all points of a run."""

    spec: EvaluatorSpec  # what it was built from
    maps: tuple[PreparedMap, ...]
    terrains: TerrainSet  # the walls of all maps
    space: DesignSpace  # maps points to designs
    task: Task  # scores final states, in the form for searching
    penalty_of_batch: PenaltyOfBatch | None  # where that is faster
    workspaces: list[Workspace] = field(default_factory=list)  # idle memory for growth
    # full checks by lengths and levels of the designs
    checked: dict[object, tuple[Finding, ...] | None] = field(default_factory=dict)
    # launches prepared ahead
    ready: list[tuple[Conditions, Launches]] = field(default_factory=list)

    @property
    def growth(self) -> GrowthOptions:
        """How robots grow."""
        return self.spec.settings.growth

    @property
    def evaluation(self) -> EvaluationSettings:
        """How scores become a fitness."""
        return self.spec.settings.evaluation

    @property
    def penalty(self) -> Penalty | None:
        """The penalty; None in a run that does not check manufacturability."""
        return self.spec.penalty if self.evaluation.fabricable else None

    @classmethod
    def of(cls, spec: EvaluatorSpec) -> "Evaluator":
        """Build the evaluator of a run.

        Raises
        ------
        BadInputError
            Where there is no map, no free variable, no penalty though one is needed, or more maps
            per generation than maps.
        """
        settings, evaluation = spec.settings, spec.settings.evaluation
        if not spec.maps:
            raise UnfitInputError("maps", "there are none", "give at least one")
        if evaluation.fabricable and spec.penalty is None:
            problem = "is true, and there is no penalty"
            raise UnfitInputError("evaluation.fabricable", problem, "give one, or set it to false")
        space = space_of(settings.space, settings.build)
        if len(space) == 0:
            raise UnfitInputError("space", "fixes every variable", "give at least one a range")
        if evaluation.maps_per_generation > len(spec.maps):
            key, allowed = (
                "evaluation.maps_per_generation",
                f"at most the {counted(len(spec.maps), 'map')}",
            )
            raise BadInputError(key, evaluation.maps_per_generation, allowed)
        weight, counts_joints = evaluation.joint_weight, isinstance(spec.penalty, SpacePenalty)
        if weight > 0.0 and not (evaluation.fabricable and counts_joints and settings.build.pieces):
            problem = "joints are counted only with build.pieces and evaluation.fabricable = true"
            raise UnfitInputError("evaluation.joint_weight", problem, "set it to 0, or set these")
        penalty = spec.penalty if evaluation.fabricable else None
        share = evaluation.pose_range
        maps = tuple(PreparedMap.of(with_pose_range(world, share)) for world in spec.maps)
        names = ["", *(other.name for other in settings.other_tasks)]
        for (name, task), prepared in product(zip(names, spec.tasks, strict=True), maps):
            with keys_of_other_task(name):
                check_on_map(task, prepared.world, prepared.context)
        for task in spec.tasks:
            check_targets_on(task, spec.maps)
        return cls(
            spec=replace(spec, penalty=penalty),
            maps=maps,
            terrains=TerrainSet([prepared.terrain for prepared in maps]),
            space=space,
            task=spec.search_task,
            penalty_of_batch=penalty.within(space) if isinstance(penalty, SpacePenalty) else None,
        )

    def conditions(self, seed: int, stream: int, generation: int, count: int) -> Conditions:
        """Draw the poses and contacts of one generation: the same for all its points."""
        seeds = [
            int(child(seed, stream, generation, index).integers(2**62))
            for index in range(len(self.maps))
        ]
        angles, drawn, number = tuple[float, ...](), tuple[int, ...](), count * len(self.maps)
        poses = poses_on(self.maps, count, seeds, repeats=self.growth.draws)
        if self.growth.draws_half_angle:
            rng = child(seed, HALF_ANGLES, stream, generation)
            angles = tuple(rng.uniform(*self.growth.half_angle_range_rad, number).tolist())
        if self.growth.emergence < 1.0:
            rng = child(seed, EMERGENCE, stream, generation)
            drawn = tuple(rng.integers(2**62, size=number).tolist())
        return Conditions(poses=poses, half_angles_rad=angles, draw_seeds=drawn)

    def final_conditions(self, seed: int) -> Conditions:
        """Draw the conditions of the finalists, as ``vinefab score`` does with `final_seed`."""
        first, count = final_seed(seed), self.evaluation.final_poses_per_map
        seeds = range(first, first + len(self.maps))
        return Conditions(poses=poses_on(self.maps, count, seeds, repeats=self.growth.draws))

    @property
    def winner_penalty(self) -> Penalty | None:
        """The penalty that a winner must not have; None where nothing is asked of designs."""
        if not self.space.most:
            return self.penalty
        return PenaltyWithLimits(rules=self.penalty, space=self.space)

    def broken(self, design: Design) -> tuple[Finding, ...] | None:
        """Return the full check's findings against a design; None where only a simulation tells.

        Remembered, because the best of a generation may be finalists.
        """
        if not isinstance(self.penalty, TableCheck):
            return None
        key = design.tree.key  # the space has the rest
        if key not in self.checked:
            self.checked[key] = self.penalty.broken(design)
        return self.checked[key]

    @property
    def has_table(self) -> bool:
        """Whether designs can be asked for all rules without a simulation."""
        return isinstance(self.penalty, TableCheck)

    def may_win(self, design: Design) -> bool:
        """Return whether a design keeps all limits and rules, as far as no simulation is needed."""
        excess = self.space.limit_excess(self.space.batch_of(design))[0] if self.space.most else 0.0
        return excess == 0.0 and not self.broken(design)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of designs and starts, a sentence each.

        Nothing of starts without spread where the run itself asks for them as they are.
        """
        notes = [_AS_DESIGNED] if self.space.build.compensation == "none" else []
        aimed = any(prepared.world.targets for prepared in self.maps)
        if aimed and not any(isinstance(task, Reach) for task in self.spec.tasks):
            notes.append(f"{self.task.name} does not score the maps' targets; {_SCORES_TARGETS}")
        if self.evaluation.pose_range == 0.0:
            return tuple(notes)
        count = max(self.evaluation.poses_per_map, self.evaluation.final_poses_per_map)
        worlds = [prepared.world for prepared in self.maps]
        return (*notes, *spread_notes(worlds, count, repeats=self.growth.draws))

    def training_conditions(self, seed: int, generation: int) -> Conditions:
        """Draw the conditions of a generation of the search, on all maps or on some of them."""
        draw = generation if self.evaluation.redraw else 0
        drawn = self.conditions(seed, TRAINING, draw, self.evaluation.poses_per_map)
        wanted = self.spec.settings.maps_per_generation
        if wanted == 0:
            return drawn
        taken = child(seed, MAPS, draw).permutation(len(drawn.poses))[:wanted].tolist()
        return drawn.on_maps(taken)

    def evaluate(self, x: Floats, conditions: Conditions) -> tuple[Evaluations, Work]:
        """Return the evaluations of points and the processor time that they took; see `begin`."""
        return self.begin(x, conditions, Executor())()

    def warm_up(self, conditions: Conditions) -> None:
        """Evaluate the middle of the space once: compiled code is loaded when first used."""
        self.evaluate(np.full((1, len(self.space)), 0.5), conditions)

    def begin(
        self, x: Floats, conditions: Conditions, executor: Executor
    ) -> Callable[[], tuple[Evaluations, Work]]:
        """Begin to evaluate points, shape (m, d), m at least 1; also those without a design.

        Points do not influence each other: results depend neither on the executor nor on how the
        points are divided. The larger designs are begun first, which shortens the wait at the end.

        Returns
        -------
        Callable
            Finishes the work, and returns the evaluations in the order of the points and the
            processor time that they took.
        """
        watch = Stopwatch()
        designs, launches = self.space.batch(x), self.launches(conditions)
        order = np.argsort(-designs.sizes, kind="stable")
        rows = order[designs.sizes[order] <= MOST_BRANCHES]
        growths = (
            self._growth_units(designs.part(rows), launches, executor.count) if len(rows) else []
        )
        penalties, excess = self._penalty_units(x, designs, executor.count), self._excess(designs)
        planning = Work(growth_s=watch.lap_s())
        done = executor.begin([*penalties, *growths])

        def finish() -> tuple[Evaluations, Work]:
            done()
            grown = concatenated_outcomes([unit.result[0] for unit in growths]) if growths else None
            evaluations = Evaluations.of(len(x), len(launches), rows, grown)
            if penalties:
                penalty = np.concatenate([unit.result[0] for unit in penalties])
                evaluations = evaluations.with_penalties(penalty + excess)
            elif self.space.most:
                evaluations = evaluations.with_penalties(excess)
            spent = [unit.result[1] for unit in penalties] + [unit.result[1] for unit in growths]
            return evaluations, Work.total([planning, *spent])

        return finish

    def penalties(self, x: Floats) -> Floats:
        """Return the penalties of points, NaN where there is no valid design, shape (m,).

        Rules count only where they are computed for many designs at once.
        """
        return self._penalties_of(self.space.batch(x))

    def penalties_of_levels(self, x: Floats) -> Floats:
        """Return the penalties of points of the space's levels, as `penalties`."""
        return self._penalties_of(self.space.levels.batch(x))

    def _penalties_of(self, designs: DesignBatch | TreeBatch) -> Floats:
        """Return the penalties of designs, NaN where there is no valid one, shape (m,)."""
        excess = self._excess(designs)
        if self.penalty_of_batch is None:
            return np.where(designs.sizes > MOST_BRANCHES, np.nan, excess)
        return self.penalty_of_batch(designs) + excess

    @property
    def screens(self) -> bool:
        """Whether `penalties` tells designs apart: by rules at once, or by limits."""
        return self.penalty_of_batch is not None or bool(self.space.most)

    def _excess(self, designs: DesignBatch | TreeBatch) -> Floats:
        """Return by how much designs exceed limits, 0 where they are not valid, shape (m,)."""
        excess = np.zeros(len(designs))
        if self.space.most:
            rows = np.flatnonzero(designs.sizes <= MOST_BRANCHES)
            excess[rows] = self.space.limit_excess(designs.part(rows))
        return excess

    def _penalty_units(
        self, x: Floats, designs: DesignBatch | TreeBatch, workers: int
    ) -> list[WorkUnit[tuple[Floats, Work]]]:
        """Return the work of computing penalties."""
        alone, at_once = self.penalty, self.penalty_of_batch
        if alone is None:
            return []

        def computed(rows: Ints) -> tuple[Floats, Work]:
            watch = Stopwatch()
            if at_once is not None:
                penalties = at_once(designs.part(rows))
                return penalties, Work(making_s=watch.lap_s())
            penalties = np.full(len(rows), np.nan)
            for place, point in enumerate(x[rows]):
                with suppress(BadInputError):  # no valid design
                    penalties[place] = penalty_at(alone, self.space.design(point))
            return penalties, Work(making_s=watch.lap_s())

        # Penalties per work unit, at least: some 10 us each, against 200 us for a unit.
        least_penalties = 64
        least, share = (least_penalties, 2) if at_once is not None else (1, 4)
        size = max(least, math.ceil(len(x) / (share * workers)))
        return [
            WorkUnit(partial(computed, rows)) for rows in in_work_units(np.arange(len(x)), size)
        ]

    def _growth_units(
        self, designs: DesignBatch | TreeBatch, launches: Launches, workers: int
    ) -> list[WorkUnit[tuple[TaskOutcomes, Work]]]:
        """Return the work of growing and scoring designs, in the order of a batch."""
        plans = self.space.planned(designs, self.growth)
        batch = Batch(plans, launches, self.growth, self.workspaces)
        grounds = [prepared.context for prepared in self.maps]

        def grown(first: int, size: int) -> tuple[TaskOutcomes, Work]:
            watch = Stopwatch()

            def work(block: GrowthBlock) -> tuple[TaskOutcomes, Work]:
                growth_s = watch.lap_s()
                scored = outcomes(self.task, block, grounds)
                return scored, Work(growth_s=growth_s, scoring_s=watch.lap_s())

            return batch.worked(first, size, work)

        ends = accumulate(block_sizes(len(batch), workers), initial=0)
        return [WorkUnit(partial(grown, one, two - one)) for one, two in pairwise(ends)]

    def score(self, evaluations: Evaluations, row: int, conditions: Conditions) -> Score:
        """Return the evaluations of one point with a valid design as a score."""
        terms = {name: values[row] for name, values in evaluations.terms.items()}
        outcome = TaskOutcomes(evaluations.score[row], terms)
        (score,) = scores_of(outcome, self.task, self.maps, self.launches(conditions))
        return score

    def launches(self, conditions: Conditions) -> Launches:
        """Return the places that robots grow from, from memory where they were prepared."""
        for known, launches in self.ready:
            if known is conditions:
                return launches
        return conditions.launches(self.terrains)

    def prepare_launches(self, several: Iterable[Conditions]) -> None:
        """Prepare the places that robots grow from next, in place of those prepared before."""
        self.ready[:] = [(each, each.launches(self.terrains)) for each in several]

    def composites(self, scores: Floats, weights: Floats | None = None) -> Floats:
        """Return the composite of each row of scores as the run weighs them, shape (m,)."""
        kind = self.evaluation.composite
        return composites(scores, kind, self.evaluation.reference_deviation, weights)

    def term_means(
        self, terms: Mapping[str, Floats], weights: Floats | None = None
    ) -> dict[str, Floats]:
        """Return each term's mean over the evaluations; of other tasks' scores their composite."""
        tasks = [other.name for other in self.spec.settings.other_tasks]
        return {
            name: self.composites(values, weights) if name in tasks else values.mean(axis=1)
            for name, values in terms.items()
        }

    def joint_costs(self, x: Floats) -> Floats:
        """Return the cost of the designs' sleeve joints in fitness, shape (m,)."""
        weight, counter = self.evaluation.joint_weight, self.penalty_of_batch
        if weight == 0.0 or not isinstance(counter, BatchPenalty):
            return np.zeros(len(x))
        _, joints = counter.with_joints(self.space.batch(x))
        return np.multiply(weight, joints, dtype=np.float64)

    def fitness(self, composite: Floats, penalty: Floats, costs: Floats | float = 0.0) -> Floats:
        """Return the fitness of designs with composite scores, penalties and `joint_costs`."""
        weight = self.evaluation.penalty_weight
        return penalized_fitness(composite - costs, penalty, lowest=self.lowest, weight=weight)

    @property
    def lowest(self) -> float:
        """The lowest fitness of a manufacturable design."""
        pieces = self.space.build.pieces
        costs = self.evaluation.joint_weight * (pieces.most - 1) if pieces else 0.0
        return min(0.0, self.task.lowest) - costs


def final_seed(seed: int) -> int:
    """Return the seed of the finalists' poses on the first map of a run with some seed."""
    most_training_maps = 10_000
    return int(child(seed, FINAL).integers(2**31 - most_training_maps))


def block_sizes(growths: int, workers: int) -> list[int]:
    """Return the numbers of growths of the work units, larger ones first.

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
        sizes.append(min(max(share, least), GROWTHS_PER_CALL, left))
        left -= sizes[-1]
    return sizes


def with_pose_range(world: Map, share: float) -> Map:
    """Return a map whose starts spread poses over a share of their range.

    Of an area, the part around the pose that a single growth takes.
    """
    if share == 1.0:
        return world
    starts = [
        replace(
            start,
            area=share_around(start, share),
            spread_x_mm=share * start.spread_x_mm,
            spread_y_mm=share * start.spread_y_mm,
            spread_heading_rad=min(math.tau, share * start.spread_heading_rad),
        )
        for start in world.starts
    ]
    return replace(world, starts=tuple(starts))


Finish = Callable[[], Evaluations]
"""Waits for evaluations that were begun and returns them in the order of the points."""

Begin = Callable[[Floats, Conditions], Finish]
"""Begins to evaluate points of shape (m, d) on poses."""


class PointEvaluator(Protocol):
    """Evaluates points with several workers."""

    @property
    def count(self) -> int:
        """Number of workers."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know after a run, a sentence each."""
        ...

    def started(self, evaluator: Evaluator, ledger: Ledger) -> AbstractContextManager[Begin]:
        """Start the workers for a run; the ledger counts their work."""
        ...


class ThreadEvaluator:
    """Threads of this process.

    Growth is compiled and geometry is in C, and both release the interpreter. Threads draw no
    random numbers and share nothing mutable, so that their number has no influence on results.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, count: int) -> None:
        self.count = whole("workers", count, 1, 1024)

    @contextmanager
    def started(self, evaluator: Evaluator, ledger: Ledger) -> Iterator[Begin]:
        """Start the threads for a run."""
        usual_s = sys.getswitchinterval()
        # Interval after which a thread that returns from compiled code gets the interpreter; in the
        # usual 5 ms it would have grown fifty robots.
        switch_s = 1e-4
        # A pool needs at least one worker; without work it starts no thread.
        with ThreadPoolExecutor(max_workers=max(1, self.count - 1)) as pool:
            executor, is_loaded = Executor(pool, self.count), False

            def begin(x: Floats, conditions: Conditions) -> Finish:
                nonlocal is_loaded
                if not is_loaded:
                    with ledger.spending("loading"):
                        evaluator.warm_up(conditions)
                    is_loaded = True
                wait = evaluator.begin(x, conditions, executor)

                def finish() -> Evaluations:
                    evaluations, spent = wait()
                    ledger.add(spent)
                    return evaluations

                return finish

            sys.setswitchinterval(switch_s)
            try:
                yield begin
            finally:
                sys.setswitchinterval(usual_s)
                executor.stop()
