"""How far more workers help a search: a simulated cluster around the real division of work.

A search waits for a whole generation before it asks for the next one. Here the workers, their
network and the process that hands out work are simulated event by event with measured costs; where
a generation is evaluated and its work units come from `vinefab.search.dask_cluster`, as
in a run with ``--cluster``.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats
from vinefab.search.dask_cluster import HandingOut, Pace, point_weights
from vinefab.search.evaluator import Evaluations, Stopwatch
from vinefab.search.run import Search, penalty_of, training_maps
from vinefab.search.settings import RunSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitCosts:
    """Processor time that a work unit costs beside its work, s.

    The defaults were measured with dask on the development machine (docs/studies/cluster.md).
    """

    submit_s: float = 0.3e-3  # in the process that runs the search, before the unit is sent
    receive_s: float = 1.0e-3  # in that process and the scheduler, when it is done
    worker_s: float = 1.2e-3  # on the worker


@dataclass(frozen=True, slots=True, kw_only=True)
class Network:
    """The connection between the search and each worker."""

    latency_s: float  # one way
    bytes_per_s: float = 125e6  # of the search's own connection, which all results share


CLUSTER_GENERATIONS, FEW = 3, 64
"""Generations of random designs that are simulated, and designs that are evaluated to time them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchLoad:
    """What a search asks of its workers."""

    name: str
    generations: Sequence[Floats]  # weight of each point, as `PlacedRun` weighs them, shape (m,)
    work_s: float  # processor time per weight
    result_bytes: float  # of each point's evaluations
    loop_s: float  # asking, telling and adding up results, per generation


def load_of(name: str, settings: RunSettings) -> SearchLoad:
    """Measure what a search asks of its workers, with a few designs."""
    search = Search.of(settings, training_maps(settings), penalty_of(settings))
    evaluator, seed, population = search.evaluator, settings.search.seed, settings.search.population
    conditions, rng = evaluator.training_conditions(seed, 0), np.random.default_rng(seed)
    x = rng.random((CLUSTER_GENERATIONS, population, len(evaluator.space)))
    weights = [point_weights(evaluator, each, conditions) for each in x]
    few = x[0, : min(population, FEW)]
    evaluator.warm_up(conditions)
    few_s = []
    for _ in range(3):
        evaluations, work = evaluator.evaluate(few, conditions)
        few_s.append(sum(work))
    whole = evaluations.reordered(np.arange(population) % len(few))
    return SearchLoad(
        name=name,
        generations=weights,
        work_s=min(few_s) / float(weights[0][: len(few)].sum()),
        result_bytes=8.0 * (1 + len(whole.terms)) * whole.score.shape[1],
        loop_s=min(_loop_s(search, whole) for _ in range(3)),
    )


def _loop_s(search: Search, evaluations: Evaluations) -> float:
    """Return the time of one generation in which no point is evaluated, as `Search` spends it."""
    watch, evaluator = Stopwatch(), search.evaluator
    asked = search.optimizer.ask()
    whole = Evaluations.concatenated([evaluations]).reordered(np.arange(len(asked)))
    composite = evaluator.composites(whole.score)
    search.optimizer.tell(asked, evaluator.fitness(composite, whole.penalty))
    for values in whole.terms.values():
        values.mean(axis=1)
    return watch.lap_s()


def simulated_s(
    work_s: Sequence[float],
    *,
    workers: int,
    costs: UnitCosts,
    network: Network,
    result_bytes: float = 0.0,
) -> float:
    """Return how long workers take for the work units of one generation.

    Units are sent one after the other, each goes to the worker that is free first, and results are
    collected when the last unit is done.

    Parameters
    ----------
    work_s
        Work of each unit, in the order in which they are handed out.
    result_bytes
        Of all results together.

    Examples
    --------
    >>> free = UnitCosts(submit_s=0.0, receive_s=0.0, worker_s=0.0)
    >>> simulated_s([3.0, 2.0, 1.0], workers=2, costs=free, network=Network(latency_s=0.0))
    3.0
    """
    idle_s = [0.0] * min(workers, len(work_s))  # a heap: when each worker is free
    arrivals_s, sent_s = list[float](), 0.0
    for unit_s in work_s:
        sent_s += costs.submit_s
        began_s = max(heapq.heappop(idle_s), sent_s + network.latency_s)
        done_s = began_s + costs.worker_s + unit_s
        heapq.heappush(idle_s, done_s)
        arrivals_s.append(done_s + network.latency_s)
    noticed_s = sent_s
    for arrival_s in sorted(arrivals_s):
        noticed_s = max(noticed_s, arrival_s) + costs.receive_s
    return noticed_s + 2.0 * network.latency_s + result_bytes / network.bytes_per_s


def handing_out(workers: int, costs: UnitCosts, network: Network) -> HandingOut:
    """Return what a run would measure before it hands out work."""
    serial_s = costs.submit_s + costs.receive_s
    return HandingOut(
        round_trip_s=4.0 * network.latency_s + serial_s + costs.worker_s,
        per_unit_s=max(serial_s, costs.worker_s / workers),
    )


def simulated_run_s(load: SearchLoad, workers: int, costs: UnitCosts, network: Network) -> float:
    """Return how long a search takes on a cluster, with one thread here for small generations."""
    known = handing_out(workers, costs, network)
    pace, total_s = Pace(threads=1, workers=workers, costs=known, work_s=load.work_s), 0.0
    for weights in load.generations:
        work_s = load.work_s * float(weights.sum())
        there = pace.goes_there(weights, 1)
        seconds = work_s
        if there:
            seconds = simulated_s(
                [load.work_s * float(weights[rows].sum()) for rows in pace.units(weights)],
                workers=workers,
                costs=costs,
                network=network,
                result_bytes=load.result_bytes * len(weights),
            )
        pace = pace.after(weights, seconds, work_s, there=there)
        total_s += seconds + load.loop_s
    return total_s


def alone_s(load: SearchLoad) -> float:
    """Return how long a search takes in one thread."""
    work_s = load.work_s * float(sum(weights.sum() for weights in load.generations))
    return work_s + load.loop_s * len(load.generations)


WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
LATENCIES_S = (0.0001, 0.005, 0.05)
"""One way: within a computer or rack, across a large cluster, across a continent."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scaling:
    """Speed of a search on simulated clusters over one thread, for each number of workers."""

    load: SearchLoad
    latency_s: float
    speedups: Floats  # shape (len(WORKERS),)

    @classmethod
    def of(cls, load: SearchLoad, latency_s: float, costs: UnitCosts | None = None) -> "Scaling":
        """Simulate a search with each number of workers."""
        network, alone, costs = Network(latency_s=latency_s), alone_s(load), costs or UnitCosts()
        speedups = [alone / simulated_run_s(load, n, costs, network) for n in WORKERS]
        return cls(load=load, latency_s=latency_s, speedups=np.array(speedups))

    @property
    def saturation(self) -> int:
        """The fewest workers with which the search is within 10 % of its highest speed."""
        return WORKERS[int(np.argmax(self.speedups >= 0.9 * self.speedups.max()))]
