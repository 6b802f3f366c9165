"""Measuring times."""

import time
from collections.abc import Callable


def least_s(work: Callable[[], object], times: int = 5, *, wall_clock: bool = False) -> float:
    """Return the least time that some work takes.

    Parameters
    ----------
    work
        Called once to warm up (it may have to be compiled), then several times.
    times
        How often it is measured; other programs can only make it slower.
    wall_clock
        Measure by the clock, as for several threads, rather than in seconds of the processor.
    """
    clock = time.perf_counter if wall_clock else time.process_time
    work()
    found = []
    for _ in range(times):
        began = clock()
        work()
        found.append(clock() - began)
    return min(found)
