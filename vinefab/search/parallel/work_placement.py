"""Where a generation is evaluated, in threads here or on a cluster, and in which work units.

The cluster of `dask_cluster` and the simulated one of `vinefab.studies.cluster_scaling` divide and
place work with the same functions of measured times.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.model.design import MOST_BRANCHES
from vinefab.search.evaluator import SHARE_LEFT, Evaluations, Evaluator
from vinefab.search.parallel.point_evaluator import Begin, Finish
from vinefab.search.timing import Ledger
from vinefab.tasks.evaluate import Conditions

EFFICIENCY = 0.9
"""Share of their time that workers are assumed to evaluate in, until it is measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HandingOut:
    """What it costs to have work done by other processes."""

    round_trip_s: float  # from handing out one empty work unit to its result
    per_unit_s: float  # for each work unit more
    start_s: float = 0.0  # assumed, until workers have started and loaded code; 0: they have

    def overhead_s(self, units: int) -> float:
        """Return the time that a generation of so many work units takes beside the work."""
        return self.round_trip_s + (units - 1) * self.per_unit_s


SAMPLE_S = 0.05
"""Work that is evaluated here, at the beginning of a run, to know how much a generation is."""


MOST_WASTE = 0.05
"""Largest share of the cost of a unit in its work, as long as there are few workers."""


def least_unit_s(work_s: float, workers: int, costs: HandingOut) -> float:
    """Return the least work of a unit that is worth handing out.

    Units are handed out one after the other and worked off beside each other. N workers are kept
    busy by units of work N c, if each costs c. With more workers than that leaves units for, n
    units of a work W take n c + W / n on n of them, which is least for units of work sqrt(W c).
    """
    busy_s = max(workers, 1.0 / MOST_WASTE) * costs.per_unit_s
    return min(busy_s, math.sqrt(max(0.0, work_s) * costs.per_unit_s))


