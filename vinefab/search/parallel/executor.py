"""Executors of work units: serial, or with threads that help the caller."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, Protocol, TypeVar

from vinefab.core.validation import Floats, Ints

_Result = TypeVar("_Result")


class WorkUnit(Generic[_Result]):
    """A function to call once, and its result."""

    __slots__ = ("_done", "_work")

    def __init__(self, work: Callable[[], _Result]) -> None:
        self._work = work
        self._done: list[_Result] = []

    def do(self) -> None:
        """Call the function."""
        self._done.append(self._work())

    @property
    def result(self) -> _Result:
        """The result; only after `do`."""
        return self._done[0]


class Executor(Protocol):
    """Runs work units."""

    @property
    def count(self) -> int:
        """Number of workers."""
        ...

    def begin(self, units: Sequence[WorkUnit[Any]]) -> Callable[[], None]:
        """Begin work units in their order; return the function that finishes them."""
        ...


class SerialExecutor:
    """Runs all work units in the calling thread, when they are to be finished."""

    count = 1

    def begin(self, units: Sequence[WorkUnit[Any]]) -> Callable[[], None]:
        """Defer work units until they are to be finished."""

        def finish() -> None:
            for unit in units:
                unit.do()

        return finish


class ThreadExecutor:
    """Runs work units in the calling thread and in helper threads.

    A caller that only waited would have to be woken at the end, and would take a processor from
    the helpers whenever it does something else meanwhile.
    """

    def __init__(self, helpers: ThreadPoolExecutor, count: int) -> None:
        self.count = count
        self._helpers = helpers
        # Appending and popping are thread-safe.
        self._queue = deque[WorkUnit[Any]]()

    def begin(self, units: Sequence[WorkUnit[Any]]) -> Callable[[], None]:
        """Begin work units in the helpers; nothing else may begin before these are finished."""
        self._queue.extend(units)
        helping = [
            self._helpers.submit(self._work_off) for _ in range(min(self.count, len(units)) - 1)
        ]

        def finish() -> None:
            self._work_off()
            for helper in helping:
                helper.result()

        return finish

    def stop(self) -> None:
        """Drop the work units that have not begun."""
        self._queue.clear()

    def _work_off(self) -> None:
        """Run work units until none is left or one fails."""
        while self._queue:
            try:
                unit = self._queue.popleft()
            except IndexError:  # Another thread took the last one.
                return
            try:
                unit.do()
            except BaseException:
                self.stop()
                raise


_Rows = TypeVar("_Rows", Floats, Ints)


def in_work_units(x: _Rows, rows: int) -> Sequence[_Rows]:
    """Divide an array into parts of at most ``rows`` rows, at least one each."""
    size = max(1, rows)
    return [x[first : first + size] for first in range(0, len(x), size)]
