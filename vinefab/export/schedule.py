"""When a laser runs each path of a job, from the first move to the last."""

import math
from dataclasses import dataclass

from vinefab.export.motion import move_time_s, segment_times_s
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """One pass along one path.

    Parameters
    ----------
    path
        The path.
    begins_s
        When the beam goes on, from the start of the job.
    times_s
        How long each line and arc takes.
    """

    path: LaserPath
    begins_s: float
    times_s: tuple[float, ...]

    @property
    def ends_s(self) -> float:
        """When the beam goes off."""
        return self.begins_s + math.fsum(self.times_s)


def schedule(job: Job, profile: LaserProfile) -> tuple[Run, ...]:
    """Return every pass of a job in the order in which the laser runs it.

    The head is at rest at both ends of a path and at its corners (see `vinefab.export.motion`).
    Travel is straight at the machine's top speed, in process order, from the sheet's lower left.
    What an impulse sealer does is not in it.

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
    acceleration, top = machine.acceleration_mm_s2.value, machine.speed_max_mm_s.value
    runs: list[Run] = []
    now, head = 0.0, (0.0, 0.0)
    for path in (path for op in lasered(job, profile) for path in job.along(op)):
        settings, (start, end) = path.settings_in(profile), path_ends(path)
        times = segment_times_s(path.contour, settings.speed_mm_s.value, acceleration)
        for _ in range(settings.passes):
            now += move_time_s(math.dist(head, start), top, acceleration)
            runs.append(Run(path=path, begins_s=now, times_s=times))
            now, head = runs[-1].ends_s, end
    return tuple(runs)


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


def path_ends(path: LaserPath) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where a path begins and where it ends."""
    first, last = path.contour.points_mm[0], path.contour.points_mm[-1]
    start = float(first[0]), float(first[1])
    return start, start if path.contour.closed else (float(last[0]), float(last[1]))
