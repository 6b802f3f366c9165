"""How long the laser takes: path lengths, speeds, acceleration and travel."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.export.schedule import lasered, schedule
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile, Quantity


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
    """Return how long a job should take, all its tiles if it has any.

    It is the sum of `vinefab.export.schedule.schedule` over what the machine runs. What people do
    between tiles is not in it.

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
    parts = [_sheet_time(run, profile) for run in job.runs]
    operations = dict.fromkeys(op for op in Operation if any(op in part.work_s for part in parts))
    return MachineTime(
        work_s={op: math.fsum(part.work_s.get(op, 0.0) for part in parts) for op in operations},
        travel_s=math.fsum(part.travel_s for part in parts),
        inputs=tuple(quantity for part in parts for quantity in part.inputs),
    )


def _sheet_time(job: Job, profile: LaserProfile) -> MachineTime:
    machine, runs = profile.machine, schedule(job, profile)
    work = {
        operation: math.fsum(
            t for run in runs if run.path.operation is operation for t in run.times_s
        )
        for operation in lasered(job, profile)
    }
    starts = [0.0, *(run.ends_s for run in runs)]
    travel = math.fsum(run.begins_s - start for run, start in zip(runs, starts, strict=False))
    speeds = [run.path.settings_in(profile).speed_mm_s for run in runs]
    inputs = (machine.acceleration_mm_s2, machine.speed_max_mm_s, *speeds)
    return MachineTime(work_s=work, travel_s=travel, inputs=inputs)
