"""The guard in front of the server: who may ask, and what a browser may do with the answer.

A page of any website can send requests to this computer's own address, and a name that the website
owns can be made to lead here (DNS rebinding). So the address alone lets nobody in: every request
must name this server as its ``Host``, and one with an ``Origin`` must come from its own page. Only
the socket gives anything of the user's. Its first request must show the token that the command
printed, so that no message is read without it.
"""

from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vinefab.studio.connections import Connections
from vinefab.studio.door import SUBPROTOCOL, Door

_HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


OPEN_AGAIN = (
    "the token is missing or old. Open the whole address that `vinefab studio` printed in its "
    "terminal; if it has ended, start it again"
)
"""What to do without a token."""


class Gate:
    """Passes on the requests of the server's own page, and refuses all others."""

    def __init__(
        self, app: ASGIApp, door: Door, connections: Connections, script_hashes: tuple[str, ...]
    ) -> None:
        self._app = app
        self._door = door
        self._connections = connections
        scripts = " ".join(["'self'", *(f"'{one}'" for one in script_hashes)])
        # Not every browser takes a socket of the page's own address for 'self'.
        sockets = " ".join(f"ws://{name}" for name in door.hosts)
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
            with self._connections.tab(scope):
                await self._app(scope, receive, send)
            return
        app = PlainTextResponse(f"vinefab studio: {problem}\n", 403) if problem else self._app
        with self._connections.answering(scope):
            await app(scope, receive, self._guarded(send))

    def _problem(self, scope: Scope) -> str:
        """Return why a request is refused, or nothing."""
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self._door.hosts:
            return "this address is not the studio's"
        if origin is None and scope["type"] == "websocket":
            return "a socket must say where it comes from"
        if origin is not None and origin not in [f"http://{name}" for name in self._door.hosts]:
            return "a page from elsewhere may not ask"
        if scope["type"] == "websocket":
            return self._problem_of_socket(scope["subprotocols"])
        if scope["method"] not in ("GET", "HEAD"):
            return "only pages are read here"
        return self._problem_of_page(scope) if scope["path"] == "/" else ""

    def _problem_of_socket(self, offered: list[str]) -> str:
        if offered[:1] != [SUBPROTOCOL] or not self._door.opens("".join(offered[1:])):
            return OPEN_AGAIN
        return "too many tabs are open" if self._connections.full else ""

    def _problem_of_page(self, scope: Scope) -> str:
        if not scope["query_string"]:
            return ""  # it holds nothing of the user's, and has stored the token or leads back here
        query = parse_qs(scope["query_string"].decode("latin-1"))
        if not self._door.opens(query.get("token", [""])[0]):
            return OPEN_AGAIN
        self._door.remove_forwarding()
        return ""

    def _guarded(self, send: Send) -> Send:
        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["content-security-policy"] = self._policy
                for name, value in _HEADERS.items():
                    headers[name] = value
            await send(message)

        return guarded
