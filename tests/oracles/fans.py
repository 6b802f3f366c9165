"""The fans of a design of levels, read off its tree: of a flat or a deployed one too."""

from typing import NamedTuple

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.outline.joint import taper_rad


class Fan(NamedTuple):
    """The children of every parent of one level."""

    angles_rad: Floats
    lengths_mm: Floats

    @property
    def branches(self) -> int:
        """Children per parent."""
        return len(self.angles_rad)

    @property
    def least_gap_rad(self) -> float:
        """Smallest angle between siblings; there must be two."""
        return float(np.diff(self.angles_rad).min())

    @property
    def widest_turn_rad(self) -> float:
        """Largest angle between a child and its parent's heading."""
        return float(np.abs(self.angles_rad).max())


def fans_of(design: Design) -> list[Fan]:
    """Return the fan of each level after the trunk."""
    tree, found = design.tree, []
    for level in range(1, design.depth):
        parent = int(np.flatnonzero(tree.level == level)[0])
        children = tree.parent == parent
        found.append(Fan(tree.offset_rad[children], tree.length_mm[children]))
    return found


def level_lengths_mm(design: Design, level: int) -> list[float]:
    """Return the lengths of a level's branches, one per child of a fan; 1 is the trunk."""
    if level == 1:
        return [design.trunk_length_mm]
    lengths_mm: list[float] = fans_of(design)[level - 2].lengths_mm.tolist()
    return lengths_mm


def level_tapers_rad(design: Design, level: int) -> list[float]:
    """Return by how much the sides of a level's branches lean, one per child of a fan."""
    base, end = design.build.widths_mm[level - 1] / 2, design.build.end_widths_mm[level - 1] / 2
    return [taper_rad(base, end, length) for length in level_lengths_mm(design, level)]
