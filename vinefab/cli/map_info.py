"""``vinefab map info``: what can be said of a map before anything grows on it."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.options import CommandOutput, Force, JsonOut, Quiet, ensure_kind
from vinefab.core.atomic import write_bytes
from vinefab.model.files.map_geojson import read_map
from vinefab.prediction.map_info import info_lines, info_text, map_info


def add_to(maps: typer.Typer) -> None:
    """Add the command to those of ``map``."""
    maps.command("info")(info_command)


def info_command(
    *,
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map file.")],
    width_mm: Annotated[
        float | None, typer.Option("--width-mm", help="Lay-flat width of a body to look at.")
    ] = None,
    passages: Annotated[int, typer.Option(help="How many of the narrowest passages to find.")] = 5,
    json_out: JsonOut = None,
    svg: Annotated[Path | None, typer.Option("--svg", help="A picture (SVG, or PNG).")] = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Say how large a map is, where it is narrow, and how wide a robot has room in it.

    Example: vinefab map info cave.geojson --width-mm 20 --svg cave.svg
    """
    voice = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    ensure_kind("--svg", svg, (".svg", ".png"), force=force)
    info = map_info(read_map(map_file), width_mm=width_mm, passages=passages)
    voice.give_json(info_text(info))
    if svg:
        write_bytes(svg, info.picture(svg.suffix), force=force)
    for line in info_lines(info):
        voice.say(line)
    if svg:
        voice.say(f"wrote {svg}")
