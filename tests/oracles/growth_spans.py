"""One growth, span by span in plain Python: the oracle that batches of growths are held against.

Which kernel grows the branches is a parameter: the reference of `tests.oracles.growth_reference`,
or the kernel that ships, as the interpreter runs it.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.oracles.growth_reference import grow_reference_branches
from vinefab.core.compiling import interpreted
from vinefab.growth.arrays import (
    Growth,
    JobArrays,
    Launch,
    Rules,
    TreesArrays,
    WallArrays,
)
from vinefab.growth.batch import KERNEL, Settling, grow_on, rules_of
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Pose

Fits = NDArray[np.bool_]
GrowBranches = Callable[[WallArrays, TreesArrays, Fits, Rules, Launch, Growth, int, int], int]


def launch_of(terrain: Terrain, pose: Pose) -> Launch:
    """Return where a trunk starts, as kernels take it."""
    return (*terrain.start_mm(pose), math.cos(pose.heading_rad), math.sin(pose.heading_rad))


def grow_spans(
    grow_branches: GrowBranches,
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions | None = None,
    draw_seed: int = 0,
) -> Deployment:
    """Return how a design deploys from a pose, grown by some kernel."""
    options = options or GrowthOptions()
    start, plan = launch_of(terrain, pose), Plan.of(design, options)
    rules = rules_of(options, terrain.tolerance_mm)
    rules = rules._replace(head_on_half_angle_rad=options.only_half_angle_rad)
    arrays, growth = plan.arrays(), Growth.empty(len(plan), 6 * len(plan) + 16)
    fits, reached_mm = np.ones(len(plan), dtype=np.bool_), 0.0
    for first, last, radius_mm in zip(plan.edges, plan.edges[1:], plan.radii_mm, strict=False):
        # Only a body wider than the one that reached the place can lack room there.
        if radius_mm > reached_mm:
            bases_mm = np.array([start[:2]])
            if first > 0:
                parent = arrays.parent[first:last]
                bases_mm = growth.points[growth.first_point[parent + 1] - 1]
            fits[first:last] = terrain.have_room(bases_mm, radius_mm)
        reached_mm, walls, done = radius_mm, terrain.walls(radius_mm), first
        with np.errstate(all="ignore"):
            while done < last:
                done = grow_branches(walls, arrays, fits, rules, start, growth, done, last)
                growth = growth if done == last else _with_room(growth, 2 * len(growth.points))
    _settle(growth, plan, start, terrain, options, draw_seed)
    return Deployment(
        tree=plan.tree,
        pose=pose,
        points_mm=growth.points[: growth.first_point[-1]].copy(),
        first_point=growth.first_point,
        stop=growth.stop,
        grown_mm=growth.grown,
        contact_turn_rad=growth.turn,
    )


def _with_room(growth: Growth, room: int) -> Growth:
    """Return the same growth so far, with room for more chain points."""
    more = Growth.empty(len(growth.stop), room)
    more.points[: len(growth.points)] = growth.points
    return growth._replace(
        points=more.points,
        chain_length=more.chain_length,
        chain_sense=more.chain_sense,
        chain_gain=more.chain_gain,
        chain_drawn=more.chain_drawn,
    )


def _settle(
    growth: Growth,
    plan: Plan,
    start: Launch,
    terrain: Terrain,
    options: GrowthOptions,
    draw_seed: int,
) -> None:
    settling, none = Settling.of(options), np.zeros(1, dtype=np.int64)
    if not settling.is_needed:
        return
    jobs = JobArrays(
        tree=none,
        page=none,
        start=np.array([start], dtype=np.float64),
        half_angle=np.zeros(1),
        fits=np.ones(len(plan), dtype=np.bool_),
        branch=np.array([0, len(plan)]),
        room=np.array([0, len(growth.points)]),
        done=none,
        until=np.array([len(plan)]),
    )
    tolerance_mm = np.array([terrain.tolerance_mm])
    trees = TreesArrays.of([plan.arrays()])
    emergence = np.where(plan.parts.is_bent, 1.0, settling.emergence)
    seeds = np.array([draw_seed])
    settling.settle(trees, plan.radius_mm, emergence, jobs, growth, tolerance_mm, seeds, "kernel")


def grow_reference(
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions | None = None,
    draw_seed: int = 0,
) -> Deployment:
    """Return how a design deploys from a pose, grown by the reference."""
    return grow_spans(grow_reference_branches, design, terrain, pose, options, draw_seed)


class Grower(NamedTuple):
    """One of the two simulators under test: of whole designs, and of some branches."""

    grow: Callable[..., Deployment]
    branches: GrowBranches


SHIPPED = Grower(grow_on, interpreted(KERNEL).grow_branches)
