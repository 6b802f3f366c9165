"""How long the laser takes: path lengths, speed limits, acceleration, stops and travel.

The head changes speed at one acceleration. It stops fully where a path turns by more than
`CORNER_RAD` at a point (no cornering speed is assumed), and in an arc of radius r it keeps below
sqrt(a r). Between those limits it is as fast as it can be: speeds are lowered from the end
backwards and raised from the start forwards, as a controller that looks ahead does.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, Quantity
from vinefab.model.outline import Contour, Segment

CORNER_RAD = math.radians(5.0)
"""The head stops where a path turns by more than this at a point."""


def move_time_s(length_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Return the time of a straight move from rest to rest.

    >>> move_time_s(100.0, 50.0, 1000.0)
    2.05
    >>> move_time_s(0.4, 50.0, 1000.0)  # too short to reach full speed
    0.04
    """
    if length_mm < speed_mm_s**2 / acceleration_mm_s2:
        return 2.0 * math.sqrt(length_mm / acceleration_mm_s2)
    return length_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2


def segment_times_s(
    contour: Contour, speed_mm_s: float, acceleration_mm_s2: float
) -> tuple[float, ...]:
    """Return the time that each line and arc of a contour takes in one pass."""
    segments = list(contour.segments)
    lengths = [segment.length_mm for segment in segments]
    tops = [min(speed_mm_s, math.sqrt(acceleration_mm_s2 * s.radius_mm)) for s in segments]
    speeds = _joint_speeds(segments, lengths, tops, acceleration_mm_s2)
    return tuple(
        _time_s(length, top, ends, acceleration_mm_s2)
        for length, top, ends in zip(lengths, tops, pairwise(speeds), strict=True)
    )


def _joint_speeds(
    segments: list[Segment], lengths: list[float], tops: list[float], acceleration: float
) -> list[float]:
    """Return the speed at the start, at every joint between segments and at the end."""
    speeds = [0.0]
    speeds += [
        0.0 if abs(math.remainder(turn_rad, math.tau)) > CORNER_RAD else min(two)
        for (before, after), two in zip(pairwise(segments), pairwise(tops), strict=True)
        for turn_rad in [after.direction_rad() - before.direction_rad(at_end=True)]
    ]
    speeds.append(0.0)
    for at, length in enumerate(lengths):
        speeds[at + 1] = min(speeds[at + 1], _reached(speeds[at], length, acceleration))
    for at in range(len(lengths) - 1, -1, -1):
        speeds[at] = min(speeds[at], _reached(speeds[at + 1], lengths[at], acceleration))
    return speeds


def _reached(speed: float, length: float, acceleration: float) -> float:
    return math.sqrt(speed**2 + 2.0 * acceleration * length)


def _time_s(length: float, top: float, ends: tuple[float, float], acceleration: float) -> float:
    """Return the time of one segment between two speeds: up, along at the top, down."""
    if length == 0.0:
        return 0.0
    first, last = ends
    peak = min(top, math.sqrt((first**2 + last**2) / 2.0 + acceleration * length))
    ramps = (2.0 * peak**2 - first**2 - last**2) / (2.0 * acceleration)
    return (2.0 * peak - first - last) / acceleration + max(0.0, length - ramps) / peak


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathPass:
    """One pass along one path."""

    path: LaserPath
    begins_s: float  # when the beam goes on, from the start of the job
    times_s: tuple[float, ...]  # how long each line and arc takes

    @property
    def ends_s(self) -> float:
        """When the beam goes off."""
        return self.begins_s + math.fsum(self.times_s)


def schedule(job: Job, profile: LaserProfile) -> tuple[PathPass, ...]:
    """Return every pass of a job in the order in which the laser runs it.

    The head rests at both ends of a path. Travel is straight at the machine's top speed, in process
    order, from the sheet's lower left. Seams made by an impulse sealer are not included.
    """
    machine = profile.machine
    acceleration, top = machine.acceleration_mm_s2.value, machine.speed_max_mm_s.value
    runs: list[PathPass] = []
    now, head = 0.0, (0.0, 0.0)
    for path in (path for op in laser_on_passes(job, profile) for path in job.along(op)):
        settings, (start, end) = path.settings_in(profile), path_ends(path)
        times = segment_times_s(path.contour, settings.speed_mm_s.value, acceleration)
        for _ in range(settings.passes):
            now += move_time_s(math.dist(head, start), top, acceleration)
            runs.append(PathPass(path=path, begins_s=now, times_s=times))
            now, head = runs[-1].ends_s, end
    return tuple(runs)


def laser_on_passes(job: Job, profile: LaserProfile) -> tuple[Operation, ...]:
    """Return the operations of a job that the laser runs, in process order."""
    machined = (op for op in Operation if op.is_machined and job.along(op))
    return tuple(
        op for op in machined if all(p.settings_in(profile).by_laser for p in job.along(op))
    )


def path_ends(path: LaserPath) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where a path begins and where it ends."""
    first, last = path.contour.points_mm[0], path.contour.points_mm[-1]
    start = float(first[0]), float(first[1])
    return start, start if path.contour.closed else (float(last[0]), float(last[1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineTime:
    """An estimate of a job's time on the machine."""

    work_s: Mapping[Operation, float]  # time with the beam on, by operation, all passes
    travel_s: float  # time between paths with the beam off
    inputs: tuple[Quantity, ...]  # the quantities that the estimate rests on

    @property
    def total_s(self) -> float:
        """Work and travel together."""
        return math.fsum(self.work_s.values()) + self.travel_s


def machine_time(job: Job, profile: LaserProfile) -> MachineTime:
    """Return how long a job should take, the sum of `schedule` over all its tiles if it has any.

    Moving and aligning the film between tiles is not included.
    """
    machine = profile.machine
    work_s: dict[Operation, list[float]] = {}
    travel_s: list[float] = []
    inputs: list[Quantity] = []
    for sheet in job.runs:
        inputs += [machine.acceleration_mm_s2, machine.speed_max_mm_s]
        rest_s = 0.0
        for run in schedule(sheet, profile):
            work_s.setdefault(run.path.operation, []).extend(run.times_s)
            travel_s.append(run.begins_s - rest_s)
            inputs.append(run.path.settings_in(profile).speed_mm_s)
            rest_s = run.ends_s
    return MachineTime(
        work_s={op: math.fsum(work_s[op]) for op in Operation if op in work_s},
        travel_s=math.fsum(travel_s),
        inputs=tuple(inputs),
    )
