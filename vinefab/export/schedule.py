"""When a laser runs each path of a job, from the first move to the last."""

import math
from dataclasses import dataclass

from vinefab.export.machine_time import lasered, path_ends
from vinefab.export.motion import move_time_s, segment_times_s
from vinefab.model.job import Job, LaserPath
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

    Travel and speeds are those of `vinefab.export.machine_time.machine_time`.

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
