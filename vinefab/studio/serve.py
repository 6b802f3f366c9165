"""The server: bound to this computer, up until Ctrl-C."""

import asyncio
import os
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from threading import Thread
from threading import enumerate as enumerate_threads

from vinefab.studio.door import Door, bound_socket
from vinefab.studio.workplace import Opened, Workplace

MOST_MESSAGE_BYTES = 8 << 20
"""A state with thousands of edits is far below; more closes the socket."""


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
    workplace = Workplace(opened)
    bound = bound_socket(port)
    door = Door(port=bound.getsockname()[1])

    def announce() -> None:
        say(f"studio: {door.address}  (Ctrl-C ends it)")
        if browser:
            Thread(target=webbrowser.open, args=(door.address,), daemon=True).start()

    asyncio.run(_until_stopped(workplace, door, bound, announce))
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

    config = uvicorn.Config(
        make_app(workplace, door),
        log_level="warning",
        ws="websockets-sansio",
        ws_max_size=MOST_MESSAGE_BYTES,
        timeout_graceful_shutdown=2,
        server_header=False,
    )

    class Server(uvicorn.Server):
        """Leaves signals alone: it would raise them once more at its end."""

        def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]
            return nullcontext()

    server = Server(config)
    await server.serve(sockets=[bound])
