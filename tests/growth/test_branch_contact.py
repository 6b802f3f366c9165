"""Branches that stop at each other: against small steps, and what always holds."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import affinity
from shapely.ops import substring

from tests.oracles.branch_contact import stopped_in_steps
from vinefab.growth.batch import Batch, Launches, TerrainSet, grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan, Plans
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose

STOP = GrowthOptions(branch_contact="stop", pressure_stop=False)
PASS = STOP.changed(branch_contact="pass")
EMPTY = Terrain.of(Map(name="empty", bounds=shapely.box(-1000, -1000, 1000, 1000), obstacles=()))
MIDDLE = Pose(x_mm=0.0, y_mm=-500.0, heading_rad=math.pi / 2.0)
seeds = st.integers(0, 2**32 - 1)
quick = settings(max_examples=12, suppress_health_check=list(HealthCheck), deadline=None)


def crowded(rng) -> Design:
    """Return a robot whose branches get in each other's way."""
    width_mm = float(rng.uniform(6.0, 30.0))
    levels = tuple(
        Level(
            branches=int(rng.integers(2, 4)),
            length_mm=float(rng.uniform(40.0, 150.0)),
            fan_rad=float(rng.uniform(0.5, 4.5)),
            growth=float(rng.uniform(0.5, 1.6)),
        )
        for _ in range(rng.integers(1, 4))
    )
    widths_mm = tuple(width_mm * 0.7**level for level in range(len(levels) + 1))
    trunk_mm = float(rng.uniform(60.0, 200.0))
    build = Build(widths_mm=widths_mm)
    return Design(name="crowded", trunk_length_mm=trunk_mm, levels=levels, build=build)


def free_pose(rng, terrain, room_mm) -> Pose:
    while True:
        x, y = rng.uniform(0.0, 500.0, 2).tolist()
        pose = Pose(x_mm=x, y_mm=y, heading_rad=float(rng.uniform(-3.0, 3.0)))
        if terrain.is_free(pose) and terrain.have_room(np.array([[x, y]]), room_mm)[0]:
            return pose


def grown_both(random_map, seed, options=STOP):
    rng = np.random.default_rng(seed)
    world, design = random_map(rng, "convex"), crowded(rng)
    terrain = Terrain.of(world)
    pose = free_pose(rng, terrain, 6.0)
    stopped = grow_on(design, terrain, pose, options, "kernel")
    alone = grow_on(design, terrain, pose, options.changed(branch_contact="pass"), "kernel")
    return world, design, pose, stopped, alone


def test_stops_where_small_steps_do(random_map):
    cuts = 0
    for seed in range(4):
        _, design, _, stopped, alone = grown_both(random_map, [31, seed])
        bodies = stopped_in_steps(alone, Plan.of(design, STOP).radius_mm, 0.2)
        for k, body in enumerate(bodies):
            expected = {"cut": Stop.BRANCH, "inside": Stop.NOT_DEPLOYED}.get(
                body.state, alone.stop[k]
            )
            length_mm = 0.0 if body.state == "inside" else body.end_mm - body.begin_mm
            assert stopped.stop[k] == expected, (seed, k)
            assert abs(stopped.grown_mm[k] - length_mm) <= 0.5, (seed, k)
            cuts += body.state == "cut"
    assert cuts > 3


@quick
@given(seed=seeds)
def test_no_two_bodies_overlap_once_they_were_apart(random_map, seed):
    _, design, _, grown, alone = grown_both(random_map, seed)
    radius_mm = Plan.of(design, STOP).radius_mm
    out = np.flatnonzero(grown.deployed).tolist()
    base_mm = grown.base_mm
    for one in out:
        chain = shapely.LineString(grown.chain_mm(one))
        touches_at_its_end = False
        for other in out:
            if one == other or base_mm[other] >= base_mm[one] + grown.grown_mm[one] - 1e-6:
                continue
            reach_mm = radius_mm[one] + radius_mm[other]
            born_mm = max(base_mm[one], base_mm[other])
            was_apart = False
            end_mm = base_mm[one] + grown.grown_mm[one]
            body = shapely.LineString(grown.chain_mm(other))
            for now_mm in np.linspace(born_mm, end_mm, 60).tolist():
                tip = shapely.line_interpolate_point(chain, now_mm - base_mm[one])
                laid_mm = min(now_mm - base_mm[other], grown.grown_mm[other])
                laid = substring(body, 0.0, laid_mm)
                gap_mm = shapely.distance(tip, laid) - reach_mm
                assert gap_mm >= -1e-4 or not was_apart, (one, other, now_mm)
                was_apart |= gap_mm > 1e-4
                touches_at_its_end |= now_mm == end_mm and gap_mm <= 1e-4
        if grown.stop[one] == Stop.BRANCH:
            assert touches_at_its_end, one
            assert grown.grown_mm[one] < alone.grown_mm[one]
            # Shorter, it has turned no further against walls.
            assert 0.0 <= grown.contact_turn_rad[one] <= alone.contact_turn_rad[one]
        else:
            assert grown.grown_mm[one] == alone.grown_mm[one]
            assert (grown.chain_mm(one) == alone.chain_mm(one)).all()


