"""Reachability: how much of the free space lies close to the deployed body."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import shapely

from vinefab.model.checked import positive
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
        body = shapely.MultiLineString(_chains(deployment))
        reached = shapely.intersection(shapely.buffer(body, self.buffer_mm), ground.free)
        share = min(1.0, reached.area / ground.area_mm2)
        return share, {"reached_mm2": reached.area, "grown_mm": float(deployment.grown_mm.sum())}


def _chains(deployment: Deployment) -> list[list[list[float]]]:
    """Return the points of every deployed branch's centreline."""
    deployed = np.flatnonzero(deployment.deployed)
    return [deployment.chain_mm(int(branch)).tolist() for branch in deployed]
