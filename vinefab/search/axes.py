"""What an optimizer is told about the coordinates that it searches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchAxes:
    """The d coordinates of a search: which stand for whole numbers, and which matter where.

    A coordinate that stands for one of k whole numbers has k equal shares of 0 to 1. A coordinate
    of a level has no effect on designs with fewer levels: it is inactive at such points.

    Examples
    --------
    >>> axes = SearchAxes(choices=(3, 0, 0), levels=(0, 0, 3), depth=0, least_depth=1)
    >>> axes.active(np.array([[0.1, 0.5, 0.5], [0.9, 0.5, 0.5]])).tolist()
    [[True, True, False], [True, True, True]]
    """

    # how many whole numbers each coordinate stands for; 0 where it is continuous. Length d.
    choices: tuple[int, ...]
    levels: tuple[int, ...]  # the level that each belongs to; 0 where it always matters. Length d.
    # the coordinate that stands for the number of levels; None when that number is fixed
    depth: int | None = None
    least_depth: int = 1  # the smallest number of levels, or the fixed one

    def __post_init__(self) -> None:
        if len(self.choices) != len(self.levels) or not self.choices:
            raise BadInputError("axes", len(self.choices), "as many levels, and at least one")

    @classmethod
    def plain(cls, dimensions: int) -> "SearchAxes":
        """Return continuous coordinates that always matter."""
        return cls(choices=(0,) * dimensions, levels=(0,) * dimensions)

    def __len__(self) -> int:
        return len(self.choices)

    @property
    def whole(self) -> NDArray[np.bool_]:
        """Whether each coordinate stands for whole numbers, shape (d,)."""
        return np.array(self.choices) > 0

    def active(self, x: Floats) -> NDArray[np.bool_]:
        """Return whether each coordinate matters at each point.

        Parameters
        ----------
        x
            Points, shape (m, d), entries 0 to 1.
        """
        depths = np.full(len(x), self.least_depth)
        if self.depth is not None:
            depths = self.least_depth + self.indices(x)[:, self.depth]
        active: NDArray[np.bool_] = np.array(self.levels) <= depths[:, None]
        return active

    def indices(self, x: Floats) -> Ints:
        """Return the number, from 0, of the share that each entry lies in; 0 if continuous.

        Parameters
        ----------
        x
            Points, shape (m, d), entries 0 to 1.
        """
        counts = np.array(self.choices)
        found: Ints = np.clip((x * counts).astype(np.int64), 0, np.maximum(counts - 1, 0))
        return found

    def settled(self, x: Floats) -> Floats:
        """Return the points with every entry that says nothing put in the middle.

        Inactive entries become 0.5, whole numbers the middle of their share: points that stand
        for the same design become the same point.

        Parameters
        ----------
        x
            Points, shape (m, d), entries 0 to 1.
        """
        counts = np.maximum(np.array(self.choices), 1)
        settled = np.where(self.whole, (self.indices(x) + 0.5) / counts, x)
        return np.where(self.active(x), settled, 0.5)