@quick
@given(seed=seeds)
def test_children_of_a_cut_branch_stay_in(random_map, seed):
    *_, grown, alone = grown_both(random_map, seed, STOP.changed(children_of_stuck="deploy"))
    for branch, parent in enumerate(grown.tree.parent.tolist()):
        if parent >= 0 and grown.stop[parent] in (Stop.BRANCH, Stop.NOT_DEPLOYED):
            assert grown.stop[branch] == Stop.NOT_DEPLOYED
        elif grown.stop[branch] == Stop.NOT_DEPLOYED:
            assert alone.stop[branch] == Stop.NOT_DEPLOYED
        assert len(grown.chain_mm(branch)) == 0 or len(grown.chain_mm(branch)) >= 2


@quick
@given(
    seed=seeds,
    turn_rad=st.floats(-3.0, 3.0),
    mirrored=st.booleans(),
    scale=st.sampled_from([0.5, 1.0, 4.0]),
)
def test_mirroring_turning_and_scaling_everything_moves_the_result(
    random_map, seed, turn_rad, mirrored, scale
):
    world, design, pose, grown, _ = grown_both(random_map, seed)
    hand = -1.0 if mirrored else 1.0
    c, s = scale * math.cos(turn_rad), scale * math.sin(turn_rad)
    matrix = [c, -hand * s, s, hand * c, 0.0, 0.0]

    def moved(shape):
        return affinity.affine_transform(shape, matrix)

    other = Map(
        name="moved", bounds=moved(world.bounds), obstacles=tuple(map(moved, world.obstacles))
    )
    x, y = np.array([[c, -hand * s], [s, hand * c]]) @ (pose.x_mm, pose.y_mm)
    start = Pose(x_mm=float(x), y_mm=float(y), heading_rad=hand * pose.heading_rad + turn_rad)
    tree = design.tree
    build = Build(widths_mm=tuple(scale * width for width in design.build.widths_mm))
    robot = design.changed(
        trunk_length_mm=scale * design.trunk_length_mm,
        levels=tuple(level.changed(length_mm=scale * level.length_mm) for level in design.levels),
        build=build,
    )
    length_mm, offset_rad = scale * tree.length_mm, hand * tree.offset_rad
    plan = Plan.of(robot, STOP, replace(robot.tree, length_mm=length_mm, offset_rad=offset_rad))
    there = grow_on(robot, Terrain.of(other), start, STOP, "kernel", plan)
    assert there.stop.tolist() == grown.stop.tolist()
    assert_allclose(there.grown_mm, scale * grown.grown_mm, atol=1e-4 * max(1.0, scale))


@quick
@given(seed=seeds)
def test_the_order_of_children_does_not_matter(random_map, seed):
    rng = np.random.default_rng(seed)
    world, design, pose, grown, _ = grown_both(random_map, seed)
    tree = grown.tree
    # Branches of a level in any order, so that children of one parent are reordered too.
    order = np.lexsort((rng.random(len(tree)), tree.level))
    place = np.argsort(order)
    parent = np.where(tree.parent[order] < 0, -1, place[tree.parent[order]])
    shuffled = replace(
        tree,
        parent=parent,
        level=tree.level[order],
        offset_rad=tree.offset_rad[order],
        length_mm=tree.length_mm[order],
    )
    plan = Plan.of(design, STOP, shuffled)
    again = grow_on(design, Terrain.of(world), pose, STOP, "kernel", plan)
    assert again.stop.tolist() == grown.stop[order].tolist()
    assert_allclose(again.grown_mm, grown.grown_mm[order], atol=1e-6)


