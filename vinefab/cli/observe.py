"""``vinefab observe``: a photo of a grown robot beside its prediction."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    CommandOutput,
    Force,
    GrowthIn,
    JsonOut,
    PoseIn,
    Quiet,
    ensure_apart,
    ensure_kind,
    growth_from,
    numbers_from,
    pose_from,
)
from vinefab.core.atomic import write_text
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map


def observe_command(
    *,
    photo: Annotated[Path, typer.Argument(help="A photo from above (JPEG or PNG).")],
    map_file: Annotated[Path, typer.Option("--map", help="The map file.")],
    design: Annotated[str, typer.Option("--design", help="A design file, or a shipped name.")],
    pose: PoseIn = None,
    rig: Annotated[
        Path | None,
        typer.Option("--rig", help="The rig's rig.json: where its markers lie, how high it is."),
    ] = None,
    corners: Annotated[
        str | None,
        typer.Option(
            help="Without markers: where the photo shows the corners of the bounds' box, in "
            "pixels: X,Y of lower left, lower right, upper right, upper left."
        ),
    ] = None,
    obstacle_height: Annotated[
        float | None, typer.Option(help="Height of the obstacles in mm; they hide what is behind.")
    ] = None,
    film_colour: Annotated[
        str | None, typer.Option(help="R,G,B of the film, 0 to 255; default: as at the base.")
    ] = None,
    outline: Annotated[
        Path | None,
        typer.Option(help="The film outlined by hand: GeoJSON (map mm) or SVG (photo pixels)."),
    ] = None,
    growth: GrowthIn = None,
    out: Annotated[Path | None, typer.Option("--out", help="A page (HTML).")] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Trace a grown robot on a photo and put it beside the prediction.

    Example: vinefab observe photo.jpg --map grid.geojson --design grid_explorer --rig rig/rig.json
    --out seen.html --json seen.json
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    ensure_kind("--out", out, (".html",), force=force)
    if out is not None:
        ensure_apart("--out", out, photo, "the photo")
    output.ensure_json()
    given = growth_from(growth)
    # OpenCV's and scipy's parts take a moment, which `vinefab observe --help` does not need.
    from vinefab.observation.observation_json import observation_text  # noqa: PLC0415
    from vinefab.observation.observation_page import observation_html  # noqa: PLC0415
    from vinefab.observation.observe_photo import observe_photo  # noqa: PLC0415
    from vinefab.observation.photo_setup import PhotoSetup  # noqa: PLC0415
    from vinefab.photos.photo import read_photo  # noqa: PLC0415
    from vinefab.prediction.deploy import first_start  # noqa: PLC0415

    setup = PhotoSetup.of(
        rig=rig,
        corners_px=None if corners is None else numbers_from("--corners", corners, 8),
        obstacle_mm=obstacle_height,
        film_colour=None if film_colour is None else numbers_from("--film-colour", film_colour, 3),
        outline=outline,
    )
    robot, world = read_design(design), read_map(map_file)
    start = pose_from(pose) or first_start(world)
    seen = observe_photo(
        read_photo(photo),
        world,
        robot,
        start,
        setup,
        growth=given,
        map_file=str(map_file),
        design_file=design,
    )
    output.give_json(observation_text(seen))
    if out is not None:
        write_text(out, observation_html(seen), force=force)
    for line in seen.lines():
        output.say(line)
    if out is not None:
        output.say(f"wrote {out}")
