"""The least that the growths of a batch could take: what their tests alone take."""

from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.growth import kernel
from vinefab.growth.arrays import Growth, Launch
from vinefab.growth.simulator import rules_of
from vinefab.growth.terrain import Terrain
from vinefab.model.map import Pose
from vinefab.studies.benchmark.bench_cases import OPTIONS, batch_on, least_s


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
    walls, rules = terrain.walls(), rules_of(OPTIONS, terrain.tolerance_mm)
    wall_s = least_s(lambda: kernel.meet_all(walls, rules, tests.rays, tests.wall))
    corner_s = least_s(lambda: kernel.sweep_all(walls, rules, tests.sweeps, tests.corner))
    return Floor(
        wall_tests=len(tests.wall) / tests.events,
        corner_tests=len(tests.corner) / tests.events,
        wall_ns=1e9 * wall_s / len(tests.wall),
        corner_ns=1e9 * corner_s / len(tests.corner),
    )


def _tests(terrain: Terrain, poses: tuple[Pose, ...]) -> _Tests:
    """Return every test that some growths make, by running the kernel as plain Python."""
    batch = batch_on(terrain, poses)
    walls, rules = terrain.walls(), rules_of(OPTIONS, terrain.tolerance_mm)
    plan, rays, sweeps, count = batch.plans.each[0], [], [], 0
    plain = _plain_kernel()
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


def _plain_kernel() -> dict[str, Any]:
    """Return the kernel's names with functions that are not compiled and call each other."""
    plain: dict[str, Any] = dict(vars(kernel))
    for name, part in vars(kernel).items():
        if hasattr(part, "py_func"):
            plain[name] = FunctionType(part.py_func.__code__, plain, name)
    return plain
