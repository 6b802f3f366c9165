"""Growing a fleet: a batch whose designs are columns of numbers."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from vinefab.growth.batch import Batch, Block, Launches, Result, _Spans
from vinefab.growth.grow import rules_of
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan
from vinefab.growth.scratch import Scratch
from vinefab.optimize.fleet import Trees
from vinefab.optimize.timing import Stopwatch


class FleetBatch(Batch):
    """Every design of a fleet from every launch, as `vinefab.growth.batch.Batch` grows designs.

    Parameters
    ----------
    trees
        The fleet's trees.
    launches
        Where to grow them from.
    options
        Choices of the growth model.
    idle
        Memory that other batches have used and nobody uses now; threads may share it.
    """

    plans: Sequence[Plan]  # type: ignore[assignment]  # made when they are asked for

    def __init__(
        self, trees: Trees, launches: Launches, options: GrowthOptions, idle: list[Scratch]
    ) -> None:
        self.plans = trees
        self.launches = launches
        self._rules = rules_of(options, 0.0)
        self._trees = trees.arrays
        ends = trees.arrays.first.tolist()
        length = trees.arrays.length
        # Tree by tree: other ways to add up the same numbers differ in the last digit.
        self._lengths_mm = np.array(
            [length[one:two].sum() for one, two in itertools.pairwise(ends)]
        )
        self._spans = _spans(trees)
        self._walls = launches.atlas.arrays(self._spans.radii_mm)
        self._page = launches.atlas.pages(self._spans.radii_mm)
        self._idle = idle

    def worked(self, first: int, size: int, work: Callable[[Block, Stopwatch], Result]) -> Result:
        """Grow some growths, and return what some work makes of them.

        Parameters
        ----------
        first, size
            The growths ``first .. first + size - 1``, as far as there are any.
        work
            Called with the block, whose arrays are used again afterwards, and a watch that has
            run since before it was grown.
        """
        watch = Stopwatch()
        try:
            scratch = self._idle.pop()
        except IndexError:
            scratch = Scratch()
        result = work(self._block(first, size, scratch), watch)
        self._idle.append(scratch)
        return result


def _spans(trees: Trees) -> _Spans:
    """Return the branches that are grown on the same walls: all, or level by level."""
    count, widest = len(trees), len(trees.radii_mm)
    until = np.cumsum(trees.counts, axis=1)
    if trees.radii_mm == (0.0,):
        return _Spans(
            (0.0,),
            np.ones(count, dtype=np.int64),
            np.zeros((count, 1), dtype=np.int64),
            until[:, -1:],
            np.zeros((count, 1), dtype=np.bool_),
        )
    radii_mm = tuple(sorted(set(trees.radii_mm)))
    levels = np.count_nonzero(trees.counts, axis=1)
    there = np.arange(widest) < levels[:, None]
    wider = np.diff(trees.radii_mm, prepend=0.0) > 0.0
    page = np.searchsorted(radii_mm, trees.radii_mm)
    return _Spans(radii_mm, levels, np.where(there, page, 0), until, there & wider)
