"""How long the laser takes: path lengths, speeds, acceleration and travel."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.export.motion import contour_time_s, move_time_s
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, OperationSettings, Quantity


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

    The head is at rest at both ends of a path and at its corners (see `vinefab.export.motion`).
    Travel is straight at the machine's top speed, in process order, from the sheet's lower left.
    What an impulse sealer does is not counted.

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
    work = dict.fromkeys(lasered(job, profile), 0.0)
    inputs = [machine.acceleration_mm_s2, machine.speed_max_mm_s]
    travel, head = 0.0, (0.0, 0.0)
    for operation in work:
        for path in job.along(operation):
            settings = path.settings_in(profile)
            inputs.append(settings.speed_mm_s)
            start, end = path_ends(path)
            work[operation] += _path_time_s(path, settings, acceleration)
            hops = [(head, start)] + [(end, start)] * (settings.passes - 1)
            travel += math.fsum(
                move_time_s(math.dist(*hop), machine.speed_max_mm_s.value, acceleration)
                for hop in hops
            )
            head = end
    return MachineTime(work_s=work, travel_s=travel, inputs=tuple(inputs))


def lasered(job: Job, profile: LaserProfile) -> tuple[Operation, ...]:
    """Return the operations of a job that the laser runs, in process order.

    Raises
    ------
    BadInputError
        If the recipe lacks an operation of the job.
    """
    machined = (op for op in Operation if op.is_machined and job.along(op))
    return tuple(
        op for op in machined if all(p.settings_in(profile).by_laser for p in job.along(op))
    )


def _path_time_s(path: LaserPath, settings: OperationSettings, acceleration: float) -> float:
    one = contour_time_s(path.contour, settings.speed_mm_s.value, acceleration)
    return settings.passes * one


def path_ends(path: LaserPath) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where a path begins and where it ends."""
    first, last = path.contour.points_mm[0], path.contour.points_mm[-1]
    start = float(first[0]), float(first[1])
    return start, start if path.contour.closed else (float(last[0]), float(last[1]))
