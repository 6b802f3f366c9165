"""The benchmark's result in words."""

from vinefab.pipeline.bench import Bench
from vinefab.pipeline.bench_search import DESIGNS, MAPS


def bench_lines(result: Bench) -> list[str]:
    """Return everything that was measured as lines for the user."""
    return [
        "one tree of 40 branches on Grid maps, bare centreline; times of one core",
        *_compared(result),
        "",
        "walls      prepare   per event (from anywhere)   to the first",
        *(
            f"{size.walls:<9,d} {size.prepare_s:6.2f} s  {size.ns_per_event:12.1f} ns"
            f"  {size.ns_per_event / result.sizes[0].ns_per_event:20.2f}"
            for size in result.sizes
        ),
        "",
        *_floor(result),
        "",
        *(
            f"{count} thread{'s' if count > 1 else ' '}            {rate:10,.0f} evaluations/s"
            f"  x {rate / result.threads[1]:.2f}"
            for count, rate in result.threads.items()
        ),
        *(
            f"{size:<4d} growths per call {rate:10,.0f} growths/s  x {rate / result.batches[1]:.2f}"
            for size, rate in result.batches.items()
        ),
        *(
            f"after {count:,} evaluations the process had taken {peak:.1f} MB at most"
            for count, peak in result.memory.items()
        ),
        "",
        f"a search of the paper's size, {DESIGNS} designs a generation on {MAPS} Grid maps:",
        *(f"{name:<14} {split.words}" for name, split in result.searches.items()),
    ]


def _compared(result: Bench) -> list[str]:
    growths_per_s = result.branches_per_s / 40.0
    twin = result.branches_per_s / result.twin_branches_per_s
    return [
        f"growth             {result.branches_per_s:12,.0f} branches/s"
        f"  ({growths_per_s:,.0f} trees/s, {result.events_per_branch:.2f} events a branch)",
        f"Shapely reference  {result.reference_branches_per_s:12,.0f} branches/s"
        f"  {result.speedup:,.0f} times slower, tips within {result.reference_error_mm:.1e} mm",
        f"plain Python twin  {result.twin_branches_per_s:12,.0f} branches/s"
        f"  {twin:,.0f} times slower",
        f"full evaluation    {result.evaluations_per_s:12,.0f} trees/s scored for coverage"
        f"  {result.evaluation_over_growth:.2f} times the time of growth alone",
    ]


def _floor(result: Bench) -> list[str]:
    floor = result.floor
    return [
        f"floor: {floor.wall_tests:.2f} wall tests of {floor.wall_ns:.1f} ns and "
        f"{floor.corner_tests:.2f} corner tests of {floor.corner_ns:.1f} ns per event"
        f" = {floor.ns_per_event:.1f} ns",
        f"an event takes {result.ns_per_event:.1f} ns, {result.over_floor:.1f} times that; "
        f"{result.foreseen_ns_per_event:.1f} ns where the processor knows the growth by heart",
        "the rest beside the tests: wrong guesses of branches, finding cells, the tips themselves",
    ]
