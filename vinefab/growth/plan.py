"""Plans: designs prepared for growth, once for all maps and poses."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import TreeArrays, TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Build, Design
from vinefab.model.tree import BranchTree, branch_tree

LONG_WIDTHS = 5.0
"""A straight body behind a steep tip counts as long from so many lay-flat widths, about eight
inflated diameters: slender enough to bow, as the growth model says of tight exits. The number is
vinefab's own [assumed]; no measurement of where bowing begins is known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A design prepared for growth."""

    tree: BranchTree  # the planned branches
    turn: Floats  # cosine and sine of each branch's angle from its parent, shape (n, 2)
    # span k, the branches that grow on the same walls, is ``edges[k] .. edges[k + 1] - 1``: the
    # whole tree for bare centrelines, one level for inflated bodies
    edges: tuple[int, ...]
    radii_mm: tuple[float, ...]  # body radius on each span
    long_mm: Floats  # length from which a straight body counts as long, for each branch, shape (n,)
    build: Build  # how the design is built

    @classmethod
    def of(cls, design: Design, options: GrowthOptions, tree: BranchTree | None = None) -> "Plan":
        """Return the plan of a design."""
        tree = branch_tree(design) if tree is None else tree
        long_mm = LONG_WIDTHS * np.array(design.build.widths_mm)[tree.level - 1]
        turn = np.column_stack([np.cos(tree.offset_rad), np.sin(tree.offset_rad)])
        if options.body == "centerline":
            edges, radii_mm = [0, len(tree)], [0.0]
        else:
            edges = np.searchsorted(tree.level, np.arange(1, design.depth + 2)).tolist()
            radii_mm = [width_mm / math.pi for width_mm in design.build.widths_mm]
        return cls(
            tree=tree,
            turn=turn,
            edges=tuple(edges),
            radii_mm=tuple(radii_mm),
            long_mm=long_mm,
            build=design.build,
        )

    def __len__(self) -> int:
        return len(self.tree)

    def arrays(self) -> TreeArrays:
        """Return the tree as the engines take it; every branch is assumed to have room."""
        fits = np.ones(len(self.tree), dtype=np.bool_)
        return TreeArrays(self.tree.parent, self.turn, self.tree.length_mm, fits)


class Spans(NamedTuple):
    """The spans of all plans as tables, one row per plan and one column per span."""

    radii_mm: tuple[float, ...]  # all body radii, rising
    number: Ints  # number of spans of each plan; columns beyond it have no meaning
    radius: Ints  # index of the radius
    until: Ints  # first branch that is not in the span
    # whether the body is wider than the body that reached its base, and so may lack room there
    is_wider: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plans:
    """Several designs prepared for growth."""

    each: Sequence[Plan]  # the plans one by one
    trees: TreesArrays  # their branches, one tree after the other
    spans: Spans  # branches that grow on the same walls
    _lengths: list[Floats] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.each)

    @property
    def lengths_mm(self) -> Floats:
        """Planned length of each tree, shape (n,); computed once."""
        if not self._lengths:
            # Tree by tree: other orders of summation differ in the last digit.
            edges = itertools.pairwise(self.trees.first.tolist())
            total = [np.add.reduce(self.trees.length[one:two]) for one, two in edges]
            self._lengths.append(np.array(total))
        return self._lengths[0]

    @classmethod
    def of(cls, designs: Sequence[Design], options: GrowthOptions) -> "Plans":
        """Return the plans of some designs, at least one, for one set of growth options."""
        return cls.joined([Plan.of(design, options) for design in designs])

    @classmethod
    def joined(cls, plans: Sequence[Plan]) -> "Plans":
        """Return some plans, at least one, together."""
        return cls(
            each=tuple(plans),
            trees=TreesArrays.of([plan.arrays() for plan in plans]),
            spans=_spans(plans),
        )


def _spans(plans: Sequence[Plan]) -> Spans:
    """Return the spans of plans as tables."""
    radii_mm = tuple(sorted({radius for plan in plans for radius in plan.radii_mm}))
    number = np.array([len(plan.radii_mm) for plan in plans])
    spans = Spans(
        radii_mm,
        number,
        radius=np.zeros((len(plans), number.max()), dtype=np.int64),
        until=np.zeros((len(plans), number.max()), dtype=np.int64),
        is_wider=np.zeros((len(plans), number.max()), dtype=np.bool_),
    )
    for row, plan in enumerate(plans):
        spans.until[row] = len(plan)
        spans.until[row, : number[row]] = plan.edges[1:]
        spans.radius[row, : number[row]] = np.searchsorted(radii_mm, plan.radii_mm)
        # Only a body wider than the one that reached the place can lack room there.
        spans.is_wider[row, : number[row]] = np.diff(plan.radii_mm, prepend=0.0) > 0.0
    return spans
