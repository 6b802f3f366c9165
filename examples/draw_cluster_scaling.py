"""How far more workers help a search: the simulated speed on up to 256 workers, as a figure.

python examples/draw_cluster_scaling.py PICTURE.png              the search is measured here
python examples/draw_cluster_scaling.py PICTURE.png sleeping     then dask workers that sleep
python examples/draw_cluster_scaling.py PICTURE.png local:2      then a search on real workers
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from distributed import Client, LocalCluster
from matplotlib.figure import Figure

from vinefab.core.atomic import write_bytes
from vinefab.core.validation import Floats
from vinefab.pages.panel import INK, LEVEL_COLOURS
from vinefab.search.dask_cluster import DaskEvaluator, Pace, point_weights
from vinefab.search.evaluator import Evaluations, Ledger
from vinefab.search.run import Schedule, Search, training_maps
from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings, SearchSettings
from vinefab.search.workers import Begin, ThreadEvaluator
from vinefab.studies.benchmark import (
    LATENCIES_S,
    WORKERS,
    Network,
    Scaling,
    UnitCosts,
    handing_out,
    load_of,
    simulated_s,
)
from vinefab.studies.paper_charts import blank, frame, house_style, svg_bytes
from vinefab.tasks.evaluate import Conditions

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
