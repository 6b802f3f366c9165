"""A task: how far from its base any tip of the robot gets."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vinefab.model.deployment import Deployment
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Farthest:
    """Distance of the farthest tip from the base, over a distance of reference.

    Parameters
    ----------
    reference_mm
        That scores 1.
    """

    name: ClassVar[str] = "farthest"
    lowest: ClassVar[float] = 0.0

    reference_mm: float = 500.0

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:  # noqa: ARG002  the map is not looked at
        """Return the score and its terms."""
        base = np.array([deployment.pose.x_mm, deployment.pose.y_mm])
        farthest_mm = float(np.hypot(*(deployment.tips_mm - base).T).max())
        return farthest_mm / self.reference_mm, {"farthest_mm": farthest_mm}
