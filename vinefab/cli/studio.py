"""``vinefab studio``: the page in the browser."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vinefab.cli.common_options import CommandOutput, EnvironmentIn, Force, Quiet, ensure_kind
from vinefab.core.errors import BadInputError

if TYPE_CHECKING:
    from vinefab.studio.workplace import Opened

_PACKAGES = ("starlette", "tomlkit", "uvicorn", "watchfiles", "websockets")


def studio_command(
    *,
    design: Annotated[
        str, typer.Argument(help="A design file, or the name of a shipped design.")
    ] = "grid_explorer",
    map_file: Annotated[Path | None, typer.Option("--map", help="The map file.")] = None,
    environment: EnvironmentIn = None,
    recipe: Annotated[
        str | None, typer.Option(help="A recipe file, or a shipped one's name.")
    ] = None,
    port: Annotated[int, typer.Option(help="Where to listen; 0: any port that is free.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    snapshot: Annotated[
        Path | None,
        typer.Option(
            help="Serve nothing: write the page as it begins, with all that it shows, as one HTML "
            "file that needs no server. `vinefab studio FILE.html` opens it again."
        ),
    ] = None,
    family: Annotated[
        bool, typer.Option("--family", help="With --snapshot: the robot on many maps too.")
    ] = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Design with the robot under your hands: a page where every change is seen at once.

    Example: vinefab studio grid_explorer --environment cave

    Example: vinefab studio mine.toml --map table.geojson --snapshot state.html
    """
    _ensure_packages()
    from vinefab.studio.serve import serve  # noqa: PLC0415  its packages are an extra
    from vinefab.studio.workplace import Opened  # noqa: PLC0415  as above

    output = CommandOutput(quiet=quiet, force=force)
    opened = Opened(
        design=design, map_file=map_file, environment=environment or "grid", recipe=recipe or ""
    )
    if snapshot is None:
        if family:
            raise BadInputError("--family", family, "to be given together with --snapshot")
        serve(opened, port=port, browser=browser, say=output.say)
        return
    ensure_kind("--snapshot", snapshot, (".html",), force=force)
    _write_snapshot(opened, snapshot, output, family=family)


def _ensure_packages() -> None:
    missing = [name for name in _PACKAGES if find_spec(name) is None]
    if missing:
        allowed = "together with the packages of the studio: pip install 'vinefab[studio]'"
        raise BadInputError("vinefab studio", f"without {', '.join(missing)}", allowed)


def _write_snapshot(opened: "Opened", path: Path, output: CommandOutput, *, family: bool) -> None:
    from vinefab.studio.snapshot import SnapshotOptions, write_snapshot  # noqa: PLC0415  as above
    from vinefab.studio.workplace import Workplace  # noqa: PLC0415  as above

    workplace = Workplace(opened)
    options = SnapshotOptions(family=family, file=opened.design)
    with output.progress("snapshot") as show:
        write_snapshot(workplace.state, path, options, show, force=output.force)
    output.say(f"wrote {path}")
