"""The guard in front of the server: who may ask, how many may connect, and for how long.

A page of any website can send requests to this computer's own address, and a name that the website
owns can be made to lead here (DNS rebinding). So the address alone opens nothing: every request
must name this server as its ``Host``, and one with an ``Origin`` must come from its own page. Only
the socket gives anything of the user's. Its first request must show the token that the command
printed, so that no message is read without it.

Every user of the computer can connect to the server. Whatever a connection holds before it has
shown the token is bounded: one head of a request (16 kB, by h11), `PATIENCE_S` to send it, and
`MOST_PENDING` connections in all. When one more comes an old one goes: to refuse the new one would
lock the owner out. Half the room is for connections that have asked for something, so that idle
ones cannot break off a page that is being loaded.

With the token a page may leave messages unread and send one in many parts, but not without end:
then its connection is dropped, and the page connects again.
"""

from asyncio import TimerHandle, Transport, get_running_loop
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from vinefab.studio.server import SUBPROTOCOL, Endpoint

MOST_PENDING = 128
"""Connections without the token; a browser opens six for a page."""

MOST_TABS = 64
"""Open pages."""

PATIENCE_S = 5.0
"""Time to send the head of a request."""

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
