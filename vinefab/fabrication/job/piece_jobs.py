"""The laser job of a robot in pieces: the pieces nested on as few sheets as they need."""

from collections.abc import Sequence
from dataclasses import replace

from vinefab.core.errors import BadInputError
from vinefab.core.units import deg
from vinefab.fabrication.job.passes import body_paths, in_order
from vinefab.fabrication.job.piece_marks import marks_of_pieces
from vinefab.fabrication.job.placement import (
    BedPlacement,
    SheetOptions,
    SheetRobot,
    nest,
    place_contours,
)
from vinefab.fabrication.job.registration import registration
from vinefab.fabrication.job.sleeve import piece_ends, sleeve_size
from vinefab.model.design import Design
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile
from vinefab.model.pieces import Partition
from vinefab.model.tree import branch_tree


def recipe_facts(profile: LaserProfile) -> dict[str, object]:
    """Return which machine, film and recipe a job is for."""
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
        If other designs are asked for beside it.
    """
    if sheet.beside:
        other = sheet.beside[0].name
        raise BadInputError("--with", other, f"nothing: {design.name} is cut in pieces of its own")
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
    margin, usable = machine.margin_mm.value, machine.usable_mm
    within = (margin, margin, margin + usable[0], margin + usable[1])
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
