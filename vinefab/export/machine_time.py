"""How long the laser takes: path lengths, speeds, acceleration and travel."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, OperationSettings, Quantity
from vinefab.model.outline import Contour, Segment

CORNER_RAD = math.radians(5.0)
"""The head is taken to stop where a path turns by more than this at a point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineTime:
    """An estimate of a job's time on the machine.

    Parameters
    ----------
    work_s
        Time with the beam on, by operation, all passes.
    travel_s
        Time between paths with the beam off.
    inputs
        The quantities that the estimate rests on.
    """

    work_s: Mapping[Operation, float]
    travel_s: float
    inputs: tuple[Quantity, ...]

    @property
    def total_s(self) -> float:
        """Work and travel together."""
        return math.fsum(self.work_s.values()) + self.travel_s


def machine_time(job: Job, profile: LaserProfile) -> MachineTime:
    """Return how long a job should take.

    The head is at rest at both ends of a path and at its corners; between them it speeds up and
    slows down at the machine's acceleration, and in an arc of radius r it keeps below sqrt(a r).
    Travel is straight at the machine's top speed, in the job's order, from the sheet's lower left.

    Parameters
    ----------
    job
        The paths.
    profile
        Speeds and passes from its recipe, acceleration and top speed from its machine.

    Raises
    ------
    BadInputError
        If the recipe lacks an operation of the job.
    """
    machine = profile.machine
    acceleration = machine.acceleration_mm_s2.value
    work = dict.fromkeys((op for op in Operation if op.is_machined and job.along(op)), 0.0)
    inputs = [machine.acceleration_mm_s2, machine.speed_max_mm_s]
    travel, head = 0.0, (0.0, 0.0)
    for operation in work:
        settings = profile.settings(operation)
        inputs.append(settings.speed_mm_s)
        for path in job.along(operation):
            start, end = _ends(path)
            work[operation] += _path_time_s(path, settings, acceleration)
            hops = [(head, start)] + [(end, start)] * (settings.passes - 1)
            travel += math.fsum(
                move_time_s(math.dist(*hop), machine.speed_max_mm_s.value, acceleration)
                for hop in hops
            )
            head = end
    return MachineTime(work_s=work, travel_s=travel, inputs=tuple(inputs))


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


def contour_time_s(contour: Contour, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Return the time of one pass along a contour.

    Each stretch between corners is one move at the mean of what its lines and arcs allow.
    """
    total = 0.0
    for stretch in _stretches(list(contour.segments)):
        length = math.fsum(segment.length_mm for segment in stretch)
        cruise = math.fsum(
            segment.length_mm / min(speed_mm_s, math.sqrt(acceleration_mm_s2 * segment.radius_mm))
            for segment in stretch
        )
        total += move_time_s(length, length / cruise, acceleration_mm_s2) if cruise else 0.0
    return total


def _path_time_s(path: LaserPath, settings: OperationSettings, acceleration: float) -> float:
    one = contour_time_s(path.contour, settings.speed_mm_s.value, acceleration)
    return settings.passes * one


def _stretches(segments: list[Segment]) -> list[list[Segment]]:
    stretches = [[segments[0]]]
    for before, after in pairwise(segments):
        turn = after.direction_rad() - before.direction_rad(at_end=True)
        if abs(math.remainder(turn, math.tau)) > CORNER_RAD:
            stretches.append([])
        stretches[-1].append(after)
    return stretches


def _ends(path: LaserPath) -> tuple[tuple[float, float], tuple[float, float]]:
    first, last = path.contour.points_mm[0], path.contour.points_mm[-1]
    start = float(first[0]), float(first[1])
    return start, start if path.contour.closed else (float(last[0]), float(last[1]))
