"""Measuring times."""

import math
import time
from collections.abc import Callable, Sequence


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
    (found,) = least_each_s((work,), times, wall_clock=wall_clock)
    return found


def least_each_s(
    works: Sequence[Callable[[], object]], times: int = 5, *, wall_clock: bool = False
) -> list[float]:
    """Return the least time that each of some works takes, done in turns.

    A processor that is faster at one time than at another is so for all of them: what counts is
    how they compare.

    Parameters
    ----------
    works, times, wall_clock
        As in `least_s`.
    """
    clock = time.perf_counter if wall_clock else time.process_time
    for work in works:
        work()
    found = [math.inf] * len(works)
    for _ in range(times):
        for number, work in enumerate(works):
            began = clock()
            work()
            found[number] = min(found[number], clock() - began)
    return found
