"""Lanes: where answers are computed, each one question at a time.

What follows the pointer runs in a thread of the server. Everything that takes longer has a process
of its own, started when first asked, so that it neither holds up the pointer nor another panel, and
can be stopped by killing it.
"""

import asyncio
import multiprocessing
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.pool import ThreadPool
from typing import Any, Protocol

from vinefab.core.errors import VinefabError


class Pipe(Protocol):
    """One end of a pipe between processes; its class differs between systems."""

    def send(self, message: object, /) -> None:
        """Send one message."""

    def recv(self) -> Any:  # noqa: ANN401  whatever was sent
        """Wait for a message."""


Send = Callable[[float, str], None]
"""Takes progress of an answer, from any thread."""


class LaneEndedError(VinefabError):
    """A process that was to answer ended instead."""

    def __str__(self) -> str:
        return "the process of this panel ended unexpectedly; what it printed is in the terminal"


_PAINTED_S = 0.5
"""Time that a page takes to show its first answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What a panel asks."""

    panel: str
    state: Mapping[str, Any]
    ask: Mapping[str, Any]


class ProcessLane:
    """A process that answers one question at a time."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._turn = asyncio.Lock()
        self._pipe: Pipe | None = None
        self._process: multiprocessing.process.BaseProcess | None = None

    async def answer(self, question: Question, send: Send) -> Any:  # noqa: ANN401  plain values
        """Return the answer; if the caller is cancelled the process is killed.

        Raises
        ------
        VinefabError
            If something on the page cannot be used.
        """
        async with self._turn:
            pipe = self._ready()
            try:
                return await asyncio.to_thread(_exchange, pipe, question, send)
            except (asyncio.CancelledError, LaneEndedError):
                self.close()
                raise

    def close(self) -> None:
        """End the process, whatever it does."""
        process, self._process = self._process, None
        self._pipe = None  # closed with its last user: a thread may still read from it
        if process is not None:
            process.kill()
            process.join()

    def _ready(self) -> Pipe:
        if self._pipe is not None and self._process is not None and self._process.is_alive():
            return self._pipe
        self.close()
        # Not a fork: the server has threads.
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=answer_questions, args=(theirs,), name=f"vinefab {self._name}", daemon=True
        )
        self._process.start()
        theirs.close()
        return self._pipe


def _exchange(pipe: Pipe, question: Question, send: Send) -> Any:  # noqa: ANN401
    try:
        pipe.send(question)
        while True:
            kind, content = pipe.recv()
            if kind != "progress":
                break
            send(*content)
    except (EOFError, OSError) as error:
        raise LaneEndedError from error
    if kind == "error":
        raise content
    return content


def answer_questions(pipe: Pipe) -> None:
    """Answer what comes through a pipe until the server is gone: what a lane's process does."""
    from vinefab.studio.panels import answer_of  # noqa: PLC0415  only this process needs it all

    # Ctrl-C goes to the server, which ends its lanes; one that is killed closes the pipe.
    with suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            question = pipe.recv()

            def tell(share: float, text: str) -> None:
                pipe.send(("progress", (share, text)))

            try:
                found = answer_of(question.panel, question.state, question.ask, tell)
            except VinefabError as error:
                pipe.send(("error", error))
            else:
                pipe.send(("answer", found))


class ThreadLane:
    """A thread of the server, for what must follow the pointer."""

    def __init__(self) -> None:
        # Its thread is a daemon: Ctrl-C waits for no answer.
        self._pool = ThreadPool(1)
        self.answered = asyncio.Event()
        """Set once the page has shown its first answer: what takes long may begin."""

    async def answer(self, question: Question, send: Send) -> Any:  # noqa: ANN401  plain values
        """Return the answer; what raises raises here."""
        try:
            return await self.run(lambda: _answer(question, send))
        finally:
            asyncio.get_running_loop().call_later(_PAINTED_S, self.answered.set)

    async def run(self, work: Callable[[], Any]) -> Any:  # noqa: ANN401  as the work
        """Return what some work of the server gives, after what was asked before it."""
        loop = asyncio.get_running_loop()
        found: asyncio.Future[Any] = loop.create_future()

        def settle(how: Callable[[Any], None], value: Any) -> None:  # noqa: ANN401  as the work
            with suppress(RuntimeError):  # the server has ended meanwhile
                loop.call_soon_threadsafe(lambda: None if found.done() else how(value))

        self._pool.apply_async(
            lambda: found.cancelled() or work(),
            callback=partial(settle, found.set_result),
            error_callback=partial(settle, found.set_exception),
        )
        return await found

    def close(self) -> None:
        """Take no more questions."""
        self._pool.terminate()


def first_answer(state: Mapping[str, Any]) -> None:
    """Answer what every page asks first; what it loads and prepares stays."""
    from vinefab.studio.panels import answer_of  # noqa: PLC0415  as below

    answer_of("live", state, {}, lambda _share, _text: None)


def _answer(question: Question, send: Send) -> Any:  # noqa: ANN401  plain values
    from vinefab.studio.panels import answer_of  # noqa: PLC0415  after the page has been sent

    return answer_of(question.panel, question.state, question.ask, send)
