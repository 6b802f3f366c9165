"""Processes that do the jobs of a study, and end with the command that began them."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Self, TypeVar

from vinefab.core.errors import WorkersLostError
from vinefab.core.interruption import end_with_parent, stops_deferred

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
