"""Executors: where the panels of the page are answered, one question of each at a time.

What follows the pointer runs in a thread of the server. Everything that takes longer has its own
process, started when first asked, so that it holds up neither the pointer nor another panel. It is
stopped by killing it.
"""

import asyncio
import multiprocessing
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from multiprocessing.pool import ThreadPool
from typing import Any, Protocol

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.progress import ProgressLine, heard_by, progress_seen
from vinefab.studio.state import PAGE, StudioState

Seen = Callable[[float | None, str], None]
"""Takes the share of a phase that is done, None where nothing is counted, and its words."""

"""Takes the share that is done, 0 to 1, and the name of the present step; from any thread."""

AnswerFunction = Callable[[StudioState, Mapping[str, Any]], dict[str, Any]]
"""An answer: takes the state of the page and the panel's question; returns plain values."""

LIVE, CUT = "live", "cut"
"""Executors that are threads of the server: what must follow the pointer."""

PANELS = {
    "live": ("live_answers.live_answer", LIVE),
    "before": ("live_answers.live_answer", LIVE),  # of the version that is compared with
    "front": ("live_answers.front_answer", LIVE),
    "tip": ("branch_edits.tip_answer", LIVE),
    "edit": ("branch_edits.edit_answer", LIVE),
    "cut": ("pattern_answers.cut_answer", CUT),
    "inflated": ("pattern_answers.inflated_answer", "inflated"),
    "rules": ("sheet_answers.rules_answer", "rules"),
    "fix": ("sheet_answers.fix_answer", "fix"),
    "family": ("family_answers.family_answer", "family"),
    "width": ("family_answers.width_answer", "family"),  # simulates as that does
    "export": ("file_exports.export_answer", "export"),
}
"""Every panel: its `AnswerFunction`, imported when first used, and the name of its executor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """A question of a panel: the open state of the page, and the request."""

    panel: str
    state: Mapping[str, Any]
    ask: Mapping[str, Any]


def answer_of(panel: str, state: Mapping[str, Any], ask: Mapping[str, Any]) -> Any:  # noqa: ANN401  plain values
    """Return a panel's answer.

    Raises
    ------
    VinefabError
        If something on the page cannot be used.
    """
    if panel not in PANELS:
        raise BadInputError("panel", panel, f"one of {', '.join(PANELS)}", PAGE)
    module, _, name = PANELS[panel][0].partition(".")
    function: AnswerFunction = getattr(import_module(f"vinefab.studio.{module}"), name)
    return function(StudioState.of(state), ask)


class Pipe(Protocol):
    """One end of a pipe between processes; its class differs between systems."""

    def send(self, message: object, /) -> None:
        """Send one message."""

    def recv(self) -> Any:  # noqa: ANN401  whatever was sent
        """Wait for a message."""


class WorkerEndedError(VinefabError):
    """A process that was to answer ended instead."""

    def __str__(self) -> str:
        return "the process of this panel ended unexpectedly; what it printed is in the terminal"


class ProcessExecutor:
    """A process that answers one question at a time."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._turn = asyncio.Lock()
        self._pipe: Pipe | None = None
        self._process: multiprocessing.process.BaseProcess | None = None
        self._scratch: tempfile.TemporaryDirectory[str] | None = None

    async def answer(self, question: Question, progress: Seen) -> Any:  # noqa: ANN401  plain values
        """Return the answer; if the caller is cancelled the process is killed.

        Raises
        ------
        VinefabError
            If something on the page cannot be used.
        """
        async with self._turn:
            if self._pipe is None or self._process is None or not self._process.is_alive():
                self.close()
                # Not a fork: the server has threads.
                context = multiprocessing.get_context("spawn")
                self._pipe, theirs = context.Pipe()
                # One that is killed takes none of its temporary files away.
                self._scratch = tempfile.TemporaryDirectory(
                    prefix="vinefab-", ignore_cleanup_errors=True
                )
                self._process = context.Process(
                    target=answer_questions, args=(theirs, self._scratch.name),
                    name=f"vinefab {self._name}", daemon=True,
                )  # fmt: skip
                self._process.start()
                theirs.close()
            pipe = self._pipe

            def exchange() -> Any:  # noqa: ANN401  plain values
                try:
                    pipe.send(question)
                    while True:
                        kind, content = pipe.recv()
                        if kind != "progress":
                            break
                        progress(*content)
                except (EOFError, OSError) as error:
                    raise WorkerEndedError from error
                if kind == "error":
                    raise content
                return content

            try:
                return await asyncio.to_thread(exchange)
            except (asyncio.CancelledError, WorkerEndedError):
                self.close()
                raise

    def close(self) -> None:
        """End the process, whatever it does."""
        process, self._process = self._process, None
        self._pipe = None  # closed with its last user: a thread may still read from it
        if process is not None:
            process.kill()
            process.join()
        scratch, self._scratch = self._scratch, None
        if scratch is not None:
            scratch.cleanup()


def answer_questions(pipe: Pipe, scratch: str) -> None:
    """Answer the questions of a pipe until the server is gone: the process of an executor.

    Its temporary files lie in a folder of the server's.
    """
    tempfile.tempdir = scratch

    def see(line: ProgressLine) -> None:
        share = None if line.now is None else line.now.share
        with suppress(OSError):  # the server is gone
            pipe.send(("progress", (share, ", ".join(filter(None, (line.what, line.left))))))

    # Ctrl-C goes to the server, which ends its executors; one that is killed closes the pipe.
    with suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            question = pipe.recv()
            try:
                with progress_seen(see) as listener, heard_by(listener):
                    found = answer_of(question.panel, question.state, question.ask)
            except VinefabError as error:
                pipe.send(("error", error))
            else:
                pipe.send(("answer", found))


class ThreadExecutor:
    """A thread of the server, for answers that must follow the pointer."""

    def __init__(self) -> None:
        # Its thread is a daemon: Ctrl-C waits for no answer.
        self._pool = ThreadPool(1)
        self.answered = asyncio.Event()
        """Set once the page has shown its first answer: what takes long may begin."""

    async def answer(self, question: Question, _progress: Seen) -> Any:  # noqa: ANN401  plain values
        """Return the answer; what raises raises here."""
        painted_s = 0.5  # time that a page takes to show its first answer
        try:
            return await self.run(lambda: answer_of(question.panel, question.state, question.ask))
        finally:
            asyncio.get_running_loop().call_later(painted_s, self.answered.set)

    async def run(self, work: Callable[[], Any]) -> Any:  # noqa: ANN401  as the work
        """Return the result of a function, after everything that was asked before."""
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
