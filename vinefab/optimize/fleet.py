"""Many designs at once, as columns of numbers: what a search needs of them.

A search looks at thousands of designs a second. As single objects, making them and their trees
would take as long as growing them, and Python does it for one thread at a time. Designs are here,
to the last bit, what `vinefab.optimize.space.Space.design` makes of them one by one.
"""

from dataclasses import dataclass

import numpy as np

from vinefab.model.checked import Floats, Ints
from vinefab.model.design import MOST_BRANCHES


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fleet:
    """Designs, m of them, with at most n levels below the trunk.

    Parameters
    ----------
    depth
        Number of levels, the trunk included, shape (m,).
    trunk_mm
        Length of the trunk, shape (m,).
    branches, length_mm, fan_rad, growth
        As in `vinefab.model.design.Level`, shape (m, n); without meaning beyond a design's depth.
    counts
        Number of branches on each level, the trunk's first, shape (m, n + 1); at most so many that
        it is too many.
    """

    depth: Ints
    trunk_mm: Floats
    branches: Ints
    length_mm: Floats
    fan_rad: Floats
    growth: Floats
    counts: Ints

    def __len__(self) -> int:
        return len(self.depth)

    @property
    def sizes(self) -> Ints:
        """Number of branches of each design, shape (m,)."""
        return np.asarray(self.counts.sum(axis=1))

    def part(self, rows: Ints) -> "Fleet":
        """Return some of the designs."""
        return Fleet(
            depth=self.depth[rows],
            trunk_mm=self.trunk_mm[rows],
            branches=self.branches[rows],
            length_mm=self.length_mm[rows],
            fan_rad=self.fan_rad[rows],
            growth=self.growth[rows],
            counts=self.counts[rows],
        )


def branch_counts(depth: Ints, branches: Ints) -> Ints:
    """Return the number of branches on each level as `Fleet.counts` has it.

    Parameters
    ----------
    depth, branches
        As in `Fleet`.
    """
    below = np.arange(branches.shape[1]) < depth[:, None] - 1
    # More than any design may have is more than enough, whatever comes after.
    counts = np.ones((len(depth), 1 + branches.shape[1]))
    np.cumprod(np.where(below, branches, 0.0), axis=1, out=counts[:, 1:])
    return np.minimum(counts, MOST_BRANCHES + 1.0).astype(np.int64)
