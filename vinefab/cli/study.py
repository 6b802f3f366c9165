"""``vinefab study``: commands for those who study vinefab itself, under one roof."""

import typer

from vinefab.cli.bench import bench_command
from vinefab.cli.contest import contest_command
from vinefab.cli.reproduce import reproduce_command


def study_group() -> typer.Typer:
    """Return ``study`` with its subcommands."""
    words = [
        "Compare optimizers, do the paper's experiments again, or measure the simulator's speed.",
        "Example: vinefab study reproduce transfer --quick --out transfer",
    ]
    study = typer.Typer(help="\n\n".join(words), rich_markup_mode=None)
    study.command("contest")(contest_command)
    study.command("reproduce")(reproduce_command)
    study.command("bench")(bench_command)
    return study
