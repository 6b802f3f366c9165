"""Growth pressure path by path, each from its base: the twin of `growth_pressures_kpa`."""

import math

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment
from vinefab.physics.growth_pressure import _ROUNDING, GrowthPath, Steps, _path


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