def unit_rows(weights: Floats, workers: int, least: float) -> list[Ints]:
    """Divide points into work units: the heaviest first, and smaller units towards the end.

    Only points that are heavier than a least unit are sorted. The others stay in their order:
    units of large designs alone, more than fit into a processor's caches, take a seventh longer.

    Parameters
    ----------
    weights
        Work of each point, in any unit, shape (m,), m at least 1; all above 0.
    workers
        How many there are.
    least
        Least work of a unit, the last one excepted.

    Returns
    -------
    list of arrays
        The rows of each unit.
    """
    order = np.argsort(-np.where(weights > least, weights, 0.0), kind="stable")
    until = np.cumsum(weights[order])
    middle = until - 0.5 * weights[order]
    units, first, done = list[Ints](), 0, 0.0
    while first < len(order):
        share = max((until[-1] - done) / (SHARE_LEFT * workers), least)
        last = max(first + 1, int(np.searchsorted(middle, done + share)))
        units.append(order[first:last])
        first, done = last, float(until[last - 1])
    return units


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How fast a run is evaluated here and on a cluster, as far as it was measured."""

    threads: int  # here; 0: nothing is to be evaluated here
    workers: int
    costs: HandingOut
    work_s: float  # processor time per weight of points
    here_s: float | None = None  # time per weight in the threads; None: not measured yet
    there_s: float | None = None  # time per weight on the cluster beside the overhead

    def units(self, weights: Floats) -> list[Ints]:
        """Return the rows of each work unit for the cluster."""
        weight = float(weights.sum())
        if self.work_s <= 0.0:  # not measured yet: the same for every worker
            return unit_rows(weights, self.workers, weight / self.workers)
        least_s = least_unit_s(self.work_s * weight, self.workers, self.costs)
        return unit_rows(weights, self.workers, least_s / self.work_s)

    def seconds_here(self, weight: float) -> float:
        """Return how long points take in the threads here."""
        usual_s = self.work_s / (EFFICIENCY * max(1, self.threads))
        return weight * (usual_s if self.here_s is None else self.here_s)

    def seconds_there(self, weights: Floats) -> float:
        """Return how long points take on the cluster."""
        usual_s = self.work_s / (EFFICIENCY * self.workers)
        working_s = float(weights.sum()) * (usual_s if self.there_s is None else self.there_s)
        return self.costs.overhead_s(len(self.units(weights))) + working_s

    def goes_there(self, weights: Floats, generations: int) -> bool:
        """Return whether to hand points out, with so many generations like them to come."""
        if self.threads == 0:
            return True
        if self.workers == 0:  # not there yet
            return False
        gain_s = self.seconds_here(float(weights.sum())) - self.seconds_there(weights)
        return gain_s * generations > self.costs.start_s

    def after(
        self, weights: Floats, seconds: float | None, work_s: float, *, there: bool
    ) -> "Pace":
        """Return the pace after points took so long, here or there; None: no typical time."""
        if seconds is None:  # with the loading of code in both
            return self
        weight = float(weights.sum())
        measured = replace(self, work_s=work_s / weight)
        if not there:
            return replace(measured, here_s=seconds / weight)
        working_s = max(0.0, seconds - self.costs.overhead_s(len(self.units(weights))))
        return replace(measured, there_s=working_s / weight)

    def text(self, weights: Floats) -> str:
        """Return the times that a decision rests on."""
        weight, costs = float(weights.sum()), self.costs
        trip = f" with a round trip of {1e3 * costs.round_trip_s:.0f} ms (measured)"
        start = f" once they have started, {costs.start_s:.0f} s (assumed)"
        there = "no worker had come"
        if self.workers:
            plural = "" if self.workers == 1 else "s"
            seconds = self.seconds_there(weights)
            there = f"{seconds:.2g} s on {self.workers} worker{plural}"
            there += start if costs.start_s else trip
        return (
            f"{weight * self.work_s:.2g} s of work (measured), expected to take "
            f"{self.seconds_here(weight):.2g} s on {self.threads} "
            f"thread{'' if self.threads == 1 else 's'} here, {there}"
        )


def point_weights(evaluator: Evaluator, x: Floats, conditions: Conditions) -> Floats:
    """Return the work of each point in branches to grow; too large a design grows none."""
    sizes = evaluator.space.batch(x).sizes
    growths = sum(len(places) for places in conditions.poses)
    return np.where(sizes > MOST_BRANCHES, 1.0, 1.0 + sizes) * max(1, growths)


class RemoteWorkers(Protocol):
    """The workers of a cluster."""

    def connect(self, *, wait_s: float) -> int:
        """Return the number of workers, started or waited for at most so long; 0: none yet."""
        ...

    def costs(self) -> HandingOut:
        """Return what handing out costs; assumed before `connect`, then measured."""
        ...

    def begin(self, x: Floats, conditions: Conditions, units: Sequence[Ints]) -> Finish:
        """Begin to evaluate points in work units of some rows each."""
        ...


class PlacedRun:
    """A run whose generations are evaluated here or by remote workers, where it is done sooner.

    Parameters
    ----------
    here
        Evaluates points in threads.
    threads
        How many; 0: everything is handed out.
    workers
        Number of remote workers that there are or would be started; 0: not known yet.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        ledger: Ledger,
        remote: RemoteWorkers,
        *,
        here: Begin,
        threads: int,
        workers: int,
    ) -> None:
        self._evaluator, self._ledger = evaluator, ledger
        self._remote, self._here = remote, here
        self._left = evaluator.spec.settings.search.generations
        self._has_worked_there, self._most_there = False, 0
        self._heaviest_s, self._last_large = 0.0, ""
        self.pace = Pace(threads=threads, workers=workers, costs=remote.costs(), work_s=0.0)
        self.batches, self.handed_out = 0, 0  # of designs: generations, finalists

    def begin(self, x: Floats, conditions: Conditions) -> Finish:
        """Begin to evaluate points."""
        self.batches += 1
        self._left = max(1, self._left - 1)
        if self.pace.threads == 0 or self.pace.work_s > 0.0:
            return self._placed(x, conditions)
        first = self._sample(x, conditions)
        rest = x[len(first.penalty) :]
        if not len(rest):
            self._decide(point_weights(self._evaluator, x, conditions))
            return lambda: first
        finish = self._placed(rest, conditions)
        return lambda: Evaluations.concatenated([first, finish()])

    @property
    def decision(self) -> str:
        """What was decided and why, for the user."""
        why = f"the last large one had {self._last_large}"
        if self.pace.threads == 0:
            why = "as --workers 0 asks"
        return f"handed out {self.handed_out} of {self.batches} batches of designs; {why}"

    def _sample(self, x: Floats, conditions: Conditions) -> Evaluations:
        """Evaluate the first points here, as many as it takes to time them."""
        parts, done, work_s = [self._here(x[:1], conditions)()], 1, 0.0
        while work_s < SAMPLE_S and done < len(x):
            part, work = self._evaluator.evaluate(x[done : 2 * done], conditions)
            self._ledger.add(work)
            parts.append(part)
            done, work_s = min(2 * done, len(x)), work_s + sum(work)
        if done > 1:  # the first point was evaluated while code was loaded
            weight = float(point_weights(self._evaluator, x[1:done], conditions).sum())
            self.pace = replace(self.pace, work_s=work_s / weight)
        return Evaluations.concatenated(parts)

    def _placed(self, x: Floats, conditions: Conditions) -> Finish:
        """Begin to evaluate points where it is done sooner, and time them."""
        weights = point_weights(self._evaluator, x, conditions)
        there = self._decide(weights)
        pace, began_s, worked_s = self.pace, time.perf_counter(), self._ledger.worked_s
        if there:
            self.handed_out += 1
            finish = self._remote.begin(x, conditions, pace.units(weights))
        else:
            finish = self._here(x, conditions)
        # Workers load compiled code first, which says nothing of the next generation.
        is_typical = not there or self._has_worked_there
        if there and not self._has_worked_there:
            self._has_worked_there = True
            self.pace = replace(pace, costs=replace(pace.costs, start_s=0.0))

        def timed() -> Evaluations:
            evaluations = finish()
            seconds, work_s = time.perf_counter() - began_s, self._ledger.worked_s - worked_s
            self.pace = self.pace.after(
                weights, seconds if is_typical else None, work_s, there=there
            )
            return evaluations

        return timed

    def _decide(self, weights: Floats) -> bool:
        """Return whether to hand out points; connect to the workers where that is worth it."""
        if self.pace.workers == 0 or self.pace.goes_there(weights, self._left):
            wait_s = self.pace.seconds_here(float(weights.sum())) if self.pace.threads else math.inf
            workers = self._remote.connect(wait_s=wait_s)
            costs = self._remote.costs()
            if self._has_worked_there:
                costs = replace(costs, start_s=0.0)
            self.pace = replace(self.pace, workers=workers, costs=costs)
        there = self.pace.goes_there(weights, self._left)
        self._most_there = max(self._most_there, self.pace.workers)
        self._ledger.workers = self._most_there if there else max(1, self.pace.threads)
        work_s = self.pace.work_s * float(weights.sum())
        self._heaviest_s = max(self._heaviest_s, work_s)
        if work_s >= 0.5 * self._heaviest_s:  # finalists are few
            self._last_large = self.pace.text(weights)
        return there
