"""The server's application: the page, and a socket for each tab that is open."""

import asyncio
import base64
import hashlib
import json
import traceback
from collections.abc import AsyncIterator, Callable, Mapping
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
from vinefab.studio.connections import DROP, Connections
from vinefab.studio.door import SUBPROTOCOL, Door
from vinefab.studio.gate import Gate
from vinefab.studio.lanes import ProcessLane, Question, ThreadLane, first_answer
from vinefab.studio.panels import CUT
from vinefab.studio.workplace import TIP, Workplace

PAGE_FOLDER = Path(str(files("vinefab.studio"))) / "page"
MODULES = "<!-- modules -->"
"""What in ``index.html`` is replaced by the import map, here and in snapshots."""

_FIRST_PICTURE_S = 2.0
"""Time that everything else leaves to the first picture."""

_MOST_ASKED = 64
"""Questions of one tab that are being answered."""

_MOST_UNREAD = 100
"""Messages that a tab may leave unread before it is asked nothing more of."""

_MOST_UNREAD_BYTES = 16 << 20
"""What a tab may leave unread before its connection is dropped: events come without a question."""

_KINDS = {".js": "text/javascript", ".css": "text/css"}
"""What browsers ask for, with its media type; a table of the system may have another."""

_LANES = ("rules", "fix", "family", "export", "inflated")


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


class Studio:
    """What all tabs share: the lanes, the files, the events."""

    def __init__(self, workplace: Workplace) -> None:
        self.workplace = workplace
        self.live = ThreadLane()
        self.lanes: dict[str, ThreadLane | ProcessLane] = {
            # A thread of its own: loading the simulation of joints must not hold up a robot.
            CUT: ThreadLane(),
            **{name: ProcessLane(name) for name in _LANES},
        }
        self._tabs: set[Tab] = set()

    def tell_all(self, event: Mapping[str, Any]) -> None:
        """Send an event to every tab."""
        for tab in self._tabs:
            tab.put(event)

    @asynccontextmanager
    async def running(self, _: Starlette) -> AsyncIterator[None]:
        """Watch files and runs while the server is up; end every process with it."""
        tasks = [
            asyncio.create_task(work)
            for work in (self._prepare(), *self.workplace.background(self.tell_all, self.live))
        ]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            for lane in self.lanes.values():
                lane.close()
            self.live.close()
            self.workplace.close()

    async def _prepare(self) -> None:
        """Load what the first picture needs, and the map, while the browser opens the page."""
        state = self.workplace.state
        with suppress(VinefabError):  # the page will be told
            await self.live.run(lambda: first_answer(state))

    async def socket(self, socket: WebSocket) -> None:
        """Serve a tab until it is closed."""
        await socket.accept(SUBPROTOCOL)
        tab = Tab(self, socket)
        self._tabs.add(tab)
        try:
            with suppress(WebSocketDisconnect):
                await tab.serve()
        finally:
            self._tabs.discard(tab)
            tab.close()


