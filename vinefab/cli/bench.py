"""``vinefab bench``: how fast growth and search are on this computer."""

from typing import Annotated

import typer

from vinefab.cli.options import Force, JsonOut, Quiet, Voice
from vinefab.pipeline.bench import bench
from vinefab.pipeline.bench_text import bench_lines


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("bench")(bench_command)


def bench_command(
    *,
    million: Annotated[
        bool, typer.Option("--million", help="Grow on a map of a million walls too.")
    ] = False,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Measure growth against other ways to compute the same and its floor, and a search's time.

    Example: vinefab bench --json bench.json
    """
    voice = Voice(quiet=quiet, json_out=json_out, force=force)
    with voice.progress("measuring") as progress:
        result = bench(progress, million=million)
    voice.give_json(result.text())
    for line in bench_lines(result):
        voice.say(line)
