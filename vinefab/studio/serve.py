"""The server: bound to this computer, up until Ctrl-C."""

import asyncio
import signal
import socket
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread

import uvicorn

from vinefab.core.errors import BadInputError
from vinefab.studio.app import make_app
from vinefab.studio.gate import LOOPBACK, Door
from vinefab.studio.workplace import Opened, Workplace

MOST_MESSAGE_BYTES = 8 << 20
"""A state with thousands of edits is far below; more closes the socket."""


class _Server(uvicorn.Server):
    """A server that leaves signals to `serve`."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Do nothing: `serve` stops the server."""
        yield


def serve(
    opened: Opened, *, port: int = 0, browser: bool = True, say: Callable[[str], None] = print
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
    bound = _bound(port)
    door = Door(port=bound.getsockname()[1])
    # The browser starts while the rest is being loaded; the system keeps its call waiting.
    say(f"studio: {door.address}  (Ctrl-C ends it)")
    if browser:
        Thread(target=webbrowser.open, args=(door.address,), daemon=True).start()
    config = uvicorn.Config(
        make_app(Workplace(opened), door),
        log_level="warning",
        ws="websockets-sansio",
        ws_max_size=MOST_MESSAGE_BYTES,
        timeout_graceful_shutdown=2,
        server_header=False,
    )
    asyncio.run(_until_stopped(_Server(config), bound))


async def _until_stopped(server: uvicorn.Server, bound: socket.socket) -> None:
    loop = asyncio.get_running_loop()

    def stop() -> None:
        server.should_exit = True

    for name in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(name, stop)
    await server.serve(sockets=[bound])


def _bound(port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        raise BadInputError("--port", port, "0 to 65535")
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((LOOPBACK, port))
        bound.listen(64)
    except OSError as error:
        bound.close()
        allowed = f"a port that is free ({error.strerror}); 0 takes any"
        raise BadInputError("--port", port, allowed) from error
    return bound