class Tab:
    """One open page: its questions, one at a time for each panel."""

    def __init__(self, studio: Studio, socket: WebSocket) -> None:
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
        sending = asyncio.create_task(self._send())
        try:
            hello = await asyncio.to_thread(self._studio.workplace.hello)
            self.put({"event": "hello", **hello})
            while True:
                self._take(await _received(self._socket))
                while self._out.qsize() > _MOST_UNREAD and not sending.done():  # it does not read
                    await asyncio.sleep(0.05)
        finally:
            sending.cancel()

    def close(self) -> None:
        """Drop what was asked: nobody waits for it any more."""
        for task in self._asked.values():
            task.cancel()

    async def _send(self) -> None:
        with suppress(WebSocketDisconnect, RuntimeError):  # the tab was closed meanwhile
            while True:
                text = await self._out.get()
                await self._socket.send_text(text)
                self._unread_bytes -= len(text)

    def _take(self, message: Mapping[str, Any]) -> None:
        if "cancel" in message:
            task = self._asked.get(str(message["cancel"]))
            if task is not None:
                task.cancel()
            return
        key = "panel" if "panel" in message else "desk"
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
        task = asyncio.create_task(self._answer(message, reply))
        self._asked[slot] = task
        task.add_done_callback(lambda done: self._settle(slot, reply, done))

    def _settle(self, slot: str, reply: Mapping[str, Any], done: asyncio.Task[None]) -> None:
        """Forget a question that is over; say so where nothing else has."""
        self._asked.pop(slot, None)
        if done.cancelled():
            self.put({**reply, "error": {"message": "stopped", "stopped": True}})
            return
        error = done.exception()
        if isinstance(error, VinefabError):
            self.put({**reply, "error": {"message": str(error)}})
        elif error is not None:
            # A bug: the page goes on, and whoever started the server can report it.
            traceback.print_exception(error)
            words = f"this should not happen: {type(error).__name__}: {error}"
            self.put({**reply, "error": {"message": words}})

    async def _answer(self, message: Mapping[str, Any], reply: Mapping[str, Any]) -> None:
        state, ask = message.get("state") or {}, message.get("ask") or {}
        if not isinstance(state, dict) or not isinstance(ask, dict):
            raise BadInputError("message", "state, ask", "names with values", "the page")
        workplace = self._studio.workplace
        if "desk" in reply:
            name = str(reply["desk"])
            # Files and runs are read beside the thread that follows the pointer.
            run = self._studio.live.run if name == TIP else asyncio.to_thread
            found = await run(lambda: workplace.answer(name, state, ask))
        else:
            ask = workplace.allowed(str(reply["panel"]), state, ask)
            question = Question(panel=str(reply["panel"]), state=state, ask=ask)
            lane = await self._lane(question.panel)
            found = await lane.answer(question, self._progress(reply))
        self.put({**reply, "answer": found})

    async def _lane(self, panel: str) -> ThreadLane | ProcessLane:
        """Return where a panel is answered; no process is started before the first picture."""
        lane = self._studio.lanes.get(panel)
        if lane is None:
            return self._studio.live
        with suppress(TimeoutError):
            await asyncio.wait_for(self._studio.live.answered.wait(), _FIRST_PICTURE_S)
        return lane

    def _progress(self, reply: Mapping[str, Any]) -> Callable[[float, str], None]:
        loop = asyncio.get_running_loop()

        def send(share: float, text: str) -> None:
            loop.call_soon_threadsafe(self.put, {**reply, "progress": [share, text]})

        return send


async def _received(socket: WebSocket) -> Mapping[str, Any]:
    """Return the next message of the page; one that is no object closes the socket."""
    try:
        message = json.loads(await socket.receive_text())
    except (ValueError, RecursionError, KeyError):
        message = None
    except RuntimeError as error:  # sending has found out before that nobody is there
        raise WebSocketDisconnect(1006) from error
    if not isinstance(message, dict):
        await socket.close(1003, "messages are JSON objects")
        raise WebSocketDisconnect(1003)
    return message


def make_app(workplace: Workplace, door: Door, connections: Connections) -> ASGIApp:
    """Return the guarded application."""
    studio = Studio(workplace)
    scripts, script_hash = live_scripts()
    app = Starlette(
        routes=[
            WebSocketRoute("/socket", studio.socket),
            *(Route(path, response) for path, response in _page(scripts).items()),
        ],
        lifespan=studio.running,
    )
    return Gate(app, door, connections, (script_hash,))


def _page(scripts: str) -> dict[str, Response]:
    """Return the files of the page, by path, from memory: a flood of requests waits for no disk."""
    html = (PAGE_FOLDER / "index.html").read_text(encoding="utf-8").replace(MODULES, scripts)
    templates = Path(str(files("vinefab.pages"))) / "templates"
    paths = [*PAGE_FOLDER.iterdir(), templates / "plan.css"]
    return {"/": HTMLResponse(html)} | {
        f"/page/{path.name}": Response(path.read_bytes(), media_type=_KINDS[path.suffix])
        for path in paths
        if path.suffix in _KINDS
    }
