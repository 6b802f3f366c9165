"""The marks of all robots on a sheet, and what of them found no room."""

from collections.abc import Sequence
from dataclasses import dataclass

from vinefab.geometry.font import unwritten
from vinefab.geometry.marks import Box, Free, fold_ticks, label_lines, label_paths, mark
from vinefab.geometry.robot import Robot
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marking:
    """Marks of a sheet.

    Parameters
    ----------
    paths
        The marks.
    left_out
        In words, what should have been marked and was not.
    """

    paths: tuple[LaserPath, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def facts(self) -> dict[str, object]:
        """What a job records of it."""
        return {"marks_left_out": list(self.left_out)} if self.left_out else {}


def marks_of(
    robots: Sequence[Robot], bodies: Sequence[LaserPath], profile: LaserProfile, within: Box
) -> Marking:
    """Return fold lines and labels of robots, as far as there is room for them.

    Parameters
    ----------
    robots
        The robots; those without a place get none.
    bodies
        All paths that marks must stay clear of.
    profile
        Marks are made only where the recipe can mark.
    within
        The part of the sheet that marks may use.
    """
    if Operation.MARK not in profile.recipe.operations:
        return Marking()
    free = Free(bodies, within)
    placed = [robot for robot in robots if robot.placement]
    folds = [_fold(robot, free) for robot in placed]
    for path in (path for fold in folds for path in fold.paths):
        free.take(Free([path], within).taken)
    labels = [_label(robot, free, profile) for robot in placed]
    made = [*folds, *labels]
    return Marking(
        paths=tuple(path for one in made for path in one.paths),
        left_out=tuple(words for one in made for words in one.left_out),
    )


def _fold(robot: Robot, free: Free) -> Marking:
    """Return the ends of the line along which the tail is folded; one of them tells where."""
    label = f"fold line of {robot.title}"
    ticks = [robot.on_sheet(tick) for tick in fold_ticks(robot.design, robot.body.reach_mm)]
    paths = tuple(mark(tick, label, robot.design.name) for tick in ticks if free.has(tick))
    return Marking(paths=paths, left_out=() if paths else (f"no room for the {label}",))


def _label(robot: Robot, free: Free, profile: LaserProfile) -> Marking:
    name = robot.design.name
    lines = label_lines(name, profile, (robot.number, robot.count))
    tail = robot.on_sheet(robot.body.outline.contour).points_mm
    x, y = ((tail[0] + tail[-1]) / 2.0).tolist()
    label = f"label of {robot.title}"
    paths = label_paths(lines, free, (x, y), label, name)
    if not paths:
        return Marking(left_out=(f"no room for the {label}",))
    blank = unwritten("".join(lines))
    left_out = (f"no strokes for {blank} in the {label}",) if blank else ()
    return Marking(paths=paths, left_out=left_out)
