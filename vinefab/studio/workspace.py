"""The workspace of all tabs: what the command opened, the files, the searches."""

import asyncio
import secrets
from collections.abc import Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from vinefab.core import __version__
from vinefab.core.errors import BadInputError, VinefabError
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.pages.plan_svg import legend_rows
from vinefab.studio.file_store import FILE_REQUESTS, Broadcast, FileStore
from vinefab.studio.state import PAGE, StudioState, design_form, growth_form

if TYPE_CHECKING:
    from vinefab.studio.executors import ThreadExecutor
    from vinefab.studio.searches import SearchManager

TIP = "tip"
"""Request of a dragged tip; it is answered in the thread that follows the pointer."""

_EMPTY: Mapping[str, Any] = {
    "design": None,
    "map": None,
    "pose": None,
    "recipe": None,
    "task": "coverage",
    "family": {"environment": "grid", "count": 40, "seed": 1000},
    "growth": {},
    "locks": [],
}
"""A state without anything open."""

_PAUSE_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchOptions:
    """Options of the command line."""

    design: str = "grid_explorer"
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
        self._searches: SearchManager | None = None
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
        """Return the answer to a request about files, searches or a dragged tip.

        Raises
        ------
        VinefabError
            If something on the page cannot be used.
        """
        if name in FILE_REQUESTS:
            return FILE_REQUESTS[name](self.files, ask)
        if name.startswith("search_"):
            # The room of searches takes a second to load, and most pages are opened without one.
            from vinefab.studio.searches import SEARCH_REQUESTS, SearchManager  # noqa: PLC0415

            self.files.check_paths(state)
            if name not in SEARCH_REQUESTS:
                raise BadInputError("request", name, f"one of {', '.join(SEARCH_REQUESTS)}", PAGE)
            with self._lock:
                if self._searches is None:
                    self._searches = SearchManager(self.files.roots, self._options.folder)
            return SEARCH_REQUESTS[name](self._searches, state, ask)
        if name == TIP:
            from vinefab.studio.live_answers import tip_answer  # noqa: PLC0415  with the simulator

            self.files.check_paths(state)
            return tip_answer(StudioState.of(state), ask)
        raise BadInputError("request", name, f"one of {', '.join((*FILE_REQUESTS, TIP))}", PAGE)

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
            from vinefab.studio.live_answers import compile_kernel  # noqa: PLC0415  the simulator

            if await compile_kernel():
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
            from vinefab.studio.snapshot import stored_state  # noqa: PLC0415  few open one

            state = stored_state(Path(options.design))
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
                "family": {"environment": options.environment, "count": 40, "seed": 1000},
            }
        return {
            "version": __version__,
            "started": self._started,
            "folder": str(options.folder),
            "environments": list(ENVIRONMENTS),
            "form": design_form(),
            "growth_form": growth_form(),
            "legend": legend_rows(),
            "state": {**_EMPTY, **state},
            "file": file,
        }
