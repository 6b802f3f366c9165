"""``vinefab runs``: list the records of runs, and rebuild files from one."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import EXIT_FINDINGS, CommandOutput, Force, JsonOut, Quiet
from vinefab.prediction.run_page import EndedRun, write_run_page
from vinefab.search.run_pages import list_runs, rebuild, run_line


def runs_command(
    *,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run's folder, or one above.")],
    out: Annotated[
        Path | None,
        typer.Option("--rebuild", help="Write best.toml, page and figures of the run in DIR here."),
    ] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """List the records of runs in a folder and below; --rebuild writes files from a record alone.

    Example: vinefab runs . --json -
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    listing = list_runs(folder)
    if out is not None:
        run = EndedRun.read(folder)
        for path in (*rebuild(folder, out, force=force), write_run_page(out, run, force=force)):
            output.say(f"wrote {path}")
    for row in listing.rows:
        output.say(run_line(row))
    for line in listing.broken:
        output.say(f"unreadable: {line}")
    output.give_json(listing.json())
    return EXIT_FINDINGS if listing.broken and not listing.rows else 0
