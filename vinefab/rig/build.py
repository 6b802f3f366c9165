"""Rigs from maps: obstacles printed on the tiles of a plate, or loose ones with pegs on a board.

`compare_with_map` compares the assembled rig with the map that it stands for.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from manifold3d import Manifold
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import agreeing, counted
from vinefab.model.map import Map
from vinefab.rig.part import GRID_MM, MOST_PARTS, Printer, Rig, RigOptions, RigPart, manifold_of
from vinefab.rig.rig_plan import (
    Cuts,
    Dovetail,
    Polygons,
    RigPlan,
    RigTile,
    cuts_of,
    dovetails_of,
    grid_of,
    plan_of,
    polygon_parts,
    rig_tiles,
    snapped_union,
    without_slivers,
)
from vinefab.rig.solid import (
    Course,
    built_of,
    corbelled,
    engraved_marks,
    extra_parts,
    hollowed,
    number_marks,
    outlines_at,
    plan_volume_mm3,
    shell_wall_mm,
    shell_walls,
    stacked,
)

RIM_MM = 0.6
"""Least material around a peg or a pin's hole."""

WELD_MM = 0.1 * GRID_MM
"""Corners of shells nearer than this are joined: where courses cross, slivers would be left."""


PEG_RECESS_MM = 0.2
"""Pegs end this far above the board's underside, so that the board lies flat."""


def refuse_early(world: Map, printer: Printer, options: RigOptions) -> None:
    """Refuse, before any long work, what the sizes alone show to be impossible."""
    if options.plate_mm + options.height_mm > printer.height_mm:
        most_mm = math.floor(10.0 * (printer.height_mm - options.plate_mm)) / 10.0
        raise BadInputError("height_mm", options.height_mm, f"at most {most_mm:g} mm")
    grid_of(_plate_size_mm(world, options), printer, options)


def _plate_size_mm(world: Map, options: RigOptions) -> tuple[float, float]:
    width_mm, depth_mm = (options.scale * side + 2.0 * options.border_mm for side in world.size_mm)
    return width_mm, depth_mm


def _rig_of(
    plan: RigPlan,
    world: Map,
    printer: Printer,
    options: RigOptions,
    notes: Mapping[str, object],
    **others: Any,  # noqa: ANN401  fields of a rig
) -> Rig:
    """Return a rig with the values that follow from its plan, and the notes that hold."""
    thin = len(plan.thin_places)
    notes = {
        f"{counted(thin, 'place')} {agreeing(thin, 'was', 'were')} thinner than the "
        f"{printer.least_wall_mm:g} mm that {printer.name} prints and "
        f"{agreeing(thin, 'was', 'were')} thickened to it: {plan.thickened.area:.0f} mm2 of wall "
        "added": thin,
        f"{counted(plan.slivers, 'piece')} thinner than {options.sliver_mm:g} mm "
        f"{agreeing(plan.slivers, 'was', 'were')} left out": plan.slivers,
        f"{counted(plan.slits, 'gap')} narrower than {options.sliver_mm:g} mm "
        f"{agreeing(plan.slits, 'was', 'were')} filled": plan.slits,
        **notes,
    }
    return Rig(
        name=world.name,
        printer=printer,
        options=options,
        extras=extra_parts(plan.plate.bounds, plan.to_map(-options.plate_mm)),
        plate=plan.on_map(plan.plate),
        walls=plan.on_map(shapely.MultiPolygon(list(plan.solids))),
        thickened=plan.on_map(plan.thickened),
        thin_places=plan.thin_places,
        origin_mm=plan.origin_mm,
        notes=(*plan.notes, *(text for text, holds in notes.items() if holds)),
        **others,
    )