def fork(fan_deg, length_mm, then_deg):
    levels = (Level.of(2, length_mm, fan_deg, 100.0), Level.of(2, 150.0, then_deg, 100.0))
    return Design(
        name="fork", trunk_length_mm=50.0, levels=levels, build=Build(widths_mm=(20, 14, 10))
    )


def test_tips_that_meet_head_to_head_both_stop_half_way():
    # The inner grandchildren grow towards each other: 45 - 135 = -90 degrees from the trunk.
    grown = grow_on(fork(90.0, 100.0, 270.0), EMPTY, MIDDLE, STOP)
    (inner,) = [[k for k in range(3, 7) if grown.stop[k] == Stop.BRANCH]]
    assert len(inner) == 2
    apart_mm = 2 * 100.0 * math.sin(math.radians(45.0))
    assert_allclose(grown.grown_mm[inner], (apart_mm - 2 * 10.0 / math.pi) / 2.0, atol=1e-5)
    one, two = (grown.chain_mm(k)[-1] for k in inner)
    assert_allclose(one * (-1.0, 1.0), two, atol=1e-9)


def test_a_tip_stops_at_the_side_of_a_body_that_was_there():
    # The first child is short: one of its children grows at right angles to the trunk, and meets
    # the second child, which leaves the trunk at 45 degrees, half a turn from it.
    levels = (Level.of(2, 100.0, 90.0, 160.0), Level.of(2, 150.0, 270.0, 100.0))
    design = fork(90.0, 100.0, 270.0).changed(levels=levels)
    grown = grow_on(design, EMPTY, MIDDLE, STOP)
    (met,) = [k for k in range(7) if grown.stop[k] == Stop.BRANCH]
    assert grown.tree.parent[met] == 1
    reach_mm = (14.0 + 10.0) / math.pi
    expected_mm = 2.0 * 100.0 * math.sin(math.pi / 4.0) - reach_mm / math.sin(math.pi / 4.0)
    assert_allclose(grown.grown_mm[met], expected_mm, atol=1e-5)


def test_siblings_are_free_near_their_joint_and_children_of_their_parent():
    grown = grow_on(fork(20.0, 100.0, 20.0), EMPTY, MIDDLE, STOP)
    assert (grown.stop == Stop.FULL_LENGTH).all()


def test_lines_stop_where_they_cross():
    options = GrowthOptions.published(branch_contact="stop")
    grown = grow_on(fork(90.0, 100.0, 270.0), EMPTY, MIDDLE, options)
    inner = [k for k in range(3, 7) if grown.stop[k] == Stop.BRANCH]
    assert_allclose(grown.grown_mm[inner], 100.0 * math.sin(math.radians(45.0)), atol=1e-5)
    chains = [shapely.LineString(grown.chain_mm(k)) for k in range(7)]
    assert not any(a.crosses(b) for a in chains for b in chains)


@pytest.mark.parametrize("body", ["inflated", "centerline"])
def test_batches_and_the_interpreter_give_the_same_bytes(random_map, body):
    rng = np.random.default_rng(3)
    terrain = Terrain.of(random_map(rng, "convex"))
    designs = [crowded(rng) for _ in range(6)]
    poses = [free_pose(rng, terrain, 6.0) for _ in range(4)]
    options = STOP.changed(body=body)
    launches = Launches.of(TerrainSet([terrain]), [poses])
    batch = Batch(Plans.of(designs, options), launches, options).deployments()
    pairs = [(design, pose) for pose in poses for design in designs]
    cuts = 0
    for (design, pose), one in zip(pairs, batch, strict=True):
        for engine in ("kernel", "interpreted"):
            alone = grow_on(design, terrain, pose, options, engine)
            for name in ("points_mm", "first_point", "stop", "grown_mm", "contact_turn_rad"):
                assert (getattr(alone, name) == getattr(one, name)).all(), (name, engine)
        cuts += int((one.stop == Stop.BRANCH).sum())
    assert cuts > 3
