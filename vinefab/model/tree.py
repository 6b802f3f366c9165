"""The planned branches of a design, and the flat pieces that they may be cut in."""

import math
from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A connected part of the branch tree that lies flat by itself.

    Branches are named by their index in the tree.
    """

    label: str  # A for the piece with the tail, then B, C, ...; AA after Z
    root: int  # the branch that it begins with: the trunk (0), or one that is cut
    branches: tuple[int, ...]  # the branches that end on it, its root among them, ascending
    stubs: tuple[int, ...] = ()  # the branches of which only the stub is on it


@dataclass(frozen=True, slots=True, kw_only=True)
class Sleeve:
    """Where two pieces meet: a plug in a socket, on a straight stretch of one branch.

    Distances are along the branch, from the joint or base where it begins. The plug is the stub's
    end, or where the stub has the socket the outer piece's base.
    """

    label: str  # that of the outer piece
    inner: str  # label of the piece with the stub
    branch: int  # index of the branch
    socket_mm: float  # rim of the socket
    plug_mm: float  # rim of the plug, one lap away
    blend_end_mm: float  # where the socket's blend ends and the branch has its own width
    rise_mm: float  # how far the socket's lumen edge lies outside the branch's, on each side
    width_mm: float  # lay-flat lumen width of the branch where the lap begins

    @property
    def socket_on_stub(self) -> bool:
        """Whether the outer piece goes into the stub, not over it."""
        return self.plug_mm < self.socket_mm

    @property
    def plug_on(self) -> str:
        """Label of the piece with the plug."""
        return self.label if self.socket_on_stub else self.inner

    @property
    def socket_on(self) -> str:
        """Label of the piece with the socket."""
        return self.inner if self.socket_on_stub else self.label

    @property
    def outer_from_mm(self) -> float:
        """Where the outer piece begins, and the lap."""
        return min(self.socket_mm, self.plug_mm)

    @property
    def stub_to_mm(self) -> float:
        """Where the stub ends, and the lap."""
        return max(self.socket_mm, self.plug_mm)

    @property
    def lap_mm(self) -> float:
        """How deep the plug goes into the socket."""
        return self.stub_to_mm - self.outer_from_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Unparted:
    """Bodies that must not lie on one piece, and that no cut parts."""

    why: str  # what happens where they lie on one piece: a predicate
    branches: tuple[int, ...]  # indices of the branches concerned
    between: tuple[int, ...]  # branches that would part them, had one of them the room
    room_mm: float  # longest straight side among these
    needed_mm: float  # straight side that a sleeve takes


@dataclass(frozen=True, slots=True, kw_only=True)
class Partition:
    """A robot in pieces; one that cannot be parted stays whole."""

    # from the base outward: the piece with the tail first; the whole robot if it is not cut
    pieces: tuple[Piece, ...]
    sleeves: tuple[Sleeve, ...] = ()  # of all pieces but the first, in their order
    proven_least: bool = True  # whether no fewer pieces are possible
    # Whether even these pieces do not pass: the search for the least number was given up, as it is
    # beyond what the design allows.
    unfinished: bool = False
    unparted: tuple[Unparted, ...] = ()  # why it cannot be cut in pieces that lie flat; else none

    def sleeve(self, branch: int) -> Sleeve:
        """Return the sleeve on a branch that is cut, by the branch's index."""
        return next(sleeve for sleeve in self.sleeves if sleeve.branch == branch)


def piece_label(number: int) -> str:
    """Return the label of a piece by its number from 0.

    >>> [piece_label(number) for number in (0, 25, 26)]
    ['A', 'Z', 'AA']
    """
    first, last = divmod(number, 26)
    return (piece_label(first - 1) if first else "") + chr(ord("A") + last)
