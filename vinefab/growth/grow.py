"""The front door of the simulator: one design, one map, one pose."""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from vinefab.core.errors import UnknownNameError
from vinefab.growth.arrays import Growth, Rules, Start, TreeArrays, WallArrays
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.model.tree import BranchTree, branch_tree

Engine = Literal["kernel", "reference"]
GrowBranches = Callable[[WallArrays, TreeArrays, Rules, Start, Growth, int, int], int]

TOLERANCE_RAD = 2.0**-42
"""Directions that differ by less are parallel: far below the bend of any corner of a terrain."""

MOST_EVENTS = 100_000
"""Guard against a branch that never ends; the most seen in trials is below a hundred."""

POINTS_PER_BRANCH = 6
"""Room for chain points to begin with; more is made when a tree needs it."""


def grow(
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions | None = None,
    engine: Engine = "kernel",
    tree: BranchTree | None = None,
) -> Deployment:
    """Return how a design deploys from a pose.

    Parameters
    ----------
    design
        The robot.
    terrain
        The map, made ready with `Terrain.of`.
    pose
        Where the trunk is launched. A start on a wall is allowed.
    options
        Choices of the growth model; the defaults if None.
    engine
        ``kernel``: compiled. ``reference``: the readable twin, a thousand times slower.
    tree
        What to grow in place of all the design's branches, such as some of them, cut shorter; the
        design then gives the widths of the levels.

    Returns
    -------
    Deployment
        Chains, stop reasons, lengths and turns. A branch that stopped at once has a chain of two
        equal points; one that never emerged has none. With inflated bodies, a branch without room
        for its base has not deployed.

    Raises
    ------
    BadInputError
        If the pose is inside an obstacle or outside the bounds.
    """
    options = options or GrowthOptions()
    start = Start(*terrain.start_mm(pose), math.cos(pose.heading_rad), math.sin(pose.heading_rad))
    tree = branch_tree(design) if tree is None else tree
    rules = Rules(
        head_on_half_angle_rad=options.head_on_half_angle_rad,
        deploys_stuck=options.deploys_stuck,
        tolerance_mm=terrain.tolerance_mm,
        tolerance_rad=TOLERANCE_RAD,
        most_events=MOST_EVENTS,
    )
    spans = _spans(design, tree, options)
    growth = _grown(tree, terrain, start, rules, spans, grow_branches_of(engine))
    used = growth.first_point[-1]
    return Deployment(
        tree=tree,
        pose=pose,
        points_mm=growth.points[:used].copy(),
        first_point=growth.first_point,
        stop=growth.stop,
        grown_mm=growth.grown,
        contact_turn_rad=growth.turn,
    )


def grow_branches_of(engine: Engine) -> GrowBranches:
    """Return an engine by its name; it is imported only when asked for.

    Raises
    ------
    UnknownNameError
        If there is no such engine.
    """
    if engine == "kernel":
        from vinefab.growth import kernel  # noqa: PLC0415  numba takes a second to import

        return kernel.grow_branches  # type: ignore[no-any-return]
    if engine == "reference":
        from vinefab.growth import reference  # noqa: PLC0415  as above: one engine at a time

        return reference.grow_branches
    raise UnknownNameError("growth engine", engine, ("kernel", "reference"))


class _Span(NamedTuple):
    """Branches ``first .. last - 1``, grown on the same walls."""

    first: int
    last: int
    radius_mm: float


def _spans(design: Design, tree: BranchTree, options: GrowthOptions) -> tuple[_Span, ...]:
    """Return the whole tree for bare centrelines, or one span per level for inflated bodies."""
    if options.body == "centerline":
        return (_Span(0, len(tree), 0.0),)
    edges = np.searchsorted(tree.level, np.arange(1, design.depth + 2)).tolist()
    radii_mm = [width_mm / math.pi for width_mm in design.build.widths_mm]
    return tuple(map(_Span, edges[:-1], edges[1:], radii_mm))


def _grown(
    tree: BranchTree,
    terrain: Terrain,
    start: Start,
    rules: Rules,
    spans: tuple[_Span, ...],
    grow_branches: GrowBranches,
) -> Growth:
    """Return the growth of a tree, span by span, with as much room as it takes."""
    arrays = _tree_arrays(tree)
    growth = Growth.empty(len(tree), POINTS_PER_BRANCH * len(tree) + 16)
    radius_mm = 0.0
    for span in spans:
        # Only a body wider than what reached the place can lack room there.
        if span.radius_mm > radius_mm:
            _look_for_room(arrays, growth, start, terrain, span)
        radius_mm = span.radius_mm
        walls, done = terrain.walls(radius_mm), span.first
        while True:
            done = grow_branches(walls, arrays, rules, start, growth, done, span.last)
            if done == span.last:
                break
            growth = growth.with_room(2 * len(growth.points))
    return growth


def _tree_arrays(tree: BranchTree) -> TreeArrays:
    turn = np.column_stack([np.cos(tree.offset_rad), np.sin(tree.offset_rad)])
    return TreeArrays(tree.parent, turn, tree.length_mm, np.ones(len(tree), dtype=np.bool_))


def _look_for_room(
    arrays: TreeArrays, growth: Growth, start: Start, terrain: Terrain, span: _Span
) -> None:
    """Mark the branches of a span whose bases lie outside their own free space."""
    for branch in range(span.first, span.last):
        parent = arrays.parent[branch]
        if parent < 0:
            x_mm, y_mm = start.x, start.y
        else:
            x_mm, y_mm = growth.points[growth.first_point[parent + 1] - 1]
        arrays.fits[branch] = terrain.has_room(x_mm, y_mm, span.radius_mm)
