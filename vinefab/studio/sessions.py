"""The application: the page, and a session over a socket for each tab that is open."""

import asyncio
import base64
import hashlib
import json
import traceback
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.responses import HTMLResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.studio.executors import (
    CUT,
    LIVE,
    PANELS,
    ProcessExecutor,
    Question,
    ThreadExecutor,
    answer_of,
)
from vinefab.studio.request_guard import DROP, Connections, RequestGuard
from vinefab.studio.server import MODULES, PAGE_FOLDER, SUBPROTOCOL, Endpoint
from vinefab.studio.workspace import TIP, StudioWorkspace

_FIRST_PICTURE_S = 2.0
"""Time that everything else leaves to the first picture."""

_MOST_ASKED = 64
"""Questions of one session that are being answered."""

_MOST_UNREAD = 100
"""Messages that a page may leave unread before it is asked nothing more of."""

_MOST_UNREAD_BYTES = 16 << 20
"""Bytes that a page may leave unread before it is dropped: events come without a question."""

_KINDS = {".js": "text/javascript", ".css": "text/css"}
"""Media types of the page's files; a table of the system may have others."""


class StudioServer:
    """The executors, the workspace and the events that all sessions share."""

    def __init__(self, workspace: StudioWorkspace) -> None:
        self.workspace = workspace
        self.live = ThreadExecutor()
        names = {name for _, name in PANELS.values()} - {LIVE, CUT}
        self.executors: dict[str, ThreadExecutor | ProcessExecutor] = {
            LIVE: self.live,
            # Its own thread: loading the simulation of joints must not hold up a robot.
            CUT: ThreadExecutor(),
            **{name: ProcessExecutor(name) for name in sorted(names)},
        }
        self._sessions: set[TabSession] = set()

    def broadcast(self, event: Mapping[str, Any]) -> None:
        """Send an event to every tab."""
        for session in self._sessions:
            session.put(event)

    @asynccontextmanager
    async def running(self, _: Starlette) -> AsyncIterator[None]:
        """Watch files and runs while the server is up; end every process with it."""

        async def prepare() -> None:  # what the first picture needs, while the browser opens
            state = self.workspace.state
            with suppress(VinefabError):  # the page will be told
                await self.live.run(lambda: answer_of(LIVE, state, {}, lambda _share, _text: None))

        tasks = [
            asyncio.create_task(work)
            for work in (prepare(), *self.workspace.background(self.broadcast, self.live))
        ]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            for executor in self.executors.values():
                executor.close()
            self.workspace.close()

    async def socket(self, socket: WebSocket) -> None:
        """Serve a tab until it is closed."""
        await socket.accept(SUBPROTOCOL)
        session = TabSession(self, socket)
        self._sessions.add(session)
        try:
            with suppress(WebSocketDisconnect):
                await session.serve()
        finally:
            self._sessions.discard(session)
            session.close()


