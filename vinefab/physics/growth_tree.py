"""Growth pressure of every branch of a planned tree at once, in free space."""

import numpy as np

from vinefab.model.checked import Floats
from vinefab.model.tree import BranchTree
from vinefab.physics.growth_path import riding_mm
from vinefab.physics.growth_pressure import GrowthConstants
from vinefab.physics.lumen import inflated_diameter_mm


def planned_growth_kpa(
    tree: BranchTree,
    widths_mm: tuple[float, ...],
    constants: GrowthConstants,
    fitted_diameter_mm: float,
) -> Floats:
    """Return the pressure that growth to each tip takes in free space, shape (n,).

    The same as `growth_pressure_kpa` along each of `planned_paths`, with constants at the
    diameter of the branch and its descendants riding along, but level by level: contacts on the
    way can only add to it.

    Parameters
    ----------
    tree
        The planned branches.
    widths_mm
        Lay-flat width of each level, trunk first.
    constants
        The fit.
    fitted_diameter_mm
        Inflated diameter of the tube that it belongs to.
    """
    drag_kpa_mm = constants.drag_kpa_m.value / 1000.0
    bend = np.exp(constants.friction.value * np.abs(tree.offset_rad))
    # What the store's tension and the drag of all stretches before the last have grown to.
    factor, before_kpa = np.ones(len(tree)), np.zeros(len(tree))
    own_kpa = drag_kpa_mm * tree.length_mm
    for level in range(2, len(widths_mm) + 1):
        rows = np.flatnonzero(tree.level == level)
        parent = tree.parent[rows]
        factor[rows] = factor[parent] * bend[rows]
        before_kpa[rows] = (before_kpa[parent] + own_kpa[parent]) * bend[rows]
    store_kpa = constants.storage_kpa.value + drag_kpa_mm * riding_mm(tree, widths_mm)
    unscaled = constants.yield_kpa.value + store_kpa * factor + before_kpa + own_kpa
    diameter_mm = inflated_diameter_mm(1.0) * np.array(widths_mm)
    return np.asarray(unscaled * (fitted_diameter_mm / diameter_mm)[tree.level - 1])
