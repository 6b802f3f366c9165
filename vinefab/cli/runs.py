"""``vinefab runs``: list the records of runs, merge those of several seeds, rebuild files."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import EXIT_FINDINGS, CommandOutput, Force, JsonOut, Quiet
from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.prediction.run_page import EndedRun, write_run_page
from vinefab.search.run_pages import list_runs, rebuild, write_best


def runs_command(
    *,
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Runs' folders, or folders above them.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--rebuild", help="Write best.toml, page and figures of the run in DIR here."),
    ] = None,
    best: Annotated[
        Path | None,
        typer.Option(
            "--best",
            metavar="FILE",
            help="Write the best winner of runs that differ in their seed alone to this file; exit "
            "code 1 when some have not ended.",
        ),
    ] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """List the records of runs in folders and below, with mean and deviation over seeds.

    --rebuild writes files from a record alone.

    Example: vinefab runs . --json -
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    if out is not None and len(folders) > 1:
        raise BadInputError("--rebuild", counted(len(folders), "folder"), "one DIR")
    listing = list_runs(folders)
    if out is not None:
        run = EndedRun.read(folders[0])
        for path in (*rebuild(folders[0], out, force=force), write_run_page(out, run, force=force)):
            output.say(f"wrote {path}")
    for line in listing.summary:
        output.say(line)
    output.give_json(listing.json_text())
    whole = True
    if best is not None:
        whole = write_best(listing, best, force=force)
        output.say(f"wrote {best}{'' if whole else ', of the runs that have ended'}")
    return EXIT_FINDINGS if not whole or (listing.broken and not listing.rows) else 0
