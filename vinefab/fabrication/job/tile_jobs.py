"""Registration of the tiles of a robot, and the jobs that cut them.

Two registration targets are marked with one tile and found again for the next one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.fabrication.job.marks import CLEAR_MM, Box, mark, region
from vinefab.fabrication.job.passes import BodyPaths, in_order
from vinefab.fabrication.job.placement import BedPlacement, place_contours, placed_at
from vinefab.fabrication.job.tiling import (
    OVERLAP_MM,
    TARGET_MM,
    BranchAxes,
    FilmTile,
    NoTilesError,
    film_tiles,
    union_box,
)
from vinefab.fabrication.outline.layout import flat_layout
from vinefab.fabrication.outline.stroke import Point
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour

LEAST_APART_MM = 50.0
"""Least distance between the two targets of a tile."""

APART_ENOUGH_MM = 150.0
"""Distance between targets beyond which no more film is spent on them (assumed)."""

_BESIDE_MM = (15.0, 30.0, 60.0, 120.0, 180.0, 240.0)
"""Distances from the robot's box within which targets are placed, before all of the window is."""

_GRID_MM = 5.0

TARGET = "registration target"
"""Label of the lines of a registration target."""

VERIFICATION = "verification mark"
"""Label of what a tile marks first of all, over the targets that it is aligned by."""

VERIFY = "verify"
"""Variant of verification marks, which gives them a layer of their own."""

_TURNS_RAD = (0.0, math.pi / 2, math.pi / 4, -math.pi / 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tiled:
    """A robot in tiles, in the coordinates of its film."""

    placement: BedPlacement  # of the whole robot
    tiles: tuple[FilmTile, ...]
    film_mm: Point = (0.0, 0.0)  # lower left corner of the film


def tiled(
    design: Design, body: BodyPaths, profile: LaserProfile, *, pass_through: bool = False
) -> Tiled | str:
    """Return a robot in as few tiles as the rotations tried allow, or why it cannot be tiled."""
    room, margin = profile.machine.usable_mm, profile.machine.margin_mm.value
    contours = [path.contour for path in body.paths]
    best = place_contours(contours, (1e9, room[1]) if pass_through else room, margin)
    found: list[tuple[int, Tiled, list[LaserPath]]] = []
    reasons: dict[int, str] = {}
    for row, turn in enumerate(
        dict.fromkeys((best.angle_rad, *(() if pass_through else _TURNS_RAD)))
    ):
        placement = replace(placed_at(contours, turn, room, margin), fits=False)
        paths = [replace(path, contour=placement.moved(path.contour)) for path in body.paths]
        try:
            tiles = film_tiles(_axes(design, placement), paths, room, pass_through=pass_through)
        except NoTilesError as error:
            reasons[row] = str(error)
        else:
            found.append((row, Tiled(placement=placement, tiles=tuple(tiles)), paths))
    # Targets take longest to place, so the fewest tiles come first.
    for row, one, paths in sorted(found, key=lambda option: len(option[1].tiles)):
        try:
            register(one.tiles, room, [path.contour for path in paths])
        except NoTilesError as error:
            reasons[row] = str(error)
        else:
            return one
    return reasons[min(reasons)]


def register(tiles: Sequence[FilmTile], room_mm: Point, contours: Sequence[Contour]) -> None:
    """Place two targets for each tile after the first, which an earlier tile makes."""
    taken = shapely.union_all([region(contour) for contour in contours])
    robot = reduce(union_box, (contour.box_mm for contour in contours))
    for row, tile in enumerate(tiles):
        if tile.after is None:
            continue
        others = [tile.after, *(other for other in range(row) if other != tile.after)]
        for other in others:
            pair = near_pair(_shared(tile.low_mm, tiles[other].low_mm, room_mm), robot, taken)
            if pair:
                tile.after, tile.found_mm = other, pair
                tiles[other].made_mm += pair
                crosses = [shapely.Point(point).buffer(TARGET_MM) for point in pair]
                taken = shapely.union_all([taken, *crosses])
                break
        else:
            raise NoTilesError(f"tile {row + 1} has no room for two registration targets")


def _shared(one: Point, two: Point, room_mm: Point) -> Box:
    """Return the overlap of two windows, reduced by the size of a target."""
    rim = TARGET_MM / 2.0 + 0.5
    low = [max(a, b) + rim for a, b in zip(one, two, strict=True)]
    high = [min(a, b) + room - rim for a, b, room in zip(one, two, room_mm, strict=True)]
    return low[0], low[1], high[0], high[1]


def near_pair(box: Box, robot: Box, taken: shapely.Geometry) -> list[Point]:
    """Return two free points of a box that are far enough apart, or else as far as possible.

    Points near the robot's own box are preferred: film that holds only a target is wasted.
    """
    for beside_mm in _BESIDE_MM:
        low = [max(a, b - beside_mm) for a, b in zip(box[:2], robot[:2], strict=True)]
        high = [min(a, b + beside_mm) for a, b in zip(box[2:], robot[2:], strict=True)]
        pair = _pair((low[0], low[1], high[0], high[1]), taken)
        if pair and math.dist(*pair) >= APART_ENOUGH_MM:
            return pair
    return _pair(box, taken)


def _pair(box: Box, taken: shapely.Geometry) -> list[Point]:
    """Return the two free points of a box that are farthest apart, or nothing."""
    free = free_grid(box, taken)
    if len(free) < 2:
        return []
    corners = shapely.get_coordinates(shapely.MultiPoint(free).convex_hull)
    apart = np.hypot(*(corners[:, None] - corners[None]).transpose(2, 0, 1))
    one, two = np.unravel_index(int(apart.argmax()), apart.shape)
    if apart[one, two] < LEAST_APART_MM:
        return []
    return [(float(x), float(y)) for x, y in (corners[one], corners[two])]


def free_grid(box: Box, taken: shapely.Geometry) -> Floats:
    """Return points of a grid over a box where a target is clear of all that is taken, (n, 2)."""
    if box[2] < box[0] or box[3] < box[1]:
        return np.empty((0, 2))
    across, up = (
        np.linspace(low, high, max(2, math.ceil((high - low) / _GRID_MM) + 1))
        for low, high in ((box[0], box[2]), (box[1], box[3]))
    )
    grid: Floats = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2)
    shapely.prepare(taken)
    clear = CLEAR_MM + TARGET_MM * math.sqrt(0.5)
    return grid[~shapely.dwithin(taken, shapely.points(grid), clear)]


