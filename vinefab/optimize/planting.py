"""From designs as columns of numbers to their planned trees, for all of them at once.

Everything here gives, to the last bit, what `vinefab.model.tree.branch_tree` and
`vinefab.growth.plans.Plans.of` give for the designs one by one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from vinefab.growth.batch_arrays import TreesArrays
from vinefab.growth.plan import LONG_WIDTHS, Plan
from vinefab.growth.plans import Plans, Spans
from vinefab.model.checked import Floats, Ints
from vinefab.model.design import Build
from vinefab.model.tree import BranchTree
from vinefab.optimize.fleet import Fleet


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
    from vinefab.growth import batch_kernel  # noqa: PLC0415  numba takes a second to import

    first = np.zeros(len(fleet) + 1, dtype=np.int64)
    np.cumsum(fleet.sizes, out=first[1:])
    parent, level = np.empty((2, first[-1]), dtype=np.int64)
    offset_rad, length_mm = np.empty((2, first[-1]))
    # Columns of a table are another type to the compiler, which would compile twice.
    batch_kernel.plant(
        np.ascontiguousarray(fleet.depth),
        np.ascontiguousarray(fleet.trunk_mm),
        np.ascontiguousarray(fleet.branches),
        np.ascontiguousarray(fleet.fan_rad),
        np.ascontiguousarray(fleet.length_mm),
        np.ascontiguousarray(fleet.growth),
        first,
        parent,
        level,
        offset_rad,
        length_mm,
    )
    turn = np.column_stack([np.cos(offset_rad), np.sin(offset_rad)])
    arrays = TreesArrays(parent=parent, turn=turn, length=length_mm, first=first)
    for array in arrays:
        array.setflags(write=False)
    each = _Trees(
        arrays=arrays,
        level=level,
        offset_rad=offset_rad,
        counts=fleet.counts,
        builds=builds,
        radii_mm=radii_mm,
    )
    spans = _spans(fleet.counts, radii_mm)
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
