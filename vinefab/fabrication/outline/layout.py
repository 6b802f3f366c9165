"""The flat layout of a design: straight branches at their joint angles, before inflation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, frozen_floats
from vinefab.model.design import DEFAULT_FILLET_RATIO, DEFAULT_LEAST_FILLET_MM, Build, Design
from vinefab.model.tree import BranchTree, branch_tree


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlatLayout:
    """Every branch of a design as it lies on the sheet, n of them.

    The trunk's base is the origin, the trunk points along +x and the tail along -x.
    """

    tree: BranchTree  # the planned branches
    start_mm: Floats  # joint where each branch begins, shape (n, 2)
    end_mm: Floats  # joint or tip where each branch ends, shape (n, 2)
    heading_rad: Floats  # direction of each branch, counter-clockwise from +x, shape (n,)
    width_mm: Floats  # lay-flat lumen width where each branch begins, shape (n,)
    end_width_mm: Floats  # lay-flat lumen width where each branch ends, shape (n,)
    # Designed fillet radius at the base of each branch and at the neck of its pouch, shape (n,).
    # The trunk has no joint at its base: its value is the default radius for its width.
    fillet_mm: Floats
    is_leaf: NDArray[np.bool_]  # whether each branch has no children, shape (n,)
    tail_mm: float  # straight length below the trunk's base


def level_fillets_mm(build: Build) -> tuple[float, ...]:
    """Return the designed fillet radius of every level, the trunk's default first."""
    trunk = max(DEFAULT_LEAST_FILLET_MM, DEFAULT_FILLET_RATIO * build.widths_mm[0])
    return (trunk, *build.fillet_mm)


def flat_layout(design: Design) -> FlatLayout:
    """Return where every branch of a design lies on the sheet.

    Examples
    --------
    >>> from vinefab.model.design import Build, Level
    >>> fork = Level(branches=2, length_mm=50.0, fan_rad=np.pi)
    >>> design = Design(
    ...     name="t", trunk_length_mm=100.0, levels=(fork,), build=Build.standard(2)
    ... )
    >>> flat_layout(design).end_mm.round(6).tolist()
    [[100.0, 0.0], [100.0, -50.0], [100.0, 50.0]]
    """
    tree = branch_tree(design)
    start, end, heading = np.zeros((len(tree), 2)), np.zeros((len(tree), 2)), np.zeros(len(tree))
    for level in range(1, design.depth + 1):
        rows = np.flatnonzero(tree.level == level)
        if level > 1:
            parents = tree.parent[rows]
            start[rows] = end[parents]
            heading[rows] = heading[parents] + tree.offset_rad[rows]
        along = np.column_stack([np.cos(heading[rows]), np.sin(heading[rows])])
        end[rows] = start[rows] + tree.length_mm[rows, None] * along
    is_leaf = tree.is_leaf
    is_leaf.setflags(write=False)
    return FlatLayout(
        tree=tree,
        start_mm=frozen_floats("start_mm", start, 2),
        end_mm=frozen_floats("end_mm", end, 2),
        heading_rad=frozen_floats("heading_rad", heading),
        width_mm=frozen_floats("width_mm", np.array(design.build.widths_mm)[tree.level - 1]),
        end_width_mm=frozen_floats(
            "end_width_mm", np.array(design.build.end_widths_mm)[tree.level - 1]
        ),
        fillet_mm=frozen_floats(
            "fillet_mm", np.array(level_fillets_mm(design.build))[tree.level - 1]
        ),
        is_leaf=is_leaf,
        tail_mm=design.build.tail_mm,
    )
