"""What is said and refused before a search begins: the trunk, targets, and starts without room.

What rules say of trunk and targets refuses nothing: a robot with fewer branches, or one that misses
a target, may serve.
"""

import math
from collections.abc import Iterator

import numpy as np
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.fabrication.rules.laser_rules import BED
from vinefab.fabrication.rules.spacing import RotatedSpan
from vinefab.fabrication.rules.tree_rules import CLAMP, PACKING
from vinefab.growth.simulator import grow_on
from vinefab.model.design import DEFAULT_TRUNK_WIDTH_MM, Design, Level
from vinefab.model.files.profile_toml import profile_files
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.map import Pose
from vinefab.search.evaluator import Evaluator
from vinefab.search.manufacturability import (
    ManufacturabilityPenalty,
    SpaceQuery,
    film_in_trunk,
    run_profile,
)
from vinefab.search.settings import RunSettings
from vinefab.tasks.evaluate import Conditions, PreparedMap
from vinefab.tasks.targets import task_targets

_WIDTHS = {"trunk_width_mm", "widths_mm"}

MOST_BRANCHED = 20
"""Children of a fan above which nothing is said of the film that rides in a trunk."""

LEAST_EXCESS_MM = 20.0
"""Excess over the sheet from which on it is named: fans are cut at other angles than deployed."""


def middle_tree(query: SpaceQuery) -> Design | None:
    """Return a design of middle depth, with the middle number of branches on each level."""
    settings = query.settings
    depth = int(settings.space.levels.low + settings.space.levels.high) // 2
    below = [query.bounds(level, "branches")[1] for level in range(2, depth + 1)]
    branches = [math.ceil((bounds.low + bounds.high) / 2.0) for bounds in below]
    if max(branches, default=0) > MOST_BRANCHED:
        return None
    levels = tuple(Level.of(branches=count, length_mm=100.0, angle_deg=90.0) for count in branches)
    build = settings.build.build(depth)
    return Design(name="middle", trunk_length_mm=100.0, levels=levels, build=build)


def with_trunk_for_film(settings: RunSettings) -> RunSettings:
    """Return the settings of a run; a trunk width that it does not name is one its film takes.

    The usual one, or the narrowest that the film of the middle tree of the space rides through.
    """
    if not settings.evaluation.fabricable or _WIDTHS & settings.build.model_fields_set:
        return settings
    # A name that is unknown is told; what stands in its files is not.
    profile_files(settings.evaluation.recipe or DEFAULT_RECIPE)
    query = SpaceQuery.of(settings, run_profile(settings.evaluation), (math.inf, math.inf))
    tree = middle_tree(query)
    wide_mm = DEFAULT_TRUNK_WIDTH_MM
    if tree is not None and tree.levels:
        holds_mm = math.ceil(film_in_trunk(query, tree)[1])
        wide_mm = max(wide_mm, min(float(holds_mm), query.limit(CLAMP)))
    return settings.changed(build=settings.build.changed(trunk_width_mm=wide_mm))


def said_before(evaluator: Evaluator) -> str:
    """Return what a user should know of a run's trunk and targets; empty if nothing."""
    penalty, settings = evaluator.penalty, evaluator.spec.settings
    if not isinstance(penalty, ManufacturabilityPenalty):
        return ""
    query = SpaceQuery.of(settings, penalty.profile, penalty.sheet_mm)
    return "; ".join([*_trunk(query), *_flat(evaluator, query)])


def _trunk(query: SpaceQuery) -> Iterator[str]:
    """Yield that film fills the trunk, or that the trunk is wide because of it."""
    tree, build, ply_mm = middle_tree(query), query.settings.build, query.profile.material.ply_mm
    if tree is None or not tree.levels:
        return
    percent, holds_mm = film_in_trunk(query, tree)
    counts = [level.branches for level in tree.levels]
    shape = " x ".join(map(str, counts))
    what = f"{counted(tree.depth, 'level')} (branches {shape}) of {ply_mm.value:g} mm film"
    wide_mm, most = build.build(1).widths_mm[0], query.limit(PACKING)
    if percent > most:
        yield (
            f"a trunk of {wide_mm:g} mm is narrow for this film: {what} fill {percent:.0f} % of a "
            f"lumen, and {most:g} % is allowed ({PACKING.id}); one of {math.ceil(holds_mm):g} mm "
            f"holds them ({build.widths_key})"
        )
    elif wide_mm > DEFAULT_TRUNK_WIDTH_MM and wide_mm == math.ceil(holds_mm):
        yield f"trunk {wide_mm:g} mm: the narrowest that {what} ride through ({PACKING.id})"


def _flat(evaluator: Evaluator, query: SpaceQuery) -> Iterator[str]:
    """Yield that no flat outline that touches all targets as designed fits the sheet."""
    pieces, (wide_mm, high_mm) = query.settings.build.pieces, query.sheet_mm
    excess_mm = max(_excesses_mm(evaluator, query), default=0.0)
    if (pieces is None or pieces.most == 1) and excess_mm > LEAST_EXCESS_MM:
        yield (
            f"one flat outline that touches all targets is about {excess_mm:.0f} mm too large "
            f"for the sheet of {wide_mm:.0f} x {high_mm:.0f} mm ({BED.id}), its tail of "
            f"{query.settings.build.tail_mm:g} mm included, unless walls bend it: allow pieces "
            "([build.pieces] most = 6)"
        )


def _excesses_mm(evaluator: Evaluator, query: SpaceQuery) -> Iterator[float]:
    """Yield by how much mouth, base and targets exceed the sheet, on maps with targets at points.

    Of several starts the best counts. Tolerances and ranges of starts make robots smaller.
    """
    tail_mm = query.settings.build.tail_mm
    for prepared in evaluator.maps:
        found = []
        targets = task_targets(evaluator.spec.tasks[0], prepared.world)
        points = [target for target in targets if target.point_mm is not None]
        for start in prepared.world.starts:
            pose = start.pose
            heading = np.array([math.cos(pose.heading_rad), math.sin(pose.heading_rad)])
            base = np.array([pose.x_mm, pose.y_mm])
            slack_mm = math.hypot(start.spread_x_mm, start.spread_y_mm)
            slack_mm += tail_mm * start.spread_heading_rad
            span = RotatedSpan()
            span.add(np.stack([base - tail_mm * heading, base]), np.zeros(2))
            for target in points:
                away_mm = np.array([target.tolerance_mm + slack_mm])
                span.add(np.array([target.point_mm]), -away_mm)
            found.append(span.excess_mm(query.sheet_mm) if start.area is None else 0.0)
        if points and found:
            yield min(found)


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
