"""From designs as columns of numbers to their planned trees, for all of them at once.

Everything here gives, to the last bit, what `vinefab.model.tree.branch_tree` and
`vinefab.growth.plans.Plans.of` give for the designs one by one.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import overload

import numpy as np
from numpy.typing import NDArray

from vinefab.growth.batch_arrays import TreesArrays
from vinefab.growth.plan import LONG_WIDTHS, Plan
from vinefab.growth.plans import Plans, Spans
from vinefab.model.checked import Floats, Ints
from vinefab.model.design import Build
from vinefab.model.tree import BranchTree
from vinefab.optimize.fleet import Fleet

MOST_KEPT, LARGEST_KEPT = 512, 1000
"""So many shapes of trees are kept, of trees with at most so many branches."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Trees(Sequence[Plan]):
    """The planned trees of a fleet; a plan is made when it is asked for.

    Parameters
    ----------
    arrays
        All trees, one after the other.
    level
        Level of each branch, 1 for the trunk.
    offset_rad
        Angle of each branch from its parent's heading.
    counts
        Number of branches of each tree per level, shape (m, n + 1).
    builds
        How designs are built, by their depth.
    radii_mm
        Body radius per level of the deepest designs; one 0 for bare centrelines.
    """

    arrays: TreesArrays
    level: Ints
    offset_rad: Floats
    counts: Ints
    builds: dict[int, Build]
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
            long_mm=LONG_WIDTHS * np.array(build.widths_mm)[level - 1],
            build=build,
        )


def planted(fleet: Fleet, builds: dict[int, Build], radii_mm: tuple[float, ...]) -> Plans:
    """Return the plans of a fleet.

    Parameters
    ----------
    fleet
        Designs that may be: none with too many branches.
    builds
        How designs are built, by their depth.
    radii_mm
        Body radius per level of the deepest designs; one 0 for bare centrelines.
    """
    rows = zip(fleet.branches.tolist(), fleet.depth.tolist(), fleet.sizes.tolist(), strict=True)
    shapes = [
        (_kept_shape if size <= LARGEST_KEPT else _shape)(tuple(branches[: depth - 1]))
        for branches, depth, size in rows
    ]
    first = np.zeros(len(fleet) + 1, dtype=np.int64)
    np.cumsum([len(shape.parent) for shape in shapes], out=first[1:])
    level = np.concatenate([shape.level for shape in shapes])
    offsets, lengths = _tables(fleet)
    row = np.repeat(np.arange(len(fleet)), np.diff(first))
    place = (row * offsets.shape[1] + level - 1) * offsets.shape[2]
    place += np.concatenate([shape.rank for shape in shapes])
    turns = np.stack([np.cos(offsets), np.sin(offsets)], axis=-1).reshape(-1, 2)
    arrays = TreesArrays(
        parent=np.concatenate([shape.parent for shape in shapes]),
        turn=turns[place],
        length=lengths.ravel()[place],
        first=first,
    )
    for array in arrays:
        array.setflags(write=False)
    each = _Trees(
        arrays=arrays,
        level=level,
        offset_rad=offsets.ravel()[place],
        counts=fleet.counts,
        builds=builds,
        radii_mm=radii_mm,
    )
    # Tree by tree: other ways to add up the same numbers differ in the last digit.
    total = [arrays.length[one:two].sum() for one, two in itertools.pairwise(first.tolist())]
    spans = _spans(fleet.counts, radii_mm)
    return Plans(each=each, trees=arrays, lengths_mm=np.array(total), spans=spans)


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Shape:
    """Who is whose child: level, parent, and number among the siblings of each branch."""

    parent: Ints
    level: Ints
    rank: Ints


def _shape(branches: tuple[int, ...]) -> _Shape:
    """Return the shape of all trees with so many children per parent, level by level."""
    parents, levels, ranks = [np.array([-1])], [np.array([1])], [np.array([0])]
    first, count = 0, 1
    for number, children in enumerate(branches, start=2):
        parents.append(np.arange(first, first + count).repeat(children))
        ranks.append(np.tile(np.arange(children), count))
        first, count = first + count, count * children
        levels.append(np.full(count, number))
    return _Shape(
        parent=np.concatenate(parents), level=np.concatenate(levels), rank=np.concatenate(ranks)
    )


_kept_shape = lru_cache(maxsize=MOST_KEPT)(_shape)


def _tables(fleet: Fleet) -> tuple[Floats, Floats]:
    """Return angle and length of each design's branches, shape (m, n + 1, most siblings)."""
    below = np.arange(fleet.branches.shape[1]) < fleet.depth[:, None] - 1
    most = int(np.where(below, fleet.branches, 1).max(initial=1))
    shape = (len(fleet), 1 + fleet.branches.shape[1], most)
    offsets, lengths = np.zeros(shape), np.zeros(shape)
    lengths[:, 0, 0] = fleet.trunk_mm
    count = fleet.branches
    fan = _evenly(-fleet.fan_rad / 2, fleet.fan_rad / 2, count, most)
    offsets[:, 1:] = np.where(count[..., None] == 1, 0.0, fan)
    one = np.ones_like(fleet.growth)
    lengths[:, 1:] = fleet.length_mm[..., None] * _evenly(one, fleet.growth, count, most)
    return offsets, lengths


def _evenly(first: Floats, last: Floats, count: Ints, most: int) -> Floats:
    """Return numbers evenly spaced from first to last, ``count`` of them in ``most`` places."""
    places: NDArray[np.float64] = np.arange(most, dtype=np.float64)
    values = places * ((last - first) / np.maximum(count - 1, 1))[..., None]
    values += first[..., None]
    at_end = (places == count[..., None] - 1) & (count[..., None] > 1)
    return np.where(at_end, last[..., None], values)
