"""The laser job of a sheet, or of the sheets of a robot in pieces: all paths placed on the bed."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import counted
from vinefab.fabrication.job.marks import fold_ticks, marks_of
from vinefab.fabrication.job.passes import BodyPaths, body_paths, in_order, piece_ends, sleeve_size
from vinefab.fabrication.job.placement import (
    ONE,
    BedPlacement,
    SheetOptions,
    SheetRobot,
    box_around_mm,
    nest,
    place_contours,
)
from vinefab.fabrication.job.tiling import Tiled, registration, target_paths, tile_jobs, tiled
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation, PieceJoint, PlacedPiece
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import Partition


def recipe_facts(profile: LaserProfile) -> dict[str, object]:
    """Return the machine, film and recipe of a job."""
    return {
        "machine": profile.machine.name,
        "material": profile.material.name,
        "recipe": profile.recipe.name,
        "recipe_status": profile.recipe.status.value,
    }


MOST_CUT_BRANCHES = 5000
"""Larger trees are refused: no sheet holds them, and pairs of branches grow with the square."""


def check_size(design: Design) -> None:
    """Refuse a design with more branches than any sheet could hold."""
    if design.branch_count > MOST_CUT_BRANCHES:
        allowed = f"at most {MOST_CUT_BRANCHES} for checks and laser files"
        raise BadInputError(
            f"design {design.name}", counted(design.branch_count, "branch"), allowed
        )


def laser_job(
    design: Design,
    profile: LaserProfile,
    sheet: SheetOptions = ONE,
    partition: Partition | None = None,
    *,
    pinned: bool = True,
) -> Job:
    """Return the job of a sheet: outlines, the cuts that free them, and marks next to them.

    Of a robot in several pieces it is the job of all its sheets.

    A single robot that does not fit the bed is cut in tiles where possible, and else placed all the
    same with ``fits_bed`` false in the facts. Of several robots those that find no room are left
    out; ``robots_placed`` counts the others.

    Parameters
    ----------
    pinned
        False for a robot that is put on another sheet: holes to put this one back take long to
        place.

    Raises
    ------
    BadInputError
        If a design has too many branches, or different designs have the same name.
    """
    for one in (design, *sheet.beside):
        check_size(one)
    if partition is not None and len(partition.pieces) > 1:
        return _pieces_job(design, profile, sheet, partition)
    robots = _placed_robots(design, profile, sheet)
    facts = {**_placement_facts(robots, profile), **_body_facts(robots[0])}
    single = robots[0].placement
    if len(robots) == 1 and single is not None and not single.fits:
        if all(tool.by_hand for tool in profile.tools):
            facts["tiling"] = "people seal and cut it, on a table as large as the film"
            return _sheet_job(robots, profile, sheet, facts, pinned=pinned)
        parted = tiled(design, robots[0].body, profile, pass_through=sheet.pass_through)
        if isinstance(parted, Tiled):
            return _tiled_job(design, robots[0].body, profile, parted)
        facts["tiling"] = parted
    return _sheet_job(robots, profile, sheet, facts, pinned=pinned)


def _sheet_job(
    robots: Sequence[SheetRobot],
    profile: LaserProfile,
    sheet: SheetOptions,
    facts: Mapping[str, object],
    partition: Partition | None = None,
    *,
    pinned: bool = True,
) -> Job:
    """Return the job of one sheet: its robots or pieces, pins to put it back by, and marks."""
    machine, bodies = profile.machine, [path for robot in robots for path in robot.paths]
    pins: tuple[LaserPath, ...] = ()
    if pinned:
        pins = registration(bodies, profile, machine.usable_box_mm, separate=sheet.separate)
    marks = marks_of(robots, [*bodies, *pins], profile, machine.usable_box_mm, partition)
    alone = robots[0].placement if len(robots) == 1 else None
    return Job(
        name=robots[0].design.name,
        transform=None if alone is None else alone.transform,
        sheet_width_mm=machine.bed_width_mm.value,
        sheet_height_mm=machine.bed_height_mm.value,
        paths=in_order([*marks.paths, *bodies, *pins]),
        facts={**recipe_facts(profile), **robots[0].body.facts, **facts, **marks.facts},
    )


def _pieces_job(
    design: Design, profile: LaserProfile, sheet: SheetOptions, partition: Partition
) -> Job:
    """Return the job of a robot in several pieces: one job per sheet, and all of them side by side.

    Every copy of the robot has all its pieces; they share sheets where there is room.
    """
    if sheet.beside:
        other = sheet.beside[0].name
        problem = f"{design.name} is cut in pieces, and {other} finds no room with them"
        raise UnfitInputError("--with", problem, "make a sheet of each")
    bodies = {
        piece.label: body_paths(
            design, profile, separate=sheet.separate, ends=piece_ends(partition, piece)
        )
        for piece in partition.pieces
    }
    left = [
        SheetRobot(
            design=design, body=body, placement=None, number=copy, count=sheet.copies, piece=label
        )
        for copy in range(1, sheet.copies + 1)
        for label, body in bodies.items()
    ]
    first, sheets = left[0].body, list[list[SheetRobot]]()
    room, corner = profile.machine.usable_mm, profile.machine.margin_mm.value
    while left:
        contours = [tuple(path.contour for path in part.body.paths) for part in left]
        placements: list[BedPlacement | None] = nest(contours, room, corner, once=True)
        if not any(placements):
            # One that fits no bed: it lies there all the same, and rule VF-S01 says so.
            placements[0] = place_contours(contours[0], room, corner)
        pairs = list(zip(left, placements, strict=True))
        sheets.append([replace(part, placement=place) for part, place in pairs if place])
        left = [part for part, place in pairs if not place]
    jobs = []
    for number, robots in enumerate(sheets, start=1):
        facts = {
            "sheet": f"{number} of {len(sheets)}",
            "pieces": [robot.piece for robot in robots],
            "fits_bed": all(robot.placement and robot.placement.fits for robot in robots),
        }
        jobs.append(_sheet_job(robots, profile, sheet, facts, partition))
    left_out: list[object] = []  # marks that found no room on their sheets
    for job in jobs:
        missed = job.facts.get("marks_left_out", [])
        left_out += missed if isinstance(missed, list) else []
    wide = jobs[0].sheet_width_mm
    size = sleeve_size(design.build, profile, separate=sheet.separate)
    return Job(
        name=design.name,
        sheet_width_mm=len(jobs) * wide,
        sheet_height_mm=jobs[0].sheet_height_mm,
        paths=in_order(
            replace(path, contour=path.contour.moved(0.0, number * wide, 0.0))
            for number, job in enumerate(jobs)
            for path in job.paths
        ),
        facts={
            **recipe_facts(profile),
            **first.facts,
            **_usable(profile),
            "fits_bed": all(bool(job.facts["fits_bed"]) for job in jobs),
            "sheets": len(jobs),
            "proven_least_pieces": partition.proven_least,
            "lap_mm": size.lap_mm,
            "socket_wider_mm": 2.0 * size.rise_mm,
            "outline_problems": [problem.message for problem in first.outline.problems],
            **({"marks_left_out": left_out} if left_out else {}),
        },
        pieces=_placed_pieces(design, partition, sheets),
        joints=_piece_joints(design, partition),
        sheets=tuple(jobs),
    )


def _placed_pieces(
    design: Design, partition: Partition, sheets: Sequence[Sequence[SheetRobot]]
) -> tuple[PlacedPiece, ...]:
    """Return every piece with its place, copy by copy."""
    ids = design.tree.straight.ids
    order = [piece.label for piece in partition.pieces]
    placed = [
        (number, robot, partition.pieces[order.index(robot.piece)], robot.placement)
        for number, robots in enumerate(sheets, start=1)
        for robot in robots
        if robot.placement is not None
    ]
    placed.sort(key=lambda one: (one[1].number, order.index(one[2].label)))
    return tuple(
        PlacedPiece(
            label=piece.label,
            copy=robot.number,
            sheet=number,
            root=ids[piece.root],
            branches=tuple(ids[row] for row in piece.branches),
            stubs=tuple(ids[row] for row in piece.stubs),
            transform=placement.transform,
            fits_bed=placement.fits,
        )
        for number, robot, piece, placement in placed
    )


def _piece_joints(design: Design, partition: Partition) -> tuple[PieceJoint, ...]:
    ids = design.tree.straight.ids
    return tuple(
        PieceJoint(
            label=sleeve.label,
            inner=sleeve.inner,
            socket_on=sleeve.socket_on,
            plug_on=sleeve.plug_on,
            branch=ids[sleeve.branch],
            lumen_width_mm=sleeve.width_mm,
            socket_wider_mm=2.0 * sleeve.rise_mm,
            socket_rim_mm=sleeve.socket_mm,
            plug_rim_mm=sleeve.plug_mm,
            blend_to_mm=sleeve.blend_end_mm,
        )
        for sleeve in partition.sleeves
    )


def _tiled_job(design: Design, body: BodyPaths, profile: LaserProfile, parted: Tiled) -> Job:
    """Return the job of a robot in tiles: the whole on its film, and one job per tile."""
    robot = SheetRobot(design=design, body=body, placement=parted.placement)
    first, room = parted.tiles[0], profile.machine.usable_mm
    within = (*first.low_mm, first.low_mm[0] + room[0], first.low_mm[1] + room[1])
    targets = [path for tile in parted.tiles for path in target_paths(tile, profile)]
    # By layer, as in every file: each tile between two others has crosses of both kinds.
    targets.sort(key=lambda path: path.variant)
    marks = marks_of([robot], [*robot.paths, *targets], profile, within)
    facts = {**recipe_facts(profile), **body.facts, **_body_facts(robot), **marks.facts}
    # Targets and labels may lie beyond the robot: the film begins a margin below all of them.
    paths = [*marks.paths, *robot.paths, *targets]
    margin = profile.machine.margin_mm.value
    x0, y0, x1, y1 = box_around_mm(path.contour for path in paths)
    low = x0 - margin, y0 - margin
    jobs = tile_jobs(design.name, profile, replace(parted, film_mm=low), marks.paths, facts)
    shifted = parted.placement.shifted(-low[0], -low[1])
    whole = [path for path in paths if path.operation is not Operation.REG]
    return Job(
        name=design.name,
        transform=shifted.transform,
        sheet_width_mm=x1 - low[0] + margin,
        sheet_height_mm=y1 - low[1] + margin,
        paths=in_order(
            replace(path, contour=path.contour.moved(0.0, -low[0], -low[1])) for path in whole
        ),
        facts={
            **facts,
            **_placement_facts([replace(robot, placement=shifted)], profile),
            "tiles": len(jobs),
        },
        tiles=jobs,
    )


def _placed_robots(design: Design, profile: LaserProfile, sheet: SheetOptions) -> list[SheetRobot]:
    """Return the robots of a sheet where they lie; a single one has room for its fold line."""
    room, corner = profile.machine.usable_mm, profile.machine.margin_mm.value
    designs = [*[design] * sheet.copies, *sheet.beside]
    named: dict[str, Design] = {}  # a name identifies paths, labels and findings
    for one in designs:
        if named.setdefault(one.name, one) != one:
            problem = f"two designs of one sheet are called {one.name}"
            raise UnfitInputError("name", problem, "rename one of them")
    bodies = {
        name: body_paths(one, profile, separate=sheet.separate) for name, one in named.items()
    }
    made = [bodies[one.name] for one in designs]
    contours = [tuple(path.contour for path in body.paths) for body in made]
    placements: list[BedPlacement | None]
    if len(designs) > 1:
        placements = nest(contours, room, corner)
    else:
        marked = None
        if Operation.MARK in profile.recipe.by_operation:
            ticks = fold_ticks(design, made[0].reach_mm)
            marked = place_contours([*contours[0], *ticks], room, corner)
        bare = marked is None or not marked.fits
        placements = [place_contours(contours[0], room, corner) if bare else marked]
    count, numbers = sum(place is not None for place in placements), itertools.count(1)
    return [
        SheetRobot(design=one, body=body, placement=place, number=next(numbers), count=count)
        if place
        else SheetRobot(design=one, body=body, placement=None)
        for one, body, place in zip(designs, made, placements, strict=True)
    ]


def _usable(profile: LaserProfile) -> dict[str, object]:
    wide_mm, high_mm = profile.machine.usable_mm
    return {"usable_width_mm": wide_mm, "usable_height_mm": high_mm}


def _placement_facts(robots: Sequence[SheetRobot], profile: LaserProfile) -> dict[str, object]:
    if len(robots) == 1 and (placement := robots[0].placement):
        return {
            **placement.transform.content,
            "box_width_mm": placement.width_mm,
            "box_height_mm": placement.height_mm,
            **_usable(profile),
            "fits_bed": placement.fits,
        }
    placed = [(robot.design.name, robot.placement) for robot in robots if robot.placement]
    return {
        **_usable(profile),
        "fits_bed": len(placed) == len(robots),
        "robots_wanted": len(robots),
        "robots_placed": len(placed),
        "robots": [
            {"part": number, "design": name, **placement.transform.content}
            for number, (name, placement) in enumerate(placed, start=1)
        ],
    }


def _body_facts(robot: SheetRobot) -> dict[str, object]:
    points, outline = robot.body.outline.contour.points_mm, robot.body.outline
    return {
        "mouth_lumen_mm": robot.design.build.mouth_width_mm,
        "mouth_gap_mm": math.dist(points[0], points[-1]),
        "outline_problems": [problem.message for problem in outline.problems],
    }
