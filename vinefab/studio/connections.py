"""Connections: few without the token and none for long, and bounds for those that have shown it.

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

from starlette.types import Scope
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

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
        """Whether there are as many tabs as may be."""
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
    def tab(self, scope: Scope) -> Iterator[None]:
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
    """Bounds what a tab can pile up in the server before the application hears of it."""

    _parts = 0  # of the message that is being received

    async def run_asgi(self) -> None:
        """Serve the socket; whoever reads nothing is not waited for at its end."""
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
