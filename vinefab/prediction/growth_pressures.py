"""The pressure that growth takes to every tip of a simulated deployment, all tips at once.

The same model as `vinefab.physics.growth_pressure`, which says what counts as a turn. There every
path is computed from its base; here each branch continues from its parent's result, on arrays.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.physics.growth_pressure import (
    FITTED,
    FITTED_DIAMETER_MM,
    NO_TENSION,
    GrowthConstants,
    riding_mm,
)
from vinefab.physics.tube import inflated_diameter_mm

LOOSE = FITTED.with_storage(NO_TENSION)
TIGHT = FITTED
"""Film that nothing holds back as it leaves its store, and film on a tight spool."""


def growth_pressures_kpa(
    deployment: Deployment, design: Design, fits: Sequence[GrowthConstants] = (LOOSE, TIGHT)
) -> Floats:
    """Return the pressure that growth to each tip takes, a row per fit, shape (fits, n).

    Branches that never emerged get NaN.

    Parameters
    ----------
    fits
        Constants of the tube that was measured, with the same friction; they are scaled to the
        diameter of each level.

    Notes
    -----
    ``P = Y + (T + f l_r) G + f M``: G is the product of ``e^(mu theta)`` over all turns of the
    path, M the sum of its lengths, each times that product over the turns behind it.
    """
    gain, drawn_mm = path_gains(deployment, fits[0].friction.value)
    own = deployment.tree.level - 1
    riding = riding_mm(deployment.tree, design.build.widths_mm)
    rows = []
    for fit in fits:
        levels = constants_by_level(design, fit)
        yielding = np.array([level.yield_kpa.value for level in levels])[own]
        storage = np.array([level.storage_kpa.value for level in levels])[own]
        drag_kpa_mm = np.array([level.drag_kpa_m.value / 1000.0 for level in levels])[own]
        rows.append(yielding + (storage + drag_kpa_mm * riding) * gain + drag_kpa_mm * drawn_mm)
    return np.array(rows)


def constants_by_level(design: Design, fit: GrowthConstants) -> tuple[GrowthConstants, ...]:
    """Return the growth constants of each level's tube, trunk first."""
    return tuple(
        fit.at_diameter(inflated_diameter_mm(width_mm), FITTED_DIAMETER_MM.value)
        for width_mm in design.build.widths_mm
    )


def path_gains(deployment: Deployment, friction: float) -> tuple[Floats, Floats]:
    """Return G and M (mm) of the path to each tip, shape (n,) each; NaN where none emerged."""
    tree, runs = deployment.tree, _Runs.of(deployment)
    gain, drawn_mm, heading = np.full((3, len(tree)), np.nan)
    for level in range(1, int(tree.level.max()) + 1):
        members = np.flatnonzero((tree.level == level) & deployment.deployed)
        parents, joint = tree.parent[members], tree.offset_rad[members]
        if level == 1:
            before, g, m = np.full(1, deployment.pose.heading_rad), np.ones(1), np.zeros(1)
            before, g, m = before[: len(members)], g[: len(members)], m[: len(members)]
        else:
            before, g, m = heading[parents], gain[parents], drawn_mm[parents]
        before = before + joint
        turn = np.abs(joint)
        for step in range(max(1, int(runs.count[members].max(initial=0)))):
            has = runs.count[members] > step
            at = runs.first[members[has]] + step
            turn[has] += _between(before[has], runs.heading[at])
            bend = np.exp(friction * turn)
            g, m = g * bend, m * bend
            m[has] += runs.length_mm[at]
            before[has] = runs.heading[at]
            turn = np.zeros(len(members))
        gain[members], drawn_mm[members], heading[members] = g, m, before
    return gain, drawn_mm


@dataclass(frozen=True, slots=True)
class _Runs:
    """The straight stretches of all branches, one branch after the other."""

    heading: Floats
    length_mm: Floats
    first: Ints
    count: Ints

    @classmethod
    def of(cls, deployment: Deployment) -> "_Runs":
        """Return the stretches of a deployment that have a length."""
        points, first_point = deployment.points_mm, deployment.first_point
        run = np.diff(points, axis=0)
        length = np.hypot(run[:, 0], run[:, 1])
        branch = np.repeat(np.arange(len(deployment.tree)), np.diff(first_point))
        real = (branch[:-1] == branch[1:]) & (length > 0.0)
        count = np.bincount(branch[:-1][real], minlength=len(deployment.tree))
        return cls(
            np.arctan2(run[real, 1], run[real, 0]), length[real], np.cumsum(count) - count, count
        )


def _between(one_rad: Floats, two_rad: Floats) -> Floats:
    """Return the angles between directions, 0 to pi."""
    turns: Floats = np.abs(np.remainder(two_rad - one_rad + math.pi, math.tau) - math.pi)
    return turns
