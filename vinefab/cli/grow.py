"""``vinefab grow``: one deployment."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.options import DesignIn, Force, JsonOut, PoseIn, Quiet, Voice, pose_from
from vinefab.core.atomic import ensure_writable, write_bytes
from vinefab.export.deployment_json import deployment_text
from vinefab.files.design import read_design
from vinefab.files.map import read_map
from vinefab.pipeline.grow import deploy, growth_options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("grow")(grow_command)


def grow_command(
    *,
    design: DesignIn,
    map_file: Annotated[Path, typer.Option("--map", help="The map file.")],
    pose: PoseIn = None,
    body: Annotated[str, typer.Option(help="centerline or inflated.")] = "centerline",
    head_on_half_angle_deg: Annotated[
        float, typer.Option(help="Contacts closer to head-on than this stop a tip (assumed).")
    ] = 1.0,
    children_of_stuck: Annotated[
        str, typer.Option(help="stop: they never emerge; deploy: they grow from there.")
    ] = "stop",
    json_out: JsonOut = None,
    svg: Annotated[Path | None, typer.Option("--svg", help="A picture (SVG, or PNG).")] = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Deploy a design on a map and say where every branch ended.

    Example: vinefab grow three_level_tree --map grid.geojson --svg grown.svg
    """
    voice = Voice(quiet=quiet, json_out=json_out, force=force)
    if svg:
        ensure_writable(svg, force=force)
    options = growth_options(body, head_on_half_angle_deg, children_of_stuck)
    result = deploy(read_design(design), read_map(map_file), pose_from(pose), options)
    voice.give_json(
        deployment_text(result.deployment, result.design.name, result.world.name, result.metrics)
    )
    if svg:
        write_bytes(svg, result.picture(svg.suffix), force=force)
    for line in result.summary():
        voice.say(line)
    if svg:
        voice.say(f"wrote {svg}")
