"""``vinefab reproduce``: the paper's experiments."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from vinefab.cli.options import CommandOutput, Quiet
from vinefab.studies.reproduction import NUMBERS, PAGE, reproduce
from vinefab.studies.study_sizes import PAPER, QUICK


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("reproduce")(reproduce_command)


def reproduce_command(
    *,
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME...",
            help="transfer, convergence, maps, weighting, reach, anchor, search, ablation, price, "
            "or all.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="The folder; a stopped run goes on in it.")],
    quick: Annotated[bool, typer.Option("--quick", help="A smoke run of a few seconds.")] = False,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Processes.")] = 2,
    quiet: Quiet = False,
) -> int:
    """Do the paper's experiments again and put our numbers beside the paper's.

    Example: vinefab reproduce all --out reproduction

    Finished parts are kept in the folder and not done again; no number depends on how many
    processes work or on how often the run was stopped. The exit code is 0 whether the paper's
    claims hold or not.
    """
    voice = CommandOutput(quiet=quiet)
    size = QUICK if quick else PAPER
    with voice.progress("reproduce") as show:
        done = reproduce(names, out, size, workers=workers, tell=show, announce=voice.say)
    table = Table("experiment", "verdict", "claim", "difference [95 %]", "p")
    for finding in done.findings:
        for claim in finding.claims:
            table.add_row(finding.name, *claim.cells()[:4])
    voice.show(table)
    held, claims = done.held
    voice.say(f"{held} of {claims} claims hold; {done.spent_s:.0f} s of work in this session")
    voice.say(f"read this first: {out / PAGE}")
    voice.say(f"        numbers: {out / NUMBERS}")
    return 0
