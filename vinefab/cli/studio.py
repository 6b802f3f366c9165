"""``vinefab studio``: the page in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, EnvironmentIn, Quiet
from vinefab.core.errors import BadInputError

_PACKAGES = "the packages of the studio: pip install 'vinefab[studio]'"


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
    quiet: Quiet = False,
) -> None:
    """Design with the robot under your hands: a page where every change is seen at once.

    Example: vinefab studio grid_explorer --environment cave
    """
    try:
        from vinefab.studio.serve import serve  # noqa: PLC0415  an extra
    except ModuleNotFoundError as error:
        raise BadInputError("vinefab studio", f"no {error.name}", _PACKAGES) from error
    from vinefab.studio.workplace import Opened  # noqa: PLC0415  as above

    output = CommandOutput(quiet=quiet)
    opened = Opened(
        design=design, map_file=map_file, environment=environment or "grid", recipe=recipe or ""
    )
    serve(opened, port=port, browser=browser, say=output.say)
