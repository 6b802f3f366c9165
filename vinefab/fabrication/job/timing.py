"""When machines run each path: from speeds, accelerations, and the ways of tools down and up."""

import math
from dataclasses import dataclass
from itertools import pairwise

from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import HeadMachine
from vinefab.model.outline import Contour

CORNER_RAD = math.radians(5.0)
"""The head stops where a path turns by more than this at a point."""


def move_time_s(
    length_mm: float,
    speed_mm_s: float,
    acceleration_mm_s2: float,
    ends_mm_s: tuple[float, float] = (0.0, 0.0),
) -> float:
    """Return the time of a move between two speeds: up, along at full speed, down.

    >>> move_time_s(100.0, 50.0, 1000.0)
    2.05
    >>> move_time_s(0.4, 50.0, 1000.0)  # too short to reach full speed
    0.04
    """
    if length_mm == 0.0:
        return 0.0
    first, last = ends_mm_s
    peak = min(speed_mm_s, math.sqrt((first**2 + last**2) / 2.0 + acceleration_mm_s2 * length_mm))
    ramps_mm = (2.0 * peak**2 - first**2 - last**2) / (2.0 * acceleration_mm_s2)
    along_s = max(0.0, length_mm - ramps_mm) / peak
    return (2.0 * peak - first - last) / acceleration_mm_s2 + along_s


def segment_times_s(
    contour: Contour, speed_mm_s: float, acceleration_mm_s2: float
) -> tuple[float, ...]:
    """Return the time that each line and arc of a contour takes in one pass."""
    segments = list(contour.segments)
    lengths = [segment.length_mm for segment in segments]
    tops = [min(speed_mm_s, math.sqrt(acceleration_mm_s2 * s.radius_mm)) for s in segments]
    # At the start, at every joint between segments, and at the end.
    speeds = [0.0]
    speeds += [
        0.0 if abs(before.corner_rad(after)) > CORNER_RAD else min(two)
        for (before, after), two in zip(pairwise(segments), pairwise(tops), strict=True)
    ]
    speeds.append(0.0)
    for at, length in enumerate(lengths):
        speeds[at + 1] = min(speeds[at + 1], _reached(speeds[at], length, acceleration_mm_s2))
    for at in range(len(lengths) - 1, -1, -1):
        speeds[at] = min(speeds[at], _reached(speeds[at + 1], lengths[at], acceleration_mm_s2))
    return tuple(
        move_time_s(length, top, acceleration_mm_s2, ends)
        for length, top, ends in zip(lengths, tops, pairwise(speeds), strict=True)
    )


def _reached(speed: float, length: float, acceleration: float) -> float:
    return math.sqrt(speed**2 + 2.0 * acceleration * length)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathPass:
    """One pass along one path."""

    path: LaserPath
    begins_s: float  # when the beam is switched on, from the start of the job
    times_s: tuple[float, ...]  # how long each line and arc takes

    @property
    def ends_s(self) -> float:
        """When the beam goes off."""
        return self.begins_s + math.fsum(self.times_s)


def schedule(job: Job, profile: LaserProfile) -> tuple[PathPass, ...]:
    """Return every pass of a job in the order in which its machines run it.

    The head rests at both ends of a path, where some tools are lowered and lifted. Travel is
    straight at the machine's top speed, in process order, from the sheet's lower left. What people
    do by hand is not included.
    """
    runs: list[PathPass] = []
    now, head = 0.0, (0.0, 0.0)
    for path in (path for op in Operation if op.is_machined for path in job.along(op)):
        settings, (start, end) = path.settings_in(profile), path_ends(path)
        machine = profile.machine_of(settings.tool)
        if not isinstance(machine, HeadMachine) or settings.head_speed is None:
            continue
        acceleration, top = machine.acceleration_mm_s2.value, machine.speed_max_mm_s.value
        times = segment_times_s(path.contour, settings.head_speed.value, acceleration)
        down_s, up_s = settings.lowered_s(machine)
        for _ in range(settings.passes):
            now += move_time_s(math.dist(head, start), top, acceleration) + down_s
            runs.append(PathPass(path=path, begins_s=now, times_s=times))
            now, head = runs[-1].ends_s + up_s, end
    return tuple(runs)


def path_ends(path: LaserPath) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where a path begins and where it ends."""
    first, last = path.contour.points_mm[0], path.contour.points_mm[-1]
    start = float(first[0]), float(first[1])
    return start, start if path.contour.closed else (float(last[0]), float(last[1]))
