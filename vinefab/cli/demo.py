"""``vinefab demo``: the main job at small size."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from vinefab.cli.common_options import EXIT_FINDINGS, CommandOutput, Force, Quiet
from vinefab.core.atomic import new_folder
from vinefab.demonstration import DemoSettings, run_demo

_MARK = "results.json"
"""The file by which a folder of this command is known again."""


def demo_command(
    *,
    out: Annotated[Path, typer.Option("--out", help="The folder to write.")] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another demonstration.")] = 1,
    generations: Annotated[int, typer.Option(min=1, help="Generations of the search.")] = 40,
    population: Annotated[int, typer.Option(min=2, help="Designs per generation.")] = 32,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Run the main job at small size: maps, optimization, unseen-map test, files, rig, report.

    Example: vinefab demo --out demo
    """
    output = CommandOutput(quiet=quiet, force=force)
    output.ensure_folder(out, _MARK)
    output.say("vinefab demo: sensor coverage in a Grid environment, a robot that can be cut")
    settings = DemoSettings(seed=seed, generations=generations, population=population)
    with output.progress("demo") as show, new_folder(out, _MARK, force=force) as folder:
        demo = run_demo(folder, settings, show, output.say)
    table = Table("result", "value", title=f"{demo.result.best.name}, run {demo.result.run_id}")
    for name, value in demo.table():
        table.add_row(name, value)
    output.show(table)
    for words, name in {
        "read this first": "report.html",
        "for the laser": "package/README.txt",
        "for the printer": "rig/rig.json",
        "the design": "run/best.toml",
        "numbers": "results.json",
    }.items():
        output.say(f"{words:>16}: {out / name}")
    return 0 if demo.is_manufacturable else EXIT_FINDINGS
