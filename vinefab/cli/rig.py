"""``vinefab rig``: printable obstacles."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.options import Force, Quiet, Voice
from vinefab.core.atomic import ensure_own_folder, new_folder, write_bytes
from vinefab.files.map import read_map
from vinefab.files.printer import read_printer
from vinefab.files.shipped import DEFAULT_PRINTER
from vinefab.pipeline.rig import make_rig
from vinefab.rig.options import RigOptions

MARK = "rig.json"
"""The file by which a folder of this command is known again."""


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("rig")(rig_command)


def rig_command(
    *,
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="The map file.")],
    out: Annotated[Path, typer.Option("--out", help="The folder to write.")],
    printer: Annotated[str, typer.Option(help="A printer file, or a shipped one's name.")] = (
        DEFAULT_PRINTER
    ),
    height_mm: Annotated[float, typer.Option(help="Height of the obstacles.")] = 30.0,
    scale: Annotated[float, typer.Option(help="Printed size over map size.")] = 1.0,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Write a map as printable solids: one STL per part, and rig.json with where each goes.

    Example: vinefab rig grid.geojson --printer generic_220 --out rig
    """
    voice = Voice(quiet=quiet, force=force)
    ensure_own_folder(out, MARK, force=force)
    options = RigOptions(height_mm=height_mm, scale=scale)
    made = make_rig(read_map(map_file), read_printer(printer), options)
    with new_folder(out, MARK, force=force) as folder:
        for name, data in made.files.items():
            write_bytes(folder / name, data)
    for line in made.summary():
        voice.say(line)
    voice.say(f"wrote {out}/ ({len(made.files)} files)")