# --- On a plate


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
    options = (options or RigOptions()).changed(style="plate")
    refuse_early(world, printer, options)
    plan = plan or plan_of(world, printer, options)
    cuts = cuts_of(plan.plate.bounds, plan.solids, printer, options)
    joints, bare = list[Dovetail](), 0
    if options.joint == "dovetail":
        joints, bare = dovetails_of(plan, cuts, options.gap_mm(printer))
    # A top would have to be bridged over nothing: with one, obstacles on plates stay filled.
    wall_mm = 0.0 if options.top_mm else shell_wall_mm(printer, options)
    tiles = list(rig_tiles(plan, cuts, joints, (options.sliver_mm, 0.5 * printer.nozzle_mm)))
    parts = [
        _tile_part(number, len(tiles), tile, (plan, cuts, options, wall_mm))
        for number, tile in enumerate(tiles, 1)
    ]
    return _rig_of(
        plan,
        world,
        printer,
        options,
        {
            f"the border is thinner than the {printer.least_wall_mm:g} mm that {printer.name} "
            "prints": options.border_mm < printer.least_wall_mm,
            f"{counted(plan.bridges, 'corner')} that touched in one point "
            f"{agreeing(plan.bridges, 'was', 'were')} joined": plan.bridges,
            f"{counted(bare, 'seam')} {agreeing(bare, 'has', 'have')} no room for a joint: glue "
            f"{agreeing(bare, 'it', 'them')}": bare,
        },
        parts=tuple(part for part, _ in parts),
        counts={
            "slivers": plan.slivers,
            "slits": plan.slits,
            "bridges": plan.bridges,
            "joints": len(joints),
            "bare_seams": bare,
            "unmarked": sum(not marked for _, marked in parts) if options.mark_depth_mm else 0,
        },
        joint_gap_mm3=options.plate_mm * sum(joint.gap_mm2 for joint in joints),
    )


def _tile_part(
    number: int, count: int, tile: RigTile, job: tuple[RigPlan, Cuts, RigOptions, float]
) -> tuple[RigPart, bool]:
    """Return a tile as a solid, and whether its number found room."""
    plan, cuts, options, wall_mm = job
    plate_mm, depth_mm = options.plate_mm, options.mark_depth_mm
    marks = engraved_marks(number, tile.plate) if depth_mm else polygon_parts(Polygon())
    low = np.array([*tile.plate.bounds[:2], 0.0])
    standing = hollowed(tile.solids, wall_mm)
    hollow = shapely.area(standing).sum() < shapely.area(tile.solids).sum()
    plate, solids, grooves = (
        shapely.transform(pieces, lambda points: points - low[:2])
        for pieces in (polygon_parts(tile.plate), standing, marks)
    )
    pocket = Course(pieces=grooves, low_mm=-1.0, high_mm=depth_mm)
    vertices, faces = stacked(plate, solids, plate_mm, options.height_mm, [pocket])
    turn, shift = np.eye(3), np.zeros(3)
    if cuts.turned:
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        shift[0] = tile.plate.bounds[3] - tile.plate.bounds[1]
        vertices = vertices @ turn.T + shift
        # The sum is rounded once more, to what the file can hold.
        vertices = vertices.astype(np.float32).astype(np.float64)
    to_plan = np.eye(4)
    to_plan[:3, :3], to_plan[:3, 3] = turn.T, low - turn.T @ shift
    row, column = tile.cell
    part = RigPart(
        name=f"part_{number:0{max(2, len(str(count)))}d}_r{row + 1}c{column + 1}",
        number=number,
        row=row + 1,
        column=column + 1,
        vertices_mm=vertices,
        faces=faces,
        to_map=plan.to_map(-plate_mm) @ to_plan,
        volume_mm3=float(
            tile.plate.area * plate_mm
            + shapely.area(standing).sum() * options.height_mm
            - shapely.area(marks).sum() * depth_mm
        ),
        shell_wall_mm=wall_mm if hollow else 0.0,
    )
    return part, len(marks) > 0


