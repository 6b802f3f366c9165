"""The laser job of a sheet, or of the sheets of a robot in pieces: all paths placed on the bed."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

from vinefab.core.errors import BadInputError
from vinefab.core.limits import deg
from vinefab.core.plain_text import counted
from vinefab.fabrication.job.marks import fold_ticks, marks_of, marks_of_pieces
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
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import Partition, branch_tree


def recipe_facts(profile: LaserProfile) -> dict[str, object]:
    """Return the machine, film and recipe of a job."""
    return {
        "machine": profile.machine.name,
        "material": profile.material.name,
        "recipe": profile.recipe.name,
        "recipe_status": profile.recipe.status.value,
    }


def pieces_job(
    design: Design, profile: LaserProfile, sheet: SheetOptions, partition: Partition
) -> Job:
    """Return the job of a robot in several pieces: one job per sheet, and all of them side by side.

    Every copy of the robot has all its pieces; they share sheets where there is room.

    Raises
    ------
    BadInputError
        If other designs are asked for with it.
    """
    if sheet.beside:
        other = sheet.beside[0].name
        raise BadInputError("--with", other, f"nothing: {design.name} is cut in separate pieces")
    separate = sheet.process == "weld+cut"
    bodies = [
        body_paths(design, profile, separate=separate, ends=piece_ends(partition, piece))
        for piece in partition.pieces
    ]
    parts = [
        SheetRobot(
            design=design,
            body=body,
            placement=None,
            number=copy,
            count=sheet.copies,
            piece=piece.label,
        )
        for copy in range(1, sheet.copies + 1)
        for piece, body in zip(partition.pieces, bodies, strict=True)
    ]
    room, corner = profile.machine.usable_mm, profile.machine.margin_mm.value
    left, sheets = list(parts), list[list[SheetRobot]]()
    while left:
        contours = [tuple(path.contour for path in part.body.paths) for part in left]
        placements: list[BedPlacement | None] = nest(contours, room, corner, once=True)
        if not any(placements):
            # One that fits no bed: it lies there all the same, and rule VF-S01 says so.
            placements[0] = place_contours(contours[0], room, corner)
        pairs = list(zip(left, placements, strict=True))
        sheets.append([replace(part, placement=place) for part, place in pairs if place])
        left = [part for part, place in pairs if not place]
    wide, high = profile.machine.bed_width_mm.value, profile.machine.bed_height_mm.value
    jobs = [
        _sheet_job(design, profile, (number, len(sheets)), robots, (partition, separate))
        for number, robots in enumerate(sheets, start=1)
    ]
    left_out: list[object] = []  # marks that found no room on their sheets
    for job in jobs:
        missed = job.facts.get("marks_left_out", [])
        left_out += missed if isinstance(missed, list) else []
    moved = [
        replace(path, contour=path.contour.moved(0.0, number * wide, 0.0))
        for number, job in enumerate(jobs)
        for path in job.paths
    ]
    return Job(
        name=design.name,
        sheet_width_mm=len(jobs) * wide,
        sheet_height_mm=high,
        paths=in_order(moved),
        facts={
            **recipe_facts(profile),
            **parts[0].body.facts,
            "usable_width_mm": profile.machine.usable_mm[0],
            "usable_height_mm": profile.machine.usable_mm[1],
            "fits_bed": all(bool(job.facts["fits_bed"]) for job in jobs),
            "sheets": len(jobs),
            **_piece_facts(design, profile, sheet, partition, sheets),
            "outline_problems": [problem.message for problem in parts[0].body.outline.problems],
            **({"marks_left_out": left_out} if left_out else {}),
        },
        sheets=tuple(jobs),
    )


def _sheet_job(
    design: Design,
    profile: LaserProfile,
    place: tuple[int, int],
    robots: Sequence[SheetRobot],
    cutting: tuple[Partition, bool],
) -> Job:
    """Return the job of one sheet, of several."""
    partition, separate = cutting
    machine = profile.machine
    within = machine.usable_box_mm
    bodies = [path for robot in robots for path in robot.paths]
    pins = registration(bodies, profile, within, separate=separate)
    marks = marks_of_pieces(robots, [*bodies, *pins], profile, within, partition)
    return Job(
        name=design.name,
        sheet_width_mm=machine.bed_width_mm.value,
        sheet_height_mm=machine.bed_height_mm.value,
        paths=in_order([*marks.paths, *bodies, *pins]),
        facts={
            **recipe_facts(profile),
            **robots[0].body.facts,
            "sheet": f"{place[0]} of {place[1]}",
            "pieces": [robot.piece for robot in robots],
            "fits_bed": all(
                robot.placement is not None and robot.placement.fits for robot in robots
            ),
            **marks.facts,
        },
    )


def _piece_facts(
    design: Design,
    profile: LaserProfile,
    sheet: SheetOptions,
    partition: Partition,
    sheets: Sequence[Sequence[SheetRobot]],
) -> dict[str, object]:
    """Return every piece with its place, and every joint, as plain values."""
    ids = branch_tree(design).ids
    pieces = {piece.label: piece for piece in partition.pieces}
    size = sleeve_size(design.build, profile, separate=sheet.process == "weld+cut")
    placed = [
        (number, robot, robot.placement)
        for number, robots in enumerate(sheets, start=1)
        for robot in robots
        if robot.placement is not None
    ]
    placed.sort(key=lambda one: (one[1].number, [*pieces].index(one[1].piece)))
    return {
        "proven_least_pieces": partition.proven_least,
        "pieces": [
            {
                "label": robot.piece,
                "copy": robot.number,
                "sheet": number,
                "root": ids[pieces[robot.piece].root],
                "branches": [ids[row] for row in pieces[robot.piece].branches],
                "stubs": [ids[row] for row in pieces[robot.piece].stubs],
                "transform": {
                    "rotation_deg": deg(placement.angle_rad),
                    "shift_x_mm": placement.dx_mm,
                    "shift_y_mm": placement.dy_mm,
                },
                "fits_bed": placement.fits,
            }
            for number, robot, placement in placed
        ],
        "joints": [
            {
                "label": sleeve.label,
                "inner": sleeve.inner,
                "socket_on": sleeve.socket_on,
                "plug_on": sleeve.plug_on,
                "branch": ids[sleeve.branch],
                "lumen_width_mm": sleeve.width_mm,
                "socket_wider_mm": 2.0 * sleeve.rise_mm,
                "socket_rim_mm": sleeve.socket_mm,
                "plug_rim_mm": sleeve.plug_mm,
                "blend_to_mm": sleeve.blend_end_mm,
            }
            for sleeve in partition.sleeves
        ],
        "lap_mm": size.lap_mm,
        "socket_wider_mm": 2.0 * size.rise_mm,
    }


MOST_CUT_BRANCHES = 5000
"""Larger trees are refused: no sheet holds them, and pairs of branches grow with the square."""


def check_size(design: Design) -> None:
    """Refuse a design with more branches than any sheet could hold."""
    if design.branch_count > MOST_CUT_BRANCHES:
        count, allowed = (
            design.branch_count,
            f"at most {MOST_CUT_BRANCHES} for checks and laser files",
        )
        raise BadInputError(f"design {design.name}", counted(count, "branch"), allowed)


def laser_job(
    design: Design,
    profile: LaserProfile,
    sheet: SheetOptions = ONE,
    partition: Partition | None = None,
) -> Job:
    """Return the job of a sheet: outlines, the cuts that free them, and marks next to them.

    Of a robot in several pieces it is the job of all its sheets.

    A single robot that does not fit the bed is cut in tiles where possible, and else placed all the
    same with ``fits_bed`` false in the facts. Of several robots those that find no room are left
    out; ``robots_placed`` counts the others.

    Raises
    ------
    BadInputError
        If a design has too many branches, or different designs have the same name.
    """
    for one in (design, *sheet.beside):
        check_size(one)
    if partition is not None and len(partition.pieces) > 1:
        return pieces_job(design, profile, sheet, partition)
    robots = _placed_robots(design, profile, sheet)
    machine = profile.machine
    single = robots[0].placement if len(robots) == 1 else None
    parted: Tiled | str = ""
    if single is not None and not single.fits:
        body = robots[0].body
        parted = tiled(design, body, profile, pass_through=sheet.pass_through)
        if isinstance(parted, Tiled):
            return _tiled_job(design, body, profile, parted)
    bodies = [path for robot in robots for path in robot.paths]
    within = machine.usable_box_mm
    pins = registration(bodies, profile, within, separate=sheet.process == "weld+cut")
    marks = marks_of(robots, [*bodies, *pins], profile, within)
    return Job(
        name=design.name,
        sheet_width_mm=machine.bed_width_mm.value,
        sheet_height_mm=machine.bed_height_mm.value,
        paths=in_order([*marks.paths, *bodies, *pins]),
        facts={
            **recipe_facts(profile),
            **robots[0].body.facts,
            **_placement_facts(robots, profile),
            **_body_facts(robots[0]),
            **({"tiling": parted} if parted else {}),
            **marks.facts,
        },
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
    machine, separate = profile.machine, sheet.process == "weld+cut"
    designs = [*[design] * sheet.copies, *sheet.beside]
    _refuse_namesakes(designs)
    bodies = {id(one): body_paths(one, profile, separate=separate) for one in designs}
    made = [bodies[id(one)] for one in designs]
    contours = [tuple(path.contour for path in body.paths) for body in made]
    corner = machine.margin_mm.value
    placements: Sequence[BedPlacement | None]
    if len(designs) == 1:
        placements = [_single_placement(design, made[0], profile)]
    else:
        placements = nest(contours, machine.usable_mm, corner)
    robots = [
        SheetRobot(design=one, body=body, placement=placement)
        for one, body, placement in zip(designs, made, placements, strict=True)
    ]
    count = sum(robot.placement is not None for robot in robots)
    numbers = itertools.count(1)
    return [
        replace(robot, number=next(numbers), count=count) if robot.placement else robot
        for robot in robots
    ]


def _refuse_namesakes(designs: Sequence[Design]) -> None:
    """Refuse different designs of one name, which identifies paths, labels and findings."""
    named: dict[str, Design] = {}
    for design in designs:
        if named.setdefault(design.name, design) != design:
            allowed = "designs of different names on one sheet, or the same design again"
            raise BadInputError("name", f"{design.name} twice", allowed)


def _single_placement(design: Design, body: BodyPaths, profile: LaserProfile) -> BedPlacement:
    """Return the placement of one robot, with room for its fold line if possible."""
    room, corner = profile.machine.usable_mm, profile.machine.margin_mm.value
    contours = [path.contour for path in body.paths]
    if Operation.MARK in profile.recipe.by_operation:
        marked = place_contours([*contours, *fold_ticks(design, body.reach_mm)], room, corner)
        if marked.fits:
            return marked
    return place_contours(contours, room, corner)


def _placement_facts(robots: Sequence[SheetRobot], profile: LaserProfile) -> dict[str, object]:
    usable = profile.machine.usable_mm
    facts: dict[str, object] = {
        "usable_width_mm": usable[0],
        "usable_height_mm": usable[1],
    }
    if len(robots) == 1 and (placement := robots[0].placement):
        return {
            "rotation_deg": deg(placement.angle_rad),
            "shift_x_mm": placement.dx_mm,
            "shift_y_mm": placement.dy_mm,
            "box_width_mm": placement.width_mm,
            "box_height_mm": placement.height_mm,
            **facts,
            "fits_bed": placement.fits,
        }
    placed = [(robot.design.name, robot.placement) for robot in robots if robot.placement]
    return {
        **facts,
        "fits_bed": len(placed) == len(robots),
        "robots_wanted": len(robots),
        "robots_placed": len(placed),
        "robots": [
            {
                "part": number,
                "design": name,
                "rotation_deg": deg(placement.angle_rad),
                "shift_x_mm": placement.dx_mm,
                "shift_y_mm": placement.dy_mm,
            }
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
