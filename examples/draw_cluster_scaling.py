"""How far more workers help a search: the simulated speed on up to 256 workers, as a figure.

python examples/draw_cluster_scaling.py PICTURE.png              the search is measured here
python examples/draw_cluster_scaling.py PICTURE.png sleeping     then dask workers that sleep
python examples/draw_cluster_scaling.py PICTURE.png local:2      then a search on real workers
"""

import heapq
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from distributed import Client, LocalCluster
from matplotlib.figure import Figure

from vinefab.core.atomic import write_bytes
from vinefab.core.validation import Floats
from vinefab.pages.panel import INK, LEVEL_COLOURS
from vinefab.search.dask_cluster import DaskEvaluator, HandingOut, Pace, point_weights
from vinefab.search.evaluator import Begin, Evaluations, Ledger, Stopwatch, ThreadEvaluator
from vinefab.search.run import Schedule, Search, penalty_of, training_maps
from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings, SearchSettings
from vinefab.studies.paper_charts import blank, frame, house_style, svg_bytes
from vinefab.tasks.evaluate import Conditions


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitCosts:
    """Processor time of a work unit in addition to its work, s.

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
    """The load of a search on its workers."""

    name: str
    generations: Sequence[Floats]  # weight of each point, as `PlacedRun` weighs them, shape (m,)
    work_s: float  # processor time per weight
    result_bytes: float  # of each point's evaluations
    loop_s: float  # asking, telling and adding up results, per generation


def load_of(name: str, settings: RunSettings) -> SearchLoad:
    """Measure the load of a search on its workers, with a few designs."""
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
        few_s.append(work.worked_s)
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
    """Return the time of workers for the work units of one generation.

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
    """Return the costs that a run would measure before it hands out work."""
    serial_s = costs.submit_s + costs.receive_s
    return HandingOut(
        round_trip_s=4.0 * network.latency_s + serial_s + costs.worker_s,
        per_unit_s=max(serial_s, costs.worker_s / workers),
    )


def simulated_run_s(load: SearchLoad, workers: int, costs: UnitCosts, network: Network) -> float:
    """Return the time of a search on a cluster, with one thread here for small generations."""
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
    """Return the time of a search in one thread."""
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


MEASURED_GENERATIONS = 8
HARDER = 100
"""A score that takes longer, such as coverage with `area = "exact"`."""

NEAR = Network(latency_s=LATENCIES_S[0])
SLEEPERS = ((1, 2), (2, 4), (2, 32), (2, 64))
"""Processes and threads in each."""


def search_of(population: int, maps: int) -> RunSettings:
    """Return a search for coverage in the Grid."""
    return RunSettings(
        maps=MapSettings(count=maps),
        search=SearchSettings(population=population, generations=MEASURED_GENERATIONS),
        evaluation=EvaluationSettings(fabricable=False),
    )


def draw(picture: Path) -> None:
    loads = (
        load_of("20 designs x 4 maps", search_of(20, 4)),
        load_of("100 designs x 20 maps", search_of(100, 20)),
        load_of("1,000 designs x 20 maps", search_of(1000, 20)),
    )
    heavy, name = loads[-1], f"1,000 x 20, {HARDER} times the work each"
    loads = (*loads, replace(heavy, name=name, work_s=HARDER * heavy.work_s))
    for load in loads:
        work_s = load.work_s * load.generations[0].sum()
        print(f"{load.name}: {work_s:.3g} s of work and {load.loop_s:.2g} s between generations")
    results = [Scaling.of(load, latency_s) for load in loads for latency_s in LATENCIES_S]
    print("\n".join(scaling_rows(results)))
    figure = scaling_figure(results)
    if picture.suffix == ".svg":
        write_bytes(picture, svg_bytes(figure))
    else:
        figure.savefig(picture, dpi=150)


def scaling_rows(results: Sequence[Scaling]) -> list[str]:
    """Return results as rows of a Markdown table."""
    heading = f"| search | latency | {' | '.join(map(str, WORKERS))} | saturates at |"
    rows = [heading, f"|{'---|' * (len(WORKERS) + 3)}"]
    for result in results:
        cells = " | ".join(f"{speedup:.1f}" for speedup in result.speedups)
        latency = f"{1e3 * result.latency_s:g} ms"
        rows.append(f"| {result.load.name} | {latency} | {cells} | {result.saturation} |")
    return rows


