"""A map that is turned, mirrored, moved or scaled with its robot gives the same growth, ties too.

Children as short as 0.02 mm start in the corners where their parents ended, go out along a wall and
come back, and meet walls at right angles: here rounding would decide, if no rule did.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pytest
from shapely import affinity, box

from tests.growth.conftest import SIZE_MM, convex, star
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose

Tree = Callable[..., Design]
FANS_DEG = (0.0, 30.0, 60.0, 90.0, 180.0, 270.0, 360.0)
SHORTEST_MM, LONGEST_MM = 0.002, 0.05
OPTIONS = GrowthOptions.published(
    head_on_half_angle_rad=0.0, children_of_stuck="deploy", body="centerline"
)


class Motion(NamedTuple):
    """A motion of the plane: a turn, perhaps a mirror before it, a scale and a shift."""

    turn_rad: float = 0.0
    shift_mm: tuple[float, float] = (0.0, 0.0)
    scale: float = 1.0
    mirrors: bool = False

    @property
    def matrix(self) -> np.ndarray:
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        return (
            self.scale * np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if self.mirrors else 1.0, 1])
        )

    def of_points(self, points_mm: np.ndarray) -> np.ndarray:
        return points_mm @ self.matrix.T + self.shift_mm

    def of_map(self, world: Map) -> Map:
        numbers = [*self.matrix.ravel().tolist(), *self.shift_mm]
        bounds, *obstacles = (
            affinity.affine_transform(shape, numbers) for shape in (world.bounds, *world.obstacles)
        )
        return Map(name="moved", bounds=bounds, obstacles=tuple(obstacles))

    def of_pose(self, pose: Pose) -> Pose:
        x_mm, y_mm = self.of_points(np.array([pose.x_mm, pose.y_mm])).tolist()
        heading_rad = math.pi - pose.heading_rad if self.mirrors else pose.heading_rad
        return Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=heading_rad + self.turn_rad)


def _motions(rng: np.random.Generator) -> Iterator[Motion]:
    for mirrors in (False, True):
        yield Motion(turn_rad=rng.uniform(-3.0, 3.0), mirrors=mirrors)
        far_mm = tuple(rng.uniform(-20_000.0, 20_000.0, 2).tolist())
        yield Motion(turn_rad=rng.uniform(-3.0, 3.0), shift_mm=far_mm, mirrors=mirrors)
    yield Motion(scale=float(rng.choice([0.013, 0.7, 3.0, 170.0])))


def _images(here: Deployment, motion: Motion) -> list[int]:
    """Return which branch each one becomes: a mirror reverses the order of siblings."""
    parent, image = here.tree.parent.tolist(), [0]
    for branch in range(1, len(parent)):
        siblings = [k for k, above in enumerate(parent) if above == parent[branch]]
        place = siblings.index(branch)
        first = [k for k, above in enumerate(parent) if above == image[parent[branch]]]
        image.append(first[-1 - place] if motion.mirrors else first[place])
    return image


def _assert_moves_along(
    tree: Tree, shape: list[tuple[float, ...]], world: Map, pose: Pose, motion: Motion
) -> Deployment:
    """Grow a tree of (length) and (branches, length, fan, growth) here and moved; compare."""
    (trunk_mm,), levels = shape[0], shape[1:]
    scaled = [(n, length * motion.scale, fan, growth) for n, length, fan, growth in levels]
    here = grow_on(tree(trunk_mm, *levels), Terrain.of(world), pose, OPTIONS)
    there = grow_on(
        tree(trunk_mm * motion.scale, *scaled),
        Terrain.of(motion.of_map(world)),
        motion.of_pose(pose),
        OPTIONS,
    )
    for branch, image in enumerate(_images(here, motion)):
        assert Stop(int(there.stop[image])) == Stop(int(here.stop[branch])), (branch, motion)
        ends = motion.of_points(here.chain_mm(branch)[[0, -1]])
        away_mm = np.abs(there.chain_mm(image)[[0, -1]] - ends).max() / motion.scale
        assert away_mm <= 1e-4, (branch, motion)
    return here


TURNS_DEG = range(0, 360, 13)
ROOM = Map(name="room", bounds=box(0.0, 0.0, SIZE_MM, SIZE_MM))


@pytest.mark.parametrize("turn_deg", TURNS_DEG)
def test_a_length_used_up_where_a_wall_ends_is_full_length(tree, turn_deg):
    """Out of a corner along a wall, and back into it: the length ends with the wall."""
    shape = [(0.04,), (2, 0.02, 350.0, 1.0), (2, 0.02, 10.0, 1.0)]
    pose = Pose(x_mm=0.0, y_mm=0.0, heading_rad=math.radians(-5.0))
    grown = _assert_moves_along(tree, shape, ROOM, pose, Motion(turn_rad=math.radians(turn_deg)))
    assert [Stop(int(stop)) for stop in grown.stop] == [Stop.FULL_LENGTH] * 7


@pytest.mark.parametrize("turn_deg", TURNS_DEG)
def test_a_short_body_on_a_wall_has_its_direction(tree, turn_deg):
    """Far along a wall, a little back, then at right angles into it: head-on, to half an angle."""
    shape = [(0.014,), (1, 175.5, 0.0, 1.0), (2, 0.038, 350.0, 1.0), (2, 45.0, 180.0, 1.0)]
    pose = Pose(x_mm=500.0, y_mm=500.0, heading_rad=math.radians(175.0))
    grown = _assert_moves_along(tree, shape, ROOM, pose, Motion(turn_rad=math.radians(turn_deg)))
    assert np.flatnonzero(grown.stop == Stop.HEAD_ON).tolist() == [5]


@pytest.mark.parametrize("turn_deg", TURNS_DEG)
def test_a_body_as_short_as_rounding_keeps_its_heading(tree, turn_deg):
    """A child that is wedged in a corner at once points there, and launches its own from there."""
    shape = [(0.015,), (1, 1000.0, 0.0, 1.0), (3, 0.04, 64.0, 1.0), (3, 0.02, 270.0, 1.0)]
    pose = Pose(x_mm=0.0, y_mm=456.689, heading_rad=math.radians(90.0))
    grown = _assert_moves_along(tree, shape, ROOM, pose, Motion(turn_rad=math.radians(turn_deg)))
    assert Stop.CORNER in grown.stop[2:5].tolist()


def _corner_map(rng: np.random.Generator) -> Map:
    """Return a room with 4 to 25 obstacles, many of which overlap."""
    count, shape = int(rng.integers(2, 6)), (convex, star)[rng.integers(2)]
    pitch = SIZE_MM / count
    obstacles = []
    for cell in np.ndindex(count, count):
        centre = (np.array(cell) + 0.5 + rng.uniform(-0.1, 0.1, 2)) * pitch
        obstacles.append(shape(rng, centre, rng.uniform(0.2, 0.55) * pitch))
    good = [p for p in obstacles if p.geom_type == "Polygon" and p.is_valid and p.area > 0.0]
    return Map(name="corners", bounds=ROOM.bounds, obstacles=tuple(good))


def _free_pose(rng: np.random.Generator, terrain: Terrain) -> Pose:
    while True:
        x_mm, y_mm, heading_rad = rng.uniform([0.0, 0.0, -3.0], [SIZE_MM, SIZE_MM, 3.0]).tolist()
        pose = Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=heading_rad)
        if terrain.is_free(pose):
            return pose


def _length_mm(rng: np.random.Generator, kind: str) -> float:
    if kind == "equal":  # there and back again
        return float(rng.choice([0.02, 0.04, 5.0, 100.0]))
    is_short = kind == "short" or rng.random() < 0.5
    return float(rng.uniform(SHORTEST_MM, LONGEST_MM) if is_short else rng.uniform(1.0, 200.0))


def _tree_shape(rng: np.random.Generator, kind: str) -> list[tuple[float, ...]]:
    levels = []
    for _ in range(rng.integers(2, 5)):
        fan_deg = rng.choice(FANS_DEG) if rng.random() < 0.7 else rng.uniform(0.0, 345.0)
        levels.append((int(rng.integers(1, 4)), _length_mm(rng, kind), float(fan_deg), 1.0))
    return [(float(rng.uniform(100.0, 1500.0)),), *levels]


KINDS = ("equal", "short", "short and long")


def _moves_along(tree: Tree, kind: str, number: int) -> None:
    rng = np.random.default_rng([71, KINDS.index(kind), number])
    world = _corner_map(rng)
    pose, shape = _free_pose(rng, Terrain.of(world)), _tree_shape(rng, kind)
    for motion in _motions(rng):
        _assert_moves_along(tree, shape, world, pose, motion)


@pytest.mark.parametrize("kind", KINDS)
def test_trees_with_short_children_move_along(tree, kind):
    for number in range(6):
        _moves_along(tree, kind, number)


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(0, 1000, 250))
@pytest.mark.parametrize("kind", KINDS)
def test_many_trees_with_short_children_move_along(tree, kind, first):
    for number in range(first, first + 250):
        _moves_along(tree, kind, number)
