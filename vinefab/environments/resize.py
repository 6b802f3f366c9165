"""The same map at another size."""

from dataclasses import replace

import shapely
from shapely import Polygon

from vinefab.model.checked import positive
from vinefab.model.map import Map, Start


def scaled(world: Map, factor: float) -> Map:
    """Return a map with all lengths multiplied by a factor, about the origin.

    Parameters
    ----------
    world
        The map.
    factor
        New length over old length, above 0.

    Raises
    ------
    BadInputError
        If the factor is not above 0, or the map becomes larger than a map may be.
    """
    positive("scale", factor, 1e6, "new over old")
    if factor == 1.0:
        return world
    return replace(
        world,
        bounds=_scaled(world.bounds, factor),
        obstacles=tuple(_scaled(obstacle, factor) for obstacle in world.obstacles),
        starts=tuple(_scaled_start(start, factor) for start in world.starts),
        facts={**world.facts, "scaled_by": factor},
    )


def _scaled(polygon: Polygon, factor: float) -> Polygon:
    return shapely.transform(polygon, lambda points: points * factor)


def _scaled_start(start: Start, factor: float) -> Start:
    pose = start.pose
    return replace(
        start,
        pose=replace(pose, x_mm=pose.x_mm * factor, y_mm=pose.y_mm * factor),
        spread_x_mm=start.spread_x_mm * factor,
        spread_y_mm=start.spread_y_mm * factor,
    )
