"""Growth pressure: what a vine robot needs to grow along a path, and along every path of a tree.

Undeployed film travels inside the body to the tip, where it everts. Every straight segment adds
friction and every turn multiplies the tension built up behind it (the capstan effect), so the
same turns cost more the later they come.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment
from vinefab.model.laser import GrowthConstants, Quantity, Standing
from vinefab.model.tree import BranchTree
from vinefab.physics.tube import inflated_diameter_mm


def capstan_factor(friction: float, turn_rad: float) -> float:
    """Return e^(mu |gamma|), by which the tension grows around a turn (Eq. 2 of the paper).

    Parameters
    ----------
    friction
        Coefficient of friction mu, 0 or more.
    turn_rad
        Total turn gamma; its sign does not matter.

    Examples
    --------
    >>> capstan_factor(0.3, 0.0)
    1.0
    """
    return math.exp(friction * abs(turn_rad))


def _fitted(value: float) -> Quantity:
    source = "fit to one tube of a published everting vine robot"
    return Quantity(value=value, standing=Standing.PUBLISHED, source=source)


FITTED = GrowthConstants(
    yield_kpa=_fitted(1.92),
    drag_kpa_m=_fitted(0.771),
    storage_kpa=_fitted(8.32),
    friction=_fitted(0.234),
)
"""The published fit. It holds for one tube; treat it as an order of magnitude for any other."""

FITTED_DIAMETER_MM = Quantity(
    value=25.0,
    standing=Standing.ASSUMED,
    source="the fit is quoted without its tube's diameter; tubes of about an inch are usual",
)
"""Inflated diameter of the tube that `FITTED` belongs to."""

FITTED_DIAMETER_RANGE_MM = (15.0, 40.0)
"""Least and greatest that it may well have been [assumed]."""

_ROUNDING = 2.0**-39
"""Two steps of a map's coordinates, as a share of its size."""

NO_TENSION = Quantity(
    value=0.0, standing=Standing.ASSUMED, source="film crumpled loosely behind the base"
)
"""Least tension of film that leaves its store: nothing holds it back."""


def growth_pressure_kpa(
    lengths_mm: Sequence[float],
    turns_rad: Sequence[float],
    constants: GrowthConstants = FITTED,
    *,
    riding_mm: float = 0.0,
) -> float:
    """Return the pressure for growth to the end of a path (series of capstans).

    tau_0 = T + f l_r; tau_i = (tau_{i-1} + f l_i) e^(mu |theta_i|); P_grow = Y + tau_{n-1} + f l_n.

    Parameters
    ----------
    lengths_mm
        Lengths of the n straight segments, base first.
    turns_rad
        The n - 1 turns between them (contacts, base hinge, joints); signs do not matter.
    constants
        Y, f, T and mu.
    riding_mm
        Film of undeployed descendants that is dragged along, l_r: their length times their width
        over that of the growing branch. It is assumed to act at the store, before every turn: an
        upper bound of its share.

    Raises
    ------
    BadInputError
        If there is not exactly one turn between each two segments.

    Notes
    -----
    Fitted on paths under 2 m with up to six right angles. Standing of the result: that of the
    weakest constant.

    Examples
    --------
    >>> round(growth_pressure_kpa([300.0], []), 1)
    10.5
    """
    if len(turns_rad) != len(lengths_mm) - 1:
        raise BadInputError("turns_rad", len(turns_rad), counted(len(lengths_mm) - 1, "turn"))
    drag_kpa_mm = constants.drag_kpa_m.value / 1000.0
    tension_kpa = constants.storage_kpa.value + drag_kpa_mm * riding_mm
    for length_mm, turn_rad in zip(lengths_mm, turns_rad, strict=False):
        factor = capstan_factor(constants.friction.value, turn_rad)
        tension_kpa = (tension_kpa + drag_kpa_mm * length_mm) * factor
    return constants.yield_kpa.value + tension_kpa + drag_kpa_mm * lengths_mm[-1]


# --- Paths through a tree -----------------------------------------------------------------------

