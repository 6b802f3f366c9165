"""A rig of loose obstacles on a drilled board: printed with pegs, or cut in layers."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import agreeing, counted
from vinefab.core.validation import Floats
from vinefab.model.map import Map
from vinefab.rig.open_shell import cavities_in, corbelled, label_of, shell_wall_mm, shell_walls
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.rig_options import GRID_MM, MOST_PARTS, Printer, RigOptions
from vinefab.rig.rig_plan import (
    Polygons,
    RigPlan,
    plan_of,
    polygon_parts,
    snapped_union,
    without_slivers,
)
from vinefab.rig.solid import (
    Course,
    Pocket,
    built_of,
    engraved_marks,
    extra_parts,
    plan_volume_mm3,
)
from vinefab.rig.split import Cuts, cuts_of, grid_of

RIM_MM = 0.6
"""Least material around a peg or a pin's hole."""

WELD_MM = 0.1 * GRID_MM
"""Corners of shells nearer than this are joined: where courses cross, slivers would be left."""

_SMALLER = 0.6
_PEG_ROOT_MM = 1.0
_CIRCLE_SEGMENTS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Peg:
    """A round peg, or the hole for a pin."""

    # centre, in the coordinates of the plan
    x_mm: float
    y_mm: float
    diameter_mm: float

    @property
    def outline(self) -> Polygon:
        """The peg as a polygon of 24 corners."""
        circle = Point(self.x_mm, self.y_mm).buffer(
            0.5 * self.diameter_mm, quad_segs=_CIRCLE_SEGMENTS
        )
        return shapely.set_precision(circle, GRID_MM)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoosePiece:
    """A loose piece of obstacle or border."""

    number: int  # from 1
    outline: Polygon  # where it stands, in the coordinates of the plan
    pegs: tuple[Peg, ...]  # two against turning; fewer where there is no room


def loose_pieces(
    plan: RigPlan, cuts: Cuts, options: RigOptions, peg_mm: float, most: int
) -> tuple[LoosePiece, ...]:
    """Return all pieces of a plan, numbered from the lower left, row by row."""
    room_mm = max(np.diff(cuts.x_mm)), max(np.diff(cuts.y_mm))
    whole: list[Polygon] = []
    large: list[Polygon] = []
    for piece in plan.solids:
        x_min, y_min, x_max, y_max = piece.bounds
        fits = x_max - x_min <= room_mm[0] and y_max - y_min <= room_mm[1]
        (whole if fits else large).append(piece)
    pieces = polygon_parts(*whole, *_divided(large, cuts), Polygon())
    pieces, _ = without_slivers(pieces, options.sliver_mm)
    if len(pieces) > most:
        allowed = f"at most {most} loose pieces: --most-parts allows more, --style plate needs none"
        raise BadInputError("parts", len(pieces), allowed)
    middles = shapely.get_coordinates(shapely.centroid(pieces))
    order = np.lexsort((middles[:, 0], np.round(middles[:, 1] / 20.0)))
    return tuple(
        LoosePiece(number=number, outline=pieces[index], pegs=pegs_in(pieces[index], peg_mm))
        for number, index in enumerate(order.tolist(), 1)
    )


def pegs_in(outline: Polygon, peg_mm: float) -> tuple[Peg, ...]:
    """Return pegs that fit into an outline: the two places farthest apart, or the one with room."""
    for diameter_mm in (peg_mm, _SMALLER * peg_mm):
        reach_mm = 0.5 * diameter_mm + RIM_MM
        room = shapely.buffer(outline, -reach_mm, quad_segs=2)
        if room.is_empty:
            continue
        one, other, apart_mm = _farthest(room)
        if apart_mm >= 1.5 * diameter_mm:
            return _peg(one, diameter_mm), _peg(other, diameter_mm)
        middle = shapely.get_coordinates(shapely.maximum_inscribed_circle(outline, 0.05))[0]
        return (_peg(middle, diameter_mm),)
    return ()


