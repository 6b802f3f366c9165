"""The open map made ready for robots while a hand changes it: an obstacle costs what is near it."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point, Polygon

from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.map import Map, Pose
from vinefab.studio.edited_map import Ground
from vinefab.studio.state import StudioState
from vinefab.studio.warming import engine_now
from vinefab.tasks.evaluate import PreparedMap

_SLACK = 1.25
"""Obstacles so much farther than a branch grows are taken too: with them it may start elsewhere."""

_LAST_NEAR: dict[tuple[str, int], NDArray[np.bool_]] = {}
"""The obstacles near the robot at the last growth on a map of some name and count: a first guess.

A guess that is too large costs time; one that is too small, a second growth. No result depends on
it.
"""


def prepared_map(state: StudioState) -> PreparedMap:
    """Return the open map with all that growth and tasks need of it."""
    if state.ground is None or state.world is None:
        raise ValueError("no map is open")
    found = _prepared(state.ground)
    targets = state.world.targets  # of the page: moving one leaves the ground as it is
    return replace(found, world=state.world, context=replace(found.context, targets=targets))


@lru_cache(maxsize=64)
def _prepared(ground: Ground) -> PreparedMap:
    return PreparedMap.of(ground.world)


def grown(state: StudioState, start: Pose) -> tuple[Deployment, Terrain]:
    """Return what is open as it deploys from a start, and a terrain that has all it meets.

    Building walls for every body radius takes time with every obstacle of a map, far more than
    growing. So obstacles are left out that no branch could come to, however it turned: those
    farther from its base than it grows. Where fewer obstacles make it grow farther, it is grown
    again with those that it comes to; those of the last growth are the first guess.
    """
    world, design, options = state.world, state.grown_now, state.growth
    if world is None:
        raise ValueError("no map is open")
    tree = shapely.STRtree(world.obstacles)
    tolerance_mm = _terrain(world.name, world.bounds, ()).tolerance_mm
    body_mm = options.radius_mm(max(design.build.widths_mm)) + tolerance_mm
    map_key = world.name, len(world.obstacles)
    near = _LAST_NEAR.get(map_key, np.zeros(len(world.obstacles), dtype=np.bool_)).copy()
    near[tree.query(Point(start.x_mm, start.y_mm), "dwithin", body_mm)] = True
    while True:
        obstacles = tuple(world.obstacles[index] for index in np.flatnonzero(near).tolist())
        terrain = _terrain(world.name, world.bounds, obstacles)
        deployment = grow_on(design, terrain, start, options, engine=engine_now())
        out = np.flatnonzero(deployment.deployed)
        bases = shapely.points(deployment.points_mm[deployment.first_point[:-1][out]])
        reach_mm = deployment.grown_mm[out] + body_mm
        wider = np.zeros_like(near)
        wider[tree.query(bases, "dwithin", _SLACK * reach_mm)[1]] = True
        is_whole = near[tree.query(bases, "dwithin", reach_mm)[1]].all()
        if is_whole:
            _LAST_NEAR.clear()
            _LAST_NEAR[map_key] = near if near.sum() <= 2 * wider.sum() else wider
            return deployment, terrain
        near |= wider


@lru_cache(maxsize=32)
def _terrain(name: str, bounds: Polygon, obstacles: tuple[Polygon, ...]) -> Terrain:
    return Terrain.of(Map(name=name, bounds=bounds, obstacles=obstacles))
