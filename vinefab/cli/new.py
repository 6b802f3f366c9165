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
    "map": "vinefab map info {0}, or: vinefab grow three_level_tree --map {0} --svg grown.svg",
}


def new_command(
    *,
    kind: Annotated[str, typer.Argument(help="design, run, map or recipe.")],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")],
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Write a commented design, run file, map or recipe to begin with; its name is the file's.

    Example: vinefab new design mine.toml

    Example: vinefab new map table.geojson
    """
    output = CommandOutput(quiet=quiet, force=force)
    name = write_starter(kind, out, force=force)
    said = "" if name == out.stem else f", named {name}"
    output.say(f"wrote {out}{said}")
    output.say(f"next: {NEXT_STEPS[kind].format(out)}")
    return 0
