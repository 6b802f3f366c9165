"""The planned branches of a design, and the flat pieces that they may be cut in."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vinefab.core.limits import rad
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints, frozen_floats, frozen_ints

if TYPE_CHECKING:
    from vinefab.model.design import Branch, Build, Level

Bend = tuple[float, float]
"""A preformed turn of a branch: mm from its base, degrees counter-clockwise."""

DEFAULT_FILLET_RATIO = 0.25
"""Fillet radius of a joint over its child's width, and inner radius of an elbow over its tube's."""


def default_fillet_mm(width_mm: float, ratio: float = DEFAULT_FILLET_RATIO) -> float:
    """Return the default fillet radius where a tube of some width begins; 2 mm or more."""
    return max(2.0, ratio * width_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BranchTree:
    """All branches of a design, level by level, parents before children.

    The children of a branch follow each other from the clockwise-most to the counter-clockwise
    one. Index 0 is the trunk. In the `straight` tree of a robot with preformed bends, each straight
    part of a branch is a row, the only child of the part before.

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
    width_mm, end_width_mm
        Lay-flat lumen width where the branch begins and where it ends, shape (n,).
    fillet_mm
        Designed fillet radius of the joint where the branch begins, shape (n,); 0 for the trunk.
    bend_branch, bend_mm, bend_rad
        Branch of each bend, rising, its distance from the branch's base, rising within a branch,
        and its turn, counter-clockwise positive; shape (b,). Bends of 0 degrees are left out.
    branch
        Branch that each row belongs to, shape (n,): rising from 0, but in a straight tree.
    """

    parent: Ints
    level: Ints
    offset_rad: Floats
    length_mm: Floats
    width_mm: Floats
    end_width_mm: Floats
    fillet_mm: Floats
    bend_branch: Ints
    bend_mm: Floats
    bend_rad: Floats
    branch: Ints

    @classmethod
    def of(  # noqa: PLR0913  the columns of a tree
        cls,
        *,
        parent: Ints,
        level: Ints,
        offset_rad: Floats,
        length_mm: Floats,
        build: "Build",
        width_mm: Floats | None = None,
        end_width_mm: Floats | None = None,
        fillet_mm: Floats | None = None,
        bends: Sequence[Sequence[Bend]] = (),
    ) -> "BranchTree":
        """Return a tree; widths and fillets that are left out are those of a build's levels.

        Parameters
        ----------
        bends
            Of each branch; empty: none has any. Bends at one place are one.
        """
        place = level - 1
        if width_mm is None:
            width_mm = np.array(build.widths_mm)[place]
        if end_width_mm is None:
            end_width_mm = np.array(build.end_widths_mm)[place]
        if fillet_mm is None:
            fillet_mm = np.array([0.0, *build.fillet_mm])[place]
        rows = [
            (branch, at_mm, turn_deg)
            for branch, own in enumerate(bends)
            for at_mm, turn_deg in _together(own)
        ]
        bend_branch, bend_mm, bend_deg = zip(*rows, strict=True) if rows else ((), (), ())
        return cls(
            parent=parent,
            level=level,
            offset_rad=offset_rad,
            length_mm=length_mm,
            width_mm=width_mm,
            end_width_mm=end_width_mm,
            fillet_mm=fillet_mm,
            bend_branch=frozen_ints(bend_branch),
            bend_mm=frozen_floats("bend_mm", bend_mm),
            bend_rad=frozen_floats("bend_rad", np.radians(bend_deg)),
            branch=np.arange(len(parent)),
        )

    def __len__(self) -> int:
        return len(self.parent)

    def __repr__(self) -> str:
        bends = f", {counted(len(self.bend_mm), 'bend')}" if len(self.bend_mm) else ""
        return (
            f"<BranchTree: {counted(len(self), 'branch')} on "
            f"{counted(int(self.level.max()), 'level')}{bends}, "
            f"{self.total_length_mm:.5g} mm>"
        )

    @property
    def ids(self) -> tuple[str, ...]:
        """The branches' names as paths: ``0``, ``0.0``, ``0.2``, ``0.2.1``.

        In a straight tree the part of ``0.2`` after its first bend is ``0.2/1``.
        """
        names: list[str] = []
        used = [0] * len(self)
        bent, number = self.is_bent.tolist(), [0] * len(self)
        for row, parent in enumerate(self.parent.tolist()):
            if parent < 0:
                names.append("0")
            elif bent[row]:
                number[row] = number[parent] + 1
                names.append(f"{names[parent].partition('/')[0]}/{number[row]}")
            else:
                names.append(f"{names[parent].partition('/')[0]}.{used[parent]}")
                used[parent] += 1
        return tuple(names)

    def bends_of(self, row: int) -> list[tuple[float, float]]:
        """Return the bends of one branch: mm from its base, and turn in radians."""
        own = self.bend_branch == row
        return list(zip(self.bend_mm[own].tolist(), self.bend_rad[own].tolist(), strict=True))

    @property
    def is_bent(self) -> NDArray[np.bool_]:
        """Whether each row of a straight tree continues behind a bend, shape (n,)."""
        bent: NDArray[np.bool_] = self.branch == self.branch[self.parent]
        bent[0] = False
        return bent

    @property
    def last_parts(self) -> Ints:
        """The row of a straight tree where each branch ends, shape (branches,)."""
        last = np.empty(int(self.branch.max()) + 1, dtype=np.int64)
        last[self.branch] = np.arange(len(self))  # the last part of a branch comes last
        return last

    @property
    def generations(self) -> list[Ints]:
        """Rows whose parents stand in the entry before: the trunk, its children and so on."""
        depth = self.level
        if self.is_bent.any():
            depth = np.ones(len(self), dtype=np.int64)
            for row, parent in enumerate(self.parent[1:].tolist(), start=1):
                depth[row] = depth[parent] + 1
        return [np.flatnonzero(depth == one) for one in range(1, int(depth.max()) + 1)]

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

    def laid_out(
        self, base_mm: tuple[float, float] = (0.0, 0.0), heading_rad: float = 0.0
    ) -> tuple[Floats, Floats, Floats]:
        """Return where the branches of a tree without bends lie where nothing is in the way.

        Parameters
        ----------
        base_mm, heading_rad
            Of the trunk.

        Returns
        -------
        tuple
            Base and end of each branch in mm, shape (n, 2) each, and its heading in rad, shape
            (n,).
        """
        heading = np.full(len(self), heading_rad)
        begin_mm, end_mm = np.zeros((2, len(self), 2))
        begin_mm[0] = base_mm
        for rows in self.generations:
            above = self.parent[rows]
            if above[0] >= 0:
                begin_mm[rows], heading[rows] = end_mm[above], heading[above]
            heading[rows] += self.offset_rad[rows]
            way = np.column_stack([np.cos(heading[rows]), np.sin(heading[rows])])
            end_mm[rows] = begin_mm[rows] + self.length_mm[rows, None] * way
        return begin_mm, end_mm, heading

    @property
    def key(self) -> tuple[bytes, ...]:
        """Everything as bytes: trees with the same key are equal."""
        return tuple(getattr(self, name).tobytes() for name in self.__slots__)

    @property
    def straight(self) -> "BranchTree":
        """The tree of the straight parts between bends; the tree itself without bends.

        Parts are ordered by level and, within one, by the number of bends before them. A part has
        its share of its branch's taper, and its bend an inner radius of a quarter of the width.
        """
        return self if not len(self.bend_mm) else _straight(self)

    def of_parts(self, parts: "BranchTree", offset_rad: Floats, length_mm: Floats) -> "BranchTree":
        """Return this tree with other angles and lengths of its straight parts.

        Parameters
        ----------
        parts
            Its `straight` tree.
        offset_rad, length_mm
            Of the parts.
        """
        offset_rad = frozen_floats("offset_rad", offset_rad)
        length_mm = frozen_floats("length_mm", length_mm)
        if parts is self:
            return replace(self, offset_rad=offset_rad, length_mm=length_mm)
        bent, until_mm = parts.is_bent, np.zeros(len(parts))
        for row, before in enumerate(np.where(bent, parts.parent, -1).tolist()):
            until_mm[row] = length_mm[row] + (until_mm[before] if before >= 0 else 0.0)
        rows = np.flatnonzero(bent)
        rows = rows[np.argsort(parts.branch[rows], kind="stable")]
        return replace(
            self,
            offset_rad=frozen_floats("offset_rad", offset_rad[~bent]),
            length_mm=frozen_floats("length_mm", until_mm[parts.last_parts]),
            bend_branch=frozen_ints(parts.branch[rows]),
            bend_mm=frozen_floats("bend_mm", until_mm[parts.parent[rows]]),
            bend_rad=frozen_floats("bend_rad", offset_rad[rows]),
        )

    def scaled(self, factor: float) -> "BranchTree":
        """Return the tree with all lengths times a factor; widths stay."""
        return replace(
            self,
            length_mm=frozen_floats("length_mm", self.length_mm * factor),
            bend_mm=frozen_floats("bend_mm", self.bend_mm * factor),
        )

    def taken(self, rows: Ints, length_mm: Floats) -> "BranchTree":
        """Return the tree of some branches, whole families of siblings, with other lengths.

        Bends beyond a branch's new length are left out.
        """
        place = np.full(len(self), -1)
        place[rows] = np.arange(len(rows))
        parent, own = self.parent[rows], place[self.bend_branch]
        length_mm = frozen_floats("length_mm", length_mm)
        kept = own >= 0
        kept[kept] = self.bend_mm[kept] < length_mm[own[kept]]
        return replace(
            self,
            parent=frozen_ints(np.where(parent < 0, -1, place[parent])),
            level=frozen_ints(self.level[rows]),
            offset_rad=frozen_floats("offset_rad", self.offset_rad[rows]),
            length_mm=length_mm,
            width_mm=frozen_floats("width_mm", self.width_mm[rows]),
            end_width_mm=frozen_floats("end_width_mm", self.end_width_mm[rows]),
            fillet_mm=frozen_floats("fillet_mm", self.fillet_mm[rows]),
            bend_branch=frozen_ints(own[kept]),
            bend_mm=frozen_floats("bend_mm", self.bend_mm[kept]),
            bend_rad=frozen_floats("bend_rad", self.bend_rad[kept]),
            branch=np.arange(len(rows)),
        )


def _together(bends: Sequence[Bend]) -> list[Bend]:
    """Return bends with those at one place added up, by their place, without those of 0 degrees."""
    at: dict[float, float] = {}
    for place_mm, turn_deg in sorted(bends):
        at[place_mm] = at.get(place_mm, 0.0) + turn_deg
    return [(place_mm, turn_deg) for place_mm, turn_deg in at.items() if turn_deg]


def fan_offsets_rad(level: "Level") -> Floats:
    """Return the angles of one fan relative to the parent's heading, shape (branches,).

    Evenly spaced from ``-fan/2`` (clockwise) to ``+fan/2``; a single child goes straight on.
    """
    if level.branches == 1:
        return np.zeros(1)
    return _evenly(-level.fan_rad / 2, level.fan_rad / 2, level.branches)


def child_lengths_mm(level: "Level") -> Floats:
    """Return the lengths of one fan's children, shape (branches,): linear from first to last."""
    return level.length_mm * _evenly(1.0, level.growth, level.branches)


