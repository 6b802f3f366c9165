"""Starts that no robot of a run can leave, found before the search begins."""

from collections.abc import Iterator

import numpy as np
import shapely

from vinefab.core.errors import BadInputError
from vinefab.growth.simulator import grow_on
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.search.evaluator import Evaluator
from vinefab.tasks.evaluate import Conditions, PreparedMap

MOST_TRIALS = 40
"""Most poses that a trunk is grown from."""


def refuse_starts_without_room(evaluator: Evaluator, conditions: Conditions) -> None:
    """Raise `BadInputError` where no robot of a run can leave the starts of its maps.

    The run's own start needs room for the trunk on every map; of the maps' own starts one must have
    it. From one of all poses the shortest trunk must grow by its own width.

    Parameters
    ----------
    conditions
        The poses of the first generation.
    """
    given = evaluator.spec.settings.maps.start is not None
    starts = [(one, one.world.starts[0].pose) for one in evaluator.maps] if given else []
    radius_mm = evaluator.radii_mm[0]
    for prepared, pose in starts:
        if radius_mm > 0.0 and not _has_room(prepared, pose, radius_mm):
            raise _narrow(evaluator, prepared, pose, "maps.start")
    poses = [
        (prepared, pose)
        for prepared, places in zip(evaluator.maps, conditions.poses, strict=True)
        for pose in (*(start.pose for start in prepared.world.starts), *places)
    ]
    roomy = [pair for pair in poses if radius_mm == 0.0 or _has_room(*pair, radius_mm)]
    if poses and not roomy:
        prepared, pose = max(poses, key=lambda pair: _away_mm(*pair))
        raise _narrow(evaluator, prepared, pose, f"start of map {prepared.world.name!r}")
    grown_mm = 0.0
    for (prepared, pose), grown in _grown_mm(evaluator, roomy[:MOST_TRIALS]):
        if grown is None:
            return
        if grown >= grown_mm:
            grown_mm, stuck = grown, (prepared, pose)
    if roomy:
        raise _blocked(evaluator, *stuck, grown_mm)


def _has_room(prepared: PreparedMap, pose: Pose, radius_mm: float) -> bool:
    terrain = prepared.terrain
    return bool(terrain.have_room(terrain.starts_mm([pose]), radius_mm).all())


def _away_mm(prepared: PreparedMap, pose: Pose) -> float:
    """Return how far a start is from the nearest wall."""
    walls = shapely.boundary(prepared.terrain.free_space())
    return float(shapely.distance(walls, shapely.Point(pose.x_mm, pose.y_mm)))


def _narrow(evaluator: Evaluator, prepared: PreparedMap, pose: Pose, key: str) -> BadInputError:
    """Return the error of a start that is too near a wall."""
    radius_mm, build = evaluator.radii_mm[0], evaluator.space.build
    away_mm, width_mm = _away_mm(prepared, pose), build.build(1).widths_mm[0]
    most_mm = np.floor(10.0 * width_mm * away_mm / radius_mm) / 10.0
    helps = f", or {build.widths_key} of at most {most_mm:g}" if most_mm >= 1.0 else ""
    allowed = (
        f"a place with room: it is {away_mm:.3g} mm from a wall of map {prepared.world.name!r}, "
        f"and a trunk of {width_mm:g} mm needs {radius_mm:.1f} mm{helps}"
    )
    return BadInputError(key, f"({pose.x_mm:g}, {pose.y_mm:g})", allowed)


def _grown_mm(
    evaluator: Evaluator, poses: list[tuple[PreparedMap, Pose]]
) -> Iterator[tuple[tuple[PreparedMap, Pose], float | None]]:
    """Yield how far the shortest trunk grows from each pose; None where it is not stopped."""
    growth, space = evaluator.growth.at_one_angle, evaluator.space
    length_mm, build = space.design(np.zeros(len(space))).trunk_length_mm, space.build_of(1)
    trunk = Design(name="trunk", trunk_length_mm=length_mm, build=build)
    for prepared, pose in poses:
        grown = float(grow_on(trunk, prepared.terrain, pose, growth).grown_mm.sum())
        leaves = grown >= min(length_mm - 1.0, build.widths_mm[0])
        free = growth.children_of_stuck == "deploy" or leaves
        yield (prepared, pose), None if free else grown


def _blocked(
    evaluator: Evaluator, prepared: PreparedMap, pose: Pose, grown_mm: float
) -> BadInputError:
    """Return the error of starts from which every trunk is stopped."""
    given = evaluator.spec.settings.maps.start is not None
    key = "maps.start" if given else f"start of map {prepared.world.name!r}"
    heading_deg = np.degrees(pose.heading_rad)
    allowed = (
        f"a pose that a robot can leave: the trunk stops after {grown_mm:.0f} mm (simulated), less "
        "than its own width: turn or move the start"
    )
    where = f"({pose.x_mm:g}, {pose.y_mm:g}), heading {heading_deg:.0f} deg"
    return BadInputError(key, where, allowed)
