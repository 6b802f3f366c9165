"""What the server holds for all tabs: what the command opened, the files, the searches."""

import asyncio
import secrets
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.version import __version__
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.pages.plan_svg import legend_rows
from vinefab.studio.design_form import design_form, growth_form
from vinefab.studio.desk import DESK, Desk
from vinefab.studio.edited_map import PAGE
from vinefab.studio.state import StudioState

if TYPE_CHECKING:
    from vinefab.studio.lanes import ThreadLane
    from vinefab.studio.search_desk import SearchDesk

TellAll = Callable[[Mapping[str, Any]], None]
"""Sends an event to every tab."""

TIP = "tip"
"""What a drag of a tip asks; it is answered between the answers that follow the pointer."""


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

_SEARCH = "search_"
_PAUSE_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """What the command line asked for."""

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


class Workplace:
    """Files and searches of the folder that the command was started in.

    Raises
    ------
    VinefabError
        If what the command line asks for cannot be opened.
    """

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self._started = secrets.token_hex(8)
        self.desk = Desk(opened.folder, opened.named)
        self._searches: SearchDesk | None = None
        self._lock = Lock()
        self._first = self._read()
        StudioState.of(self._first["state"])

    @property
    def state(self) -> Mapping[str, Any]:
        """The state of what the command line asks for."""
        state: Mapping[str, Any] = self._first["state"]
        return state

    def hello(self) -> dict[str, Any]:
        """Return what a tab shows first: the files as they are now, or as they last could be."""
        try:
            self._first = self._read()
        except VinefabError as error:
            return {**self._first, "problem": str(error)}
        return self._first

    def answer(self, name: str, state: Mapping[str, Any], ask: Mapping[str, Any]) -> Any:  # noqa: ANN401  plain values
        """Return what a function of the desk gives.

        Raises
        ------
        VinefabError
            If something on the page cannot be used.
        """
        if name in DESK:
            return DESK[name](self.desk, ask)
        if name.startswith(_SEARCH):
            self.desk.check_paths(state)
            return self._ask_searches(name, state, ask)
        if name == TIP:
            from vinefab.studio.tip_answer import tip_answer  # noqa: PLC0415  with the simulator

            self.desk.check_paths(state)
            return tip_answer(StudioState.of(state), ask)
        raise BadInputError("desk", name, f"one of {', '.join((*DESK, TIP))}", PAGE)

    def _ask_searches(self, name: str, state: Mapping[str, Any], ask: Mapping[str, Any]) -> Any:  # noqa: ANN401  as above
        # The room of searches takes a second to load, and most pages are opened without one.
        from vinefab.studio.search_desk import SEARCH_DESK, SearchDesk  # noqa: PLC0415

        if name not in SEARCH_DESK:
            raise BadInputError("desk", name, f"one of {', '.join(SEARCH_DESK)}", PAGE)
        with self._lock:
            if self._searches is None:
                self._searches = SearchDesk(self.desk.roots, self._opened.folder)
        return SEARCH_DESK[name](self._searches, state, ask)

    def allowed(
        self, panel: str, state: Mapping[str, Any], ask: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """Return what a panel asks if every path in it lies where the user opened files."""
        self.desk.check_paths(state)
        if panel == "export":
            # A snapshot holds the state itself, whose paths have been looked at.
            return {**ask, "state": state, "roots": [str(root) for root in self.desk.roots]}
        return ask

    def background(self, tell: TellAll, live: "ThreadLane") -> list[Coroutine[Any, Any, None]]:
        """Return what goes on beside the answers: compiling, watching files and searches."""
        return [_compile(tell, live), self.desk.watch(tell), self._search_events(tell)]

    async def _search_events(self, tell: TellAll) -> None:
        while self._searches is None:
            await asyncio.sleep(_PAUSE_S)
        await self._searches.watch(tell)

    def close(self) -> None:
        """Stop the search that is running; it can be resumed."""
        if self._searches is not None:
            self._searches.close()

    def _read(self) -> dict[str, Any]:
        opened = self._opened
        state, file = self._snapshot() if opened.is_snapshot else self._files()
        return {
            "version": __version__,
            "started": self._started,
            "folder": str(opened.folder),
            "environments": list(ENVIRONMENTS),
            "form": design_form(),
            "growth_form": growth_form(),
            "legend": legend_rows(),
            "state": {**_EMPTY, **state},
            "file": file,
        }

    def _files(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the state of the files that were named, and the design's file."""
        opened = self._opened
        file = self.desk.open_design({"design": opened.design})
        of_run: dict[str, Any] = {k: file.pop(k) for k in ("task", "recipe") if k in file}
        source: dict[str, Any] = {"environment": opened.environment, "seed": opened.seed}
        if opened.map_file is not None:
            source = self.desk.open_map({"path": str(opened.map_file)})["source"]
        state: dict[str, Any] = {
            "design": file.pop("design"),
            "map": {"source": source, "edits": []},
            **of_run,
            **({"recipe": opened.recipe} if opened.recipe else {}),
            "family": {"environment": opened.environment, "count": 40, "seed": 1000},
        }
        return state, file

    def _snapshot(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the state that a snapshot was made of; its design has no file yet."""
        from vinefab.studio.snapshot import stored_state  # noqa: PLC0415  few open one

        state = stored_state(Path(self._opened.design))
        name = state["design"]["name"]
        return state, {"path": name, "name": name, "writable": False, "stamp": ""}


async def _compile(tell: TellAll, live: "ThreadLane") -> None:
    """Compile the simulator once the first picture is there, and tell the tabs."""
    await live.answered.wait()
    from vinefab.studio.warming import warm  # noqa: PLC0415  it loads the simulator

    if await warm():
        tell({"event": "engine", "engine": "kernel"})
