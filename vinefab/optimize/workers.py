"""Evaluating many points at once, with results that do not depend on how many at once."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from vinefab.model.checked import Floats, whole
from vinefab.optimize.trial import Candidate, Trial
from vinefab.tasks.evaluate import Poses

Evaluate = Callable[[Floats, Poses], list[Candidate]]
"""Takes points of shape (m, d) and poses, gives the candidates in the points' order."""


@contextmanager
def working(trial: Trial, workers: int) -> Iterator[Evaluate]:
    """Offer a function that evaluates points on several threads.

    Growth is compiled and geometry is in C, and both let other threads run meanwhile. Nothing
    random happens in a thread and nothing is shared that changes, so the number of threads has no
    influence on any result.

    Parameters
    ----------
    trial
        What a point is worth.
    workers
        Threads, at least 1.
    """
    whole("workers", workers, 1, 1024)
    if workers == 1:
        yield trial.evaluate
        return
    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            yield lambda x, poses: trial.evaluate(x, poses, pool.map)
        finally:
            pool.shutdown(cancel_futures=True)
