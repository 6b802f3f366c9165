"""The server: the workspace that all tabs share, and its address with an access token.

It is bound to this computer and up until Ctrl-C.
"""

import asyncio
import hmac
import os
import secrets
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from threading import enumerate as enumerate_threads
from typing import TYPE_CHECKING, Any

from vinefab.core import __version__
from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.front_door import imported_later
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.pages.plan_svg import legend_rows
from vinefab.studio.file_store import FILE_REQUESTS, Broadcast, FileStore
from vinefab.studio.state import PAGE, StudioState, design_form, growth_form

if TYPE_CHECKING:
    from vinefab.studio import file_exports, live_answers, searches, sessions
    from vinefab.studio.executors import ThreadExecutor
else:  # a second each, once the page is there; most pages need no search and no snapshot
    file_exports = imported_later("vinefab.studio.file_exports")
    live_answers = imported_later("vinefab.studio.live_answers")
    searches = imported_later("vinefab.studio.searches")
    sessions = imported_later("vinefab.studio.sessions")

LOOPBACK = "127.0.0.1"
PAGE_FOLDER = Path(__file__).with_name("page")
MODULES = "<!-- modules -->"
"""The mark in ``index.html`` that the import map replaces, here and in snapshots."""

SUBPROTOCOL = "vinefab"
"""The subprotocol of a socket before its token: a page can send no other header with it."""

_EMPTY: Mapping[str, Any] = {
    "design": None,
    "map": None,
    "pose": None,
    "recipe": None,
    "task": "coverage",
    "family": {"count": 40, "seed": 1000},
    "growth": {},
    "locks": [],
}
"""A state without anything open."""

_PAUSE_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchOptions:
    """Options of the command line."""

    design: str = "grid_explorer_levels"
    map_file: Path | None = None
    environment: str = "grid"
    seed: int = 3
    recipe: str = ""
    folder: Path = field(default_factory=Path.cwd)  # where the command was started

    @property
    def is_snapshot(self) -> bool:
        """Whether a snapshot is opened in place of a design."""
        return self.design.lower().endswith(".html")

    @property
    def named(self) -> tuple[Path, ...]:
        """The files that were named, whose folders are open as well."""
        given = (self.design, self.map_file, self.recipe)
        paths = [Path(name) for name in given if name]
        return tuple(path for path in paths if path.suffix or path.parent != Path())


class StudioWorkspace:
    """Files and searches of the folder that the command was started in.

    Raises
    ------
    VinefabError
        If what the command line asks for cannot be opened.
    """

    def __init__(self, options: LaunchOptions) -> None:
        self._options = options
        self._started = secrets.token_hex(8)
        self.files = FileStore(options.folder, options.named)
        self._searches: searches.SearchManager | None = None
        self._lock = Lock()
        self._first = self._read()
        StudioState.of(self._first["state"])

    @property
    def state(self) -> Mapping[str, Any]:
        """The state that the command line asks for."""
        return self._first["state"]  # type: ignore[no-any-return]

    def hello(self) -> dict[str, Any]:
        """Return the first message of a tab: the files as they are, or as they last could be."""
        try:
            self._first = self._read()
        except VinefabError as error:
            return {**self._first, "problem": str(error)}
        return self._first

    def answer(self, name: str, state: Mapping[str, Any], ask: Mapping[str, Any]) -> Any:  # noqa: ANN401  plain values
        """Return the answer to a request about files or searches.

        Raises
        ------
        VinefabError
            If something on the page cannot be used.
        """
        if name in FILE_REQUESTS:
            return FILE_REQUESTS[name](self.files, ask)
        if name.startswith("search_"):
            self.files.check_paths(state)
            requests = searches.SEARCH_REQUESTS
            if name not in requests:
                raise BadInputError("request", name, f"one of {', '.join(requests)}", PAGE)
            with self._lock:
                if self._searches is None:
                    self._searches = searches.SearchManager(self.files.roots, self._options.folder)
            return requests[name](self._searches, state, ask)
        raise BadInputError("request", name, f"one of {', '.join(FILE_REQUESTS)}", PAGE)

    def allowed(
        self, panel: str, state: Mapping[str, Any], ask: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """Return the question of a panel if every path in it lies where the user opened files."""
        self.files.check_paths(state)
        if panel == "export":
            # A snapshot holds the state itself, whose paths have been looked at.
            return {**ask, "state": state, "roots": [str(root) for root in self.files.roots]}
        return ask

    def background(
        self, broadcast: Broadcast, live: "ThreadExecutor"
    ) -> list[Coroutine[Any, Any, None]]:
        """Return the tasks of the server: compiling, watching files and searches."""

        async def compiling() -> None:  # once the first picture is there
            await live.answered.wait()
            if await live_answers.compile_kernel():
                broadcast({"event": "engine", "engine": "kernel"})

        async def searching() -> None:
            while self._searches is None:
                await asyncio.sleep(_PAUSE_S)
            await self._searches.watch(broadcast)

        return [compiling(), self.files.watch(broadcast), searching()]

    def close(self) -> None:
        """Stop the search that is running; it can be resumed."""
        if self._searches is not None:
            self._searches.close()

    def _read(self) -> dict[str, Any]:
        options = self._options
        if options.is_snapshot:  # its design has no file yet
            state = file_exports.stored_state(Path(options.design))
            name = state["design"]["name"]
            file = {"path": name, "name": name, "writable": False, "stamp": ""}
        else:
            file = self.files.open_design({"design": options.design})
            of_run: dict[str, Any] = {k: file.pop(k) for k in ("task", "recipe") if k in file}
            source: dict[str, Any] = {"environment": options.environment, "seed": options.seed}
            if options.map_file is not None:
                source = self.files.open_map({"path": str(options.map_file)})["source"]
            state = {
                "design": file.pop("design"),
                "map": {"source": source, "edits": []},
                **of_run,
                **({"recipe": options.recipe} if options.recipe else {}),
                "family": _EMPTY["family"],
            }
        return {
            "version": __version__,
            "started": self._started,
            "folder": str(options.folder),
            "environments": list(ENVIRONMENTS.names()),
            "form": design_form(),
            "growth_form": growth_form(),
            "legend": legend_rows(),
            "state": {**_EMPTY, **state},
            "file": file,
        }


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
        raise BadInputError("--port", port, allowed) from None
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
    server = sessions.make_server(workspace, endpoint)
    await server.serve(sockets=[bound])