Steps = list[tuple[float, float]]
"""Turn (rad) before each segment, and the segment's length (mm)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthPath:
    """A path from the base to a tip.

    Parameters
    ----------
    lengths_mm
        Lengths of the n straight segments, base first.
    turns_rad
        The n - 1 absolute turns between them: at contacts, and at bases, where joint and hinge
        are one net turn.
    """

    lengths_mm: tuple[float, ...]
    turns_rad: tuple[float, ...]

    @property
    def length_mm(self) -> float:
        """Length of the whole path."""
        return math.fsum(self.lengths_mm)

    @property
    def turn_rad(self) -> float:
        """Sum of all turns."""
        return math.fsum(self.turns_rad)

    def pressure_kpa(self, constants: GrowthConstants, riding_mm: float = 0.0) -> float:
        """Return the pressure for growth to the path's end; see `growth_pressure_kpa`."""
        return growth_pressure_kpa(self.lengths_mm, self.turns_rad, constants, riding_mm=riding_mm)


def planned_paths(tree: BranchTree) -> tuple[GrowthPath, ...]:
    """Return the path to every tip in free space: straight branches, turns at joints only.

    Contacts add turns, but for a hinge that bends a branch back towards its parent's heading: there
    less pressure may do than in free space.
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
    Turns are taken from the chains: between two segments, and at a branch's base between the
    parent's last heading and the first segment. So a joint and the hinge that bends it back are
    one turn, the difference of the two.
    """
    tree = deployment.tree
    steps: dict[int, Steps] = {}
    headings_rad: dict[int, float] = {}
    for branch in np.flatnonzero(deployment.deployed).tolist():
        parent = int(tree.parent[branch])
        joint_rad = float(tree.offset_rad[branch])
        before = headings_rad[parent] if parent >= 0 else deployment.pose.heading_rad
        own, heading_rad = _chain_steps(deployment.chain_mm(branch), before, joint_rad)
        steps[branch] = [*(steps[parent] if parent >= 0 else []), *own]
        headings_rad[branch] = heading_rad
    return {branch: _path(found) for branch, found in steps.items()}


def riding_mm(tree: BranchTree, widths_mm: tuple[float, ...]) -> Floats:
    """Return the film inside each branch for its descendants, as a length of its own film.

    Parameters
    ----------
    tree
        The planned branches.
    widths_mm
        Lay-flat width of each level, trunk first.

    Returns
    -------
    array
        Sum of length times width over all descendants, over the branch's width, mm; shape (n,).
    """
    width_mm = np.array(widths_mm)[tree.level - 1]
    film_mm2 = tree.length_mm * width_mm
    inside_mm2 = np.zeros(len(tree))
    for branch in range(len(tree) - 1, 0, -1):
        inside_mm2[tree.parent[branch]] += inside_mm2[branch] + film_mm2[branch]
    return np.asarray(inside_mm2 / width_mm)


def _chain_steps(chain_mm: Floats, before_rad: float, joint_rad: float) -> tuple[Steps, float]:
    """Return turn and length of each segment of a chain, and the last heading.

    The film comes to the chain's base along ``before_rad``.
    """
    runs = np.diff(chain_mm, axis=0)
    lengths = np.hypot(runs[:, 0], runs[:, 1])
    # A step as short as the rounding of its places has no direction.
    long = lengths > _ROUNDING * np.abs(chain_mm).max()
    runs, lengths = runs[long], lengths[long]
    if len(runs) == 0:  # it emerged and stopped at once
        return [(abs(joint_rad), 0.0)], before_rad + joint_rad
    headings = np.concatenate([[before_rad], np.arctan2(runs[:, 1], runs[:, 0])])
    turns = np.abs(np.remainder(np.diff(headings) + math.pi, math.tau) - math.pi)
    steps = list(zip(turns.tolist(), lengths.tolist(), strict=True))
    return steps, float(headings[-1])


def _path(steps: Steps) -> GrowthPath:
    """Return a path; a turn at the very base follows a segment of length 0."""
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
    """Return the pressure for growth to each tip in free space, kPa; shape (n,).

    The same as `growth_pressure_kpa` along each of `planned_paths`, with the constants scaled to
    the branch's diameter and the film of its descendants, but level by level.

    Parameters
    ----------
    tree
        The planned branches.
    widths_mm
        Lay-flat width of each level, trunk first.
    constants
        Y, f, T and mu, fitted to one tube.
    fitted_diameter_mm
        Inflated diameter of that tube.
    """
    drag_kpa_mm = constants.drag_kpa_m.value / 1000.0
    bend = np.exp(constants.friction.value * np.abs(tree.offset_rad))
    # Factor on the store's tension, and the drag of all segments before the last, after turns.
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
