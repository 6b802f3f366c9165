"""``vinefab grow``: one deployment."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    BodyIn,
    CommandOutput,
    ContactsIn,
    DesignIn,
    Force,
    GrowthIn,
    HalfAngleIn,
    JsonOut,
    PoseIn,
    Quiet,
    StartIn,
    ensure_kind,
    growth_choice,
    growth_from,
    pose_from,
    started_maps,
)
from vinefab.core.atomic import write_bytes
from vinefab.core.errors import BadInputError
from vinefab.core.validation import whole
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.prediction.deploy import (
    FRAMES,
    MOST_FRAMES,
    deploy,
    frames_of,
    fronts_from,
)


def grow_command(
    *,
    design: DesignIn,
    map_file: Annotated[Path, typer.Option("--map", help="The map file.")],
    pose: PoseIn = None,
    start: StartIn = None,
    growth: GrowthIn = None,
    body: BodyIn = None,
    head_on_half_angle_deg: HalfAngleIn = None,
    contacts: ContactsIn = None,
    children_of_stuck: Annotated[
        str | None, typer.Option(help="stop: they never emerge; deploy: they grow from there.")
    ] = None,
    json_out: JsonOut = None,
    svg: Annotated[Path | None, typer.Option("--svg", help="A picture (SVG, or PNG).")] = None,
    label: Annotated[
        bool, typer.Option("--label", help="Write branch ids in the picture.")
    ] = False,
    history: Annotated[
        str | None,
        typer.Option(
            help="Add to the JSON the shapes at these lengths of the growing front, L1,L2,... in "
            "mm along the body from the base; a whole number alone: so many equal steps."
        ),
    ] = None,
    animate: Annotated[
        Path | None, typer.Option(help="The deployment as a moving picture (SVG, or GIF).")
    ] = None,
    frames: Annotated[int, typer.Option(help="Frames of the moving picture.")] = FRAMES,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Deploy a design on a map and say where every branch ended.

    Example: vinefab grow three_level_tree --map grid.geojson --svg grown.svg --animate grows.gif
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    ensure_kind("--svg", svg, (".svg", ".png"), force=force)
    ensure_kind("--animate", animate, (".svg", ".gif"), force=force)
    if animate:
        whole("--frames", frames, 1, MOST_FRAMES)
    if history is not None and json_out is None:
        raise BadInputError("--history", history, "to be given together with --json")
    fronts = None if history is None else fronts_from(history)
    given = growth_from(
        growth,
        body=body,
        head_on_half_angle_deg=head_on_half_angle_deg,
        contacts=contacts,
        children_of_stuck=children_of_stuck,
    )
    if pose is not None and start:
        raise BadInputError("--pose", pose, "not beside --start")
    robot, here = read_design(design), pose_from(pose)
    growth_choice([design], [robot], given)
    (world,) = started_maps([read_map(map_file)], start)
    result = deploy(robot, world, here, given)
    output.give_json(result.text(None if fronts is None else frames_of(result.history, fronts)))
    if svg:
        write_bytes(svg, result.picture(svg.suffix, named=label), force=force)
    if animate:
        write_bytes(animate, result.animation(animate.suffix, frames), force=force)
    for line in result.summary():
        output.say(line)
    for path in filter(None, (svg, animate)):
        output.say(f"wrote {path}")
