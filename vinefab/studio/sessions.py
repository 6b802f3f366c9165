"""The application: the guard of its requests, the page, and a session for each open tab.

A page of any website can send requests to this computer's own address, and a name that the website
owns can be made to lead here (DNS rebinding). So the address alone opens nothing: every request
must name this server as its ``Host``, and one with an ``Origin`` must come from its own page. Only
the socket gives anything of the user's. Its first request must show the token that the command
printed, so that no message is read without it.

Every user of the computer can connect to the server. Whatever a connection holds before it has
shown the token is bounded: one request of `MOST_HEAD_BYTES`, `PATIENCE_S` to send it, and
`MOST_PENDING` connections in all. When one more comes an old one goes: to refuse the new one would
lock the owner out. Half the room is for connections that have asked for something, so that idle
ones cannot break off a page that is being loaded.

With the token a page may leave messages unread and send one in many parts, but not without end:
then its connection is dropped, and the page connects again.
"""

import asyncio
import base64
import hashlib
import json
import traceback
from asyncio import TimerHandle, Transport, get_running_loop
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import (
    AbstractContextManager,
    asynccontextmanager,
    contextmanager,
    nullcontext,
    suppress,
)
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

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
from vinefab.studio.server import MODULES, PAGE_FOLDER, SUBPROTOCOL, Endpoint, StudioWorkspace

MOST_PENDING = 128
"""Connections without the token; a browser opens six for a page."""

MOST_TABS = 64
"""Open pages."""

MOST_HEAD_BYTES = 16 << 10
"""Size of a request without the token: its head, for pages are asked for without content."""

PATIENCE_S = 5.0
"""Time to send the head of a request."""

MOST_MESSAGE_BYTES = 4 << 20
"""Size of the largest autosave; more closes the socket."""

MOST_PARTS = 10_000
"""Frames of a message: empty ones add nothing to its length."""


DROP = "drop"
"""Key of the function, in the state of a socket's scope, that ends its connection at once."""


@dataclass(slots=True)
class _Pending:
    transport: Transport
    timer: TimerHandle | None = None  # none while a request is answered
    has_asked: bool = False

    def stop_timer(self) -> None:
        if self.timer is not None:
            self.timer.cancel()
        self.timer = None


class Connections:
    """The connections without the token, the oldest first, and the number of tabs."""

    def __init__(self) -> None:
        self._pending: dict[object, _Pending] = {}  # by the address of the client
        self._tabs = 0

    @property
    def full(self) -> bool:
        """Whether the greatest number of tabs is open."""
        return self._tabs >= MOST_TABS

    def add(self, transport: Transport) -> None:
        """Take a new connection, in place of another where there are too many."""
        if len(self._pending) >= MOST_PENDING:
            silent = [name for name, one in self._pending.items() if not one.has_asked]
            asked = [name for name, one in self._pending.items() if one.has_asked]
            self._abort((silent if len(silent) > len(asked) else asked)[0])
        client = transport.get_extra_info("peername")
        self.remove(client)  # a refused socket may have left its address
        self._pending[client] = _Pending(transport)
        self._start_timer(client)

    def remove(self, client: object) -> None:
        """Forget a connection that has ended or shown the token."""
        pending = self._pending.pop(client, None)
        if pending is not None:
            pending.stop_timer()

    @contextmanager
    def answering(self, scope: Scope) -> Iterator[None]:
        """Hold the clock of a connection while its request is answered."""
        pending = self._pending.get(scope["client"])
        if pending is not None:
            pending.stop_timer()
            pending.has_asked = True
        try:
            yield
        finally:
            self._start_timer(scope["client"])

    @contextmanager
    def session(self, scope: Scope) -> Iterator[None]:
        """Count a tab that has shown the token."""
        self.remove(scope["client"])
        self._tabs += 1
        try:
            yield
        finally:
            self._tabs -= 1

    def _start_timer(self, client: object) -> None:
        pending = self._pending.get(client)
        if pending is not None:
            pending.stop_timer()
            pending.timer = get_running_loop().call_later(PATIENCE_S, self._abort, client)

    def _abort(self, client: object) -> None:
        transport = self._pending[client].transport
        self.remove(client)
        transport.abort()


def limited_protocol(connections: Connections) -> type[H11Protocol]:
    """Return the protocol of a server whose connections are limited."""

    class LimitedProtocol(H11Protocol):
        _received = 0  # bytes since the last answer

        def data_received(self, data: bytes) -> None:
            # By the sum: h11 measures only what is incomplete, not a head that comes in one piece.
            self._received += len(data)
            if self._received > MOST_HEAD_BYTES:
                self.send_400_response("a request has at most 16 kB here")
            else:
                super().data_received(data)

        def on_response_complete(self) -> None:
            self._received = 0
            super().on_response_complete()

        def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            connections.add(transport)

        def connection_lost(self, exc: Exception | None) -> None:
            connections.remove(self.transport.get_extra_info("peername"))
            super().connection_lost(exc)

        def send_400_response(self, msg: str) -> None:
            if self.cycle is None:
                super().send_400_response(msg)
            else:  # two answers to one request would be a traceback on the owner's terminal
                self.transport.abort()

    return LimitedProtocol


