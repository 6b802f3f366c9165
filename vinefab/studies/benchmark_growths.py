"""What the benchmark grows, how it takes times, and the least that a growth could take."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vinefab.core.compiling import rebindable
from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints
from vinefab.growth import kernel
from vinefab.growth.arrays import Growth, Launch
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.simulator import KERNEL, rules_of
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

_CELLS = 7
"""Cells along one side of the smallest map, which has about 300 walls."""

WALLS_PER_CELL = 5.5
"""What the default Grid has; from its largest maps."""

_CELL_MM = 500.0 / _CELLS

BENCH_GROWTH = GrowthOptions(
    head_on_half_angle_rad=math.radians(1.0),
    children_of_stuck="deploy",
    body="centerline",
    pressure_stop=False,
)
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
    options = GridOptions(columns=cells, rows=cells, size_mm=cells * _CELL_MM)
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
    return Batch(Plans.of([tree_of_40()], BENCH_GROWTH), launches, BENCH_GROWTH)


def events(batch: Batch) -> int:
    """Return the number of events in all growths of a batch."""
    return int(np.sum(list(batch.each(lambda block: int(block.growth.events.sum())))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """Tests per event, and what they take in a loop of nothing else."""

    # wall_tests, corner_tests: tests of a ray against a wall, and of a turning body against a
    # corner, per event
    wall_tests: float
    corner_tests: float
    # wall_ns, corner_ns: time of one such test in a compiled loop over the tests of real growths
    wall_ns: float
    corner_ns: float

    @property
    def ns_per_event(self) -> float:
        """The floor."""
        return self.wall_tests * self.wall_ns + self.corner_tests * self.corner_ns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tests:
    """All tests of some growths."""

    events: int  # number of events that they belong to
    # what `vinefab.growth.kernel.meet_all` and ``sweep_all`` take
    rays: Floats
    wall: Ints
    sweeps: Floats
    corner: Ints


def floor_on(terrain: Terrain, poses: tuple[Pose, ...]) -> Floor:
    """Return the floor of the benchmark's growths on a map."""
    tests = _tests(terrain, poses)
    walls, rules = terrain.walls(), rules_of(BENCH_GROWTH, terrain.tolerance_mm)
    wall_s = least_s(lambda: kernel.meet_all(walls, rules, tests.rays, tests.wall))
    corner_s = least_s(lambda: kernel.sweep_all(walls, rules, tests.sweeps, tests.corner))
    return Floor(
        wall_tests=len(tests.wall) / tests.events,
        corner_tests=len(tests.corner) / tests.events,
        wall_ns=1e9 * wall_s / len(tests.wall),
        corner_ns=1e9 * corner_s / len(tests.corner),
    )


def _tests(terrain: Terrain, poses: tuple[Pose, ...]) -> _Tests:
    """Return every test that some growths make, from an interpreted kernel that notes them."""
    batch = batch_on(terrain, poses)
    walls, rules = terrain.walls(), rules_of(BENCH_GROWTH, terrain.tolerance_mm)
    plan, rays, sweeps, count = batch.plans.each[0], [], [], 0
    plain = rebindable(KERNEL)
    meeting, sweep_to = plain["_meeting"], plain["_sweep_to"]

    def note_ray(walls: Any, rules: Any, *ray: Any) -> Any:  # noqa: ANN401  as the kernel
        rays.append(ray)
        return meeting(walls, rules, *ray)

    def note_sweep(walls: Any, rules: Any, vertex: Any, *sweep: Any) -> Any:  # noqa: ANN401
        sweeps.append((*sweep[0], *sweep[1], sweep[2], vertex))
        return sweep_to(walls, rules, vertex, *sweep)

    plain["_meeting"], plain["_sweep_to"] = note_ray, note_sweep
    for start in batch.launches.start.tolist():
        growth = Growth.empty(len(plan), 20 * len(plan))
        plain["grow_branches"](walls, plan.arrays(), rules, Launch(*start), growth, 0, len(plan))
        count += int(growth.events.sum())
    ray, sweep = np.array(rays, dtype=np.float64), np.array(sweeps, dtype=np.float64)
    return _Tests(
        events=count,
        rays=np.ascontiguousarray(ray[:, :4]),
        wall=ray[:, 4].astype(np.int64),
        sweeps=np.ascontiguousarray(sweep[:, :12]),
        corner=sweep[:, 12].astype(np.int64),
    )
