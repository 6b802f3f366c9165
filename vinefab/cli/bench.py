"""``vinefab study bench``: how fast growth and search are on this computer."""

from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, JsonOut, Quiet
from vinefab.studies.benchmark import bench_lines, run_benchmark


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

    Example: vinefab study bench --json bench.json
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    with output.progress("measuring") as progress:
        result = run_benchmark(progress, million=million)
    output.give_json(result.text())
    for line in bench_lines(result):
        output.say(line)