def scaling_figure(results: Sequence[Scaling]) -> Figure:
    """Return the chart of speed over workers."""
    colours = {
        name: LEVEL_COLOURS[rank % len(LEVEL_COLOURS)]
        for rank, name in enumerate(dict.fromkeys(result.load.name for result in results))
    }
    styles = dict(zip(LATENCIES_S, ("-", "--", ":"), strict=True))
    with house_style():
        figure, axes = blank(6.5, 4.2)
        axes.plot(WORKERS, WORKERS, color=INK, linewidth=0.8)
        axes.annotate("every worker counts", (16, 16), (6, 26), fontsize=8, color=INK)
        for result in results:
            name = result.load.name if result.latency_s == LATENCIES_S[0] else None
            style, colour = styles[result.latency_s], colours[result.load.name]
            axes.plot(WORKERS, result.speedups, style, color=colour, label=name)
        axes.set_xscale("log", base=2)
        axes.set_yscale("log", base=2)
        ticks = list(map(str, WORKERS))
        axes.set_xticks(WORKERS, ticks)
        axes.set_yticks(WORKERS, ticks)
        axes.set_xlabel("workers")
        axes.set_ylabel("speed over one thread (simulated)")
        axes.legend(fontsize=8, title="latency: solid 0.1, dashed 5, dotted 50 ms")
        frame(axes)
    return figure


def compare_sleepers() -> None:
    """Print how long dask takes for work units that sleep, and what the simulation says."""
    load = load_of("1,000 designs x 20 maps", search_of(1000, 20))
    weights = load.generations[0]
    for processes, threads in SLEEPERS:
        workers = processes * threads
        pace = pace_on(workers, load.work_s)
        units_s = [load.work_s * float(weights[rows].sum()) for rows in pace.units(weights)]
        with (
            LocalCluster(processes, threads_per_worker=threads, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            client.gather([client.submit(abs, number, pure=False) for number in range(64)])
            slept_s = []
            for _ in range(5):
                began_s = time.perf_counter()
                client.gather([client.submit(time.sleep, each, pure=False) for each in units_s])
                slept_s.append(time.perf_counter() - began_s)
        predicted_s = simulated_s(units_s, workers=workers, costs=UnitCosts(), network=NEAR)
        print(
            f"{workers} sleeping workers, {len(units_s)} units of {sum(units_s):.2f} s: "
            f"{min(slept_s):.3f} s (predicted {predicted_s:.3f} s)",
            flush=True,
        )


def compare(address: str) -> None:
    """Print times of a heavy search in threads and on a cluster, and what the simulation says."""
    settings = search_of(1000, 20)
    search = Search.of(settings, training_maps(settings))
    evaluator, cluster = search.evaluator, DaskEvaluator(address, threads=0)
    here, there = Ledger(1), Ledger(1)
    schedule, ratios, errors = Schedule(evaluator, 1), [], []
    with (
        cluster.started(evaluator, there) as begin_there,
        ThreadEvaluator(cluster.count).started(evaluator, here) as begin_here,
    ):
        for number in range(MEASURED_GENERATIONS):
            x, conditions = search.optimizer.ask(), schedule.conditions(number)
            found, here_s, _ = timed(begin_here, x, conditions, here)
            same, there_s, work_s = timed(begin_there, x, conditions, there)
            if found.score.tobytes() != same.score.tobytes():
                raise SystemExit("the workers found something else: report this")
            composite = evaluator.composites(found.score, conditions.weights)
            search.optimizer.tell(x, evaluator.fitness(composite, found.penalty))
            if number < 2:  # workers load compiled code
                continue
            predicted_s = prediction_s(point_weights(evaluator, x, conditions), work_s, there)
            ratios.append(here_s / there_s)
            errors.append(predicted_s / there_s)
            print(
                f"generation {number}: {here_s:.2f} s in {cluster.count} threads, {there_s:.2f} s "
                f"on {there.workers} workers (predicted {predicted_s:.2f} s)",
                flush=True,
            )
    print(f"threads' time over workers': {np.median(ratios):.2f} (median of {len(ratios)})")
    print(f"predicted over measured: {np.median(errors):.2f}")


def timed(
    begin: Begin, x: Floats, conditions: Conditions, ledger: Ledger
) -> tuple[Evaluations, float, float]:
    """Return evaluations, how long they took, and their processor time."""
    began_s, worked_s = time.perf_counter(), ledger.worked_s
    evaluations = begin(x, conditions)()
    return evaluations, time.perf_counter() - began_s, ledger.worked_s - worked_s


def prediction_s(weights: Floats, work_s: float, ledger: Ledger) -> float:
    """Return how long the simulation takes for points of so much work."""
    each_s = work_s / weights.sum()
    units = pace_on(ledger.workers, each_s).units(weights)
    units_s = [each_s * float(weights[rows].sum()) for rows in units]
    return simulated_s(units_s, workers=ledger.workers, costs=UnitCosts(), network=NEAR)


def pace_on(workers: int, work_s: float) -> Pace:
    """Return the pace of a run that hands out everything."""
    costs = handing_out(workers, UnitCosts(), NEAR)
    return Pace(threads=0, workers=workers, costs=costs, work_s=work_s)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
    if sys.argv[2:] == ["sleeping"]:
        compare_sleepers()
    elif sys.argv[2:]:
        compare(sys.argv[2])
