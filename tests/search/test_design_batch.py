"""Designs as arrays, equal to the same designs one by one to the last bit."""

import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.growth import kernel
from vinefab.growth.batch import Batch, Launches, TerrainSet, grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan, Plans
from vinefab.growth.terrain import Terrain
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.design import MOST_BRANCHES
from vinefab.search.space import (
    LIMITS,
    SPACE_DECIMALS,
    Bounds,
    BuildSettings,
    Space,
    SpaceSettings,
    _rounded,
    batch_branches,
    planned_batch,
)

WIDE = Space(
    SpaceSettings(
        levels=Bounds(low=1, high=4),
        branches=Bounds(low=1, high=7),
        by_level={
            1: {"length_mm": Bounds(low=30, high=60)},
            3: {"branches": Bounds(low=2, high=2)},
        },
    ),
    BuildSettings(),
)
PLAIN = Space(SpaceSettings(levels=Bounds(low=1, high=1)), BuildSettings())
SPACES = [Space(SpaceSettings(), BuildSettings()), WIDE, PLAIN]


def points(space, count=60):
    """Random points, with corners of the space among them."""
    x = np.random.default_rng(5).random((count, len(space)))
    x[: count // 4] = np.round(x[: count // 4])
    return x


@pytest.mark.parametrize("space", SPACES, ids=["table 1", "wide", "plain vines"])
@pytest.mark.parametrize("pressure_stop", [False, True])
@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_a_batch_has_the_plans_of_its_designs(space, body, *, pressure_stop):
    x, options = points(space), GrowthOptions.published(body=body, pressure_stop=pressure_stop)
    singles = [space.design(row) for row in x]
    deepest = space.build_of(int(space.settings.levels.high)).widths_mm
    radii_mm = (0.0,) if body == "centerline" else tuple(w / math.pi for w in deepest)
    designs = space.batch(x)
    builds = {depth: space.build_of(depth) for depth in range(1, 6)}
    trees = planned_batch(batch_branches(designs), builds, radii_mm, options).each
    assert designs.sizes.tolist() == [design.branch_count for design in singles]
    assert len(trees[2:5]) == 3
    for design, made in zip(singles, trees, strict=True):
        plan = Plan.of(design, options)
        assert (made.edges, made.radii_mm, made.build) == (plan.edges, plan.radii_mm, plan.build)
        np.testing.assert_array_equal(made.turn, plan.turn)
        np.testing.assert_array_equal(made.limit_kpa, plan.limit_kpa)
        assert np.isfinite(made.limit_kpa).all() == pressure_stop
        if pressure_stop:
            np.testing.assert_array_equal(made.store_kpa, plan.store_kpa)
        for field in fields(plan.tree):
            one, other = getattr(made.tree, field.name), getattr(plan.tree, field.name)
            np.testing.assert_array_equal(one, other)


def everything(deployment):
    arrays = (deployment.points_mm, deployment.grown_mm, deployment.stop)
    return [deployment.pose, deployment.contact_turn_rad.tolist(), *(a.tolist() for a in arrays)]


@pytest.mark.parametrize("space", SPACES[1:], ids=["wide", "plain vines"])
@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_a_batch_grows_as_its_designs_do(space, body):
    x, options = (
        points(space, 20),
        GrowthOptions.published(body=body, pressure_stop=body == "inflated"),
    )
    worlds = [grid_map(seed, GridOptions(columns=4, rows=4)) for seed in (1, 2)]
    poses = [draw_poses(world, 2, 5, clearance_mm=14.0) for world in worlds]
    launches = Launches.of(TerrainSet([Terrain.of(world) for world in worlds]), poses)
    deepest = space.build_of(int(space.settings.levels.high)).widths_mm
    radii_mm = (0.0,) if body == "centerline" else tuple(w / math.pi for w in deepest)
    builds = {depth: space.build_of(depth) for depth in range(1, 6)}
    designs = Batch(
        planned_batch(batch_branches(space.batch(x)), builds, radii_mm, options), launches, options
    )
    batch = Batch(Plans.of([space.design(row) for row in x], options), launches, options)
    assert len(designs) == len(batch)
    assert [everything(d) for d in designs.deployments()] == [
        everything(d) for d in batch.deployments()
    ]
    lengths = [
        [length for block in each.each(lambda b: b.planned_mm().tolist()) for length in block]
        for each in (designs, batch)
    ]
    assert lengths[0] == lengths[1]


@pytest.mark.compiler
def test_growth_is_compiled_once_for_all_ways_to_grow():
    """Compiling it again would take ten seconds; arrays of another kind make that necessary."""
    terrains = [Terrain.of(grid_map(seed, GridOptions(columns=4, rows=4))) for seed in (1, 2)]
    poses = [terrain.world.starts[0].pose for terrain in terrains]
    space, options = SPACES[0], GrowthOptions.published()
    design, x = space.design(np.full(len(space), 0.5)), np.full((1, len(space)), 0.5)
    builds = {depth: space.build_of(depth) for depth in range(1, 6)}
    grow_on(design, terrains[0], poses[0])
    for some in (1, 2):
        launches = Launches.of(TerrainSet(terrains[:some]), [[pose] for pose in poses[:some]])
        for plans in (
            Plans.of([design], options),
            planned_batch(batch_branches(space.batch(x)), builds, (0.0,), options),
        ):
            assert len(Batch(plans, launches, options).deployments()) == some
    assert len(kernel.grow_jobs.signatures) == 1


@given(st.lists(st.integers(-(10**9), 10**9), min_size=1, max_size=9), st.integers(-3, 3))
def test_numbers_are_rounded_as_python_does(thousandths, ulps):
    values = np.array(thousandths) / 1000.0
    for _ in range(abs(ulps)):
        values = np.nextafter(values, math.copysign(math.inf, ulps))
    expected = [round(value, SPACE_DECIMALS) for value in values.tolist()]
    assert _rounded(values).tolist() == expected


def test_trees_too_large_for_a_design_are_counted_but_not_planned():
    space = Space(
        SpaceSettings(levels=Bounds(low=10, high=10), branches=Bounds(low=1, high=1000)),
        BuildSettings(),
    )
    x = np.zeros((3, len(space)))
    x[1:, [v.name == "branches" for v in space.variables]] = [[1.0], [0.0015]]
    sizes = space.batch(x).sizes
    assert sizes[0] == 10
    assert sizes[1] > MOST_BRANCHES
    assert sizes[2] == 2**10 - 1
    tree = (
        planned_batch(
            batch_branches(space.batch(x[2:])),
            {10: space.build_of(10)},
            (0.0,),
            GrowthOptions.published(),
        )
        .each[0]
        .tree
    )
    np.testing.assert_array_equal(tree.parent, space.design(x[2]).tree.parent)


def test_every_corner_of_what_bounds_may_be_is_a_design_unless_it_is_too_large():
    ranges = {name: Bounds(low=low, high=high) for name, (low, high) in LIMITS.items()}
    space = Space(SpaceSettings(levels=Bounds(low=1, high=2), **ranges), BuildSettings())
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * len(space))).reshape(len(space), -1).T
    for x, size in zip(corners, space.batch(corners).sizes.tolist(), strict=True):
        assert space.design(x).branch_count == size
