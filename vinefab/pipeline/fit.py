"""Where a deployed robot did not fit, and where the growth model is least to be trusted."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.growth.options import GrowthOptions
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design

MOST_NAMED = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A branch and where something happened to it.

    Parameters
    ----------
    branch
        Its id.
    x_mm, y_mm
        Where.
    radius_mm
        Its inflated radius.
    """

    branch: str
    x_mm: float
    y_mm: float
    radius_mm: float

    def content(self) -> dict[str, object]:
        """Return it as it stands in JSON."""
        where = {"x_mm": self.x_mm, "y_mm": self.y_mm}
        return {"branch": self.branch, **where, "radius_mm": self.radius_mm}


def without_room(
    design: Design, deployment: Deployment, options: GrowthOptions
) -> tuple[Place, ...]:
    """Return the branches that had no room where they should have started, and where that is.

    Only inflated bodies can lack room. Branches further out, whose parents never emerged, are not
    named.
    """
    if options.body == "centerline":
        return ()
    parent = deployment.tree.parent
    can_emerge = (parent < 0) | (deployment.stop[parent] == Stop.FULL_LENGTH)
    if options.deploys_stuck:
        can_emerge |= deployment.deployed[parent]
    lost = np.flatnonzero(~deployment.deployed & can_emerge).tolist()
    return tuple(_place(design, deployment, branch, int(parent[branch])) for branch in lost)


def wedged(design: Design, deployment: Deployment) -> tuple[Place, ...]:
    """Return the branches that ended in a corner or a gap that closes, and where."""
    stuck = np.flatnonzero(deployment.stop == Stop.CORNER).tolist()
    return tuple(_place(design, deployment, branch, branch) for branch in stuck)


def places_text(title: str, places: tuple[Place, ...]) -> list[str]:
    """Return places as a line for the user; nothing if there are none."""
    if not places:
        return []
    named = [f"{place.branch} at ({place.x_mm:.1f}, {place.y_mm:.1f})" for place in places]
    hidden = len(named) - MOST_NAMED
    more = f" and {hidden} more" if hidden > 0 else ""
    return [f"{title}: {', '.join(named[:MOST_NAMED])}{more} mm"]


def _place(design: Design, deployment: Deployment, branch: int, ended: int) -> Place:
    """Return a branch with the tip of the branch ``ended``, or the pose if that is none."""
    x_mm, y_mm = deployment.pose.x_mm, deployment.pose.y_mm
    if ended >= 0:
        x_mm, y_mm = deployment.chain_mm(ended)[-1].tolist()
    level = int(deployment.tree.level[branch])
    return Place(
        branch=deployment.tree.ids[branch],
        x_mm=x_mm,
        y_mm=y_mm,
        radius_mm=design.build.widths_mm[level - 1] / math.pi,
    )