def widest_turn_rad(level: "Level") -> float:
    """Return the largest angle between a fan's children and the parent's heading."""
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


def tree_of_levels(
    trunk_mm: float,
    design_levels: "Sequence[Level]",
    build: "Build",
    bends: Sequence[Sequence[Bend]],
) -> BranchTree:
    """Return every branch of a design of levels, parents before children.

    Parameters
    ----------
    bends
        Of each level's branches, the trunk's first.
    """
    parents, levels = [np.array([-1])], [np.array([1])]
    offsets, lengths = [np.zeros(1)], [np.array([trunk_mm])]
    first, count = 0, 1
    for number, level in enumerate(design_levels, start=2):
        parents.append(np.arange(first, first + count).repeat(level.branches))
        offsets.append(_repeated(fan_offsets_rad(level), count))
        lengths.append(_repeated(child_lengths_mm(level), count))
        first, count = first + count, count * level.branches
        levels.append(np.full(count, number))
    level_of = frozen_ints(np.concatenate(levels))
    return BranchTree.of(
        parent=frozen_ints(np.concatenate(parents)),
        level=level_of,
        offset_rad=frozen_floats("offset_rad", np.concatenate(offsets)),
        length_mm=frozen_floats("length_mm", np.concatenate(lengths)),
        build=build,
        bends=[bends[number - 1] for number in level_of.tolist()] if any(bends) else (),
    )


