"""The open map made ready for robots while a hand changes it: an obstacle costs what is near it."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import shapely
from shapely import Point, Polygon

from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.map import Map, Pose
from vinefab.studio.edited_map import Ground
from vinefab.studio.state import StudioState
from vinefab.studio.warming import engine_now
from vinefab.tasks.evaluate import PreparedMap

FEW_OBSTACLES = 40
"""Walls around so many are built for all of them: the robot need not be looked for first."""


_SLACK = 1.25
"""Obstacles so much farther than a branch grows are taken too: with them it may start elsewhere."""


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
    again with those that it comes to.
    """
    whole, design, options = prepared_map(state).terrain, state.grown_now, state.growth
    world = whole.world

    def grow(on: Terrain) -> Deployment:
        return grow_on(design, on, start, options, engine=engine_now())

    if len(world.obstacles) <= FEW_OBSTACLES:
        return grow(whole), whole
    tree = shapely.STRtree(world.obstacles)
    body_mm = options.radius_mm(max(design.build.widths_mm)) + whole.tolerance_mm
    near = np.zeros(len(world.obstacles), dtype=np.bool_)
    near[tree.query(Point(start.x_mm, start.y_mm), "dwithin", body_mm)] = True
    while True:
        obstacles = tuple(world.obstacles[index] for index in np.flatnonzero(near).tolist())
        terrain = _terrain(world.name, world.bounds, obstacles)
        deployment = grow(terrain)
        out = np.flatnonzero(deployment.deployed)
        bases = shapely.points(deployment.points_mm[deployment.first_point[:-1][out]])
        reach_mm = deployment.grown_mm[out] + body_mm
        if near[tree.query(bases, "dwithin", reach_mm)[1]].all():
            return deployment, terrain
        near[tree.query(bases, "dwithin", _SLACK * reach_mm)[1]] = True


@lru_cache(maxsize=32)
def _terrain(name: str, bounds: Polygon, obstacles: tuple[Polygon, ...]) -> Terrain:
    return Terrain.of(Map(name=name, bounds=bounds, obstacles=obstacles))
