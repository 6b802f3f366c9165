"""``vinefab study reproduce``: the paper's experiments."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from vinefab.cli.common_options import CommandOutput, Quiet
from vinefab.studies.reproduction import NUMBERS, PAGE, reproduce
from vinefab.studies.study_jobs import PAPER_SIZE, QUICK_SIZE


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
    quick: Annotated[bool, typer.Option("--quick", help="A smoke run within a minute.")] = False,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Processes.")] = 2,
    quiet: Quiet = False,
) -> int:
    """Do the paper's experiments again and put our numbers beside the paper's.

    Example: vinefab study reproduce all --quick --out reproduction

    Finished parts are kept in the folder and not done again; no number depends on how many
    processes work or on how often the run was stopped. The exit code is 0 whether the paper's
    claims hold or not.
    """
    output = CommandOutput(quiet=quiet)
    size = QUICK_SIZE if quick else PAPER_SIZE
    with output.progress("reproduce") as show:
        done = reproduce(names, out, size, workers=workers, tell=show, announce=output.say)
    table = Table("experiment", "verdict", "kind", "claim", "difference [95 %]", "p")
    for finding in done.findings:
        for claim in finding.claims:
            table.add_row(finding.name, *claim.cells()[:5])
    output.show(table)
    held, claims = done.held
    output.say(
        f"{held} of {claims} claims of the paper hold; {done.spent_s:.0f} s of work in this session"
    )
    output.say(f"read this first: {out / PAGE}")
    output.say(f"        numbers: {out / NUMBERS}")
    return 0
