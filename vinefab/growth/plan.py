"""A design made ready for growth, once for all maps and poses."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.growth.arrays import TreeArrays
from vinefab.growth.options import GrowthOptions
from vinefab.model.checked import Floats
from vinefab.model.design import Design
from vinefab.model.tree import BranchTree, branch_tree


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
    """

    tree: BranchTree
    turn: Floats
    edges: tuple[int, ...]
    radii_mm: tuple[float, ...]

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
        turn = np.column_stack([np.cos(tree.offset_rad), np.sin(tree.offset_rad)])
        if options.body == "centerline":
            return cls(tree=tree, turn=turn, edges=(0, len(tree)), radii_mm=(0.0,))
        edges = np.searchsorted(tree.level, np.arange(1, design.depth + 2)).tolist()
        radii_mm = tuple(width_mm / math.pi for width_mm in design.build.widths_mm)
        return cls(tree=tree, turn=turn, edges=tuple(edges), radii_mm=radii_mm)

    def __len__(self) -> int:
        return len(self.tree)

    def arrays(self) -> TreeArrays:
        """Return the tree as the engines take it, with room for every branch so far."""
        fits = np.ones(len(self.tree), dtype=np.bool_)
        return TreeArrays(self.tree.parent, self.turn, self.tree.length_mm, fits)
