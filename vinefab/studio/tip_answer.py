"""A tip dragged on the map: which lengths and angles of its level put it there."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.units import deg
from vinefab.core.validation import LARGEST_MM, Floats, number
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Level
from vinefab.model.tree import child_lengths_mm
from vinefab.studio.edited_map import PAGE
from vinefab.studio.live_answer import not_followed
from vinefab.studio.scene import grown
from vinefab.studio.state import StudioState

LEAST_MM = 1.0
"""Branches are dragged no shorter than this."""


def tip_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a level for which the tip of a branch lies where it is dragged to.

    The length follows the tip along its last stretch, the fan turns with what is across it; where
    a branch has been bent by walls that is the first step of the way, and the next drag goes on
    from there. Locked values stay.

    Parameters
    ----------
    ask
        ``branch``: its id; ``to``: where, map coordinates in mm.

    Returns
    -------
    dict
        ``level``: index of the level, -1 for the trunk, None if nothing can follow; ``values``: its
        new values by name, units as in design files.
    """
    to_mm = [number("to", value, -LARGEST_MM, LARGEST_MM, "mm") for value in ask.get("to", ())]
    if len(to_mm) != 2:
        raise BadInputError("to", ask.get("to"), "a point [x, y], mm", PAGE)
    deployment, _ = deployed_robot(state)
    ids = deployment.tree.ids
    if ask.get("branch") not in ids:
        raise BadInputError("branch", ask.get("branch"), "the id of a branch", PAGE)
    branch = ids.index(str(ask["branch"]))
    chain_mm = deployment.chain_mm(branch)
    if len(chain_mm) < 2:
        return {"level": None, "values": {}}
    (x0, y0), (x1, y1) = chain_mm[-2:].tolist()
    heading_rad = math.atan2(y1 - y0, x1 - x0)
    along_mm, turn_rad = _pull(chain_mm, np.array(to_mm), heading_rad)
    return _values(state, deployment, branch, along_mm, turn_rad)


def deployed_robot(state: StudioState) -> tuple[Deployment, Terrain]:
    """Return what is open, grown from its start on its map (simulated), and its terrain."""
    if state.world is None or state.start is None:
        raise BadInputError("map", None, "a map with a start", PAGE)
    if problem := not_followed(state.design):
        raise VinefabError(problem)
    return grown(state, state.start)


def _pull(chain_mm: Floats, to_mm: Floats, heading_rad: float) -> tuple[float, float]:
    """Return how much longer the last stretch gets, and by how much it turns about its base."""
    base_mm, tip_mm = chain_mm[-2], chain_mm[-1]
    reach = to_mm - base_mm
    length_mm = float(np.hypot(*reach))
    if length_mm < LEAST_MM:
        return LEAST_MM - float(np.hypot(*(tip_mm - base_mm))), 0.0
    turn_rad = math.atan2(reach[1], reach[0]) - heading_rad
    turn_rad = math.remainder(turn_rad, math.tau)
    return length_mm - float(np.hypot(*(tip_mm - base_mm))), turn_rad


def _values(
    state: StudioState, deployment: Deployment, branch: int, along_mm: float, turn_rad: float
) -> dict[str, Any]:
    design, index = state.design, int(deployment.tree.level[branch]) - 2
    grown_mm = float(deployment.grown_mm[branch])
    wanted_mm = max(LEAST_MM, grown_mm + along_mm)
    if index < 0:
        free = "trunk.length" not in state.locks
        return {"level": -1, "values": {"length": min(wanted_mm, LARGEST_MM)} if free else {}}
    level = design.levels[index]
    sibling = int(deployment.tree.ids[branch].rsplit(".", 1)[-1])
    values: dict[str, float] = {}
    if f"level.{index}.length" not in state.locks:
        share = float(child_lengths_mm(level)[sibling]) / level.length_mm
        values["length"] = min(wanted_mm / share, LARGEST_MM)
    lean = _lean(level, sibling)
    if lean and f"level.{index}.angle_deg" not in state.locks:
        fan_deg = deg(level.fan_rad + turn_rad / lean)
        values["angle_deg"] = min(360.0, max(0.0, fan_deg))
    return {"level": index, "values": values}


def _lean(level: Level, sibling: int) -> float:
    """Return by what share of the fan a child leans to the left of its parent; 0 in the middle."""
    if level.branches == 1:
        return 0.0
    return sibling / (level.branches - 1) - 0.5
