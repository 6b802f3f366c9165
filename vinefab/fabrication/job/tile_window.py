"""One tile of a robot: a window of the size of the bed onto its film."""

from dataclasses import dataclass, field

from vinefab.fabrication.job.marks import Box
from vinefab.model.job import LaserPath
from vinefab.outline.joint import Point

BranchRun = tuple[int, int]
"""A branch, and the number of a piece of it, counted from its base."""


@dataclass(slots=True)
class FilmTile:
    """One window onto the film."""

    pieces: set[BranchRun]  # the pieces of the robot in it
    box_mm: Box  # box around its paths
    paths: list[LaserPath] = field(default_factory=list)  # in the coordinates of the whole robot
    low_mm: Point = (0.0, 0.0)  # lower left corner of its window
    after: int | None = None  # number of the earlier tile that it is aligned to; None for the first
    found_mm: list[Point] = field(default_factory=list)  # targets that it is aligned to
    made_mm: list[Point] = field(default_factory=list)  # targets that it makes for later tiles
    verified: bool = True  # whether the machine marks the targets found once more, to verify them
    # the same on the robot, where it is parted
    strip_found_mm: list[Point] = field(default_factory=list)
    strip_made_mm: list[Point] = field(default_factory=list)