def _peg(point: Floats, diameter_mm: float) -> Peg:
    x_mm, y_mm = np.round(point, 3).tolist()
    return Peg(x_mm=x_mm, y_mm=y_mm, diameter_mm=diameter_mm)


def _farthest(room: BaseGeometry) -> tuple[Floats, Floats, float]:
    """Return the two corners of a region that are farthest apart, and their distance."""
    corners = shapely.get_coordinates(shapely.convex_hull(room))
    away = np.hypot(*(corners[:, None] - corners[None]).transpose(2, 0, 1))
    one, other = np.unravel_index(int(away.argmax()), away.shape)
    return corners[one], corners[other], float(away[one, other])


def _divided(large: list[Polygon], cuts: Cuts) -> Iterator[Polygons]:
    """Yield what pieces too large for the bed leave in each cell of the cuts."""
    if not large:
        return
    for _, cell in cuts.cells():
        yield snapped_union(polygon_parts(*shapely.intersection(large, cell, grid_size=GRID_MM)))


PEG_RECESS_MM = 0.2
"""Pegs end this far above the board's underside, so that the board lies flat."""


def build_board(
    world: Map, printer: Printer, options: RigOptions, plan: RigPlan | None = None
) -> tuple[Rig, tuple[LoosePiece, ...]]:
    """Return a rig of loose obstacles, and the pieces that it is made of.

    The parts are printed top down, pegs upwards, so that nothing needs supports; the number is
    engraved into the top.
    ``plan`` is the map's plan for this printer, where that is known.
    """
    width_mm, depth_mm = (options.scale * side + 2.0 * options.border_mm for side in world.size_mm)
    # Only what stands on a cell of the bed's size is a part: the cells may be many more.
    many = options.changed(most_parts=MOST_PARTS)
    grid_of((width_mm, depth_mm), printer, many)
    plan = plan or plan_of(world, printer, options)
    cuts = cuts_of(plan.plate.bounds, plan.solids, printer, many)
    pieces = loose_pieces(plan, cuts, options, options.peg_mm, options.most_parts)
    job = options, shell_wall_mm(printer, options)
    parts = tuple(_part(piece, len(pieces), plan, job) for piece in pieces)
    counts = {f"{count} pegs": sum(len(one.pegs) == count for one in pieces) for count in (0, 1, 2)}
    rig = Rig(
        name=world.name,
        parts=parts,
        printer=printer,
        options=options,
        style="board",
        extras=extra_parts(plan.plate.bounds, plan.to_map(-options.plate_mm)),
        plate=plan.on_map(plan.plate),
        walls=plan.on_map(shapely.MultiPolygon(list(plan.solids))),
        thickened=plan.on_map(plan.thickened),
        thin_places=plan.thin_places,
        origin_mm=plan.origin_mm,
        counts={"pieces": len(pieces), "slivers": plan.slivers, "slits": plan.slits, **counts},
        notes=_notes(plan, counts, printer, options),
    )
    return rig, pieces


def _notes(
    plan: RigPlan, counts: dict[str, int], printer: Printer, options: RigOptions
) -> tuple[str, ...]:
    thin, least = len(plan.thin_places), printer.least_wall_mm
    bare, single = counts["0 pegs"], counts["1 pegs"]
    conditions = {
        f"{counted(bare, 'piece')} {agreeing(bare, 'has', 'have')} no room for a peg: glue them "
        "onto their mark": bare,
        f"{counted(single, 'piece')} {agreeing(single, 'has', 'have')} room for one peg only: "
        "turn them to their mark": single,
        f"{counted(thin, 'place')} {agreeing(thin, 'was', 'were')} thinner than the {least:g} mm "
        f"that {printer.name} makes and "
        f"{agreeing(thin, 'was', 'were')} "
        f"thickened to it: {plan.thickened.area:.0f} mm2 of wall added": thin,
        f"{counted(plan.slivers, 'piece')} thinner than {options.sliver_mm:g} mm "
        f"{agreeing(plan.slivers, 'was', 'were')} left out": plan.slivers,
        f"{counted(plan.slits, 'gap')} narrower than {options.sliver_mm:g} mm "
        f"{agreeing(plan.slits, 'was', 'were')} filled": plan.slits,
    }
    return plan.notes + tuple(text for text, holds in conditions.items() if holds)


