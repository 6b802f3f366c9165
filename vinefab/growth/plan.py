"""A design made ready for growth, once for all maps and poses."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.growth.arrays import TreeArrays
from vinefab.growth.options import GrowthOptions
from vinefab.model.checked import Floats
from vinefab.model.design import Build, Design
from vinefab.model.tree import BranchTree, branch_tree

LONG_WIDTHS = 5.0
"""A straight body behind a steep tip counts as long from so many lay-flat widths, about eight
inflated diameters: slender enough to bow, as the growth model says of tight exits. The number is
vinefab's own [assumed]; no measurement of where bowing begins is known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """What growth needs of a design.

    Parameters
    ----------
    tree
        The planned branches.
    turn
        Cosine and sine of each branch's angle from its parent, shape (n, 2).
    edges
        The branches that are grown on the same walls are ``edges[k] .. edges[k + 1] - 1``: the
        whole tree for bare centrelines, one level for inflated bodies.
    radii_mm
        Body radius on each of these spans.
    long_mm
        Length from which a straight body counts as long, for each branch, shape (n,).
    build
        How the design is built.
    """

    tree: BranchTree
    turn: Floats
    edges: tuple[int, ...]
    radii_mm: tuple[float, ...]
    long_mm: Floats
    build: Build

    @classmethod
    def of(cls, design: Design, options: GrowthOptions, tree: BranchTree | None = None) -> "Plan":
        """Return the plan of a design.

        Parameters
        ----------
        design
            The robot.
        options
            Choices of the growth model.
        tree
            What to grow in place of all the design's branches; see `vinefab.growth.grow.grow`.
        """
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
        """Return the tree as the engines take it, with room for every branch so far."""
        fits = np.ones(len(self.tree), dtype=np.bool_)
        return TreeArrays(self.tree.parent, self.turn, self.tree.length_mm, fits)
