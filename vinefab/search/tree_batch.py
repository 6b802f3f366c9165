"""Many trees of any shape as arrays: what growth and the penalty of a search take."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.model.design import Design
from vinefab.model.tree import BranchTree


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TreeBatch:
    """Trees, m of them, and their straight parts one tree after the other, parents first.

    Rows are in the order of `vinefab.model.tree.BranchTree.straight`: a branch with preformed bends
    is several rows, each the only child of the one before; siblings follow each other, clockwise
    first.
    """

    trees: tuple[BranchTree, ...]  # the planned trees, with their bends
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
        return cls(
            trees=tuple(trees),
            first=np.cumsum([0, *map(len, parts)]),
            parent=np.concatenate([one.parent for one in parts]),
            level=np.concatenate([one.level for one in parts]),
            branch=np.concatenate([one.branch for one in parts]),
            offset_rad=np.concatenate([one.offset_rad for one in parts]),
            length_mm=np.concatenate([one.length_mm for one in parts]),
            width_mm=np.concatenate([one.width_mm for one in parts]),
            end_width_mm=np.concatenate([one.end_width_mm for one in parts]),
            fillet_mm=np.concatenate([one.fillet_mm for one in parts]),
        )

    @classmethod
    def of_designs(cls, designs: Sequence[Design]) -> "TreeBatch":
        """Return the trees of some designs, at least one, written either way."""
        return cls.of([design.tree for design in designs])

    @property
    def sizes(self) -> Ints:
        """Number of branches of each tree, shape (m,)."""
        return np.array([len(tree) for tree in self.trees])

    @property
    def depth(self) -> Ints:
        """Number of levels of each tree, the trunk included, shape (m,)."""
        return np.array([int(tree.level.max()) for tree in self.trees])

    @property
    def is_bent(self) -> NDArray[np.bool_]:
        """Whether each row continues its branch behind a bend."""
        before = np.where(self.parent < 0, 0, self.parent)
        start = np.repeat(self.first[:-1], np.diff(self.first))
        bent: NDArray[np.bool_] = (self.parent >= 0) & (self.branch == self.branch[start + before])
        return bent

    def part(self, rows: Ints) -> "TreeBatch":
        """Return some of the trees, at least one."""
        return TreeBatch.of([self.trees[row] for row in rows.tolist()])
