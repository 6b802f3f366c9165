"""The server: bound to this computer, opened by an access token, up until Ctrl-C."""

import asyncio
import hmac
import os
import secrets
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from threading import enumerate as enumerate_threads

from vinefab.core.errors import BadInputError
from vinefab.studio.workspace import LaunchOptions, StudioWorkspace

LOOPBACK = "127.0.0.1"
PAGE_FOLDER = Path(__file__).with_name("page")
MODULES = "<!-- modules -->"
"""The mark in ``index.html`` that the import map replaces, here and in snapshots."""

SUBPROTOCOL = "vinefab"
"""The subprotocol of a socket before its token: a page can send no other header with it."""


MOST_MESSAGE_BYTES = 4 << 20
"""Size of the largest autosave; more closes the socket."""

BACKLOG = 32
"""Connections that wait, and that are accepted in one go: far fewer than may be pending, so that a
request is read before others take its place."""


@dataclass(slots=True, kw_only=True)
class Endpoint:
    """The address of the server with its access token."""

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)
    _redirect: TemporaryDirectory[str] | None = None

    @property
    def hosts(self) -> tuple[str, ...]:
        """The host names that a request may have."""
        return f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"

    @property
    def address(self) -> str:
        """The address for the user."""
        return f"http://{LOOPBACK}:{self.port}/?token={self.token}"

    def accepts(self, token: object) -> bool:
        """Tell whether a token is the right one, in constant time."""
        given = token.encode(errors="replace") if isinstance(token, str) else b""
        return hmac.compare_digest(given, self.token.encode())

    def write_redirect(self) -> str:
        """Write a page of the user's own that leads to the address; return its ``file:`` URL.

        A browser gets this URL: every user of the computer can read command lines.
        """
        # A browser in a snap can read neither /tmp nor hidden folders of the home folder.
        home = os.path.expanduser("~")  # noqa: PTH111  Path.home() fails where there is none
        self._redirect = TemporaryDirectory(  # mode 0700
            prefix="vinefab-studio-",
            dir=home if os.access(home, os.W_OK) else None,
            ignore_cleanup_errors=True,
        )
        path = Path(self._redirect.name) / "open.html"
        path.touch(0o600)
        address = escape(self.address)
        path.write_text(
            '<!doctype html><meta charset="utf-8"><title>vinefab studio</title>'
            f'<meta http-equiv="refresh" content="0; url={address}">'
            f'<a href="{address}">vinefab studio</a>\n',
            encoding="utf-8",
        )
        return path.as_uri()

    def remove_redirect(self) -> None:
        """Remove the page that leads to the address: the browser has come, or the server ends."""
        if self._redirect is not None:
            self._redirect.cleanup()
            self._redirect = None


def bound_socket(port: int) -> socket.socket:
    """Return a socket that listens on this computer only; port 0 takes any that is free.

    Raises
    ------
    BadInputError
        If the port cannot be had.
    """
    if not 0 <= port <= 65535:
        raise BadInputError("--port", port, "0 to 65535")
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if os.name == "posix":  # on Windows others could then listen on the same port
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((LOOPBACK, port))
        bound.listen(64)
    except OSError as error:
        bound.close()
        allowed = f"a port that is free ({error.strerror}); 0 takes any"
        raise BadInputError("--port", port, allowed) from error
    return bound


def serve(
    options: LaunchOptions,
    *,
    port: int = 0,
    browser: bool = True,
    say: Callable[[str], None] = print,
) -> None:
    """Serve the page until Ctrl-C.

    Parameters
    ----------
    port
        Where to listen; 0 for any port that is free.
    browser
        Whether to open the page.
    say
        Takes the line with the address.
    """
    # Matrices of the page are small: threads of BLAS would wait for each other, on busy computers
    # for seconds. Read when SciPy is first imported, here or in a process of a panel.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    workspace = StudioWorkspace(options)
    bound = bound_socket(port)
    endpoint = Endpoint(port=bound.getsockname()[1])

    def announce() -> None:
        say(f"studio: {endpoint.address}  (Ctrl-C ends it)")
        if browser:
            with suppress(OSError):  # the home folder is full: the address has been printed
                page = endpoint.write_redirect()
                Thread(target=webbrowser.open, args=(page,), daemon=True).start()

    try:
        asyncio.run(_until_stopped(workspace, endpoint, bound, announce))
    finally:
        endpoint.remove_redirect()
    if any(thread.daemon for thread in enumerate_threads()):
        # An answer is still being computed. A thread inside of compiled code must not
        # meet an interpreter that is being taken down; nothing is open any more.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


async def _until_stopped(
    workspace: StudioWorkspace,
    endpoint: Endpoint,
    bound: socket.socket,
    announce: Callable[[], None],
) -> None:
    def stop() -> None:  # called while this waits: there is a server then
        server.should_exit = True

    for name in (signal.SIGINT, signal.SIGTERM):
        try:
            asyncio.get_running_loop().add_signal_handler(name, stop)
        except NotImplementedError:  # Windows
            signal.signal(name, lambda *_: stop())
    # The browser starts while the rest is being loaded; the system keeps its call waiting.
    announce()
    import uvicorn  # noqa: PLC0415  after the address has been printed

    from vinefab.studio.request_guard import (  # noqa: PLC0415  as above
        Connections,
        LimitedSocketProtocol,
        limited_protocol,
    )
    from vinefab.studio.sessions import make_app  # noqa: PLC0415  as above

    connections = Connections()
    config = uvicorn.Config(
        make_app(workspace, endpoint, connections),
        log_level="error",  # any user of the computer could fill the terminal with warnings
        http=limited_protocol(connections),
        ws=LimitedSocketProtocol,
        ws_max_size=MOST_MESSAGE_BYTES,
        backlog=BACKLOG,
        proxy_headers=False,  # a client would choose its own address
        timeout_graceful_shutdown=2,
        server_header=False,
    )

    class Server(uvicorn.Server):
        """Leaves signals alone: it would raise them once more at its end."""

        def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]
            return nullcontext()

    server = Server(config)
    await server.serve(sockets=[bound])
