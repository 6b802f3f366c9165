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
from vinefab.core.validation import Floats, Ints
from vinefab.model.deployment import Deployment
from vinefab.model.laser import GrowthConstants
from vinefab.model.quantity import Quantity, Standing
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
    """Return the path to every tip in free space: straight bodies, turns at joints and bends.

    Contacts add turns, but for a hinge that bends a branch back towards its parent's heading: there
    less pressure may do than in free space.
    """
    steps, parts = list[Steps](), tree.straight
    for parent, turn_rad, length_mm in zip(
        parts.parent.tolist(),
        np.abs(parts.offset_rad).tolist(),
        parts.length_mm.tolist(),
        strict=True,
    ):
        before = steps[parent] if parent >= 0 else []
        steps.append([*before, (turn_rad, length_mm)])
    return tuple(_path(steps[row]) for row in parts.last_parts.tolist())


def riding_mm(tree: BranchTree) -> Floats:
    """Return the film inside each branch for its descendants, as a length of the branch's film.

    Parameters
    ----------
    tree
        The planned branches.

    Returns
    -------
    array
        Sum of length times width over all descendants, over the branch's width, mm; shape (n,).
    """
    width_mm = tree.width_mm
    film_mm2 = tree.length_mm * width_mm
    inside_mm2 = np.zeros(len(tree))
    for branch in range(len(tree) - 1, 0, -1):
        inside_mm2[tree.parent[branch]] += inside_mm2[branch] + film_mm2[branch]
    return np.asarray(inside_mm2 / width_mm)


def _path(steps: Steps) -> GrowthPath:
    """Return a path; a turn at the very base follows a segment of length 0."""
    (first_turn, first_length), *rest = steps
    if first_turn > 0.0:
        steps = [(0.0, 0.0), (first_turn, first_length), *rest]
    lengths = tuple(length for _, length in steps)
    return GrowthPath(lengths_mm=lengths, turns_rad=tuple(turn for turn, _ in steps[1:]))


def planned_growth_kpa(
    tree: BranchTree, constants: GrowthConstants, fitted_diameter_mm: float
) -> Floats:
    """Return the pressure for growth to each tip in free space, kPa; shape (n,).

    The same as `growth_pressure_kpa` along each of `planned_paths`, with the constants scaled to
    the branch's diameter and the film of its descendants, but generation by generation.

    Parameters
    ----------
    tree
        The planned branches.
    constants
        Y, f, T and mu, fitted to one tube.
    fitted_diameter_mm
        Inflated diameter of that tube.
    """
    drag_kpa_mm, parts = constants.drag_kpa_m.value / 1000.0, tree.straight
    bend = np.exp(constants.friction.value * np.abs(parts.offset_rad))
    # Factor on the store's tension, and the drag of all segments before the last, after turns.
    factor, before_kpa = np.ones(len(parts)), np.zeros(len(parts))
    own_kpa = drag_kpa_mm * parts.length_mm
    for rows in parts.generations[1:]:
        parent = parts.parent[rows]
        factor[rows] = factor[parent] * bend[rows]
        before_kpa[rows] = (before_kpa[parent] + own_kpa[parent]) * bend[rows]
    store_kpa = constants.storage_kpa.value + drag_kpa_mm * riding_mm(tree)
    unscaled = constants.yield_kpa.value + store_kpa[parts.branch] * factor + before_kpa + own_kpa
    diameter_mm = inflated_diameter_mm(1.0) * tree.width_mm
    return np.asarray(unscaled[parts.last_parts] * (fitted_diameter_mm / diameter_mm))


# --- Paths of deployments ------------------------------------------------------------------------


