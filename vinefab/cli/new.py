"""``vinefab new``: a file of your own to begin with."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, Quiet
from vinefab.model.files.starters import write_starter

NEXT_STEPS = {
    "design": "vinefab studio {0}, or edit it and: vinefab check {0}",
    "run": "vinefab optimize {0} --out run",
    "recipe": "vinefab coupon --recipe {0} --out coupons, then vinefab calibrate",
    "machine": 'put its numbers in; vinefab new recipe mine.toml beside it, with machine = "{1}"',
    "material": 'put its numbers in; vinefab new recipe mine.toml beside it, with material = "{1}"',
    "map": "vinefab map info {0}, or: vinefab grow three_level_tree --map {0} --svg grown.svg",
}


def new_command(
    *,
    kind: Annotated[
        str,
        typer.Argument(help="design, run, map, recipe, machine (a laser) or material (a film)."),
    ],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")],
    original: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="NAME", help="The shipped or own file to copy; default: a usual one."
        ),
    ] = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Write a commented file to begin with, as a design or a map; its name is the file's.

    Example: vinefab new design mine.toml

    Example: vinefab new map table.geojson
    """
    output = CommandOutput(quiet=quiet, force=force)
    name = write_starter(kind, out, original=original, force=force)
    said = "" if name == out.stem else f", named {name}"
    output.say(f"wrote {out}{said}")
    output.say(f"next: {NEXT_STEPS[kind].format(out, name)}")
    return 0
