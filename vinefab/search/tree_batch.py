"""Many trees of any shape as arrays: what growth and the penalty of a search take."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.model.design import Design
from vinefab.model.tree import BranchTree


class SomeOf(Sequence[BranchTree]):
    """Some of many trees, which are made on access."""

    def __init__(self, make: Callable[[int], BranchTree], rows: Ints) -> None:
        self._make, self._rows = make, rows

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> BranchTree: ...

    @overload
    def __getitem__(self, index: slice) -> "SomeOf": ...

    def __getitem__(self, index: int | slice) -> "BranchTree | SomeOf":
        """Return one tree, or some."""
        if isinstance(index, slice):
            return SomeOf(self._make, self._rows[index])
        return self._make(int(self._rows[index]))


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeBatch:
    """Trees, m of them, and their straight parts one tree after the other, parents first.

    Rows are in the order of `vinefab.model.tree.BranchTree.straight`: a branch with preformed bends
    is several rows, each the only child of the one before; siblings follow each other, clockwise
    first.
    """

    trees: Sequence[BranchTree]  # the planned trees, with their bends
    first: Ints  # where the rows of each tree begin, with the total at the end, shape (m + 1,)
    parent: Ints  # row within its tree, -1 for trunks
    level: Ints  # 1 for trunks
    branch: Ints  # that each row is a part of, within its tree
    offset_rad: Floats  # angle from the row before, counter-clockwise positive
    length_mm: Floats
    width_mm: Floats  # lay-flat, where the row begins
    end_width_mm: Floats  # and where it ends
    fillet_mm: Floats  # of the joint or elbow where the row begins; 0 for trunks

    def __len__(self) -> int:
        return len(self.trees)

    @classmethod
    def of(cls, trees: Sequence[BranchTree]) -> "TreeBatch":
        """Return some trees, at least one, together."""
        parts = [tree.straight for tree in trees]
        rows = {name: np.concatenate([getattr(one, name) for one in parts]) for name in _ROWS}
        return cls(trees=tuple(trees), first=np.cumsum([0, *map(len, parts)]), **rows)

    @classmethod
    def of_designs(cls, designs: Sequence[Design]) -> "TreeBatch":
        """Return the trees of some designs, at least one, written either way."""
        return cls.of([design.tree for design in designs])

    @cached_property
    def sizes(self) -> Ints:
        """Number of branches of each tree, shape (m,)."""
        return np.add.reduceat((~self.is_bent).astype(np.int64), self.first[:-1])

    @cached_property
    def depth(self) -> Ints:
        """Number of levels of each tree, the trunk included, shape (m,)."""
        return np.maximum.reduceat(self.level, self.first[:-1])

    @cached_property
    def is_bent(self) -> NDArray[np.bool_]:
        """Whether each row continues its branch behind a bend."""
        before = self.row_before
        bent: NDArray[np.bool_] = (before >= 0) & (self.branch == self.branch[before])
        return bent

    @cached_property
    def row_before(self) -> Ints:
        """The row that each row begins at the end of, among all; -1 for trunks."""
        start = np.repeat(self.first[:-1], np.diff(self.first))
        before: Ints = np.where(self.parent < 0, -1, start + self.parent)
        return before

    @cached_property
    def is_leaf(self) -> NDArray[np.bool_]:
        """Whether nothing begins at the end of each row."""
        leaf, before = np.ones(len(self.parent), dtype=np.bool_), self.row_before
        leaf[before[before >= 0]] = False
        return leaf

    @cached_property
    def generations(self) -> list[Ints]:
        """Rows whose rows before stand in the entry before: trunks first."""
        before, found = self.row_before, list[Ints]()
        rows = np.flatnonzero(before < 0)
        while len(rows):
            found.append(rows)
            is_here = np.zeros(len(before), dtype=np.bool_)
            is_here[rows] = True
            rows = np.flatnonzero((before >= 0) & is_here[before])
        return found

    @cached_property
    def base_width_mm(self) -> Floats:
        """Lay-flat width where the branch of each row begins."""
        width_mm, bent, before = self.width_mm.copy(), self.is_bent, self.row_before
        for rows in self.generations[1:]:
            behind = rows[bent[rows]]
            width_mm[behind] = width_mm[before[behind]]
        return width_mm

    def largest(self, values: Floats) -> Floats:
        """Return the largest value of the rows of each tree, shape (m,)."""
        return np.asarray(np.maximum.reduceat(values, self.first[:-1]))

    def sums(self, values: Floats) -> Floats:
        """Return the sum of one value of each row over the rows of each tree, shape (m,)."""
        return np.asarray(np.add.reduceat(values, self.first[:-1]))

    def part(self, rows: Ints) -> "TreeBatch":
        """Return some of the trees, at least one."""
        count = np.diff(self.first)[rows]
        first = np.concatenate([[0], np.cumsum(count)])
        place = np.arange(first[-1]) + np.repeat(self.first[rows] - first[:-1], count)
        some = {name: getattr(self, name)[place] for name in _ROWS}
        return TreeBatch(trees=SomeOf(self.trees.__getitem__, rows), first=first, **some)


_ROWS = (
    "parent",
    "level",
    "branch",
    "offset_rad",
    "length_mm",
    "width_mm",
    "end_width_mm",
    "fillet_mm",
)
"""Fields of a batch that have an entry for each row."""