def growth_pressures_kpa(
    deployments: Sequence[Deployment],
    several: Sequence[GrowthConstants],
    fitted_diameter_mm: float = FITTED_DIAMETER_MM.value,
    *,
    at_end: bool = False,
) -> Floats:
    """Return the pressure for growth to the tip of every branch that deployed; NaN for others.

    Of several deployments the tips come one after the other.

    Parameters
    ----------
    several
        Sets of constants, fitted to one tube, with the same friction.
    fitted_diameter_mm
        Inflated diameter of that tube.
    at_end
        Whether a tapered tube counts with its width at the tip, where it needs most.

    Returns
    -------
    array
        A row for each set of constants, kPa; shape (sets, n).

    Notes
    -----
    ``P = Y + (T + f l_r) G + f M``: G is the product of ``e^(mu theta)`` over all turns of the
    path, M the sum of its lengths, each times that product over the turns behind it. Turns are
    taken from the chains: between two segments, and at a branch's base between the parent's last
    heading and the first segment. So a joint and the hinge that bends it back are one turn.
    """
    gain, drawn_mm = _path_gains(deployments, several[0].friction.value)
    trees = [deployment.tree for deployment in deployments]
    # Deployments of one plan share their tree.
    of_tree = {key: riding_mm(tree) for key, tree in {id(tree): tree for tree in trees}.items()}
    riding = np.concatenate([of_tree[id(tree)] for tree in trees])
    widths = [tree.end_width_mm if at_end else tree.width_mm for tree in trees]
    width_mm, own = np.unique(np.concatenate(widths), return_inverse=True)
    rows = []
    for constants in several:
        tubes = [
            constants.at_diameter(inflated_diameter_mm(width), fitted_diameter_mm)
            for width in width_mm.tolist()
        ]
        yielding = np.array([tube.yield_kpa.value for tube in tubes])[own]
        storage = np.array([tube.storage_kpa.value for tube in tubes])[own]
        drag_kpa_mm = np.array([tube.drag_kpa_m.value / 1000.0 for tube in tubes])[own]
        rows.append(yielding + (storage + drag_kpa_mm * riding) * gain + drag_kpa_mm * drawn_mm)
    return np.array(rows)


def _path_gains(deployments: Sequence[Deployment], friction: float) -> tuple[Floats, Floats]:
    """Return G and M (mm) of the path to each tip; NaN where none emerged.

    All deployments are worked out together, as one forest: its arrays are theirs one after the
    other, shape (n,) each in all.
    """
    counts = [len(deployment.tree) for deployment in deployments]
    begin = np.repeat(np.cumsum([0, *counts[:-1]]), counts)
    levels = np.concatenate([deployment.tree.level for deployment in deployments])
    parent = np.concatenate([deployment.tree.parent for deployment in deployments]) + begin
    offset_rad = np.concatenate([deployment.tree.offset_rad for deployment in deployments])
    deployed = np.concatenate([deployment.deployed for deployment in deployments])
    start_rad = np.repeat([deployment.pose.heading_rad for deployment in deployments], counts)
    runs = _Runs.of(deployments)
    gain, drawn_mm, heading = np.full((3, len(levels)), np.nan)
    for level in range(1, int(levels.max()) + 1):
        members = np.flatnonzero((levels == level) & deployed)
        parents, joint = parent[members], offset_rad[members]
        if level == 1:
            before, g, m = start_rad[members], np.ones(len(members)), np.zeros(len(members))
        else:
            before, g, m = heading[parents], gain[parents], drawn_mm[parents]
        turn = np.abs(joint)
        for step in range(max(1, int(runs.count[members].max(initial=0)))):
            has = runs.count[members] > step
            at = runs.first[members[has]] + step
            # At the base net: a joint and the hinge that bends it back are one turn.
            between = np.remainder(runs.heading[at] - before[has] + math.pi, math.tau) - math.pi
            turn[has] = np.abs(between)
            bend = np.exp(friction * turn)
            g, m = g * bend, m * bend
            m[has] += runs.length_mm[at]
            before[has] = runs.heading[at]
            turn = np.zeros(len(members))
        straight = runs.count[members] == 0  # it emerged and stopped at once
        gain[members], drawn_mm[members] = g, m
        heading[members] = np.where(straight, before + joint, before)
    return gain, drawn_mm


@dataclass(frozen=True, slots=True)
class _Runs:
    """The straight stretches of all branches, one branch after the other."""

    heading: Floats
    length_mm: Floats
    first: Ints
    count: Ints

    @classmethod
    def of(cls, deployments: Sequence[Deployment]) -> "_Runs":
        """Return the stretches of deployments; one as short as rounding has no direction."""
        points = np.concatenate([deployment.points_mm for deployment in deployments])
        of_branch = np.concatenate([np.diff(one.first_point) for one in deployments])
        run = np.diff(points, axis=0)
        length = np.hypot(run[:, 0], run[:, 1])
        branch = np.repeat(np.arange(len(of_branch)), of_branch)
        largest = np.zeros(len(of_branch))
        np.maximum.at(largest, branch, np.abs(points).max(axis=1, initial=0.0))
        real = (branch[:-1] == branch[1:]) & (length > _ROUNDING * largest[branch[:-1]])
        count = np.bincount(branch[:-1][real], minlength=len(of_branch))
        return cls(
            np.arctan2(run[real, 1], run[real, 0]), length[real], np.cumsum(count) - count, count
        )