def tree_of_branches(
    trunk_mm: float,
    trunk_bends: Sequence[Bend],
    branches: "Sequence[Branch]",
    levels: Sequence[int],
    build: "Build",
) -> BranchTree:
    """Return the tree of branches that are given one by one, in the order of a tree.

    Parameters
    ----------
    levels
        Of the branches.
    """
    row = {"trunk": 0} | {branch.name: n for n, branch in enumerate(branches, start=1)}
    level = np.array([1, *levels])

    def own(usual: Floats, values: Sequence[float | None]) -> Floats:
        given = [one if value is None else value
                 for one, value in zip(usual.tolist(), (None, *values), strict=True)]  # fmt: skip
        return np.array(given)

    width_mm = own(np.array(build.widths_mm)[level - 1], [one.width_mm for one in branches])
    ratios = np.array(build.taper or (1.0,) * len(build.widths_mm))[level - 1]
    taper = own(ratios, [one.taper for one in branches])
    fillets_mm = np.array([0.0, *build.fillet_mm])[level - 1]
    return BranchTree.of(
        parent=frozen_ints([-1, *(row[branch.of] for branch in branches)]),
        level=frozen_ints(level),
        offset_rad=frozen_floats("angle_deg", [0.0, *(rad(one.angle_deg) for one in branches)]),
        length_mm=frozen_floats("length", [trunk_mm, *(one.length_mm for one in branches)]),
        build=build,
        width_mm=frozen_floats("width_mm", width_mm),
        end_width_mm=frozen_floats("taper", width_mm * taper),
        fillet_mm=frozen_floats("fillet_mm", own(fillets_mm, [one.fillet_mm for one in branches])),
        bends=[trunk_bends, *(one.bends or () for one in branches)],
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


@lru_cache(maxsize=64)
def _straight(tree: BranchTree) -> BranchTree:
    """Return the straight parts of a tree with bends; a tree is asked for them many times."""
    count = np.bincount(tree.bend_branch, minlength=len(tree))  # bends of each branch
    branch = np.repeat(np.arange(len(tree)), count + 1)
    first = np.cumsum(count + 1) - (count + 1)
    number = np.arange(len(branch)) - first[branch]  # bends before each part
    is_first = number == 0
    begin, turn = np.zeros((2, len(branch)))
    begin[~is_first], turn[~is_first] = tree.bend_mm, tree.bend_rad
    end = np.append(begin[1:], 0.0)
    is_last = number == count[branch]
    end[is_last] = tree.length_mm
    # Where each part stands after sorting, and the part before it.
    order = np.lexsort((branch, number, tree.level[branch]))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    last = first + count
    above = np.arange(len(branch)) - 1
    above[is_first] = np.append(last, -1)[tree.parent]
    parent = np.where(above < 0, -1, place[above])
    share = np.column_stack([begin, end]) / tree.length_mm[branch, None]
    fall = (tree.end_width_mm - tree.width_mm)[branch]
    width = tree.width_mm[branch] + share[:, 0] * fall
    end_width = tree.width_mm[branch] + share[:, 1] * fall
    end_width[is_last] = tree.end_width_mm
    fillet = np.where(
        is_first,
        tree.fillet_mm[branch],
        np.array([default_fillet_mm(one) for one in width.tolist()]),
    )
    none = np.zeros(0)
    return BranchTree(
        parent=frozen_ints(parent[order]),
        level=frozen_ints(tree.level[branch][order]),
        offset_rad=frozen_floats(
            "offset_rad", np.where(is_first, tree.offset_rad[branch], turn)[order]
        ),
        length_mm=frozen_floats("length_mm", (end - begin)[order]),
        width_mm=frozen_floats("width_mm", width[order]),
        end_width_mm=frozen_floats("end_width_mm", end_width[order]),
        fillet_mm=frozen_floats("fillet_mm", fillet[order]),
        bend_branch=frozen_ints(none),
        bend_mm=none,
        bend_rad=none,
        branch=frozen_ints(branch[order]),
    )
