"""``vinefab map``: generate, import or describe a map."""

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from vinefab.cli.common_options import (
    CommandOutput,
    Force,
    JsonOut,
    Quiet,
    StartIn,
    ensure_apart,
    ensure_kind,
    ensure_text_kind,
    numbers_from,
    started_maps,
    starts_from,
)
from vinefab.cli.main import MAP_SUFFIXES
from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.maps.generators.environments import ENVIRONMENTS, Environment
from vinefab.maps.generators.generated_map import option_fields
from vinefab.maps.importers.importers import import_map, import_suffixes
from vinefab.maps.importers.photo_options import PHOTO_SUFFIXES, PhotoOptions, points_from
from vinefab.maps.importers.source_drawing import ImportOptions
from vinefab.model.files.map_geojson import map_text, read_map
from vinefab.model.map import Map, Start
from vinefab.model.start_place import START_WAYS, area_notes, start_words
from vinefab.prediction.map_info import map_info, size_notes

OutFile = Annotated[Path, typer.Option("--out", help="The map file to write (GeoJSON).")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same map.")]


def map_group() -> typer.Typer:
    """Return ``map`` with one subcommand per environment, ``import``, ``start`` and ``info``."""
    ENVIRONMENTS.load_plugins()
    words = ["Generate or import a map.", "Example: vinefab map grid --seed 3 --out grid.geojson"]
    words += [f"Not loaded: {name} ({why})." for name, why in ENVIRONMENTS.broken.items()]
    maps = typer.Typer(help="\n\n".join(words), rich_markup_mode=None)
    for name, environment in ENVIRONMENTS.items():
        maps.command(name, help=_help(name, environment))(_generator(environment))
    maps.command("import")(import_command)
    maps.command("start")(start_command)
    maps.command("info")(info_command)
    return maps


def import_command(
    *,
    source: Annotated[Path, typer.Argument(help=f"A file: {', '.join(import_suffixes())}.")],
    out: OutFile,
    scale_mm_per_unit: Annotated[
        float | None,
        typer.Option(
            help="Millimetres of the map per unit of the source, instead of the unit that the "
            "file names; ROS: per metre, default 1000; photo: per pixel; nothing named: mm."
        ),
    ] = None,
    simplify_mm: Annotated[
        float | None,
        typer.Option(
            help="Largest deviation of a wall; default: curves within 1/10000 of the drawing's "
            "larger side and every corner kept; ROS and photos: one cell."
        ),
    ] = None,
    join_mm: Annotated[
        float | None,
        typer.Option(
            help="Widest gap that is closed, in outlines and between obstacles; default: 1/5000 "
            "of the drawing's larger side."
        ),
    ] = None,
    layer: Annotated[
        list[str] | None,
        typer.Option(
            help="Read only this layer (DXF, GeoPackage) or group (SVG: id or label); repeatable."
        ),
    ] = None,
    drawn: Annotated[
        str | None,
        typer.Option(
            help="What the areas of a drawing are: obstacles (in bounds), or free: their union is "
            "the free space and its holes are obstacles; default: guessed, and said."
        ),
    ] = None,
    bounds: Annotated[
        str | None,
        typer.Option(
            help="outline: the largest outline, which must contain all others (default); largest: "
            "the same, cut off what is outside; wall: its inside is solid and outlines in it are "
            "rooms; box: a rectangle around everything."
        ),
    ] = None,
    margin_mm: Annotated[
        float | None,
        typer.Option(help="Around the drawing for --bounds box; default: 1/20 of its larger side."),
    ] = None,
    wall_mm: Annotated[
        float | None, typer.Option(help="Lines are the middle of walls of this thickness.")
    ] = None,
    open_lines: Annotated[
        str | None,
        typer.Option("--open", help="Lines that enclose nothing: refuse (default) or drop."),
    ] = None,
    unknown: Annotated[
        str | None, typer.Option(help="ROS: unseen cells are obstacle (default) or free.")
    ] = None,
    least_obstacle_mm2: Annotated[
        float | None,
        typer.Option(
            help="ROS and photos: leave out obstacles smaller than this, as noise; default: none, "
            "of a photo 1/20000 of its area."
        ),
    ] = None,
    start: StartIn = None,
    points: Annotated[
        str | None,
        typer.Option(
            help="Photo: places in it as 'X,Y;X,Y' in pixels: two with --distance-mm, or the four "
            "corners of a rectangle with --rectangle-mm, lower left first, counter-clockwise."
        ),
    ] = None,
    distance_mm: Annotated[
        float | None, typer.Option(help="Photo: between the two --points.")
    ] = None,
    rectangle_mm: Annotated[
        str | None, typer.Option(help="Photo: WIDTH,HEIGHT of the rectangle of four --points.")
    ] = None,
    marker_mm: Annotated[
        float | None,
        typer.Option(
            help="Photo: side of its ArUco markers (4x4_50); one or more, lying anywhere."
        ),
    ] = None,
    height_mm: Annotated[
        float, typer.Option(help="Photo: height of obstacles above the points or markers.")
    ] = 0.0,
    obstacles: Annotated[
        str,
        typer.Option(help="Photo: obstacles are dark, light or a colour R,G,B[,TOLERANCE]."),
    ] = "dark",
    threshold: Annotated[
        float | None,
        typer.Option(
            help="Photo: brightness between floor and obstacles, 0 to 255; default: found."
        ),
    ] = None,
    crop: Annotated[
        str | None, typer.Option(help="Photo: import only LEFT,LOW,RIGHT,TOP, mm of the map.")
    ] = None,
    preview: Annotated[
        Path | None,
        typer.Option(help="Photo: a picture of it, rectified, with the walls drawn over (PNG)."),
    ] = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Import a map from a file of another program, or from a photo.

    Everything that was repaired or left out is counted and printed. Without --start, robots start
    at the roomiest place.

    Example: vinefab map import examples/imports/cave.dxf --drawn free --out plan.geojson

    Example: vinefab map import examples/arena/table.jpg --marker-mm 30 --height-mm 30
    --obstacles 50,84,176,75 --crop 42,42,642,442 --out arena.geojson
    """
    ensure_apart("--out", out, source, "the one to import")
    ensure_text_kind("--out", out, MAP_SUFFIXES, force=force)
    if preview:
        ensure_kind("--preview", preview, (".png",), force=force)
        ensure_apart("--preview", preview, source, "the one to import")
    photo = PhotoOptions(
        points_px=points_from("--points", points) if points else (),
        distance_mm=distance_mm,
        rectangle_mm=cast("Any", rectangle_mm and numbers_from("--rectangle-mm", rectangle_mm, 2)),
        marker_mm=marker_mm,
        height_mm=height_mm,
        obstacles=obstacles,
        threshold=threshold,
        crop_mm=cast("Any", crop and numbers_from("--crop", crop, 4)),
    )
    starts = starts_from(start)
    options = ImportOptions(
        scale_mm_per_unit=scale_mm_per_unit,
        simplify_mm=simplify_mm,
        unknown=unknown,
        least_obstacle_mm2=least_obstacle_mm2,
        start=next((one.pose for one in starts if isinstance(one, Start)), None),
        join_mm=join_mm,
        layers=tuple(layer or ()),
        drawn=cast("Any", drawn),
        bounds=cast("Any", bounds),
        margin_mm=margin_mm,
        wall_mm=wall_mm,
        open_lines=cast("Any", open_lines),
        photo=photo,
    )
    output = CommandOutput(quiet=quiet, force=force)
    if preview is None:
        (world,) = started_maps([import_map(source, options)], start)
        _save(world, out, output)
        return
    if source.suffix.lower() not in PHOTO_SUFFIXES:
        allowed = f"only for photos and scans ({', '.join(PHOTO_SUFFIXES)})"
        raise BadInputError("--preview", str(preview), allowed, source)
    (world,), picture = _previewed(source, options, start)
    _save(world, out, output)
    write_bytes(preview, picture, force=force)
    output.say(f"wrote {preview}")


def _previewed(
    source: Path, options: ImportOptions, start: list[str] | None
) -> tuple[tuple[Map, ...], bytes]:
    """Return the map in a photo, and the photo with the map's walls drawn over it."""
    from vinefab.maps.importers.photo_map import read_photo_map  # noqa: PLC0415  loads scipy.optimize
    from vinefab.pages.page_png import page_png  # noqa: PLC0415
    from vinefab.pages.photo_preview import photo_preview  # noqa: PLC0415

    imported = read_photo_map(source, options)
    return started_maps([imported.world], start), page_png(photo_preview(imported))


def start_command(
    *,
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map file.")],
    out: OutFile,
    start: StartIn = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Give a map other starts: a pose, a side, a line or an area, each with a range of headings.

    Poses are drawn evenly from what of a line or area is free and 15 mm from walls (clear MM).

    Example: vinefab map start grid.geojson --start "left side, heading 0+-20" --out left.geojson

    Example: vinefab map start grid.geojson --start "area 0,0 50,480, clear 20" --out area.geojson
    """
    if not start:
        raise BadInputError("--start", None, START_WAYS)
    ensure_text_kind("--out", out, MAP_SUFFIXES, force=force)
    (world,) = started_maps([read_map(map_file)], start)
    _save(world, out, CommandOutput(quiet=quiet, force=force), facts=False)


def info_command(
    *,
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map file.")],
    width_mm: Annotated[
        float | None, typer.Option("--width-mm", help="Lay-flat width of a body to check.")
    ] = None,
    start: StartIn = None,
    passages: Annotated[int, typer.Option(help="How many of the narrowest passages to find.")] = 5,
    json_out: JsonOut = None,
    svg: Annotated[Path | None, typer.Option("--svg", help="A picture (SVG, or PNG).")] = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Describe a map: its size, its narrowest passages, and the widest robot that fits.

    Example: vinefab map info cave.geojson --width-mm 20 --svg cave.svg
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    ensure_kind("--svg", svg, (".svg", ".png"), force=force)
    (world,) = started_maps([read_map(map_file)], start)
    info = map_info(world, width_mm=width_mm, passages=passages)
    output.give_json(info.json_text())
    if svg:
        write_bytes(svg, info.picture(svg.suffix), force=force)
    for line in info.summary:
        output.say(line)
    if svg:
        output.say(f"wrote {svg}")


def _save(world: Map, out: Path, output: CommandOutput, *, facts: bool = True) -> None:
    """Write a map and say what it is; `facts` says too how it was made."""
    write_text(out, map_text(world), force=output.force)
    width_mm, height_mm = world.size_mm
    output.say(
        f"{world.name}: {_rounded(width_mm)} x {_rounded(height_mm)} mm, "
        f"{counted(len(world.obstacles), 'obstacle')}, {counted(world.wall_count, 'wall')}, "
        f"free area {world.free_space.area / 1e6:.4g} m2"
    )
    for start in world.starts if any(one.area for one in world.starts) else world.starts[:1]:
        output.say(f"start: {start_words(start)}")
    for note in [*size_notes(world), *area_notes([world])]:
        output.say(f"note: {note}")
    for key, value in world.facts.items() if facts else ():
        if value is not None:
            output.say(f"  {key}: {value:.6g}" if isinstance(value, float) else f"  {key}: {value}")
    output.say(f"wrote {out}")


def _rounded(side_mm: float) -> str:
    """Return a side of a map in whole millimetres, or three digits of a small one."""
    return f"{side_mm:.0f}" if side_mm >= 100.0 else f"{side_mm:.3g}"


def _generator(environment: Environment) -> Callable[..., None]:
    """Return a command whose options are the fields of an environment's options class."""
    known = {field.name: field for field in option_fields(environment.options)}

    def generate(**given: Any) -> None:  # noqa: ANN401  one value per option, of its own type
        out, output = given["out"], CommandOutput(quiet=given["quiet"], force=given["force"])
        ensure_text_kind("--out", out, MAP_SUFFIXES, force=output.force)
        options = environment.options(**{name: given[name] for name in known})
        made = environment.make(given["seed"], options)
        _save(started_maps([made], given["start"])[0], out, output)

    described = parameter_words(environment.options)
    parameters = [_parameter("out", OutFile), _parameter("seed", Seed, default=0)]
    for name, field in known.items():
        option = typer.Option(*_flags(name), help=described.get(name, "").replace("``", ""))
        parameters.append(
            _parameter(name, Annotated[type(field.default), option], default=field.default)
        )
    parameters += [
        _parameter("start", StartIn, default=None),
        _parameter("quiet", Quiet, default=False),
        _parameter("force", Force, default=False),
    ]
    generate.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    generate.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return generate


def _parameter(
    name: str, kind: object, *, default: object = inspect.Parameter.empty
) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def _flags(name: str) -> tuple[str, ...]:
    """Return ``--size-mm`` and, where a unit ends the name, the short ``--size`` too."""
    flag = f"--{name.replace('_', '-')}"
    short = re.sub(r"-(mm|deg)$", "", flag)
    return (flag,) if short == flag else (flag, short)


def _help(name: str, environment: Environment) -> str:
    what = environment.description
    return f"Generate a map: {what}.\n\nExample: vinefab map {name} --seed 3 --out {name}.geojson"


def parameter_words(options: type) -> dict[str, str]:
    """Return what the docstrings of a class and its bases say of each parameter, by name."""
    found: dict[str, str] = {}
    for kind in reversed(options.__mro__):
        text = inspect.getdoc(kind) or ""
        block = re.search(r"Parameters\n-+\n(.*?)(?:\n\n[A-Z]\w+\n-+\n|\Z)", text, re.DOTALL)
        for names, words in re.findall(
            r"^(\w[\w, ]*)\n((?:[ \t]+.*\n?|\n)+)", block.group(1) if block else "", re.MULTILINE
        ):
            found |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return found
