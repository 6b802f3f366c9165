"""The flow of air that the tips of a robot take together from one supply (computed).

A tip that everts at speed v opens v pi R^2 of tube each second, so that all tips at once take
Q = v sum of pi R_i^2 at the working pressure, and Q (1 + P / P_0) of free air. Film of descendants
inside and the volume of pouches are left out. Tips are taken to move at one speed, and children to
set out when their parent has ended (assumed): which tips move together follows from the lengths
alone, and stops of branches only lower the flow.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, positive
from vinefab.model.tree import BranchTree
from vinefab.physics.tube import lumen_area_mm2

ATMOSPHERE_KPA = 101.325
"""Standard pressure of the air (published)."""

_L_MIN = 60.0 / 1e6  # of a mm3/s


@dataclass(frozen=True, slots=True, kw_only=True)
class SupplyFlow:
    """What a supply must give so that every tip keeps its speed."""

    tip_speed_mm_s: float
    pressure_kpa: float
    peak_l_min: float  # greatest flow during growth, at the working pressure
    free_l_min: float  # the same as air of the room
    tips: int  # that move then
    volume_l: float  # of the whole robot, at the working pressure
    time_s: float  # from the first tip to the last

    @classmethod
    def of(cls, tree: BranchTree, pressure_kpa: float, tip_speed_mm_s: float) -> "SupplyFlow":
        """Return the flow of a robot that grows in full."""
        positive("tip_speed_mm_s", tip_speed_mm_s, 1e5)
        begin = np.zeros(len(tree))
        for row in range(1, len(tree)):  # parents come first
            parent = tree.parent[row]
            begin[row] = begin[parent] + tree.length_mm[parent]
        end = begin + tree.length_mm
        fronts = np.unique(np.concatenate([begin, end]))
        # Sums of squares of widths that change evenly are convex: greatest at the ends of a stage.
        stages = [
            (_area_mm2(tree, begin, at_mm, moving), int(moving.sum()))
            for low_mm, high_mm in pairwise(fronts.tolist())
            for moving in [(begin <= low_mm) & (end >= high_mm)]
            for at_mm in (low_mm, high_mm)
        ]
        area_mm2, tips = max(stages)
        first, last = tree.width_mm, tree.end_width_mm
        mean_mm2 = (first**2 + first * last + last**2) / (3.0 * np.pi)
        peak_l_min = tip_speed_mm_s * area_mm2 * _L_MIN
        return cls(
            tip_speed_mm_s=tip_speed_mm_s,
            pressure_kpa=pressure_kpa,
            peak_l_min=peak_l_min,
            free_l_min=peak_l_min * (1.0 + pressure_kpa / ATMOSPHERE_KPA),
            tips=tips,
            volume_l=float(mean_mm2 @ tree.length_mm) / 1e6,
            time_s=float(end.max()) / tip_speed_mm_s,
        )


def _area_mm2(
    tree: BranchTree, begin_mm: Floats, front_mm: float, moving: NDArray[np.bool_]
) -> float:
    """Return the cross-sections of the tips that move while the front is somewhere, in mm2."""
    share = (front_mm - begin_mm[moving]) / tree.length_mm[moving]
    first, last = tree.width_mm[moving], tree.end_width_mm[moving]
    return float(sum(map(lumen_area_mm2, (first + share * (last - first)).tolist())))
