"""Who does pieces of work: the threads of a pool, or whoever asks."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Generic, ParamSpec, Protocol, TypeVar

Result = TypeVar("Result")
Result_co = TypeVar("Result_co", covariant=True)
Given = ParamSpec("Given")


class Promise(Protocol[Result_co]):
    """The result of a piece of work, sooner or later."""

    def result(self) -> Result_co:
        """Wait for it and return it, or raise what went wrong."""
        ...


class Crew(Protocol):
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

    def submit(
        self, work: Callable[Given, Result], /, *given: Given.args, **named: Given.kwargs
    ) -> Promise[Result]:
        """Have a piece of work done, at once or later."""
        ...

    def wait(self, promises: Sequence[Promise[object]]) -> None:
        """Wait until all work is done, or some of it went wrong."""
        ...


@dataclass(frozen=True, slots=True)
class Pool:
    """The threads of a pool.

    Parameters
    ----------
    threads
        The pool.
    count
        How many threads it has.
    """

    threads: ThreadPoolExecutor
    count: int

    def submit(
        self, work: Callable[Given, Result], /, *given: Given.args, **named: Given.kwargs
    ) -> Promise[Result]:
        """Have a thread do a piece of work."""
        return self.threads.submit(work, *given, **named)

    def wait(self, promises: Sequence[Promise[object]]) -> None:
        """Sleep until all is done; waking up for every piece would keep threads from working."""
        futures = [promise for promise in promises if isinstance(promise, Future)]
        wait(futures, return_when=FIRST_EXCEPTION)


@dataclass(frozen=True, slots=True)
class Done(Generic[Result]):
    """A result that is there."""

    value: Result

    def result(self) -> Result:
        """Return it."""
        return self.value


class Alone:
    """Whoever asks for work does it at once."""

    count = 1

    def submit(
        self, work: Callable[Given, Result], /, *given: Given.args, **named: Given.kwargs
    ) -> Promise[Result]:
        """Do a piece of work."""
        return Done(work(*given, **named))

    def wait(self, promises: Sequence[Promise[object]]) -> None:
        """Nothing is left to be done."""
