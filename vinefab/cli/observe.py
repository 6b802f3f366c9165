"""``vinefab observe``: a photo of a grown robot beside its prediction."""

from collections.abc import Mapping, Sequence
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
from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map


def observe_command(
    *,
    photos: Annotated[
        list[Path],
        typer.Argument(
            metavar="PHOTO|JSON...",
            help="A photo from above (JPEG or PNG); with --fit the JSON of several observations.",
        ),
    ],
    map_file: Annotated[Path | None, typer.Option("--map", help="The map file.")] = None,
    design: Annotated[
        str | None, typer.Option("--design", help="A design file, or a shipped name.")
    ] = None,
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
    fit: Annotated[
        Path | None,
        typer.Option(
            "--fit",
            metavar="FILE",
            help="Write what several observations measured together (TOML): half-angle, friction "
            "of the tip, widths, each with its interval; --contacts of other commands reads it.",
        ),
    ] = None,
    angle_error_deg: Annotated[
        float | None,
        typer.Option(help="With --fit: standard error of angles that have none (assumed: 2)."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="A page (HTML).")] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Trace a grown robot on a photo beside its prediction, or fit several observations.

    Example: vinefab observe examples/arena/grown_1.jpg --map arena.geojson
    --design examples/arena/sprig.toml --pose 152,132,2 --obstacle-height 30 --json seen.json

    Example: vinefab observe seen.json --fit contacts.toml
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    if fit is not None:
        others: dict[str, object] = {
            "--map": map_file,
            "--design": design,
            "--pose": pose,
            "--rig": rig,
            "--corners": corners,
            "--obstacle-height": obstacle_height,
            "--film-colour": film_colour,
            "--outline": outline,
            "--growth": growth,
            "--out": out,
        }
        _fit_observations(photos, fit, angle_error_deg, others, output)
        return
    if angle_error_deg is not None:
        raise BadInputError("--angle-error-deg", angle_error_deg, "only together with --fit")
    photo, map_file, design = _one_photo(photos, map_file, design)
    ensure_kind("--out", out, (".html",), force=force)
    if out is not None:
        ensure_apart("--out", out, photo, "the photo")
    output.ensure_json()
    given = growth_from(growth)
    # OpenCV's and scipy's parts take a moment, which `vinefab observe --help` does not need.
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
    output.give_json(seen.json_text())
    if out is not None:
        write_text(out, seen.page(), force=force)
    for line in seen.summary:
        output.say(line)
    if out is not None:
        output.say(f"wrote {out}")


def _one_photo(
    photos: Sequence[Path], map_file: Path | None, design: str | None
) -> tuple[Path, Path, str]:
    """Return the photo with its map and design, all of which must be given."""
    if len(photos) != 1:
        allowed = "one photo; several observations (JSON) together with --fit FILE"
        raise BadInputError("PHOTO", counted(len(photos), "file"), allowed)
    if map_file is None:
        raise BadInputError("--map", None, "the map file of what the photo shows")
    if design is None:
        raise BadInputError("--design", None, "a design file, or a shipped name")
    return photos[0], map_file, design


def _fit_observations(
    observations: Sequence[Path],
    file: Path,
    angle_error_deg: float | None,
    others: Mapping[str, object],
    output: CommandOutput,
) -> None:
    """Write what several observations measured together."""
    for option, given in others.items():
        if given is not None:
            allowed = "not beside --fit: photo, map and design stand in each observation"
            raise BadInputError(option, str(given), allowed)
    ensure_kind("--fit", file, (".toml",), force=output.force)
    for path in observations:
        ensure_apart("--fit", file, path, "an observation")
    ensure_writable(file, force=output.force)
    output.ensure_json()
    from vinefab.observation.contact_fit import ANGLE_ERROR_DEG, fit_files  # noqa: PLC0415  as above

    error_deg = ANGLE_ERROR_DEG if angle_error_deg is None else angle_error_deg
    found = fit_files(observations, error_deg)
    write_text(file, found.text(), force=output.force)
    output.give_json(found.json_text())
    for line in found.lines():
        output.say(line)
    output.say(f"wrote {file}")
