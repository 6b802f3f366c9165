"""A robot deployed over and over with different headings: what it reaches in all."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from scipy.sparse.csgraph import connected_components

from vinefab import __version__
from vinefab.core.hashing import fingerprint
from vinefab.experiments.designs import design_from
from vinefab.experiments.jobs import DEFAULT_GROWTH, site
from vinefab.growth.grow import grow
from vinefab.growth.options import GrowthOptions
from vinefab.model.checked import Floats
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Pose
from vinefab.optimize.settings import MapSettings, plain_settings
from vinefab.tasks.evaluate import Site, poses_on
from vinefab.tasks.reach import near_chains

FAN_DEG = 120.0
"""Headings are spread evenly over so much, around the start's own."""

SAME_MM = 10.0
"""Final shapes whose tips are nearer than this, directly or through others, count as one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Redeploying:
    """An unbranched robot on one map, from one place, with many headings.

    Parameters
    ----------
    design
        As plain values.
    worlds
        The map: the first of these.
    headings
        How many.
    buffer_mm
        Distance from the body that counts as reached.
    growth
        How robots grow.
    """

    design: Mapping[str, Any]
    worlds: MapSettings
    headings: int
    buffer_mm: float
    growth: GrowthOptions = DEFAULT_GROWTH

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"redeploy_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> dict[str, Any]:
        """Return the share of free space reached by all together, and the final shapes.

        ``shapes``; ``stops``, how often each reason stopped a growth; ``each``, the mean share
        that one deployment reaches.
        """
        place = site(self.worlds, 0)
        grown = self.deployments(place)
        tips_mm = np.array([deployment.tips_mm[0] for deployment in grown])
        each = [self.reached(place, [deployment]) for deployment in grown]
        stops = [Stop(int(deployment.stop[0])).label for deployment in grown]
        return {
            "share": self.reached(place, grown),
            "each": float(np.mean(each)),
            "shapes": _groups(tips_mm),
            "stops": {stop.label: stops.count(stop.label) for stop in Stop},
        }

    def deployments(self, place: Site) -> list[Deployment]:
        """Return one growth for each heading."""
        ((start,),) = poses_on([place], 1, [self.worlds.seed])
        middle_rad = place.world.starts[0].pose.heading_rad
        half_rad = math.radians(FAN_DEG / 2.0)
        design = design_from(self.design)
        poses = [
            Pose(x_mm=start.x_mm, y_mm=start.y_mm, heading_rad=middle_rad + offset)
            for offset in np.linspace(-half_rad, half_rad, self.headings).tolist()
        ]
        return [grow(design, place.terrain, pose, self.growth) for pose in poses]

    def reached(self, place: Site, grown: list[Deployment]) -> float:
        """Return the share of free space within the buffer of all bodies together."""
        near = near_chains([d.chain_mm(0).tolist() for d in grown], self.buffer_mm)
        return float(shapely.intersection(near, place.ground.free).area / place.ground.area_mm2)


def _groups(tips_mm: Floats) -> int:
    """Return how many groups of tips there are."""
    apart_mm = np.hypot(*(tips_mm[:, None] - tips_mm[None]).transpose(2, 0, 1))
    return int(connected_components(apart_mm < SAME_MM)[0])
