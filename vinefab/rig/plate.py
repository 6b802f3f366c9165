"""Rigs on a printed plate: a map and a printer in, the parts out."""

import math

import numpy as np
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import agreeing, counted
from vinefab.core.validation import Floats
from vinefab.model.map import Map
from vinefab.rig.open_shell import hollowed, shell_wall_mm
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.rig_options import Printer, RigOptions
from vinefab.rig.rig_plan import RigPlan, plan_of, polygon_parts
from vinefab.rig.solid import Pocket, engraved_marks, extra_parts, stacked
from vinefab.rig.split import Cuts, Dovetails, RigTile, cuts_of, dovetails_of, grid_of, rig_tiles

_QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def build_rig(
    world: Map, printer: Printer, options: RigOptions | None = None, plan: RigPlan | None = None
) -> Rig:
    """Make the printable test rig of a map; ``plan`` is its plan where that is known.

    A base plate carries the obstacles, and a wall around the bounds with an opening where a start
    is near it (see `vinefab.rig.rig_plan`). What is larger than the bed is divided by straight cuts
    into tiles that dovetails in the plate hold together. Every part is one solid that prints
    without supports.

    Returns
    -------
    Rig
        ``counts`` hold ``slivers`` and ``slits`` (left out or filled), ``bridges`` (corners that
        touched in a point, joined), ``joints``, ``bare_seams`` (without room for a joint).
    """
    options = options or RigOptions()
    refuse_early(world, printer, options)
    plan = plan or plan_of(world, printer, options)
    cuts = cuts_of(plan.plate.bounds, plan.solids, printer, options)
    joints = Dovetails(joints=(), bare_seams=0)
    if options.joint == "dovetail":
        joints = dovetails_of(plan, cuts, options.gap_mm(printer))
    least_mm = options.sliver_mm, 0.5 * printer.nozzle_mm
    # A top would have to be bridged over nothing: with one, obstacles on plates stay filled.
    wall_mm = 0.0 if options.top_mm else shell_wall_mm(printer, options)
    tiles = list(rig_tiles(plan, cuts, joints, least_mm))
    parts = [
        _part(number, len(tiles), tile, (plan, cuts, options, wall_mm))
        for number, tile in enumerate(tiles, 1)
    ]
    return Rig(
        name=world.name,
        parts=tuple(part for part, _ in parts),
        printer=printer,
        options=options,
        extras=extra_parts(plan.plate.bounds, plan.to_map(-options.plate_mm)),
        plate=plan.on_map(plan.plate),
        walls=plan.on_map(shapely.MultiPolygon(list(plan.solids))),
        thickened=plan.on_map(plan.thickened),
        thin_places=plan.thin_places,
        origin_mm=plan.origin_mm,
        counts={
            "slivers": plan.slivers,
            "slits": plan.slits,
            "bridges": plan.bridges,
            "joints": len(joints.joints),
            "bare_seams": joints.bare_seams,
            "unmarked": sum(not marked for _, marked in parts) if options.mark_depth_mm else 0,
        },
        joint_gap_mm3=options.plate_mm * sum(joint.gap_mm2 for joint in joints.joints),
        notes=_notes(plan, joints, printer, options),
    )


def refuse_early(world: Map, printer: Printer, options: RigOptions) -> None:
    """Refuse, before any long work, what the sizes alone show to be impossible."""
    _check_height(printer, options)
    border_mm = 2.0 * options.border_mm
    width_mm, depth_mm = (options.scale * side_mm + border_mm for side_mm in world.size_mm)
    grid_of((width_mm, depth_mm), printer, options)


def _part(
    number: int, count: int, tile: RigTile, job: tuple[RigPlan, Cuts, RigOptions, float]
) -> tuple[RigPart, bool]:
    """Return a tile as a solid, and whether its number found room."""
    plan, cuts, options, wall_mm = job
    depth_mm = options.mark_depth_mm
    marks = engraved_marks(number, tile.plate) if depth_mm else polygon_parts(Polygon())
    low = np.array([*tile.plate.bounds[:2], 0.0])
    standing = hollowed(tile.solids, wall_mm)
    hollow = shapely.area(standing).sum() < shapely.area(tile.solids).sum()
    plate, solids, grooves = (
        shapely.transform(pieces, lambda points: points - low[:2])
        for pieces in (polygon_parts(tile.plate), standing, marks)
    )
    pockets = [Pocket(pieces=grooves, low_mm=-1.0, high_mm=depth_mm)] if len(marks) else []
    vertices, faces = stacked(plate, solids, options.plate_mm, options.height_mm, pockets)
    turn, shift = np.eye(3), np.zeros(3)
    if cuts.turned:
        turn, shift[0] = _QUARTER_TURN, tile.plate.bounds[3] - tile.plate.bounds[1]
        vertices = vertices @ turn.T + shift
        # The sum is rounded once more, to what the file can hold.
        vertices = vertices.astype(np.float32).astype(np.float64)
    row, column = tile.cell
    part = RigPart(
        name=f"part_{number:0{max(2, len(str(count)))}d}_r{row + 1}c{column + 1}",
        number=number,
        row=row + 1,
        column=column + 1,
        vertices_mm=vertices,
        faces=faces,
        to_map=plan.to_map(-options.plate_mm) @ _back(turn, low - turn.T @ shift),
        volume_mm3=float(
            tile.plate.area * options.plate_mm
            + shapely.area(standing).sum() * options.height_mm
            - shapely.area(marks).sum() * depth_mm
        ),
        shell_wall_mm=wall_mm if hollow else 0.0,
    )
    return part, len(marks) > 0


def _back(turn: Floats, low_mm: Floats) -> Floats:
    """Return the transform printed -> plan: turn back, move."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn.T
    matrix[:3, 3] = low_mm
    return matrix


def _check_height(printer: Printer, options: RigOptions) -> None:
    height_mm = options.plate_mm + options.height_mm
    if height_mm > printer.height_mm:
        most_mm = math.floor(10.0 * (printer.height_mm - options.plate_mm)) / 10.0
        raise BadInputError("height_mm", options.height_mm, f"at most {most_mm:g} mm")


def _notes(
    plan: RigPlan, joints: Dovetails, printer: Printer, options: RigOptions
) -> tuple[str, ...]:
    count, least = len(plan.thin_places), printer.least_wall_mm
    conditions = {
        f"{counted(count, 'place')} {agreeing(count, 'was', 'were')} thinner than the {least:g} "
        f"mm that {printer.name} prints and "
        f"{agreeing(count, 'was', 'were')} "
        f"thickened to it: {plan.thickened.area:.0f} mm2 of wall added": count,
        f"the border is thinner than the {least:g} mm that {printer.name} prints": (
            options.border_mm < least
        ),
        f"{counted(plan.slivers, 'piece')} thinner than {options.sliver_mm:g} mm "
        f"{agreeing(plan.slivers, 'was', 'were')} left out": plan.slivers,
        f"{counted(plan.slits, 'gap')} narrower than {options.sliver_mm:g} mm "
        f"{agreeing(plan.slits, 'was', 'were')} filled": plan.slits,
        f"{counted(plan.bridges, 'corner')} that touched in one point "
        f"{agreeing(plan.bridges, 'was', 'were')} joined": plan.bridges,
        f"{joints.bare_seams} seams have no room for a joint: glue them": joints.bare_seams,
    }
    return plan.notes + tuple(text for text, holds in conditions.items() if holds)
