"""The steps of a job: paths that run at once, with one setting."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby

from vinefab.fabrication.job.tiling import HOLES, VERIFY
from vinefab.model.job import Job, LaserPath, Operation

_OPERATIONS = tuple(Operation)
# The alignment of a tile is verified before anything else; pin holes come after the marks.
_VARIANTS = {VERIFY: 0, "": 1, HOLES: 2}


def process_place(path: LaserPath) -> tuple[int, int]:
    """Return the place of a path's operation and variant in process order."""
    return _OPERATIONS.index(path.operation), _VARIANTS.get(path.variant, 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JobStep:
    """Paths of one operation and variant."""

    operation: Operation
    variant: str
    paths: tuple[LaserPath, ...]  # in the order in which they run

    @property
    def name(self) -> str:
        """A name that no other step of its job has; its files end in it."""
        return self.variant or str(self.operation)

    @property
    def length_mm(self) -> float:
        """Length of its paths, one pass."""
        return sum(path.contour.length_mm for path in self.paths)

    def job_of(self, whole: Job) -> Job:
        """Return the job that this step is alone."""
        return replace(whole, paths=self.paths)


def steps_of(job: Job, takes: Callable[[LaserPath], bool] = lambda _: True) -> tuple[JobStep, ...]:
    """Return what a machine runs of a job, in process order; lines for people are left out."""
    machined = [path for path in job.paths if path.operation.is_machined and takes(path)]
    groups = groupby(
        sorted(machined, key=process_place), key=lambda path: (path.operation, path.variant)
    )
    return tuple(
        JobStep(operation=operation, variant=variant, paths=tuple(paths))
        for (operation, variant), paths in groups
    )
