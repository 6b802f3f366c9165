"""Executors: work units done by the caller alone, or with threads that help."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, Protocol, TypeVar

from vinefab.core.validation import Floats

Result = TypeVar("Result")


class WorkUnit(Generic[Result]):
    """A piece of work, and its result once it is done."""

    __slots__ = ("_done", "_work")

    def __init__(self, work: Callable[[], Result]) -> None:
        self._work = work
        self._done: list[Result] = []

    def do(self) -> None:
        """Do it."""
        self._done.append(self._work())

    @property
    def result(self) -> Result:
        """What came of it; it must be done."""
        return self._done[0]


class Executor(Protocol):
    """Who can be given pieces of work.

    Attributes
    ----------
    count
        How many work at once.
    """

    @property
    def count(self) -> int:
        """How many work at once."""
        ...

    def begin(self, pieces: Sequence[WorkUnit[Any]]) -> Callable[[], None]:
        """Begin pieces of work in their order."""
        ...


class SerialExecutor:
    """Whoever asks does everything, when it is wanted."""

    count = 1

    def begin(self, pieces: Sequence[WorkUnit[Any]]) -> Callable[[], None]:
        """Put work off until it is wanted."""

        def finish() -> None:
            for piece in pieces:
                piece.do()

        return finish


class ThreadExecutor:
    """Whoever asks, with threads that help.

    One who only waited would have to be woken in the end, and would take a processor from those
    who work whenever it does something else meanwhile.
    """

    def __init__(self, helpers: ThreadPoolExecutor, count: int) -> None:
        self.count = count
        self._helpers = helpers
        # Appending and popping are safe between threads.
        self._left = deque[WorkUnit[Any]]()

    def begin(self, pieces: Sequence[WorkUnit[Any]]) -> Callable[[], None]:
        """Have helpers begin; nothing else may be begun before this is finished."""
        self._left.extend(pieces)
        helping = [
            self._helpers.submit(self._work_off) for _ in range(min(self.count, len(pieces)) - 1)
        ]

        def finish() -> None:
            self._work_off()
            for helper in helping:
                helper.result()

        return finish

    def stop(self) -> None:
        """Have nobody begin anything that is left."""
        self._left.clear()

    def _work_off(self) -> None:
        """Do pieces until none is left, or one goes wrong."""
        while self._left:
            try:
                piece = self._left.popleft()
            except IndexError:  # Somebody else was faster.
                return
            try:
                piece.do()
            except BaseException:
                self.stop()
                raise


def in_work_units(x: Floats, rows: int) -> Sequence[Floats]:
    """Return points in pieces of at most so many rows, at least one each.

    Parameters
    ----------
    x
        The points, shape (m, d).
    """
    size = max(1, rows)
    return [x[first : first + size] for first in range(0, len(x), size)]