class TabSession:
    """One open page: its questions, one at a time for each panel."""

    def __init__(self, studio: StudioServer, socket: WebSocket) -> None:
        self._studio = studio
        self._socket = socket
        self._asked: dict[str, asyncio.Task[None]] = {}
        self._out: asyncio.Queue[str] = asyncio.Queue()
        self._unread_bytes = 0

    def put(self, message: Mapping[str, Any]) -> None:
        """Send a message, after those before it, to a page that reads them."""
        if self._unread_bytes > _MOST_UNREAD_BYTES:
            self._socket.scope["state"][DROP]()
            return
        # Written here, so that a value that JSON has no word for is the fault of its question.
        text = json.dumps(message, allow_nan=False)
        self._unread_bytes += len(text)
        self._out.put_nowait(text)

    async def serve(self) -> None:
        """Greet the page, then answer it until it is gone."""

        async def send() -> None:
            with suppress(WebSocketDisconnect, RuntimeError):  # the tab was closed meanwhile
                while True:
                    text = await self._out.get()
                    await self._socket.send_text(text)
                    self._unread_bytes -= len(text)

        sending = asyncio.create_task(send())
        try:
            hello = await asyncio.to_thread(self._studio.workspace.hello)
            self.put({"event": "hello", **hello})
            while True:
                try:
                    message = json.loads(await self._socket.receive_text())
                except (ValueError, RecursionError, KeyError):
                    message = None
                except RuntimeError as error:  # sending has found out before that it is closed
                    raise WebSocketDisconnect(1006) from error
                if not isinstance(message, dict):
                    await self._socket.close(1003, "messages are JSON objects")
                    return
                self._take(message)
                while self._out.qsize() > _MOST_UNREAD and not sending.done():  # it does not read
                    await asyncio.sleep(0.05)
        finally:
            sending.cancel()

    def close(self) -> None:
        """Drop the open questions: the page is gone."""
        for task in self._asked.values():
            task.cancel()

    def _take(self, message: Mapping[str, Any]) -> None:
        """Begin to answer a question, or cancel one."""
        if "cancel" in message:
            asked = self._asked.get(str(message["cancel"]))
            if asked is not None:
                asked.cancel()
            return
        key = "panel" if "panel" in message else "request"
        name, number = str(message.get(key, ""))[:100], message.get("seq")
        number = number if isinstance(number, int) else 0
        reply = {key: name, "seq": number}
        slot = name if key == "panel" else f"{name} {number}"
        if slot in self._asked:
            self.put({**reply, "error": {"message": "one question at a time for each panel"}})
            return
        if len(self._asked) >= _MOST_ASKED:
            self.put({**reply, "error": {"message": f"at most {_MOST_ASKED} questions at once"}})
            return

        def settle(done: asyncio.Task[None]) -> None:
            self._asked.pop(slot, None)
            if done.cancelled():
                self.put({**reply, "error": {"message": "stopped", "stopped": True}})
                return
            error = done.exception()
            if isinstance(error, VinefabError):
                self.put({**reply, "error": {"message": str(error)}})
            elif error is not None:
                # A bug: the page stays, and the terminal has what can be reported.
                traceback.print_exception(error)
                text = f"this should not happen: {type(error).__name__}: {error}"
                self.put({**reply, "error": {"message": text}})

        task = asyncio.create_task(self._answer(message, reply))
        self._asked[slot] = task
        task.add_done_callback(settle)

    async def _answer(self, message: Mapping[str, Any], reply: Mapping[str, Any]) -> None:
        state, ask = message.get("state") or {}, message.get("ask") or {}
        if not isinstance(state, dict) or not isinstance(ask, dict):
            raise BadInputError("message", "state, ask", "names with values", "the page")
        workspace, live = self._studio.workspace, self._studio.live
        if "request" in reply:
            name = str(reply["request"])
            # Files and runs are read apart from the thread that follows the pointer.
            run = live.run if name == TIP else asyncio.to_thread
            found = await run(lambda: workspace.answer(name, state, ask))
        else:
            panel, loop = str(reply["panel"]), asyncio.get_running_loop()
            ask = workspace.allowed(panel, state, ask)
            _, name = PANELS.get(panel, ("", LIVE))  # an unknown one is refused there
            if name != LIVE:  # no process is started before the first picture
                with suppress(TimeoutError):
                    await asyncio.wait_for(live.answered.wait(), _FIRST_PICTURE_S)

            def progress(share: float, text: str) -> None:
                loop.call_soon_threadsafe(self.put, {**reply, "progress": [share, text]})

            question = Question(panel=panel, state=state, ask=ask)
            found = await self._studio.executors[name].answer(question, progress)
        self.put({**reply, "answer": found})


def live_scripts() -> tuple[str, str]:
    """Return the scripts of the served page, and the hash that its policy lets pass."""
    names = sorted(path.name for path in PAGE_FOLDER.glob("*.js"))
    modules = json.dumps({"imports": {f"studio/{name}": f"/page/{name}" for name in names}})
    digest = base64.b64encode(hashlib.sha256(modules.encode()).digest()).decode()
    html = (
        f'<script type="importmap">{modules}</script>\n'
        '<script type="module" src="/page/app.js"></script>'
    )
    return html, f"sha256-{digest}"


def make_app(workspace: StudioWorkspace, endpoint: Endpoint, connections: Connections) -> ASGIApp:
    """Return the guarded application.

    The files of the page are read once: a flood of requests waits for no disk.
    """
    studio = StudioServer(workspace)
    scripts, script_hash = live_scripts()
    html = (PAGE_FOLDER / "index.html").read_text(encoding="utf-8").replace(MODULES, scripts)
    templates = Path(str(files("vinefab.pages"))) / "templates"
    page = {"/": HTMLResponse(html)} | {
        f"/page/{path.name}": Response(path.read_bytes(), media_type=_KINDS[path.suffix])
        for path in [*PAGE_FOLDER.iterdir(), templates / "plan.css"]
        if path.suffix in _KINDS
    }
    app = Starlette(
        routes=[
            WebSocketRoute("/socket", studio.socket),
            *(Route(path, response) for path, response in page.items()),
        ],
        lifespan=studio.running,
    )
    return RequestGuard(app, endpoint, connections, (script_hash,))