def target_paths(tile: FilmTile, profile: LaserProfile) -> list[LaserPath]:
    """Return a tile's registration targets: those that it makes, then those that it finds.

    Where the laser can mark, a diagonal cross on each target found comes before both: if the film
    lies right, its middle is that of the cross that an earlier tile marked.
    """
    made = [mark(line, TARGET, "") for line in cross_lines(tile.made_mm)]
    verifying: list[LaserPath] = []
    if Operation.MARK in profile.recipe.by_operation:
        settings = profile.settings(Operation.MARK)
        verifying = [
            replace(mark(line, VERIFICATION, ""), variant=VERIFY, settings=settings)
            for line in cross_lines(tile.found_mm, turn_rad=math.pi / 4)
        ]
    else:
        made = [reg(path.contour) for path in made]
    return [*verifying, *made, *(reg(line) for line in cross_lines(tile.found_mm))]


def tile_jobs(
    name: str,
    profile: LaserProfile,
    parted: Tiled,
    marks: Sequence[LaserPath],
    facts: dict[str, object],
) -> tuple[Job, ...]:
    """Return one job per tile, in the order of cutting."""
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
                paths=in_order(
                    replace(path, contour=path.contour.moved(0.0, *shift)) for path in own
                ),
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


def reg(contour: Contour) -> LaserPath:
    """Return a line of a registration target as a path that is never cut."""
    return LaserPath(operation=Operation.REG, contour=contour, label=TARGET)


def cross_lines(middles_mm: Sequence[Point], turn_rad: float = 0.0) -> list[Contour]:
    """Return the two lines of a cross on each of some points, turned."""
    lines = []
    dx0, dy0 = TARGET_MM / 2.0 * math.cos(turn_rad), TARGET_MM / 2.0 * math.sin(turn_rad)
    for x, y in middles_mm:
        for dx, dy in ((dx0, dy0), (-dy0, dx0)):
            ends = np.array([[x - dx, y - dy], [x + dx, y + dy]])
            lines.append(Contour.polyline(ends, closed=False))
    return lines


def _seen(points_mm: Sequence[Point], shift_mm: Point) -> list[list[float]]:
    return [[x + shift_mm[0], y + shift_mm[1]] for x, y in points_mm]
