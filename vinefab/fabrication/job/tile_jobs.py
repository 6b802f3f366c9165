"""The jobs of a robot that is cut in tiles, and the job of the whole for pictures and checks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vinefab.fabrication.job.marks import mark
from vinefab.fabrication.job.passes import BodyPaths, in_order
from vinefab.fabrication.job.placement import BedPlacement, box_around_mm, place_contours
from vinefab.fabrication.job.tiling import (
    OVERLAP_MM,
    TARGET_MM,
    BranchAxes,
    FilmTile,
    NoTilesError,
    Point,
    film_tiles,
    register,
)
from vinefab.fabrication.outline.layout import flat_layout
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour

TARGET = "registration target"
"""What the lines of a registration target are called."""

_TURNS_RAD = (0.0, math.pi / 2, math.pi / 4, -math.pi / 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tiled:
    """A robot in tiles."""

    placement: BedPlacement  # where the whole lies
    tiles: tuple[FilmTile, ...]  # the tiles, in the same coordinates
    film_mm: Point = (0.0, 0.0)  # lower left corner of the film, in the same coordinates


def tiled(
    design: Design, body: BodyPaths, profile: LaserProfile, *, pass_through: bool = False
) -> Tiled | str:
    """Return a robot in as few tiles as a turn of it allows, or why it cannot be tiled."""
    room, margin = profile.machine.usable_mm, profile.machine.margin_mm.value
    contours = [path.contour for path in body.paths]
    best = place_contours(contours, (1e9, room[1]) if pass_through else room, margin)
    found: list[tuple[int, Tiled, list[LaserPath]]] = []
    reasons: dict[int, str] = {}
    for row, turn in enumerate(
        dict.fromkeys((best.angle_rad, *(() if pass_through else _TURNS_RAD)))
    ):
        placement = _laid(contours, turn, margin)
        paths = [_moved(path, placement) for path in body.paths]
        try:
            tiles = film_tiles(_axes(design, placement), paths, room, pass_through=pass_through)
        except NoTilesError as error:
            reasons[row] = str(error)
        else:
            found.append((row, Tiled(placement=placement, tiles=tuple(tiles)), paths))
    # Targets take longest to find, so they are looked for in the fewest tiles first.
    for row, one, paths in sorted(found, key=lambda option: len(option[1].tiles)):
        try:
            register(one.tiles, room, [path.contour for path in paths])
        except NoTilesError as error:
            reasons[row] = str(error)
        else:
            return one
    return reasons[min(reasons)]


def target_paths(tile: FilmTile, profile: LaserProfile) -> list[LaserPath]:
    """Return a tile's registration targets: those that it makes, then those that it finds."""
    made = [mark(line, TARGET, "") for line in _crosses(tile.made_mm)]
    if Operation.MARK not in profile.recipe.operations:
        made = [_reg(path.contour) for path in made]
    return [*made, *(_reg(line) for line in _crosses(tile.found_mm))]


def tile_jobs(
    name: str,
    profile: LaserProfile,
    parted: Tiled,
    marks: Sequence[LaserPath],
    facts: dict[str, object],
) -> tuple[Job, ...]:
    """Return one job per tile, in the order in which they are cut."""
    machine, tiles, jobs = profile.machine, parted.tiles, []
    corner = machine.margin_mm.value
    for number, tile in enumerate(tiles, start=1):
        shift = corner - tile.low_mm[0], corner - tile.low_mm[1]
        own = [*(marks if number == 1 else ()), *target_paths(tile, profile), *tile.paths]
        jobs.append(
            Job(
                name=f"{name}_tile_{number}",
                sheet_width_mm=machine.bed_width_mm.value,
                sheet_height_mm=machine.bed_height_mm.value,
                paths=in_order(_shifted(path, shift) for path in own),
                facts={
                    **facts,
                    "tile": number,
                    "tiles": len(tiles),
                    "window_x_mm": -shift[0] - parted.film_mm[0],
                    "window_y_mm": -shift[1] - parted.film_mm[1],
                    "overlap_mm": OVERLAP_MM,
                    "aligned_to_tile": None if tile.after is None else tile.after + 1,
                    "targets_found_mm": _seen(tile.found_mm, shift),
                    "targets_made_mm": _seen(tile.made_mm, shift),
                },
            )
        )
    return tuple(jobs)


def _axes(design: Design, placement: BedPlacement) -> BranchAxes:
    layout = flat_layout(design)
    start = layout.start_mm.copy()
    start[0, 0] -= layout.tail_mm
    cos, sin = math.cos(placement.angle_rad), math.sin(placement.angle_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    along = np.column_stack([np.cos(layout.heading_rad), np.sin(layout.heading_rad)])
    return BranchAxes(
        names=layout.tree.ids,
        parent=tuple(layout.tree.parent.tolist()),
        start_mm=start @ turn + np.array([placement.dx_mm, placement.dy_mm]),
        along=along @ turn,
    )


def _laid(contours: Sequence[Contour], turn_rad: float, corner_mm: float) -> BedPlacement:
    x0, y0, x1, y1 = box_around_mm(contour.moved(turn_rad, 0.0, 0.0) for contour in contours)
    return BedPlacement(
        angle_rad=turn_rad,
        dx_mm=corner_mm - x0,
        dy_mm=corner_mm - y0,
        width_mm=x1 - x0,
        height_mm=y1 - y0,
        fits=False,
    )


def _moved(path: LaserPath, placement: BedPlacement) -> LaserPath:
    return replace(path, contour=placement.moved(path.contour))


def _shifted(path: LaserPath, shift_mm: Point) -> LaserPath:
    return replace(path, contour=path.contour.moved(0.0, *shift_mm))


def _reg(contour: Contour) -> LaserPath:
    return LaserPath(operation=Operation.REG, contour=contour, label=TARGET)


def _crosses(middles_mm: Sequence[Point]) -> list[Contour]:
    half, lines = TARGET_MM / 2.0, []
    for x, y in middles_mm:
        for dx, dy in ((half, 0.0), (0.0, half)):
            ends = np.array([[x - dx, y - dy], [x + dx, y + dy]])
            lines.append(Contour.polyline(ends, closed=False))
    return lines


def _seen(points_mm: Sequence[Point], shift_mm: Point) -> list[list[float]]:
    return [[x + shift_mm[0], y + shift_mm[1]] for x, y in points_mm]
