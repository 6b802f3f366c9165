"""From designs and a recipe to what the laser is to do, placed on the bed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vinefab.core.units import deg
from vinefab.geometry.marks import Free, fold_ticks, label_lines, label_paths, mark
from vinefab.geometry.nesting import nest
from vinefab.geometry.order import in_order
from vinefab.geometry.passes import BodyPaths, body_paths
from vinefab.geometry.placement import Placement, place
from vinefab.geometry.sheet import ONE, SheetOptions
from vinefab.geometry.tilejobs import Tiled, target_paths, tile_jobs, tiled
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """One robot on a sheet.

    Parameters
    ----------
    design
        What it is.
    body
        Its paths in the flat layout.
    placement
        Where it lies, or None where there was no room for it.
    """

    design: Design
    body: BodyPaths
    placement: Placement | None

    @property
    def paths(self) -> tuple[LaserPath, ...]:
        """Its paths on the sheet; none without a place."""
        return tuple(self.moved(path) for path in self.body.paths if self.placement)

    def moved(self, path: LaserPath) -> LaserPath:
        """Return one of its paths where it lies."""
        return LaserPath(
            operation=path.operation,
            contour=self.on_sheet(path.contour),
            label=path.label,
            of=path.of,
        )

    def on_sheet(self, contour: Contour) -> Contour:
        """Return a contour of the flat layout where it lies."""
        return contour if self.placement is None else self.placement.moved(contour)


def laser_job(design: Design, profile: LaserProfile, sheet: SheetOptions = ONE) -> Job:
    """Return the job for a design: its outline, the cuts that free it, and marks beside it.

    A robot that does not fit the bed is placed all the same, and ``fits_bed`` in the facts says so.
    Of several robots those that find no room are left out; ``robots_placed`` counts the others.

    Parameters
    ----------
    design
        The design.
    profile
        Machine, material and recipe.
    sheet
        How many, and which others beside them.

    Raises
    ------
    BadInputError
        If the recipe lacks an operation.
    """
    robots = _placed_robots(design, profile, sheet)
    machine = profile.machine
    alone = robots[0].placement if len(robots) == 1 else None
    parted: Tiled | str = ""
    if alone is not None and not alone.fits:
        body = robots[0].body
        parted = tiled(design, body, profile, pass_through=sheet.pass_through)
        if isinstance(parted, Tiled):
            return _tiled_job(design, body, profile, parted)
    bodies = [path for robot in robots for path in robot.paths]
    margin = machine.margin_mm.value
    usable = machine.usable_mm
    within = (margin, margin, margin + usable[0], margin + usable[1])
    marks = marks_of(robots, bodies, profile, within)
    return Job(
        name=design.name,
        sheet_width_mm=machine.bed_width_mm.value,
        sheet_height_mm=machine.bed_height_mm.value,
        paths=in_order([*marks, *bodies]),
        facts={
            **_recipe_facts(profile),
            **robots[0].body.facts,
            **_placement_facts(robots, profile),
            **_body_facts(robots[0]),
            **({"tiling": parted} if parted else {}),
        },
    )


def _tiled_job(design: Design, body: BodyPaths, profile: LaserProfile, parted: Tiled) -> Job:
    """Return the job of a robot in tiles: the whole on its film, and one job per tile."""
    robot = Robot(design=design, body=body, placement=parted.placement)
    first, room = parted.tiles[0], profile.machine.usable_mm
    within = (*first.low_mm, first.low_mm[0] + room[0], first.low_mm[1] + room[1])
    targets = [path for tile in parted.tiles for path in target_paths(tile, profile)]
    marks = marks_of([robot], [*robot.paths, *targets], profile, within)
    facts = {**_recipe_facts(profile), **body.facts, **_body_facts(robot)}
    jobs = tile_jobs(design.name, profile, parted.tiles, marks, facts)
    made = [mark for mark in targets if mark.operation is Operation.MARK]
    return Job(
        name=design.name,
        sheet_width_mm=parted.sheet_mm[0],
        sheet_height_mm=parted.sheet_mm[1],
        paths=in_order([*marks, *made, *robot.paths]),
        facts={**facts, **_placement_facts([robot], profile), "tiles": len(jobs)},
        tiles=jobs,
    )


def marks_of(
    robots: Sequence[Robot],
    bodies: Sequence[LaserPath],
    profile: LaserProfile,
    within: tuple[float, float, float, float],
) -> list[LaserPath]:
    """Return fold lines and labels of robots, as far as there is room for them.

    Parameters
    ----------
    robots
        The robots; those without a place get none.
    bodies
        All paths that marks must stay clear of.
    profile
        Marks are made only where the recipe can mark.
    within
        The part of the sheet that marks may use.
    """
    if Operation.MARK not in profile.recipe.operations:
        return []
    free, marks = Free(bodies, within), []
    placed = [robot for robot in robots if robot.placement]
    for robot in placed:
        for tick in fold_ticks(robot.design, robot.body.reach_mm):
            moved = robot.on_sheet(tick)
            if free.has(moved):
                name = robot.design.name
                marks.append(mark(moved, f"fold line of {name}", name))
    for path in marks:
        free.take(Free([path], within).taken)
    for number, robot in enumerate(placed, start=1):
        lines = label_lines(robot.design.name, profile, (number, len(placed)))
        tail = robot.on_sheet(robot.body.outline.contour).points_mm
        near = (tail[0] + tail[-1]) / 2.0
        marks += label_paths(lines, free, (float(near[0]), float(near[1])), robot.design.name)
    return marks


def _placed_robots(design: Design, profile: LaserProfile, sheet: SheetOptions) -> list[Robot]:
    machine, apart = profile.machine, sheet.process == "weld+cut"
    designs = [*[design] * sheet.copies, *sheet.beside]
    bodies = {id(one): body_paths(one, profile, apart=apart) for one in designs}
    made = [bodies[id(one)] for one in designs]
    contours = [tuple(path.contour for path in body.paths) for body in made]
    corner = machine.margin_mm.value
    placements: Sequence[Placement | None]
    if len(designs) == 1:
        placements = [_alone(design, made[0], profile)]
    else:
        placements = nest(contours, machine.usable_mm, corner)
    return [
        Robot(design=one, body=body, placement=placement)
        for one, body, placement in zip(designs, made, placements, strict=True)
    ]


def _alone(design: Design, body: BodyPaths, profile: LaserProfile) -> Placement:
    """Return where one robot lies: with room for its fold line, if there is any."""
    room, corner = profile.machine.usable_mm, profile.machine.margin_mm.value
    contours = [path.contour for path in body.paths]
    if Operation.MARK in profile.recipe.operations:
        marked = place([*contours, *fold_ticks(design, body.reach_mm)], room, corner)
        if marked.fits:
            return marked
    return place(contours, room, corner)


def _recipe_facts(profile: LaserProfile) -> dict[str, object]:
    return {
        "machine": profile.machine.name,
        "material": profile.material.name,
        "recipe": profile.recipe.name,
        "recipe_status": profile.recipe.status.value,
    }


def _placement_facts(robots: Sequence[Robot], profile: LaserProfile) -> dict[str, object]:
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


def _body_facts(robot: Robot) -> dict[str, object]:
    points, outline = robot.body.outline.contour.points_mm, robot.body.outline
    return {
        "mouth_lumen_mm": robot.design.build.mouth_width_mm,
        "mouth_gap_mm": math.dist(points[0], points[-1]),
        "outline_problems": [problem.words for problem in outline.problems],
    }
