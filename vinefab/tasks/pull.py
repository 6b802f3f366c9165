"""What engaged leaves hold: pouches in gaps, films and seams that give in."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.model.checked import Floats, Ints
from vinefab.physics.anchoring import pouch_contacts_mm2
from vinefab.physics.lumen import inflated_diameter_mm
from vinefab.tasks.ground import Ground
from vinefab.tasks.leaves import Leaves, gaps_mm


class Pouches(NamedTuple):
    """The pouches of j robots, each of shape (j,).

    Parameters
    ----------
    length_mm, width_mm
        Flat size, 0 where there are none.
    press_n_mm2
        Force per mm2 of contact on both walls together, 2 P; 0 where it is not known.
    limit_n
        The most that one leaf can be pulled with, infinite where that is not known.
    """

    length_mm: Floats
    width_mm: Floats
    press_n_mm2: Floats
    limit_n: Floats


def contacts(
    leaves: Leaves, pouches: Pouches, places: Sequence[tuple[Ground, int, int]]
) -> tuple[NDArray[np.bool_], Floats]:
    """Return which leaves are engaged, and the area that each pouch presses on a wall.

    Parameters
    ----------
    leaves
        The leaves of some growths, m of them.
    pouches
        Of each growth; a leaf without one is engaged, wherever it is.
    places
        Each map with the growths ``one .. two - 1`` on it.
    """
    length_mm, width_mm = pouches.length_mm[leaves.growth], pouches.width_mm[leaves.growth]
    gap_mm, has_pouch = np.zeros(len(width_mm)), width_mm > 0.0
    if not has_pouch.any():
        return ~has_pouch, gap_mm
    for ground, one, two in places:
        here = leaves.of_growths(one, two)
        rows = here.start + np.flatnonzero(has_pouch[here])
        gap_mm[rows] = gaps_mm(leaves.points_mm, leaves.tip[rows], ground)
    engaged = ~has_pouch | (inflated_diameter_mm(width_mm) > gap_mm)
    return engaged, pouch_contacts_mm2(length_mm, width_mm, gap_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pull:
    """The engaged leaves of j robots, robot by robot, those that turned least first.

    Parameters
    ----------
    growths
        Number of robots.
    growth
        Robot of each leaf, rising, shape (m,).
    turns_rad
        Turn on the way to each tip, shape (m,).
    press_n
        Force of each pouch on both its walls, shape (m,); 0 where it is not known.
    limit_n
        The most that each leaf can be pulled with, shape (m,).
    """

    growths: int
    growth: Ints
    turns_rad: Floats
    press_n: Floats
    limit_n: Floats

    def amplifications(self, friction: float) -> Floats:
        """Return what each leaf holds over what its pouch alone holds, shape (m,).

        e^(mu gamma), or less where the film would tear or the seam open before that.
        """
        tip_n = self.press_n * friction
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.where(tip_n > 0.0, self.limit_n / tip_n, np.inf)
        return np.asarray(np.minimum(np.exp(friction * self.turns_rad), most))

    def summed(self, values: Floats) -> Floats:
        """Return the sum of one number per leaf over the leaves of each robot, shape (j,)."""
        # In the order of the leaves, so that no robot's sum depends on the others.
        sums = np.bincount(self.growth, weights=values, minlength=self.growths)
        return sums.astype(np.float64, copy=False)

    def are_among_first(self, share: float) -> NDArray[np.bool_]:
        """Tell which leaves are among the share that turned least, rounded up, shape (m,)."""
        ends = np.searchsorted(self.growth, np.arange(self.growths + 1))
        sure = np.ceil(np.diff(ends) * share - 1e-9)
        rank = np.arange(len(self.growth)) - ends[self.growth]
        return np.asarray(rank < sure[self.growth])

    def largest_turns_rad(self) -> Floats:
        """Return the largest turn of each robot's leaves, shape (j,); 0 where it has none."""
        ends = np.searchsorted(self.growth, np.arange(self.growths), side="right")
        there = np.diff(ends, prepend=0) > 0
        largest = np.zeros(self.growths)
        largest[there] = self.turns_rad[ends[there] - 1]
        return largest
