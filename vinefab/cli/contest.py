"""``vinefab study contest``: optimizers against each other."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, JsonOut, Quiet, parameters_from
from vinefab.core.atomic import write_bytes, write_text
from vinefab.search.optimizers.shipped_optimizers import make_optimizer_config
from vinefab.search.settings import PartSettings, read_run
from vinefab.studies.optimizer_contest import (
    Contender,
    Contest,
    comparison_json,
    comparison_svg,
    comparison_table,
    contest_rows,
    heading_lines,
    table_lines,
)


def contest_command(
    *,
    run_files: Annotated[
        list[Path],
        typer.Argument(metavar="RUN.toml...", help="The problems: run files, or shipped names."),
    ],
    optimizers: Annotated[
        list[str],
        typer.Option(
            "--optimizer", help="NAME or NAME:KEY=VALUE,...; repeated; the first is the reference."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for table, figure and record.")],
    seeds: Annotated[int, typer.Option(help="Runs of each optimizer on each problem.")] = 10,
    unseen: Annotated[int, typer.Option(help="Maps to test every winner on.")] = 25,
    poses: Annotated[int, typer.Option(help="Poses on each of these maps.")] = 3,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Compare optimizers on run files at equal evaluations; run again, it goes on where it was.

    Example: vinefab study contest examples/contest/grid.toml --optimizer cmaes --optimizer random
    --seeds 2 --unseen 5 --out contest
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    contest = Contest(
        problems=tuple(read_run(path) for path in run_files),
        contenders=tuple(_contender(text) for text in optimizers),
        seeds=seeds,
        unseen=unseen,
        poses=poses,
        sources=tuple(run_files),
    )
    with output.progress("comparing") as show:
        rows = contest_rows(contest, out / "bouts.jsonl", jobs=jobs, tell=show, force=force)
    document = comparison_json(contest, rows)
    write_text(out / "comparison.json", document, force=force)
    write_bytes(out / "comparison.svg", comparison_svg(contest, rows), force=force)
    output.give_json(document)
    for line in [*heading_lines(contest), *table_lines(comparison_table(contest, rows))]:
        output.say(line)
    output.say(f"wrote {out / 'comparison.json'} and {out / 'comparison.svg'}")


def _contender(text: str) -> Contender:
    name, _, rest = text.partition(":")
    parameters = parameters_from(rest.split(",") if rest else [])
    make_optimizer_config(name, parameters)
    return Contender(label=text, part=PartSettings(name=name, parameters=parameters))
