"""What always holds, on random maps with random and degenerate poses."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import affinity, box

from vinefab.growth.arrays import Growth, Rules
from vinefab.growth.batch import TIE, TOLERANCE_RAD
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.map import Map, Pose

seeds = st.integers(0, 2**32 - 1)
kinds = st.sampled_from(["convex", "star", "needles", "lattice"])
quick = settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
FITS = np.array([True])
FREE = GrowthOptions.published(head_on_half_angle_rad=0.0, children_of_stuck="deploy")


@quick
@given(seed=seeds, kind=kinds, half_angle_deg=st.sampled_from([0.0, 1.0, 15.0]))
def test_stays_in_free_space_and_within_its_length(
    *, engine, random_map, random_pose, random_tree, depth_in_solid, seed, kind, half_angle_deg
):
    rng = np.random.default_rng(seed)
    world = random_map(rng, kind)
    terrain = Terrain.of(world)
    options = GrowthOptions.published(
        head_on_half_angle_rad=math.radians(half_angle_deg), children_of_stuck="deploy"
    )
    grown = engine.grow(random_tree(rng), terrain, random_pose(rng, terrain), options)
    assert depth_in_solid(grown, world.free_space) <= 1e-6
    planned = grown.tree.length_mm
    full = grown.stop == Stop.FULL_LENGTH
    assert (grown.grown_mm <= planned).all()
    assert_allclose(grown.grown_mm[full], planned[full])
    for branch in np.flatnonzero(grown.deployed).tolist():
        chain = shapely.LineString(grown.chain_mm(branch))
        assert_allclose(chain.length, grown.grown_mm[branch], atol=1e-7)


@quick
@given(seed=seeds, kind=st.sampled_from(["convex", "star"]))
def test_contacts_are_vertices_of_the_map(engine, random_map, random_pose, vine, seed, kind):
    rng = np.random.default_rng(seed)
    world = random_map(rng, kind)
    terrain = Terrain.of(world)
    grown = engine.grow(vine(1500.0), terrain, random_pose(rng, terrain), FREE)
    corners = shapely.get_coordinates(world.free_space)
    for contact in grown.contacts_mm(0):
        assert np.hypot(*(corners - contact).T).min() <= 1e-6


@quick
@given(seed=seeds, kind=kinds, share=st.floats(0.02, 0.98))
def test_shorter_and_longer_growths_share_their_history(
    *, engine, random_map, random_pose, trunk_arrays, seed, kind, share
):
    rng = np.random.default_rng(seed)
    terrain = Terrain.of(random_map(rng, kind))
    pose = random_pose(rng, terrain)
    short, events = _stopped_after(engine, trunk_arrays, terrain, pose, share * 1500.0, 1000)
    if short.stop[0] != Stop.FULL_LENGTH:
        long, _ = _stopped_after(engine, trunk_arrays, terrain, pose, 1500.0, 1000)
        assert long.stop[0] == short.stop[0]
    else:
        # The last event of the short one is running out of length; up to there both are one.
        short, _ = _stopped_after(engine, trunk_arrays, terrain, pose, share * 1500.0, events - 1)
        long, _ = _stopped_after(engine, trunk_arrays, terrain, pose, 1500.0, events - 1)
    used = short.first_point[1]
    assert long.first_point[1] == used
    assert_allclose(long.points[:used], short.points[:used], atol=1e-9)


def _stopped_after(engine, trunk_arrays, terrain, pose, length_mm, most_events):
    """Grow a vine for at most so many events."""
    growth = Growth.empty(1, 200)
    plan = trunk_arrays(length_mm)
    rules = Rules(
        head_on_half_angle_rad=0.0,
        deploys_stuck=False,
        tolerance_mm=terrain.tolerance_mm,
        tolerance_rad=TOLERANCE_RAD,
        tie=TIE,
        most_events=most_events,
        friction=0.0,
        drag_kpa_mm=0.0,
    )
    start = (*terrain.start_mm(pose), math.cos(pose.heading_rad), math.sin(pose.heading_rad))
    assert engine.branches(terrain.walls(), plan, FITS, rules, start, growth, 0, 1) == 1
    return growth, int(growth.events[0])


def _moved(pose: Pose, turn_rad: float, shift: tuple[float, float], scale: float) -> Pose:
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return Pose(
        x_mm=scale * (c * pose.x_mm - s * pose.y_mm) + shift[0],
        y_mm=scale * (s * pose.x_mm + c * pose.y_mm) + shift[1],
        heading_rad=pose.heading_rad + turn_rad,
    )


def _mapped(world: Map, matrix: list[float]) -> Map:
    return Map(
        name="moved",
        bounds=affinity.affine_transform(world.bounds, matrix),
        obstacles=tuple(affinity.affine_transform(p, matrix) for p in world.obstacles),
    )


def _plain_pose(rng: np.random.Generator, terrain: Terrain) -> Pose:
    """A pose without exact ties, which rounding may settle otherwise after a move."""
    while True:
        x, y = rng.uniform(0.0, 500.0, 2)
        pose = Pose(x_mm=float(x), y_mm=float(y), heading_rad=float(rng.uniform(-3.0, 3.0)))
        if terrain.is_free(pose):
            return pose


@quick
@given(
    seed=seeds,
    kind=st.sampled_from(["convex", "star"]),
    turn_rad=st.floats(-3.0, 3.0),
    shift=st.tuples(st.floats(-900.0, 900.0), st.floats(-900.0, 900.0)),
    scale=st.sampled_from([0.013, 0.7, 1.0, 3.0, 170.0]),
)
def test_moving_turning_and_scaling_everything_moves_the_result(
    *, engine, random_map, tree, seed, kind, turn_rad, shift, scale
):
    rng = np.random.default_rng(seed)
    world = random_map(rng, kind)
    terrain = Terrain.of(world)
    pose = _plain_pose(rng, terrain)
    c, s = scale * math.cos(turn_rad), scale * math.sin(turn_rad)
    moved = Terrain.of(_mapped(world, [c, -s, s, c, *shift]))
    here = engine.grow(tree(700.0, (3, 200.0, 100.0, 0.5)), terrain, pose, FREE)
    robot = tree(700.0 * scale, (3, 200.0 * scale, 100.0, 0.5))
    there = engine.grow(robot, moved, _moved(pose, turn_rad, shift, scale), FREE)
    assert there.stop.tolist() == here.stop.tolist()
    assert there.first_point.tolist() == here.first_point.tolist()
    expected = here.points_mm @ np.array([[c, s], [-s, c]]) + shift
    assert_allclose(there.points_mm, expected, atol=1e-6 * max(1.0, scale))
    assert_allclose(there.contact_turn_rad, here.contact_turn_rad, atol=1e-6)


@quick
@given(seed=seeds, kind=st.sampled_from(["convex", "star"]))
def test_mirroring_everything_mirrors_the_result(engine, random_map, tree, seed, kind):
    rng = np.random.default_rng(seed)
    world = random_map(rng, kind)
    terrain = Terrain.of(world)
    pose = _plain_pose(rng, terrain)
    mirror = Terrain.of(_mapped(world, [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
    flipped = Pose(x_mm=-pose.x_mm, y_mm=pose.y_mm, heading_rad=math.pi - pose.heading_rad)
    robot = tree(700.0, (3, 200.0, 100.0, 1.0))
    here = engine.grow(robot, terrain, pose, FREE)
    there = engine.grow(robot, mirror, flipped, FREE)
    # The fan is mirrored too: its last child is the other's first.
    for one, other in zip([0, 1, 2, 3], [0, 3, 2, 1], strict=True):
        assert there.stop[other] == here.stop[one]
        assert_allclose(there.chain_mm(other) * [-1.0, 1.0], here.chain_mm(one), atol=1e-6)


@pytest.mark.parametrize("kind", ["convex", "star"])
def test_trajectories_condense(engine, random_map, vine, kind):
    """Headings that keep the contacts in order change nothing beyond the first contact."""
    pairs = 0
    for seed in range(20):
        rng = np.random.default_rng([31, seed])
        terrain = Terrain.of(random_map(rng, kind))
        pose = _plain_pose(rng, terrain)
        grown = [engine.grow(vine(1200.0), terrain, _moved(pose, 0.0, (0.0, 0.0), 1.0), FREE)]
        for step in range(1, 8):
            turned = Pose(
                x_mm=pose.x_mm, y_mm=pose.y_mm, heading_rad=pose.heading_rad + 0.01 * step
            )
            grown.append(engine.grow(vine(1200.0), terrain, turned, FREE))
        for one, other in itertools.pairwise(grown):
            contacts = one.contacts_mm(0)
            if len(contacts) and np.array_equal(contacts, other.contacts_mm(0)):
                pairs += 1
                assert_allclose(one.chain_mm(0), other.chain_mm(0), atol=1e-7)
                assert one.stop[0] == other.stop[0]
    assert pairs >= 10


@quick
@given(x=st.floats(1.0, 499.0), y=st.floats(1.0, 499.0), heading=st.floats(-3.2, 3.2))
def test_an_empty_room_ends_growth_on_its_walls(engine, vine, x, y, heading):
    assume(abs(math.sin(2.0 * heading)) > 1e-6)
    terrain = Terrain.of(Map(name="room", bounds=box(0.0, 0.0, 500.0, 500.0)))
    pose = Pose(x_mm=x, y_mm=y, heading_rad=heading)
    grown = engine.grow(vine(2000.0), terrain, pose, FREE)
    assert grown.stop[0] == Stop.CORNER
    assert len(grown.points_mm) == 2
    # It ends in the corner that it heads for, or in the one that sliding there leads to.
    u = np.array([math.cos(heading), math.sin(heading)])
    assert_allclose(grown.tips_mm[0], np.where(u > 0.0, 500.0, 0.0), atol=1e-7)
