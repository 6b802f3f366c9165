"""Evaluating many points at once, with results that do not depend on how many at once."""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from vinefab.core.validation import Floats, whole
from vinefab.search.evaluation import Evaluations
from vinefab.search.evaluator import Evaluator
from vinefab.search.parallel.executor import ThreadExecutor
from vinefab.search.record.timing import Ledger
from vinefab.tasks.evaluate import Poses

Finish = Callable[[], Evaluations]
"""Waits for what was begun and gives what was found, in the points' order."""

Begin = Callable[[Floats, Poses], Finish]
"""Takes points of shape (m, d) and poses, and has somebody evaluate them meanwhile."""

SWITCH_S = 1e-4
"""A thread that comes back from compiled code asks for the interpreter after so long, not after
the usual 5 ms, in which it would have grown fifty robots."""


class PointEvaluator(Protocol):
    """Who evaluates points."""

    @property
    def count(self) -> int:
        """How many at once."""
        ...

    def hired(self, trial: Evaluator, ledger: Ledger) -> AbstractContextManager[Begin]:
        """Offer a function that evaluates points, and count in the ledger what it takes."""
        ...


class ThreadEvaluator:
    """Threads of this process.

    Growth is compiled and geometry is in C, and both let other threads run meanwhile. Nothing
    random happens in a thread and nothing is shared that changes, so the number of threads has no
    influence on any result.
    """

    def __init__(self, count: int) -> None:
        self.count = whole("workers", count, 1, 1024)

    @contextmanager
    def hired(self, trial: Evaluator, ledger: Ledger) -> Iterator[Begin]:
        """Offer a function that has points evaluated on the threads."""
        usual_s = sys.getswitchinterval()
        # A pool of none cannot be; one that is given nothing starts no thread.
        with ThreadPoolExecutor(max_workers=max(1, self.count - 1)) as pool:
            team, is_loaded = ThreadExecutor(pool, self.count), False

            def begin(x: Floats, poses: Poses) -> Finish:
                nonlocal is_loaded
                if not is_loaded:
                    with ledger.spending("loading"):
                        trial.rehearse(poses)
                    is_loaded = True
                wait = trial.begin(x, poses, team)

                def finish() -> Evaluations:
                    found, spent = wait()
                    ledger.add(spent)
                    return found

                return finish

            sys.setswitchinterval(SWITCH_S)
            try:
                yield begin
            finally:
                sys.setswitchinterval(usual_s)
                team.stop()
