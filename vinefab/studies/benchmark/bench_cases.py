"""What the benchmark grows, and measuring times."""

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from vinefab.core.rng import child
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose


def least_s(work: Callable[[], object], times: int = 5, *, wall_clock: bool = False) -> float:
    """Return the least time that some work takes."""
    (found,) = least_each_s((work,), times, wall_clock=wall_clock)
    return found


def least_each_s(
    works: Sequence[Callable[[], object]], times: int = 5, *, wall_clock: bool = False
) -> list[float]:
    """Return the least time that each of some works takes, done in turns.

    A processor that is faster at one time than at another is so for all of them: what counts is
    how they compare.
    """
    clock = time.perf_counter if wall_clock else time.process_time
    for work in works:
        work()
    found = [math.inf] * len(works)
    for _ in range(times):
        for number, work in enumerate(works):
            began = clock()
            work()
            found[number] = min(found[number], clock() - began)
    return found


_STREAM = 1901

CELLS = 7
"""Cells along one side of the smallest map, which has about 300 walls."""

WALLS_PER_CELL = 5.5
"""What the default Grid has; from its largest maps."""

CELL_MM = 500.0 / CELLS

OPTIONS = GrowthOptions(children_of_stuck="deploy")
"""Children of stuck branches grow, so that every branch of every growth counts."""


def tree_of_40() -> Design:
    """Return a design with 1 + 3 + 9 + 27 branches that fills the smallest map."""
    fans = ((150.0, 110.0), (120.0, 90.0), (90.0, 80.0))
    return Design(
        name="bench",
        trunk_length_mm=200.0,
        levels=tuple(
            Level(branches=3, length_mm=length, fan_rad=math.radians(fan), growth=0.8)
            for length, fan in fans
        ),
        build=Build.standard(4),
    )


def square_map(walls: int) -> Map:
    """Return a Grid map of about so many walls, always with the same density."""
    cells = round(math.sqrt(walls / WALLS_PER_CELL))
    options = GridOptions(columns=cells, rows=cells, size_mm=cells * CELL_MM)
    return grid_map(1, options)


def free_poses(terrain: Terrain, count: int) -> tuple[Pose, ...]:
    """Return poses anywhere in the free space of a map, heading anywhere."""
    rng = child(0, _STREAM)
    width_mm, height_mm = terrain.world.size_mm
    poses: list[Pose] = []
    while len(poses) < count:
        x, y, turn = rng.uniform(0.0, 1.0, 3).tolist()
        pose = Pose(x_mm=x * width_mm, y_mm=y * height_mm, heading_rad=turn * math.tau)
        if terrain.is_free(pose):
            poses.append(pose)
    return tuple(poses)


def batch_on(terrain: Terrain, poses: tuple[Pose, ...]) -> Batch:
    """Return the growths of the tree from some poses on a map."""
    launches = Launches.of(TerrainSet([terrain]), [poses])
    return Batch(Plans.of([tree_of_40()], OPTIONS), launches, OPTIONS)


def events(batch: Batch) -> int:
    """Return the number of events in all growths of a batch."""
    return int(np.sum(list(batch.each(lambda block: int(block.growth.events.sum())))))
