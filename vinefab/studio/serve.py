"""The server: bound to this computer, up until Ctrl-C."""

import asyncio
import os
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from threading import Thread
from threading import enumerate as enumerate_threads

from vinefab.studio.door import Door, bound_socket
from vinefab.studio.workplace import Opened, Workplace

MOST_MESSAGE_BYTES = 4 << 20
"""What a recovery file holds at most; more closes the socket."""

BACKLOG = 32
"""Connections that wait, and that are accepted in one go: far fewer than may be pending, so that a
request is read before others take its place."""


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
    # Matrices of the page are small: threads of BLAS would wait for each other, on busy computers
    # for seconds. Read when SciPy is first imported, here or in a lane.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    workplace = Workplace(opened)
    bound = bound_socket(port)
    door = Door(port=bound.getsockname()[1])

    def announce() -> None:
        say(f"studio: {door.address}  (Ctrl-C ends it)")
        if browser:
            with suppress(OSError):  # the home folder is full: the address has been printed
                page = door.write_forwarding()
                Thread(target=webbrowser.open, args=(page,), daemon=True).start()

    try:
        asyncio.run(_until_stopped(workplace, door, bound, announce))
    finally:
        door.remove_forwarding()
    if any(thread.daemon for thread in enumerate_threads()):
        # An answer is still being computed for nobody. A thread inside of compiled code must not
        # meet an interpreter that is being taken down; nothing is open any more.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


async def _until_stopped(
    workplace: Workplace, door: Door, bound: socket.socket, announce: Callable[[], None]
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

    from vinefab.studio.app import make_app  # noqa: PLC0415  as above
    from vinefab.studio.connections import (  # noqa: PLC0415  as above
        Connections,
        LimitedSocketProtocol,
        limited_protocol,
    )

    connections = Connections()
    config = uvicorn.Config(
        make_app(workplace, door, connections),
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
