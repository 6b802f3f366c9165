"""The planned branches of a design, with parent, angle and length."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints, frozen_floats, frozen_ints
from vinefab.model.design import Design, Level, UnevenLevel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BranchTree:
    """All branches of a design, level by level, parents before children.

    The children of a branch follow each other from the clockwise-most to the counter-clockwise
    one. Index 0 is the trunk.

    Parameters
    ----------
    parent
        Index of each branch's parent, shape (n,); -1 for the trunk.
    level
        Level of each branch, shape (n,); 1 for the trunk.
    offset_rad
        Angle from the parent's heading to the branch's, counter-clockwise positive, shape (n,);
        0 for the trunk.
    length_mm
        Planned length, shape (n,).
    """

    parent: Ints
    level: Ints
    offset_rad: Floats
    length_mm: Floats

    def __len__(self) -> int:
        return len(self.parent)

    def __repr__(self) -> str:
        return (
            f"<BranchTree: {counted(len(self), 'branch')} on "
            f"{counted(int(self.level.max()), 'level')}, "
            f"{self.total_length_mm:.5g} mm>"
        )

    @property
    def ids(self) -> tuple[str, ...]:
        """The branches' names as paths: ``0``, ``0.0``, ``0.2``, ``0.2.1``."""
        names: list[str] = []
        used = [0] * len(self)
        for parent in self.parent.tolist():
            if parent < 0:
                names.append("0")
            else:
                names.append(f"{names[parent]}.{used[parent]}")
                used[parent] += 1
        return tuple(names)

    @property
    def is_leaf(self) -> NDArray[np.bool_]:
        """Whether each branch has no children, shape (n,)."""
        leaf = np.ones(len(self), dtype=np.bool_)
        leaf[self.parent[1:]] = False
        return leaf

    @property
    def total_length_mm(self) -> float:
        """Sum of all planned lengths: the film that the tree takes, as a length."""
        return float(self.length_mm.sum())


def fan_offsets_rad(level: Level) -> Floats:
    """Return the angles of one fan relative to the parent's heading, shape (branches,).

    Evenly spaced from ``-fan/2`` (clockwise) to ``+fan/2``; a single child goes straight on.
    An uneven level gives them one by one.
    """
    if isinstance(level, UnevenLevel):
        return np.radians(level.angles_deg)
    if level.branches == 1:
        return np.zeros(1)
    return _evenly(-level.fan_rad / 2, level.fan_rad / 2, level.branches)


def child_lengths_mm(level: Level) -> Floats:
    """Return the lengths of one fan's children, shape (branches,): linear from first to last.

    An uneven level gives them one by one.
    """
    if isinstance(level, UnevenLevel):
        return np.array(level.lengths_mm)
    return level.length_mm * _evenly(1.0, level.growth, level.branches)


def widest_turn_rad(level: Level) -> float:
    """Return the largest angle between a fan's children and the parent's heading."""
    if isinstance(level, UnevenLevel):
        return math.radians(max(map(abs, level.angles_deg)))
    return level.fan_rad / 2.0 if level.branches > 1 else 0.0


def least_gap_rad(level: Level) -> float:
    """Return the smallest angle between neighbours of a fan of two children or more."""
    if isinstance(level, UnevenLevel):
        return math.radians(min(two - one for one, two in pairwise(level.angles_deg)))
    return level.fan_rad / (level.branches - 1)


def _evenly(first: float, last: float, count: int) -> Floats:
    """Return `numpy.linspace` of three numbers, in a third of the time."""
    if count == 1:
        return np.array([first])
    values: Floats = np.arange(count, dtype=np.float64)
    values *= (last - first) / (count - 1)
    values += first
    values[-1] = last
    return values


def _repeated(values: Floats, count: int) -> Floats:
    """Return values repeated ``count`` times, as `numpy.tile` does."""
    return np.broadcast_to(values, (count, len(values))).ravel()


def branch_tree(design: Design) -> BranchTree:
    """Return every branch of a design, parents before children.

    Examples
    --------
    >>> from vinefab.model.design import Build
    >>> fork = Level(branches=2, length_mm=50.0, fan_rad=1.0)
    >>> design = Design(
    ...     name="y", trunk_length_mm=100.0, levels=(fork,), build=Build.standard(2)
    ... )
    >>> branch_tree(design).ids
    ('0', '0.0', '0.1')
    """
    parents, levels = [np.array([-1])], [np.array([1])]
    offsets, lengths = [np.zeros(1)], [np.array([design.trunk_length_mm])]
    first, count = 0, 1
    for number, level in enumerate(design.levels, start=2):
        parents.append(np.arange(first, first + count).repeat(level.branches))
        offsets.append(_repeated(fan_offsets_rad(level), count))
        lengths.append(_repeated(child_lengths_mm(level), count))
        first, count = first + count, count * level.branches
        levels.append(np.full(count, number))
    return BranchTree(
        parent=frozen_ints(np.concatenate(parents)),
        level=frozen_ints(np.concatenate(levels)),
        offset_rad=frozen_floats("offset_rad", np.concatenate(offsets)),
        length_mm=frozen_floats("length_mm", np.concatenate(lengths)),
    )
