"""What the server holds for all tabs: what the command opened, the files, the searches."""

from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vinefab.core.errors import BadInputError
from vinefab.core.version import __version__

if TYPE_CHECKING:
    from vinefab.studio.lanes import ThreadLane

TellAll = Callable[[Mapping[str, Any]], None]
"""Sends an event to every tab."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """What the command line asked for."""

    design: str = "grid_explorer"
    map_file: Path | None = None
    environment: str = "grid"
    seed: int = 3
    recipe: str = ""
    folder: Path = field(default_factory=Path.cwd)  # where the command was started


class Workplace:
    """Files and searches of the folder that the command was started in."""

    def __init__(self, opened: Opened) -> None:
        self._opened = opened

    def hello(self) -> dict[str, Any]:
        """Return what a tab shows first."""
        from vinefab.maps.generators.environments import ENVIRONMENTS  # noqa: PLC0415
        from vinefab.model.files.design_toml import design_content, read_design  # noqa: PLC0415

        opened = self._opened
        source = (
            {"file": str(opened.map_file)}
            if opened.map_file
            else {"environment": opened.environment, "seed": opened.seed}
        )
        design = read_design(opened.design)
        return {
            "version": __version__,
            "folder": str(opened.folder),
            "environments": list(ENVIRONMENTS),
            "state": {
                "design": design_content(design),
                "map": {"source": source, "edits": []},
                "pose": None,
                "recipe": opened.recipe or None,
                "task": "coverage",
                "family": {"environment": opened.environment, "count": 40, "seed": 1000},
                "growth": {},
                "locks": [],
            },
            "file": {"path": opened.design, "writable": False, "stamp": ""},
        }

    def answer(self, name: str, state: Mapping[str, Any], ask: Mapping[str, Any]) -> Any:  # noqa: ANN401
        """Return what a function of the desk gives."""
        from vinefab.studio.state import StudioState  # noqa: PLC0415  it loads the simulator
        from vinefab.studio.tip_answer import tip_answer  # noqa: PLC0415  as above

        if name == "tip":
            return tip_answer(StudioState.of(state), ask)
        raise BadInputError("desk", name, "a function of the desk", "the page")

    def allowed(
        self,
        panel: str,
        state: Mapping[str, Any],  # noqa: ARG002
        ask: Mapping[str, Any],
    ) -> Mapping[str, Any]:
        """Return what a panel asks if every path in it lies where the user opened files."""
        # Where exports may be written is not the page's to say.
        return {**ask, "roots": [str(self._opened.folder)]} if panel == "export" else ask

    def background(self, tell: TellAll, live: "ThreadLane") -> list[Coroutine[Any, Any, None]]:
        """Return what goes on beside the answers: compiling, watching files and searches."""
        return [_compile(tell, live)]

    def close(self) -> None:
        """End what is going on."""


async def _compile(tell: TellAll, live: "ThreadLane") -> None:
    """Compile the simulator once the first picture is there, and tell the tabs."""
    await live.answered.wait()
    from vinefab.studio.warming import warm  # noqa: PLC0415  it loads the simulator

    if await warm():
        tell({"event": "engine", "engine": "kernel"})
