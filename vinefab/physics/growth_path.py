"""The path that film takes to a tip, and the pressure to grow each branch of a tree."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment
from vinefab.model.tree import BranchTree
from vinefab.physics.growth_pressure import GrowthConstants, growth_pressure_kpa
from vinefab.physics.tube import inflated_diameter_mm

Steps = list[tuple[float, float]]
"""Turn in radians and length in mm of one stretch after the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthPath:
    """A path from the base to a tip.

    Parameters
    ----------
    lengths_mm
        Straight stretches, n of them, base first.
    turns_rad
        Absolute turns before each stretch but the first, n - 1 of them: at contacts, base hinges
        and joints. A joint that was bent by a contact at its hinge counts with both turns.
    """

    lengths_mm: tuple[float, ...]
    turns_rad: tuple[float, ...]

    @property
    def length_mm(self) -> float:
        """Whole length."""
        return math.fsum(self.lengths_mm)

    @property
    def turn_rad(self) -> float:
        """Sum of all turns."""
        return math.fsum(self.turns_rad)

    def pressure_kpa(self, constants: GrowthConstants, riding_mm: float = 0.0) -> float:
        """Return the pressure that growth to the path's end takes; see `growth_pressure_kpa`."""
        return growth_pressure_kpa(self.lengths_mm, self.turns_rad, constants, riding_mm=riding_mm)


def planned_paths(tree: BranchTree) -> tuple[GrowthPath, ...]:
    """Return the path to every tip in free space: straight branches, turns at joints only.

    No path through obstacles is shorter or turns less, so that growth takes at least what these
    paths take.
    """
    steps: list[Steps] = []
    for parent, turn_rad, length_mm in zip(
        tree.parent.tolist(), np.abs(tree.offset_rad).tolist(), tree.length_mm.tolist(), strict=True
    ):
        before = steps[parent] if parent >= 0 else []
        steps.append([*before, (turn_rad, length_mm)])
    return tuple(_path(found) for found in steps)


def grown_paths(deployment: Deployment) -> dict[int, GrowthPath]:
    """Return the path to the tip of every branch that deployed, by its index.

    Notes
    -----
    Turns are read off the chains: between two stretches, and at a branch's base between the
    planned heading (the parent's last one turned by the joint's angle) and the first stretch.
    """
    tree = deployment.tree
    steps: dict[int, Steps] = {}
    headings_rad: dict[int, float] = {}
    for branch in np.flatnonzero(deployment.deployed).tolist():
        parent = int(tree.parent[branch])
        joint_rad = float(tree.offset_rad[branch])
        before = headings_rad[parent] if parent >= 0 else deployment.pose.heading_rad
        own, heading_rad = _chain_steps(deployment.chain_mm(branch), before + joint_rad)
        first_turn, first_length = own[0]
        own[0] = (abs(joint_rad) + first_turn, first_length)
        steps[branch] = [*(steps[parent] if parent >= 0 else []), *own]
        headings_rad[branch] = heading_rad
    return {branch: _path(found) for branch, found in steps.items()}


def riding_mm(tree: BranchTree, widths_mm: tuple[float, ...]) -> Floats:
    """Return the film of each branch's descendants as a length of the branch's own, shape (n,).

    Parameters
    ----------
    tree
        The planned branches.
    widths_mm
        Lay-flat width of each level, trunk first.

    Returns
    -------
    array
        Sum of length times width over all descendants, over the branch's width.
    """
    width_mm = np.array(widths_mm)[tree.level - 1]
    film_mm2 = tree.length_mm * width_mm
    inside_mm2 = np.zeros(len(tree))
    for branch in range(len(tree) - 1, 0, -1):
        inside_mm2[tree.parent[branch]] += inside_mm2[branch] + film_mm2[branch]
    return np.asarray(inside_mm2 / width_mm)


def _chain_steps(chain_mm: Floats, planned_rad: float) -> tuple[Steps, float]:
    """Return turn and length of each stretch of a chain, and the last heading."""
    runs = np.diff(chain_mm, axis=0)
    lengths = np.hypot(runs[:, 0], runs[:, 1])
    runs, lengths = runs[lengths > 0.0], lengths[lengths > 0.0]
    if len(runs) == 0:  # it emerged and got nowhere
        return [(0.0, 0.0)], planned_rad
    headings = np.concatenate([[planned_rad], np.arctan2(runs[:, 1], runs[:, 0])])
    turns = np.abs(np.remainder(np.diff(headings) + math.pi, math.tau) - math.pi)
    steps = list(zip(turns.tolist(), lengths.tolist(), strict=True))
    return steps, float(headings[-1])


def _path(steps: Steps) -> GrowthPath:
    """Return a path; a turn at the very base comes after a stretch of no length."""
    (first_turn, first_length), *rest = steps
    if first_turn > 0.0:
        steps = [(0.0, 0.0), (first_turn, first_length), *rest]
    lengths = tuple(length for _, length in steps)
    return GrowthPath(lengths_mm=lengths, turns_rad=tuple(turn for turn, _ in steps[1:]))


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
