"""Evaluating many points at once, with results that do not depend on how many at once."""

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from vinefab.model.checked import Floats, whole
from vinefab.optimize.timing import Ledger
from vinefab.optimize.trial import Candidate, Trial
from vinefab.tasks.evaluate import Poses

Evaluate = Callable[[Floats, Poses], list[Candidate]]
"""Takes points of shape (m, d) and poses, gives the candidates in the points' order."""

GROWTHS = 64
"""Growths in one piece of work for a thread: enough to forget the handing over, few enough that
no thread has to wait long for the last one."""

SWITCH_S = 5e-4
"""A thread that comes back from compiled code asks for the interpreter after so long, not after
the usual 5 ms, in which it would have grown fifty robots."""


class Workforce(Protocol):
    """Who evaluates points."""

    @property
    def count(self) -> int:
        """How many at once."""
        ...

    def hired(self, trial: Trial, ledger: Ledger) -> AbstractContextManager[Evaluate]:
        """Offer a function that evaluates points, and count in the ledger what it takes.

        Parameters
        ----------
        trial
            What a point is worth.
        ledger
            Where the work is counted.
        """
        ...


class Threads:
    """Threads of this process.

    Growth is compiled and geometry is in C, and both let other threads run meanwhile. Nothing
    random happens in a thread and nothing is shared that changes, so the number of threads has no
    influence on any result.

    Parameters
    ----------
    count
        Threads, at least 1.
    """

    def __init__(self, count: int) -> None:
        self.count = whole("workers", count, 1, 1024)

    @contextmanager
    def hired(self, trial: Trial, ledger: Ledger) -> Iterator[Evaluate]:
        """Offer a function that evaluates points on the threads."""
        usual_s = sys.getswitchinterval()
        with ThreadPoolExecutor(max_workers=self.count) as pool:

            def evaluate(x: Floats, poses: Poses) -> list[Candidate]:
                pieces = in_pieces(x, GROWTHS // max(1, sum(map(len, poses))))
                over = pool.map if self.count > 1 else map
                done = list(over(lambda piece: trial.evaluate(piece, poses), pieces))
                for _, work in done:
                    ledger.add(work)
                return [candidate for found, _ in done for candidate in found]

            sys.setswitchinterval(SWITCH_S)
            try:
                yield evaluate
            finally:
                sys.setswitchinterval(usual_s)
                pool.shutdown(cancel_futures=True)


def in_pieces(x: Floats, rows: int) -> Sequence[Floats]:
    """Return points in pieces of at most so many rows, at least one each.

    Parameters
    ----------
    x
        The points, shape (m, d).
    rows
        Rows of a piece; 0 counts as 1.
    """
    size = max(1, rows)
    return [x[first : first + size] for first in range(0, len(x), size)]
