"""``vinefab rig``: printable obstacles."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    EXIT_FINDINGS,
    CommandOutput,
    Force,
    Quiet,
    StartIn,
    numbers_from,
    started_maps,
)
from vinefab.core.atomic import write_folder
from vinefab.core.plain_text import counted
from vinefab.model.corner_marker import DEFAULT_MARKER_MM
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.model.files.shipped import DEFAULT_PRINTER
from vinefab.rig.make import RIG_MARK, RigRequest, make_rig
from vinefab.rig.rig_options import RigOptions, read_printer
from vinefab.rig.rig_plan import refuse_fine


def rig_command(
    *,
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="The map file.")],
    out: Annotated[Path, typer.Option("--out", help="The folder to write.")],
    start: StartIn = None,
    printer: Annotated[str, typer.Option(help="A printer file, or a shipped one's name.")] = (
        DEFAULT_PRINTER
    ),
    design: Annotated[
        str | None, typer.Option(help="The robot, to check corridors and heights for it.")
    ] = None,
    style: Annotated[
        str,
        typer.Option(
            help="plate: printed on a plate; board: printed loose, with pegs for a drilled board; "
            "auto: the quicker of these."
        ),
    ] = "auto",
    lid: Annotated[bool, typer.Option("--lid", help="Add a transparent lid (DXF).")] = False,
    height_mm: Annotated[float, typer.Option(help="Height of the obstacles.")] = 30.0,
    plate_mm: Annotated[float, typer.Option(help="Thickness of the base plate.")] = 3.0,
    border_mm: Annotated[float, typer.Option(help="Thickness of the wall around.")] = 4.0,
    wall_mm: Annotated[
        float | None,
        typer.Option(help="Walls of hollow obstacles; 0: solid; default: the printer's least."),
    ] = None,
    top_mm: Annotated[float, typer.Option(help="Top of loose obstacles; 0: open.")] = 0.0,
    entry_mm: Annotated[float, typer.Option(help="Width of the entry; 0: none.")] = 40.0,
    scale: Annotated[float, typer.Option(help="Printed size over map size.")] = 1.0,
    fit_mm: Annotated[
        float | None, typer.Option(help="Length of the rig's longer side; sets the scale.")
    ] = None,
    joint: Annotated[str, typer.Option(help="dovetail or none.")] = "dovetail",
    clearance_mm: Annotated[
        float | None, typer.Option(help="Gap around joints; default: the printer's.")
    ] = None,
    peg_mm: Annotated[float, typer.Option(help="Diameter of pegs.")] = 5.0,
    kerf_mm: Annotated[float, typer.Option(help="Width that the laser removes.")] = 0.2,
    sheet_mm: Annotated[str, typer.Option(help="WIDTH,DEPTH of the laser's sheets.")] = "1000,600",
    markers: Annotated[
        str | None,
        typer.Option(
            help="Corner markers for photos: print (tiles), paper (glued), engrave (into the "
            "board) or none; default: engrave where there is a board, else print."
        ),
    ] = None,
    marker_mm: Annotated[float, typer.Option(help="Side of a corner marker.")] = DEFAULT_MARKER_MM,
    base_start: Annotated[
        int | None,
        typer.Option(help="Which start gets a holder for the robot's base; 0: none."),
    ] = None,
    collar_mm: Annotated[
        float | None,
        typer.Option(help="Diameter of the base's tube; default: the design's collar or trunk."),
    ] = None,
    most_parts: Annotated[int, typer.Option(help="Refuse a rig of more parts.")] = 100,
    allow_empty: Annotated[
        bool, typer.Option("--allow-empty", help="Make a bare tray of a map without obstacles.")
    ] = False,
    pictures: Annotated[
        bool,
        typer.Option("--pictures/--no-pictures", help="Draw the plan and sheets; report.html."),
    ] = True,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Write a map as printable solids: an STL per part, a 3MF per bed, rig.json with all places.

    Example: vinefab rig grid.geojson --printer generic_220 --fit-mm 400 --out rig
    """
    output = CommandOutput(quiet=quiet, force=force)
    output.ensure_folder(out, RIG_MARK)
    (world,) = started_maps([read_map(map_file)], start)
    refuse_fine(world, map_file)
    sheet_width_mm, sheet_depth_mm = numbers_from("--sheet-mm", sheet_mm, 2)
    options = RigOptions(
        style=style,
        height_mm=height_mm,
        plate_mm=plate_mm,
        border_mm=border_mm,
        wall_mm=wall_mm,
        top_mm=top_mm,
        entry_width_mm=entry_mm,
        scale=scale,
        joint=joint,
        clearance_mm=clearance_mm,
        peg_mm=peg_mm,
        kerf_mm=kerf_mm,
        sheet_width_mm=sheet_width_mm,
        sheet_depth_mm=sheet_depth_mm,
        most_parts=most_parts,
        markers=markers,
        marker_mm=marker_mm,
        base_start=base_start,
        collar_mm=collar_mm,
    )
    if fit_mm is not None:
        options = options.fitted(world, fit_mm)
    robot = read_design(design) if design else None
    machine = read_printer(printer)
    request = RigRequest(design=robot, allow_empty=allow_empty, pictures=pictures, lid=lid)
    with output.progress("rig") as show:
        made = make_rig(world, machine, options, request, progress=show)
    if made.report.blocking:
        for line in made.report.summary:
            output.say(line)
        return EXIT_FINDINGS
    write_folder(out, made.files, RIG_MARK, force=force)
    for line in made.summary:
        output.say(line)
    output.say(f"wrote {out}/ ({counted(len(made.files), 'file')})")
    return 0
