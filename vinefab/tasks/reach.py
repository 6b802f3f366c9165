"""Reachability: how much of the free space lies close to the deployed body."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import shapely

from vinefab.model.checked import Floats, positive
from vinefab.model.deployment import Deployment
from vinefab.tasks.ground import Ground
from vinefab.tasks.task import Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Share of the free space within a buffer of the body, by polygons (paper, Fig. 4).

    Parameters
    ----------
    buffer_mm
        Largest distance from the body's centreline that counts as reached.
    """

    name: ClassVar[str] = "reach"
    lowest: ClassVar[float] = 0.0

    buffer_mm: float = 40.0

    def __post_init__(self) -> None:
        positive("task.buffer_mm", self.buffer_mm)

    def evaluate(self, deployment: Deployment, ground: Ground) -> Outcome:
        """Return the share, 0 to 1, and as terms the reached area and the grown length."""
        chains = _chains(deployment)
        owner = np.repeat(np.arange(len(chains)), [len(chain) for chain in chains])
        body = shapely.multilinestrings(shapely.linestrings(np.concatenate(chains), indices=owner))
        reached = shapely.intersection(shapely.buffer(body, self.buffer_mm), ground.free)
        share = min(1.0, reached.area / ground.area_mm2)
        return share, {"reached_mm2": reached.area, "grown_mm": float(deployment.grown_mm.sum())}


def _chains(deployment: Deployment) -> list[Floats]:
    """Return the centreline of every deployed branch, each of shape (k, 2)."""
    return [deployment.chain_mm(int(branch)) for branch in np.flatnonzero(deployment.deployed)]
