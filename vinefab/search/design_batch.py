"""Many designs as arrays, with their planned trees.

A search evaluates thousands of designs a second. Building each as an object, with its tree, would
take as long as growing it, in one thread at a time. Results equal those of
`vinefab.search.space.Space.design`, `vinefab.model.tree.branch_tree` and
`vinefab.growth.plan.Plans.of` for single designs, to the last bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, overload

import numpy as np

from vinefab.core.compiling import imported_later
from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Feed, Plan, Plans, Spans
from vinefab.model.design import MOST_BRANCHES, Build, Design
from vinefab.model.tree import BranchTree

if TYPE_CHECKING:
    from vinefab.growth import batch_kernel
else:
    batch_kernel = imported_later("vinefab.growth.batch_kernel")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignBatch:
    """Designs, m of them, with at most n levels below the trunk."""

    depth: Ints  # number of levels, the trunk included, shape (m,)
    trunk_mm: Floats  # length of the trunk, shape (m,)
    # as in `vinefab.model.design.Level`, shape (m, n); meaningless beyond a design's depth
    branches: Ints
    length_mm: Floats
    fan_rad: Floats
    growth: Floats
    # branches per level, the trunk first, shape (m, n + 1); capped just above MOST_BRANCHES
    counts: Ints

    def __len__(self) -> int:
        return len(self.depth)

    @classmethod
    def of(cls, *designs: Design) -> "DesignBatch":
        """Return a batch of some designs, all of even fans."""
        below = max(design.depth for design in designs) - 1
        depth = np.array([design.depth for design in designs])
        branches, numbers = (
            np.ones((len(designs), below), dtype=np.int64),
            np.ones((3, len(designs), below)),
        )
        for row, design in enumerate(designs):
            for place, level in enumerate(design.levels):
                branches[row, place] = level.branches
                numbers[:, row, place] = level.length_mm, level.fan_rad, level.growth
        length_mm, fan_rad, growth = numbers
        return cls(
            depth=depth,
            trunk_mm=np.array([design.trunk_length_mm for design in designs]),
            branches=branches,
            length_mm=length_mm,
            fan_rad=fan_rad,
            growth=growth,
            counts=branch_counts(depth, branches),
        )

    @property
    def sizes(self) -> Ints:
        """Number of branches of each design, shape (m,)."""
        return np.asarray(self.counts.sum(axis=1))

    def part(self, rows: Ints) -> "DesignBatch":
        """Return some of the designs."""
        return DesignBatch(
            depth=self.depth[rows],
            trunk_mm=self.trunk_mm[rows],
            branches=self.branches[rows],
            length_mm=self.length_mm[rows],
            fan_rad=self.fan_rad[rows],
            growth=self.growth[rows],
            counts=self.counts[rows],
        )


def branch_counts(depth: Ints, branches: Ints) -> Ints:
    """Return the number of branches on each level, as in `DesignBatch.counts`."""
    below = np.arange(branches.shape[1]) < depth[:, None] - 1
    # The product may overflow; a cap just above the limit is enough.
    counts = np.ones((len(depth), 1 + branches.shape[1]))
    np.cumprod(np.where(below, branches, 0.0), axis=1, out=counts[:, 1:])
    return np.minimum(counts, MOST_BRANCHES + 1.0).astype(np.int64)


class BatchBranches(NamedTuple):
    """All branches of a design batch, design by design, parents first."""

    first: Ints  # where each design's branches begin, with the total at the end, shape (m + 1,)
    parent: Ints  # within its tree, -1 for trunks
    level: Ints  # 1 for trunks
    offset_rad: Floats  # angle from the parent's heading
    length_mm: Floats


def batch_branches(designs: DesignBatch) -> BatchBranches:
    """Return all branches of a design batch, as `vinefab.model.tree.branch_tree` has them."""
    first = np.zeros(len(designs) + 1, dtype=np.int64)
    np.cumsum(designs.sizes, out=first[1:])
    parent, level = np.empty((2, first[-1]), dtype=np.int64)
    offset_rad, length_mm = np.empty((2, first[-1]))
    found = BatchBranches(first, parent, level, offset_rad, length_mm)
    # Columns of a table are another type to numba, which would compile a second time.
    batch_kernel.plan_trees(
        np.ascontiguousarray(designs.depth),
        np.ascontiguousarray(designs.trunk_mm),
        np.ascontiguousarray(designs.branches),
        np.ascontiguousarray(designs.fan_rad),
        np.ascontiguousarray(designs.length_mm),
        np.ascontiguousarray(designs.growth),
        *found,
    )
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PlannedTrees(Sequence[Plan]):
    """The planned trees of a design batch; each plan is created on access."""

    arrays: TreesArrays  # all trees, concatenated
    level: Ints  # level of each branch, 1 for the trunk
    offset_rad: Floats  # angle of each branch from its parent's heading
    counts: Ints  # number of branches of each tree per level, shape (m, n + 1)
    builds: dict[int, Build]  # by depth
    # body radius per level of the deepest designs; one 0 for bare centrelines
    radii_mm: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.counts)

    @overload
    def __getitem__(self, index: int) -> Plan: ...

    @overload
    def __getitem__(self, index: slice) -> list[Plan]: ...

    def __getitem__(self, index: int | slice) -> Plan | list[Plan]:
        """Return the plan of one tree, or of some."""
        if isinstance(index, slice):
            return [self[row] for row in range(*index.indices(len(self)))]
        one, two = self.arrays.first[index], self.arrays.first[index + 1]
        level = self.level[one:two]
        depth = int(level[-1])
        build, wide = self.builds[depth], len(self.radii_mm) > 1 or self.radii_mm[0] > 0.0
        edges = np.cumsum(self.counts[index, :depth]).tolist() if wide else [int(two - one)]
        return Plan(
            tree=BranchTree(
                parent=self.arrays.parent[one:two],
                level=level,
                offset_rad=self.offset_rad[one:two],
                length_mm=self.arrays.length[one:two],
            ),
            turn=self.arrays.turn[one:two],
            edges=(0, *edges),
            radii_mm=self.radii_mm[:depth] if wide else self.radii_mm,
            limit_kpa=self.arrays.limit[one:two],
            store_kpa=self.arrays.store[one:two],
            build=build,
        )


def planned_batch(
    designs: DesignBatch,
    builds: dict[int, Build],
    radii_mm: tuple[float, ...],
    options: GrowthOptions,
) -> Plans:
    """Return the plans of a design batch; builds of other depths begin with the same widths."""
    first, parent, level, offset_rad, length_mm = batch_branches(designs)
    turn = np.column_stack([np.cos(offset_rad), np.sin(offset_rad)])
    deepest = builds[max(builds)]
    feed, riding_mm = Feed.of(deepest, options), np.zeros(len(length_mm))
    if np.isfinite(feed.limit_kpa).any():
        width_mm = np.array(deepest.widths_mm)
        batch_kernel.riding_film(first, parent, level, length_mm, width_mm, riding_mm)
    arrays = TreesArrays(
        parent=parent,
        turn=turn,
        length=length_mm,
        limit=feed.limit_kpa[level - 1],
        store=feed.store_kpa(riding_mm),
        first=first,
    )
    for array in arrays:
        array.setflags(write=False)
    each = _PlannedTrees(
        arrays=arrays,
        level=level,
        offset_rad=offset_rad,
        counts=designs.counts,
        builds=builds,
        radii_mm=radii_mm,
    )
    spans = _spans(designs.counts, radii_mm)
    return Plans(each=each, trees=arrays, spans=spans)


def _spans(counts: Ints, radii_mm: tuple[float, ...]) -> Spans:
    """Return the branches that are grown on the same walls: all, or level by level."""
    until = np.cumsum(counts, axis=1)
    if radii_mm == (0.0,):
        zeros = np.zeros((len(counts), 1), dtype=np.int64)
        return Spans(radii_mm, zeros[:, 0] + 1, zeros, until[:, -1:], zeros > 0)
    rising = tuple(sorted(set(radii_mm)))
    levels = np.count_nonzero(counts, axis=1)
    there = np.arange(len(radii_mm)) < levels[:, None]
    wider = np.diff(radii_mm, prepend=0.0) > 0.0
    page = np.searchsorted(rising, radii_mm)
    return Spans(rising, levels, np.where(there, page, 0), until, there & wider)
