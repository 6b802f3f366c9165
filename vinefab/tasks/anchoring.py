"""Anchoring: how much more than one pouch the branched robot holds."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vinefab.model.checked import Floats, number
from vinefab.model.deployment import Deployment
from vinefab.tasks.ground import Ground
from vinefab.tasks.task import Outcome

ASSUMED_FRICTION = 0.3
"""Film on printed plastic, 0.2 to 0.8 [assumed]: to be replaced by a measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Anchoring:
    """Anchoring force of all leaf pouches over that of one pouch without any turn.

    ``sum over leaves of exp(mu gamma)``, gamma the absolute turns at contacts and base hinges from
    the base to the leaf's tip (paper, equations 1 and 2; pressure and pouch cancel). Joint
    angles do not count. Every leaf that deployed counts as engaged: whether its pouch is wider
    than the gap that it ended in is not looked at.

    Parameters
    ----------
    friction
        Friction coefficient mu of film on the obstacles; the default is an assumption.
    """

    name: ClassVar[str] = "anchoring"
    lowest: ClassVar[float] = 0.0

    friction: float = ASSUMED_FRICTION

    def __post_init__(self) -> None:
        number("task.friction", self.friction, 0.0, 3.0)

    def evaluate(self, deployment: Deployment, ground: Ground) -> Outcome:  # noqa: ARG002 - the protocol's
        """Return the amplification and as terms the engaged leaves and their turns."""
        engaged = deployment.tree.is_leaf & deployment.deployed
        turns_rad = path_turn_rad(deployment)[engaged]
        return float(np.exp(self.friction * turns_rad).sum()), {
            "engaged": float(np.count_nonzero(engaged)),
            "mean_turn_rad": float(turns_rad.mean()) if len(turns_rad) else 0.0,
            "largest_turn_rad": float(turns_rad.max(initial=0.0)),
        }


def path_turn_rad(deployment: Deployment) -> Floats:
    """Return the sum of turns at contacts and hinges from the base to each tip, shape (n,)."""
    tree = deployment.tree
    total = deployment.contact_turn_rad.copy()
    for level in range(2, int(tree.level.max()) + 1):
        members = tree.level == level
        total[members] += total[tree.parent[members]]
    return total
