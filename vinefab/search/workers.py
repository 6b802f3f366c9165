"""Point evaluators: many points at once, with results that do not depend on the workers."""

import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol, Self, TypeVar

from vinefab.core.errors import WorkersLostError
from vinefab.core.interruption import end_with_parent, stops_deferred
from vinefab.core.validation import Floats, whole
from vinefab.search.evaluator import Evaluations, Evaluator, Executor, Ledger
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
            executor, is_loaded = Executor(pool, self.count), False

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


_Job = TypeVar("_Job")
Found = TypeVar("Found")


class WorkerProcesses:
    """A pool of processes, begun with its first jobs and ended with its block.

    Only this process hears Ctrl-C, and ends the others; they end by themselves if it is killed.
    """

    def __init__(self, count: int) -> None:
        spawn = multiprocessing.get_context("spawn")
        # Its semaphores begin a process that would end, and complain, when a terminal is closed.
        with stops_deferred():
            self._pool = ProcessPoolExecutor(count, mp_context=spawn, initializer=end_with_parent)
        self._processes = set[multiprocessing.process.BaseProcess]()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the processes; after an error or an interrupt without waiting for their jobs."""
        with stops_deferred():
            if kind is not None:
                for process in self._processes:
                    process.terminate()
            self._pool.shutdown(cancel_futures=True)

    def map(self, work: Callable[[_Job], Found], jobs: Sequence[_Job]) -> Iterator[Found]:
        """Yield the result of the work for each job, in the order of the jobs."""
        with stops_deferred():
            others = set(multiprocessing.active_children())
            futures = [self._pool.submit(work, job) for job in jobs]
            self._processes |= {*multiprocessing.active_children()} - others
        for future in futures:
            try:
                found = future.result()
            except BrokenProcessPool as error:
                raise WorkersLostError(
                    "a worker process",
                    "was killed, perhaps for want of memory",
                    "run the command again with fewer; what is finished is kept",
                ) from error
            yield found