def _part(piece: LoosePiece, count: int, plan: RigPlan, job: tuple[RigOptions, float]) -> RigPart:
    """Return a loose piece as it is printed: what will be its top lies on the bed."""
    options, wall_mm = job
    x_min, _, _, y_max = piece.outline.bounds
    courses, marks = courses_of(piece, options, wall_mm)

    def top_down(pieces: Polygons) -> Polygons:
        def flipped(points: Floats) -> Floats:
            return np.column_stack([points[:, 0] - x_min, y_max - points[:, 1]])

        return np.asarray(shapely.transform(pieces, flipped), dtype=object)

    depth_mm = _mark_depth_mm(options)
    pockets = [Pocket(pieces=top_down(marks), low_mm=-1.0, high_mm=depth_mm)] if len(marks) else []
    hollow = is_hollow(piece, wall_mm)
    vertices, faces = built_of(
        [replace(course, pieces=top_down(course.pieces)) for course in courses],
        pockets,
        weld_mm=WELD_MM if hollow else 0.0,
    )
    standing = np.diag([1.0, -1.0, -1.0, 1.0])
    standing[:3, 3] = x_min, y_max, options.height_mm
    return RigPart(
        name=f"piece_{piece.number:0{max(2, len(str(count)))}d}",
        number=piece.number,
        vertices_mm=vertices,
        faces=faces,
        to_map=plan.to_map() @ standing,
        volume_mm3=plan_volume_mm3(courses) - float(shapely.area(marks).sum()) * depth_mm,
        shell_wall_mm=wall_mm if hollow else 0.0,
    )


def is_hollow(piece: LoosePiece, wall_mm: float) -> bool:
    """Tell whether a piece has room for a cavity."""
    return wall_mm > 0.0 and len(cavities_in(piece.outline, wall_mm)) > 0


def courses_of(
    piece: LoosePiece, options: RigOptions, wall_mm: float
) -> tuple[list[Course], Polygons]:
    """Return what a piece is built of as printed, top down, and the grooves in its top.

    The top of a shell is open but for a tongue that bears the number; below each peg courses reach
    out from the walls, so that nothing needs supports.
    """
    outline, high_mm = piece.outline, options.height_mm
    walls = shell_walls(outline, wall_mm)
    hollow = len(walls.interiors) > len(outline.interiors)
    tongued = hollow and not options.top_mm
    tongue, marks = polygon_parts(Polygon()), polygon_parts(Polygon())
    if options.mark_depth_mm and tongued:
        tongue, marks = label_of(piece.number, outline, wall_mm)
    elif options.mark_depth_mm:
        marks = engraved_marks(piece.number, outline, from_below=False)
    pegs = [peg.outline for peg in piece.pegs]
    courses = [Course(pieces=polygon_parts(walls), low_mm=0.0, high_mm=high_mm)]
    if hollow:
        closed, thick_mm = (
            (tongue, 2.0 * options.mark_depth_mm)
            if tongued
            else (polygon_parts(outline), options.top_mm)
        )
        if len(closed):
            courses.append(Course(pieces=closed, low_mm=0.0, high_mm=thick_mm))
        courses += corbelled(walls, outline, pegs, high_mm, wall_mm)
    if pegs:
        # From the middle of what carries them: bodies that overlap join surely.
        peg_mm = options.plate_mm - PEG_RECESS_MM
        low_mm, up_mm = high_mm - _PEG_ROOT_MM, high_mm + peg_mm
        courses.append(Course(pieces=polygon_parts(*pegs), low_mm=low_mm, high_mm=up_mm))
    return courses, marks


def _mark_depth_mm(options: RigOptions) -> float:
    """Return how deep grooves are: at most half of a thin top."""
    half_mm = 0.5 * (options.top_mm or 2.0 * options.mark_depth_mm)
    return min(options.mark_depth_mm, half_mm)
