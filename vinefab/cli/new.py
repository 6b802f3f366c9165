"""``vinefab new``: a file of your own to begin with."""

import re
from pathlib import Path
from typing import Annotated

import shapely
import typer

from vinefab.cli.common_options import CommandOutput, Force, Quiet
from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.errors import BadInputError, ForeignFileError, nearest
from vinefab.core.plain_text import one_line
from vinefab.core.units import rad
from vinefab.model.files.map_geojson import map_text
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate, read_text
from vinefab.model.files.toml import LARGEST_TOML_BYTES
from vinefab.model.map import Map, Pose, Start

STARTERS = {
    "design": ("design", "three_level_tree"),
    "run": ("run file", "grid_coverage"),
    "recipe": ("recipe", DEFAULT_RECIPE),
    "machine": ("machine", "co2_60w"),
    "material": ("material", "stretchlon_200"),
}
"""Kind and name of the shipped file that a new one is a copy of; a map is made here."""

CALLED_AS_FILES = ("recipe", "machine", "material")
"""Kinds that other files refer to by the file's name."""

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
    if kind not in NEXT_STEPS:
        raise BadInputError(
            "KIND", kind, f"one of {', '.join(NEXT_STEPS)}{nearest(kind, NEXT_STEPS)}"
        )
    if kind == "map" and original is not None:
        raise BadInputError(
            "--from", original, "not with a map: vinefab map makes and imports them"
        )
    suffix = ".geojson" if kind == "map" else ".toml"
    if out.suffix.lower() != suffix:
        raise BadInputError("FILE", str(out), f"a file name ending in {suffix}")
    if out.exists() and not force:  # it may hold a day of work, whoever wrote its first version
        raise ForeignFileError(out, "exists")
    if kind in CALLED_AS_FILES and _plain(out.stem) != out.stem:
        allowed = f"for a {kind} a file name of letters, digits, '_', '-' and '.'"
        raise BadInputError("FILE", str(out), allowed)
    ensure_writable(out, force=force)
    name = (one_line(out.stem) if kind == "map" else _plain(out.stem)) or kind
    if kind == "map":
        text = map_text(starter_map(name))
    else:
        text = _named_copy(kind, original or STARTERS[kind][1], name)
    write_text(out, text, force=force)
    said = "" if name == out.stem else f", named {name}"
    output.say(f"wrote {out}{said}")
    output.say(f"next: {NEXT_STEPS[kind].format(out, name)}")
    return 0


def starter_map(name: str) -> Map:
    """Return a table of 600 x 400 mm with three blocks and a start that is placed by hand."""
    blocks = (
        (150.0, 120.0, 230.0, 190.0),
        (300.0, 60.0, 360.0, 160.0),
        (380.0, 240.0, 470.0, 300.0),
    )
    pose = Pose(x_mm=30.0, y_mm=100.0, heading_rad=rad(20.0))
    start = Start(pose=pose, spread_x_mm=5.0, spread_y_mm=5.0, spread_heading_rad=rad(5.0))
    return Map(
        name=name,
        bounds=shapely.box(0.0, 0.0, 600.0, 400.0),
        obstacles=tuple(shapely.box(*block) for block in blocks),
        starts=(start,),
        environment="table",
    )


def _plain(stem: str) -> str:
    """Return the stem of a file as the name of a design, run or recipe may be."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", stem).lstrip("_.-")


def _named_copy(kind: str, original: str, name: str) -> str:
    """Return the text of a shipped or own file under another name."""
    path = locate(STARTERS[kind][0], original)
    text = read_text(path, LARGEST_TOML_BYTES)
    if not re.search(rf'(?m)^schema = "vinefab/{kind}-', text):
        raise BadInputError("schema", path.name, f"a file of the kind {kind}", path)
    top, table, rest = text.partition("\n[")  # a run file need not name itself, its parts do
    named = re.sub(r'(?m)^name = "[^"]*"', f'name = "{name}"', top, count=1) + table + rest
    return (
        f"# A copy of {one_line(original)} to change as you like, title and comments too.\n{named}"
    )
