"""A rig of loose obstacles on a board that a laser drills: printed with pegs, or cut in layers."""

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.model.map import Map
from vinefab.rig.clean import Pieces, pieces_of
from vinefab.rig.engraving import extras_of, marks_for
from vinefab.rig.loose import Loose, loose_of
from vinefab.rig.options import RigOptions
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.plan import RigPlan, plan_of
from vinefab.rig.printer import Printer
from vinefab.rig.solid import Hollow, stacked
from vinefab.rig.split import cuts_of, grid_of

PEG_SHORTER_MM = 0.2
"""Pegs end this far above the board's underside, so that it lies flat."""


def build_board(world: Map, printer: Printer, options: RigOptions) -> tuple[Rig, tuple[Loose, ...]]:
    """Return a rig of loose obstacles, and the pieces that it is made of.

    With style ``board`` the parts are printed top down, pegs upwards, so that nothing needs
    supports; the number is engraved into the top. With style ``sheet`` nothing is printed but
    what stands beside the rig: the pieces are cut in layers.
    """
    printed = options.style == "board"
    machine = printer if printed else laser_as_printer(options)
    width_mm, depth_mm = (options.scale * side + 2.0 * options.border_mm for side in world.size_mm)
    grid_of((width_mm, depth_mm), machine, options)
    plan = plan_of(world, machine, options)
    cuts = cuts_of(plan.plate.bounds, plan.solids, machine, options)
    pieces = loose_of(plan, cuts, options, options.peg_mm, options.most_parts)
    parts = tuple(_part(piece, len(pieces), plan, options) for piece in pieces) if printed else ()
    counts = {f"{count} pegs": sum(len(one.pegs) == count for one in pieces) for count in (0, 1, 2)}
    rig = Rig(
        name=world.name,
        parts=parts,
        printer=printer,
        options=options,
        style=options.style,
        extras=extras_of(plan.plate.bounds, plan.to_map(-options.plate_mm)),
        plate=plan.on_map(plan.plate),
        walls=plan.on_map(shapely.MultiPolygon(list(plan.solids))),
        thickened=plan.on_map(plan.thickened),
        thin_places=plan.thin_places,
        counts={"pieces": len(pieces), "slivers": plan.slivers, "slits": plan.slits, **counts},
        notes=_notes(plan, counts, machine, options),
    )
    return rig, pieces


def laser_as_printer(options: RigOptions) -> Printer:
    """Return the laser's sheet as a bed; walls below 1 mm char through (assumed)."""
    return Printer(
        name="the laser",
        bed_width_mm=options.sheet_width_mm,
        bed_depth_mm=options.sheet_depth_mm,
        height_mm=10_000.0,
        least_wall_mm=1.0,
    )


def _notes(
    plan: RigPlan, counts: dict[str, int], machine: Printer, options: RigOptions
) -> tuple[str, ...]:
    thin, least = len(plan.thin_places), machine.least_wall_mm
    bare, single = counts["0 pegs"], counts["1 pegs"]
    said = {
        f"{bare} pieces have no room for a peg: glue them onto their mark": bare,
        f"{single} pieces have room for one peg only: turn them to their mark": single,
        f"{thin} places were thinner than the {least:g} mm that {machine.name} makes and were "
        f"thickened to it: {plan.thickened.area:.0f} mm2 of wall added": thin,
        f"{plan.slivers} pieces thinner than {options.sliver_mm:g} mm were left out": plan.slivers,
        f"{plan.slits} gaps narrower than {options.sliver_mm:g} mm were filled": plan.slits,
    }
    return plan.notes + tuple(text for text, holds in said.items() if holds)


def _part(piece: Loose, count: int, plan: RigPlan, options: RigOptions) -> RigPart:
    outline, depth_mm = piece.outline, options.mark_depth_mm
    x_min, _, _, y_max = outline.bounds
    marks = marks_for(piece.number, outline, from_below=False)
    pegs = pieces_of(*(peg.outline for peg in piece.pegs), shapely.Polygon())
    peg_mm = options.plate_mm - PEG_SHORTER_MM

    def top_down(pieces: Pieces) -> Pieces:
        def flipped(points: Floats) -> Floats:
            return np.column_stack([points[:, 0] - x_min, y_max - points[:, 1]])

        return np.asarray(shapely.transform(pieces, flipped), dtype=object)

    hollows = []
    if depth_mm and len(marks):
        hollows = [Hollow(pieces=top_down(marks), low_mm=-1.0, high_mm=depth_mm)]
    vertices, faces = stacked(
        top_down(pieces_of(outline)), top_down(pegs), options.height_mm, peg_mm, hollows
    )
    standing = np.diag([1.0, -1.0, -1.0, 1.0])
    standing[:3, 3] = x_min, y_max, options.height_mm
    cut_mm3 = shapely.area(marks).sum() * depth_mm
    return RigPart(
        name=f"piece_{piece.number:0{max(2, len(str(count)))}d}",
        number=piece.number,
        vertices_mm=vertices,
        faces=faces,
        to_map=plan.to_map() @ standing,
        volume_mm3=float(
            outline.area * options.height_mm + shapely.area(pegs).sum() * peg_mm - cut_mm3
        ),
    )
