"""Point evaluators: many points at once, with results that do not depend on the workers."""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from vinefab.core.validation import Floats, whole
from vinefab.search.evaluator import Evaluations, Evaluator
from vinefab.search.parallel.executor import ThreadExecutor
from vinefab.search.timing import Ledger
from vinefab.tasks.evaluate import Conditions

Finish = Callable[[], Evaluations]
"""Waits for evaluations that were begun and returns them in the order of the points."""

Begin = Callable[[Floats, Conditions], Finish]
"""Begins to evaluate points of shape (m, d) on poses."""

SWITCH_S = 1e-4
"""Interval after which a thread that returns from compiled code gets the interpreter; in the usual
5 ms it would have grown fifty robots."""


class PointEvaluator(Protocol):
    """Evaluates points with several workers."""

    @property
    def count(self) -> int:
        """Number of workers."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know after a run, a sentence each."""
        ...

    def started(self, evaluator: Evaluator, ledger: Ledger) -> AbstractContextManager[Begin]:
        """Start the workers for a run; the ledger counts their work."""
        ...


class ThreadEvaluator:
    """Threads of this process.

    Growth is compiled and geometry is in C, and both release the interpreter. Threads draw no
    random numbers and share nothing mutable, so that their number has no influence on results.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, count: int) -> None:
        self.count = whole("workers", count, 1, 1024)

    @contextmanager
    def started(self, evaluator: Evaluator, ledger: Ledger) -> Iterator[Begin]:
        """Start the threads for a run."""
        usual_s = sys.getswitchinterval()
        # A pool needs at least one worker; without work it starts no thread.
        with ThreadPoolExecutor(max_workers=max(1, self.count - 1)) as pool:
            executor, is_loaded = ThreadExecutor(pool, self.count), False

            def begin(x: Floats, conditions: Conditions) -> Finish:
                nonlocal is_loaded
                if not is_loaded:
                    with ledger.spending("loading"):
                        evaluator.warm_up(conditions)
                    is_loaded = True
                wait = evaluator.begin(x, conditions, executor)

                def finish() -> Evaluations:
                    evaluations, spent = wait()
                    ledger.add(spent)
                    return evaluations

                return finish

            sys.setswitchinterval(SWITCH_S)
            try:
                yield begin
            finally:
                sys.setswitchinterval(usual_s)
                executor.stop()