class LimitedSocketProtocol(WebSocketsSansIOProtocol):
    """A socket that bounds the data of a tab before the application receives them."""

    _parts = 0  # of the message that is being received

    async def run_asgi(self) -> None:
        """Serve the socket; at its end a client that reads nothing is not waited for."""
        self.scope["state"][DROP] = self.transport.abort
        await super().run_asgi()
        if self.transport.get_write_buffer_size():
            self.transport.abort()

    def handle_cont(self, event: Frame) -> None:
        """Take a further part of a message."""
        self._parts = 0 if event.fin else self._parts + 1
        if self._parts > MOST_PARTS:
            self.transport.abort()
        else:
            super().handle_cont(event)

    def handle_ping(self) -> None:
        """Answer a ping where earlier answers are read."""
        if self.writable.is_set():
            super().handle_ping()
        else:
            self.conn.data_to_send()


_HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


_OPEN_AGAIN = (
    "the token is missing or old. Open the whole address that `vinefab studio` printed in its "
    "terminal; if it has ended, start it again"
)


class RequestGuard:
    """Passes on the requests of the server's own page, and refuses all others."""

    def __init__(
        self,
        app: ASGIApp,
        endpoint: Endpoint,
        connections: Connections,
        script_hashes: tuple[str, ...],
    ) -> None:
        self._app = app
        self._endpoint = endpoint
        self._connections = connections
        scripts = " ".join(["'self'", *(f"'{one}'" for one in script_hashes)])
        # Not every browser takes a socket of the page's own address for 'self'.
        sockets = " ".join(f"ws://{name}" for name in endpoint.hosts)
        self._policy = (
            f"default-src 'none'; script-src {scripts}; style-src 'self'; "
            f"connect-src 'self' {sockets}; "
            "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or socket."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        problem = self._problem(scope)
        if problem and scope["type"] == "websocket":
            # Before it is accepted a socket is closed with 403, which has no content to guard.
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": problem})
            return
        if scope["type"] == "websocket":
            with self._connections.session(scope):
                await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["content-security-policy"] = self._policy
                headers.update(_HEADERS)
            await send(message)

        app = PlainTextResponse(f"vinefab studio: {problem}\n", 403) if problem else self._app
        with self._connections.answering(scope):
            await app(scope, receive, guarded)

    def _problem(self, scope: Scope) -> str:  # noqa: PLR0911  one for each kind of refusal
        """Return the reason to refuse a request, or an empty text."""
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self._endpoint.hosts:
            return "this address is not the studio's"
        if origin is None and scope["type"] == "websocket":
            return "a socket must say where it comes from"
        if origin is not None and origin not in [f"http://{name}" for name in self._endpoint.hosts]:
            return "a page from elsewhere may not ask"
        if scope["type"] == "websocket":
            offered = scope["subprotocols"]
            if offered[:1] != [SUBPROTOCOL] or not self._endpoint.accepts("".join(offered[1:])):
                return _OPEN_AGAIN
            return "too many tabs are open" if self._connections.full else ""
        if scope["method"] not in ("GET", "HEAD"):
            return "only pages are read here"
        if scope["path"] != "/" or not scope["query_string"]:
            return ""  # the page holds nothing of the user's, and has stored the token
        query = parse_qs(scope["query_string"].decode("latin-1"))
        if not self._endpoint.accepts(query.get("token", [""])[0]):
            return _OPEN_AGAIN
        self._endpoint.remove_redirect()
        return ""


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
                await self.live.run(lambda: answer_of(LIVE, state, {}))

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
        # Bytes that a page may leave unread before it is dropped: events come without a question.
        most_unread_bytes = 16 << 20
        if self._unread_bytes > most_unread_bytes:
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
        # Messages that a page may leave unread before it is asked nothing more of.
        most_unread = 100
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
                while self._out.qsize() > most_unread and not sending.done():  # it does not read
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
        most_asked = 64  # questions of one session that are being answered
        if len(self._asked) >= most_asked:
            self.put({**reply, "error": {"message": f"at most {most_asked} questions at once"}})
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
        first_picture_s = 2.0  # time that everything else leaves to the first picture
        if "request" in reply:
            # Files and runs are read apart from the thread that follows the pointer.
            found = await asyncio.to_thread(workspace.answer, str(reply["request"]), state, ask)
        else:
            panel, loop = str(reply["panel"]), asyncio.get_running_loop()
            ask = workspace.allowed(panel, state, ask)
            _, name = PANELS.get(panel, ("", LIVE))  # an unknown one is refused there
            if name != LIVE:  # no process is started before the first picture
                with suppress(TimeoutError):
                    await asyncio.wait_for(live.answered.wait(), first_picture_s)

            def progress(share: float | None, text: str) -> None:
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


def make_server(workspace: StudioWorkspace, endpoint: Endpoint) -> uvicorn.Server:
    """Return the server of the application; it leaves signals alone."""

    class Server(uvicorn.Server):
        def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]
            return nullcontext()  # it would raise them once more at its end

    connections = Connections()
    # Connections that wait, and that are accepted in one go: far fewer than may be pending, so that
    # a request is read before others take its place.
    backlog = 32
    return Server(
        uvicorn.Config(
            make_app(workspace, endpoint, connections),
            log_level="error",  # any user of the computer could fill the terminal with warnings
            http=limited_protocol(connections),
            ws=LimitedSocketProtocol,
            ws_max_size=MOST_MESSAGE_BYTES,
            backlog=backlog,
            proxy_headers=False,  # a client would choose its own address
            timeout_graceful_shutdown=2,
            server_header=False,
        )
    )
