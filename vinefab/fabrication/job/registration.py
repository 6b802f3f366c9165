"""Pin holes and crosses of a sheet that leaves the bed to be sealed by hand, and comes back.

Pins in a board on the bed hold it where it lay. Three holes fit one way only; two crosses, marked
on the film and drawn on the layer that is never cut, tell by the pointer whether it lies right.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
import shapely

from vinefab.fabrication.job.marks import Box, mark, region
from vinefab.fabrication.job.passes import sealed_by_hand
from vinefab.fabrication.job.tile_jobs import TARGET, cross_lines, free_grid, near_pair, reg
from vinefab.fabrication.job.tiling import TARGET_MM, union_box
from vinefab.fabrication.outline.stroke import Point
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile, SealerSettings
from vinefab.model.outline import Contour, Part

PIN_HOLE = "pin hole"
"""Label of the holes by which a sheet is put back."""

HOLES = "holes"
"""Variant of pin holes, which gives them a layer of their own and the settings of the cut."""

LEAST_PINS = 2


def registration(
    paths: Sequence[LaserPath], profile: LaserProfile, within: Box, *, separate: bool = False
) -> tuple[LaserPath, ...]:
    """Return pin holes and crosses for a sheet that is sealed by hand; none for any other.

    Fewer than `LEAST_PINS` holes where there is no room; rule VF-L01 says so.
    """
    weld = profile.recipe.by_operation.get(Operation.WELD)
    if not isinstance(weld, SealerSettings) or not sealed_by_hand(profile, separate=separate):
        return ()
    rim = TARGET_MM / 2.0 + 0.5
    room = within[0] + rim, within[1] + rim, within[2] - rim, within[3] - rim
    robots = reduce(union_box, (path.contour.box_mm for path in paths))
    taken = shapely.union_all([region(path.contour) for path in paths])
    holes = near_pair(room, robots, taken)
    if holes:
        grid = free_grid(room, shapely.union_all([taken, *map(_around, holes)]))
        line = shapely.LineString(holes)
        apart = np.asarray(shapely.distance(shapely.points(grid), line))
        near = np.asarray(shapely.dwithin(shapely.box(*robots), shapely.points(grid), 2.0 * rim))
        if len(grid) and (score := np.where(near, apart, 0.0)).max() > TARGET_MM:
            x, y = grid[int(score.argmax())].tolist()
            holes = [*holes, (x, y)]
    crosses = near_pair(room, robots, shapely.union_all([taken, *map(_around, holes)]))
    can_mark = Operation.MARK in profile.recipe.by_operation
    lines = cross_lines(crosses) if holes else []
    cut = profile.settings(Operation.CUT)
    radius_mm = weld.pin_mm.value / 2.0 - cut.kerf_mm.value / 2.0
    return (
        *(mark(line, TARGET, "") for line in lines if can_mark),
        *(
            replace(mark(_circle(at, radius_mm), PIN_HOLE, ""), variant=HOLES, settings=cut)
            for at in holes
        ),
        *(reg(line) for line in lines),
    )


def _around(point: Point) -> shapely.Geometry:
    return shapely.Point(point).buffer(TARGET_MM)


def _circle(middle: Point, radius_mm: float) -> Contour:
    """Return a circle of four arcs, which every format holds exactly."""
    x, y = middle
    quarters = [(radius_mm, 0.0), (0.0, radius_mm), (-radius_mm, 0.0), (0.0, -radius_mm)]
    return Contour(
        points_mm=np.array([(x + dx, y + dy) for dx, dy in quarters]),
        bulges=np.full(4, math.tan(math.pi / 8.0)),
        parts=(Part.OTHER,) * 4,
        branches=("",) * 4,
        closed=True,
    )