# --- Loose on a board


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
        circle_segments = 6
        circle = Point(self.x_mm, self.y_mm).buffer(
            0.5 * self.diameter_mm, quad_segs=circle_segments
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
    divided = [  # what pieces too large for the bed leave in each cell of the cuts
        snapped_union(polygon_parts(*shapely.intersection(large, cell, grid_size=GRID_MM)))
        for _, cell in cuts.cells()
        if large
    ]
    pieces = polygon_parts(*whole, *divided, Polygon())
    pieces, _ = without_slivers(pieces, options.sliver_mm)
    if len(pieces) > most:
        problem = f"the rig has {len(pieces)} loose pieces, and {most} are allowed"
        raise UnfitInputError("parts", problem, "give more --most-parts, or --style plate")
    middles = shapely.get_coordinates(shapely.centroid(pieces))
    order = np.lexsort((middles[:, 0], np.round(middles[:, 1] / 20.0)))
    return tuple(
        LoosePiece(number=number, outline=pieces[index], pegs=pegs_in(pieces[index], peg_mm))
        for number, index in enumerate(order.tolist(), 1)
    )


def pegs_in(outline: Polygon, peg_mm: float) -> tuple[Peg, ...]:
    """Return pegs that fit into an outline: the two places farthest apart, or the one with room."""
    smaller = 0.6
    for diameter_mm in (peg_mm, smaller * peg_mm):
        reach_mm = 0.5 * diameter_mm + RIM_MM
        room = shapely.buffer(outline, -reach_mm, quad_segs=2)
        if room.is_empty:
            continue
        corners = shapely.get_coordinates(shapely.convex_hull(room))
        apart_mm = np.hypot(*(corners[:, None] - corners[None]).transpose(2, 0, 1))
        ends = np.unravel_index(int(apart_mm.argmax()), apart_mm.shape)
        places = corners[np.array(ends)]
        if apart_mm[ends] < 1.5 * diameter_mm:
            circle = shapely.maximum_inscribed_circle(outline, 0.05)
            places = shapely.get_coordinates(circle)[:1]
        return tuple(
            Peg(x_mm=x_mm, y_mm=y_mm, diameter_mm=diameter_mm)
            for x_mm, y_mm in np.round(places, 3).tolist()
        )
    return ()


def build_board(
    world: Map, printer: Printer, options: RigOptions, plan: RigPlan | None = None
) -> tuple[Rig, tuple[LoosePiece, ...]]:
    """Return a rig of loose obstacles, and the pieces that it is made of.

    The parts are printed top down, pegs upwards, so that nothing needs supports; the number is
    engraved into the top.
    ``plan`` is the map's plan for this printer, where that is known.
    """
    options = options.changed(style="board")
    # Only what stands on a cell of the bed's size is a part: the cells may be many more.
    many = options.changed(most_parts=MOST_PARTS)
    grid_of(_plate_size_mm(world, options), printer, many)
    plan = plan or plan_of(world, printer, options)
    cuts = cuts_of(plan.plate.bounds, plan.solids, printer, many)
    pieces = loose_pieces(plan, cuts, options, options.peg_mm, options.most_parts)
    wall_mm = shell_wall_mm(printer, options)
    parts = tuple(_loose_part(piece, len(pieces), plan, (options, wall_mm)) for piece in pieces)
    counts = {f"{count} pegs": sum(len(one.pegs) == count for one in pieces) for count in (0, 1, 2)}
    bare, single = counts["0 pegs"], counts["1 pegs"]
    rig = _rig_of(
        plan,
        world,
        printer,
        options,
        {
            f"{counted(bare, 'piece')} {agreeing(bare, 'has', 'have')} no room for a peg: glue "
            f"{agreeing(bare, 'it', 'them')} onto {agreeing(bare, 'its', 'their')} mark": bare,
            f"{counted(single, 'piece')} {agreeing(single, 'has', 'have')} room for one peg only: "
            f"turn {agreeing(single, 'it', 'them')} to {agreeing(single, 'its', 'their')} "
            "mark": single,
        },
        parts=parts,
        counts={"pieces": len(pieces), "slivers": plan.slivers, "slits": plan.slits, **counts},
    )
    return rig, pieces


def _loose_part(
    piece: LoosePiece, count: int, plan: RigPlan, job: tuple[RigOptions, float]
) -> RigPart:
    """Return a loose piece as it is printed: what will be its top lies on the bed."""
    options, wall_mm = job
    x_min, _, _, y_max = piece.outline.bounds
    walls = shell_walls(piece.outline, wall_mm)
    hollow = len(walls.interiors) > len(piece.outline.interiors)
    courses, marks = _courses_of(piece, walls, options, wall_mm if hollow else 0.0)

    def top_down(course: Course) -> Course:
        # Mirrored at y_max: every corner lies right of x_min and below y_max.
        flipped = shapely.transform(course.pieces, lambda points: np.abs(points - (x_min, y_max)))
        return replace(course, pieces=np.asarray(flipped, dtype=object))

    # Grooves are at most half as deep as a thin top.
    depth_mm = min(options.mark_depth_mm, 0.5 * (options.top_mm or 2.0 * options.mark_depth_mm))
    vertices, faces = built_of(
        [top_down(course) for course in courses],
        [top_down(Course(pieces=marks, low_mm=-1.0, high_mm=depth_mm))],
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


def _courses_of(
    piece: LoosePiece, walls: Polygon, options: RigOptions, wall_mm: float
) -> tuple[list[Course], Polygons]:
    """Return the courses of a piece as printed, top down, and the grooves in its top.

    The top of a shell is open but for a tongue that bears the number; below each peg courses reach
    out from the walls, so that nothing needs supports. A ``wall_mm`` of 0: no shell.
    """
    outline, high_mm = piece.outline, options.height_mm
    pegs = [peg.outline for peg in piece.pegs]
    closed, marks, thick_mm = polygon_parts(outline), polygon_parts(Polygon()), options.top_mm
    if wall_mm and not options.top_mm:
        closed, thick_mm = polygon_parts(Polygon()), 2.0 * options.mark_depth_mm
        if options.mark_depth_mm:
            closed, marks = number_marks(piece.number, outline, wall_mm)
    elif options.mark_depth_mm:
        marks = engraved_marks(piece.number, outline, from_below=False)
    courses = [Course(pieces=polygon_parts(walls), low_mm=0.0, high_mm=high_mm)]
    if wall_mm:
        if len(closed):
            courses.append(Course(pieces=closed, low_mm=0.0, high_mm=thick_mm))
        courses += corbelled(walls, outline, pegs, high_mm, wall_mm)
    peg_root_mm = 1.0
    if pegs:
        # From the middle of their support: bodies that overlap join surely.
        low_mm, up_mm = high_mm - peg_root_mm, high_mm + options.plate_mm - PEG_RECESS_MM
        courses.append(Course(pieces=polygon_parts(*pegs), low_mm=low_mm, high_mm=up_mm))
    return courses, marks


_HEIGHTS = (0.5, 0.02, 0.98)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigComparison:
    """How far the walls of an assembled rig differ from the map's obstacles."""

    wall_mm2: float  # area of the map's obstacles within the bounds, in map units
    # area of rig where the map is free, and of map where the rig is, within the bounds
    excess_mm2: float
    missing_mm2: float
    # area that was added on purpose where walls were too thin to print; it is not part of the
    # excess
    thickened_mm2: float
    # by how much the walls' area differs between mid-height and just below or above it
    leaning_mm2: float
    # area within the bounds without plate below: gaps of joints, holes of entries
    floor_missing_mm2: float
    # area within walls that is left empty: cavities, which no robot can touch. Excess and missing
    # are those of the walls' outside, cavities filled
    hollow_mm2: float
    # excess, missing and leaning together, over ``wall_mm2`` (but at least over 1 % of the bounds'
    # area, so that an almost empty map is not judged by the rounding of its border)
    share: float


def compare_with_map(rig: Rig, world: Map) -> RigComparison:
    """Move all parts to their places, cut them at half their height and compare with the map.

    What is compared is the outside that a robot can touch: a hole of a part in which the map has
    no free space is a cavity and counts as filled. Works on the parts' triangles and transforms
    only, not on the plan that they were made from. Walls are upright, which two more cuts confirm;
    so a share of areas is one of volumes.
    """
    rim_mm = 0.01
    options, rim = rig.options, rim_mm / rig.options.scale
    bodies = [_body(part) for part in rig.parts]
    inside = shapely.Polygon(world.bounds.exterior)
    thickened = _areas(rig.thickened)
    # Where a robot can be, less a rim for rounding.
    free = shapely.difference(world.free_space, _widened(thickened, rim))
    free = shapely.buffer(free, -rim, join_style="mitre")
    shapely.prepare(free)
    cuts = [_cut(rig, bodies, share * options.height_mm / options.scale) for share in _HEIGHTS]
    outsides = []
    for cut in cuts:  # without their cavities: the holes that no free space reaches
        filled = []
        for shape in cut:
            pieces = polygon_parts(shape, shapely.Polygon())
            for index in np.flatnonzero(shapely.get_num_interior_rings(pieces) > 0):
                rings = np.asarray(pieces[index].interiors, dtype=object)
                is_open = shapely.intersects(free, shapely.polygons(rings))
                pieces[index] = shapely.Polygon(pieces[index].exterior, list(rings[is_open]))
            filled.append(shapely.MultiPolygon(list(pieces)))
        outsides.append(filled)
    built, outside = (shapely.union_all(shapes) for shapes in (cuts[0], outsides[0]))
    areas = [np.array([shape.area for shape in shapes]) for shapes in outsides]
    leaning_mm2 = float(sum(np.abs(area - areas[0]).sum() for area in areas[1:]))
    floor_missing_mm2 = 0.0
    if rig.style == "plate":
        floor = shapely.union_all(_cut(rig, bodies, -0.25 * options.plate_mm / options.scale))
        floor_missing_mm2 = inside.difference(floor).area

    walls = _areas(shapely.difference(inside, world.free_space))
    seen = _areas(shapely.intersection(_areas(outside), inside))
    thickened = _areas(shapely.difference(thickened, walls))
    excess = _areas(shapely.difference(seen, walls))
    excess_mm2 = shapely.difference(excess, _widened(thickened, rim)).area
    missing_mm2 = shapely.difference(walls, seen).area
    least_wall_share = 0.01
    counted_mm2 = max(walls.area, least_wall_share * inside.area)
    return RigComparison(
        wall_mm2=walls.area,
        excess_mm2=excess_mm2,
        missing_mm2=missing_mm2,
        thickened_mm2=thickened.intersection(inside).area,
        leaning_mm2=leaning_mm2,
        floor_missing_mm2=floor_missing_mm2,
        hollow_mm2=outside.intersection(inside).area - built.intersection(inside).area,
        share=(excess_mm2 + missing_mm2) / counted_mm2 + leaning_mm2 / counted_mm2,
    )


def footprints(rig: Rig) -> dict[int, BaseGeometry]:
    """Return every tile's outline where it lies, by number, in map coordinates."""
    below_mm = -0.25 * rig.options.plate_mm / rig.options.scale
    shapes = _cut(rig, [_body(part) for part in rig.parts], below_mm)
    return {part.number: shape for part, shape in zip(rig.parts, shapes, strict=True)}


def _widened(geometry: BaseGeometry, rim: float) -> BaseGeometry:
    """Grow by less than anything that matters, so that rounding leaves no rims around it."""
    return shapely.buffer(geometry, rim, join_style="mitre")


def _areas(geometry: BaseGeometry) -> BaseGeometry:
    """Drop the lines and points of an overlay; further overlays cannot take the mixture."""
    # What an overlay returns does not overlap: no need to join it once more.
    return shapely.MultiPolygon(list(polygon_parts(geometry)))


def _cut(rig: Rig, bodies: list[Manifold], z_mm: float) -> list[BaseGeometry]:
    """Return each part's cross-section at a height of the map, where it stands."""
    found = []
    for part, body in zip(rig.parts, bodies, strict=True):
        turn, shift = part.to_map[:2, :2].T, part.to_map[:2, 3]
        flat = outlines_at(body, float((z_mm - part.to_map[2, 3]) / part.to_map[2, 2]))
        points = shapely.get_coordinates(flat) @ turn + shift
        found.append(shapely.set_coordinates(flat, points))
    return found


def _body(part: RigPart) -> Manifold:
    body = manifold_of(part.vertices_mm, part.faces)
    if body.is_empty():
        problem = f"its triangles bound no solid ({body.status().name})"
        raise UnfitInputError(f"part {part.name}", problem, "report it")
    return body
