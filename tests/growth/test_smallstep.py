"""The event-driven simulator against small steps, on random maps.

The small-step tip is put back on every wall that it crosses, so its error does not add up: both
simulations end in the same place to rounding, except when two events fall into one step. Hence
two tolerances: two steps for every growth, and a hundred thousandth of a step for nearly all.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from shapely import LineString, Point, Polygon, box

from tests.growth import smallstep
from vinefab.core.rng import child
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose

SIZE_MM = 120.0
JITTER = 1e-6
MOST_TRIES = 100
TWO_STEPS_MM = 0.02
EXACT_MM = 1e-6
HALF_ANGLE_DEG = 1.0


# ---- maps


def _blob(rng: np.random.Generator, x: float, y: float, radius: float, *, convex: bool) -> Polygon:
    """Return a random polygon about a point: convex, or a star with deep notches."""
    if convex:
        angles = np.sort(rng.uniform(0.0, math.tau, rng.integers(4, 8)))
        radii = np.full(len(angles), radius)
    else:
        count = int(rng.integers(5, 13))
        angles = (np.arange(count) + rng.uniform(-0.4, 0.4, count)) * math.tau / count
        radii = radius * rng.uniform(0.15, 1.0, count)
    return Polygon(np.column_stack([x + radii * np.cos(angles), y + radii * np.sin(angles)]))


def _random_map(rng: np.random.Generator, kind: str) -> Map:
    """Return 4 to 13 obstacles: convex, stars, stars in a star room, or overlapping ones."""
    room = box(0.0, 0.0, SIZE_MM, SIZE_MM)
    if kind == "cave":
        room = _blob(rng, SIZE_MM / 2, SIZE_MM / 2, 0.9 * SIZE_MM, convex=False)
    count, obstacles = int(rng.integers(4, 14)), []
    for _ in range(300):
        x, y = rng.uniform(-0.3 * SIZE_MM, 1.3 * SIZE_MM, 2)
        convex = kind == "convex" or (kind == "overlap" and rng.random() < 0.5)
        blob = _blob(rng, x, y, rng.uniform(0.05, 0.25) * SIZE_MM, convex=convex)
        apart = room.buffer(-0.3).contains(blob) and all(blob.distance(o) > 0.3 for o in obstacles)
        if blob.is_valid and blob.area > 10.0 and (apart or kind == "overlap"):
            obstacles.append(blob)
        if len(obstacles) == count:
            break
    return Map(name=kind, bounds=room, obstacles=tuple(obstacles))


def _lattice_map(rng: np.random.Generator) -> Map:
    """Return boxes, triangles, steps and diamonds whose corners lie on a lattice of 10 mm."""
    room, obstacles = box(0.0, 0.0, SIZE_MM, SIZE_MM), []
    for _ in range(60):
        (x, y), (w, h) = rng.integers(1, 10, 2) * 10, rng.integers(1, 4, 2) * 10
        step = [(x, y), (x + 2 * w, y), (x + 2 * w, y + h), (x + w, y + h), (x + w, y + 2 * h)]
        shape = [
            box(x, y, x + w, y + h),
            Polygon([(x, y), (x + w, y), (x, y + h)]),
            Polygon([*step, (x, y + 2 * h)]),
            Polygon([(x, y - h), (x + w, y), (x, y + h), (x - w, y)]),
        ][rng.integers(4)]
        if room.buffer(-1.0).contains(shape) and all(shape.distance(o) > 1.0 for o in obstacles):
            obstacles.append(shape)
    return Map(name="lattice", bounds=room, obstacles=tuple(obstacles[:10]))


def _free_pose(rng: np.random.Generator, world: Map) -> Pose:
    inner = world.free_space.buffer(-0.3)
    x_low, y_low, x_high, y_high = inner.bounds
    while True:
        x, y = rng.uniform(x_low, x_high), rng.uniform(y_low, y_high)
        if inner.contains(Point(x, y)):
            return Pose(x_mm=x, y_mm=y, heading_rad=rng.uniform(-math.pi, math.pi))


def _lattice_pose(rng: np.random.Generator, world: Map) -> Pose:
    """Return a pose on the half lattice that aims at another of its points, or by 15 degrees."""
    inner = world.free_space.buffer(-1.0)
    while True:
        (x, y), (to_x, to_y) = rng.integers(0, 25, (2, 2)) * 5.0
        turn = math.radians(15.0 * rng.integers(24))
        heading = math.atan2(to_y - y, to_x - x) if rng.random() < 0.6 else turn
        if inner.contains(Point(x, y)):
            return Pose(x_mm=x, y_mm=y, heading_rad=heading)


# ---- the two simulations


def _vine(length_mm: float) -> Design:
    return Design(name="vine", trunk_length_mm=length_mm, build=Build.standard(1))


def _options(half_angle_deg: float) -> GrowthOptions:
    return GrowthOptions.published(
        head_on_half_angle_rad=math.radians(half_angle_deg), body="centerline"
    )


def _line(chain: list[complex]) -> LineString:
    return LineString([(p.real, p.imag) for p in chain])


class Match:
    """Compares branches with their small-step growths and counts what it finds."""

    def __init__(self, world: Map, half_angle_deg: float) -> None:
        self.free = world.free_space
        self.fat_free = self.free.buffer(1e-6)
        self.walls = smallstep.Walls(self.free)
        self.half_angle_rad = math.radians(half_angle_deg)
        self.distances: list[float] = []
        self.ties = 0
        self.log: list[str] = []

    def compare(self, deployment: Deployment, branch: int, base: complex, heading: float) -> None:
        length = float(deployment.tree.length_mm[branch])
        chain = LineString(deployment.chain_mm(branch))
        stop = Stop(int(deployment.stop[branch])).label
        assert self.fat_free.covers(chain), "the chain left the free space"
        grown = self._grow(self.walls, base, heading, length)
        self.log += grown.log
        distance = chain.hausdorff_distance(_line(grown.chain))
        if stop == grown.stop and distance <= TWO_STEPS_MM:
            self.distances.append(distance)
        else:
            steps = f"small steps: {grown.stop} {_line(grown.chain)}, {grown.log}"
            start = f"base {base!r}, heading {heading!r}, length {length!r}"
            tie = self._is_tie(chain, stop, base, heading, length)
            assert tie, f"{start}: {steps}; kernel: {stop} {chain}"
            self.ties += 1

    def _grow(self, walls: object, base: complex, heading: float, length: float) -> object:
        return smallstep.SmallSteps(walls, base, heading, length, self.half_angle_rad).run()

    def _is_tie(self, chain: LineString, stop: str, base: complex, *aim: float) -> bool:
        """Return whether small steps end like the kernel once everything is moved by 1e-6."""
        rng = child(0)
        for _ in range(MOST_TRIES):
            walls = smallstep.Walls(self.free, JITTER, rng)
            moved = smallstep.shaken(base, JITTER, rng)
            grown = self._grow(walls, moved, *(aim + rng.uniform(-JITTER, JITTER, 2)))
            close = chain.hausdorff_distance(_line(grown.chain)) <= TWO_STEPS_MM
            if grown.stop == stop and close:
                return True
        return False


def _matches(
    maps: Iterator[tuple[np.random.Generator, Map]],
    pose: Callable[[np.random.Generator, Map], Pose],
    per_map: int,
    half_angle_deg: float = HALF_ANGLE_DEG,
) -> list[Match]:
    """Grow plain vines of random length on maps, both ways."""
    matches = []
    for rng, world in maps:
        terrain, match = Terrain.of(world), Match(world, half_angle_deg)
        for _ in range(per_map):
            start, length = pose(rng, world), 5.0 * rng.integers(4, 50)
            deployment = grow_on(_vine(length), terrain, start, _options(half_angle_deg))
            base = complex(start.x_mm, start.y_mm)
            match.compare(deployment, 0, base, start.heading_rad)
        matches.append(match)
    return matches


def _maps(seed: int, kind: str, count: int) -> Iterator[tuple[np.random.Generator, Map]]:
    for number in range(count):
        rng = child(seed, number)
        world = _lattice_map(rng) if kind == "lattice" else _random_map(rng, kind)
        if world.free_space.buffer(-0.3).area > 20.0:
            yield rng, world


def _assert_agree(matches: list[Match], ties: float, least: int) -> None:
    distances = [distance for match in matches for distance in match.distances]
    tied = sum(match.ties for match in matches)
    assert len(distances) >= least
    assert tied <= ties * len(distances)
    assert np.quantile(distances, 0.99) <= EXACT_MM


@pytest.mark.parametrize("maps", [3, pytest.param(12, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("kind", ["convex", "star", "cave", "overlap"])
def test_same_end_on_random_maps(kind: str, maps: int) -> None:
    matches = _matches(_maps(11, kind, maps), _free_pose, per_map=8)
    _assert_agree(matches, ties=0.01, least=5 * maps)
    log = [entry.split()[0] for match in matches for entry in match.log]
    # Enough happens for the comparison to mean something ...
    assert log.count("wrap") > maps
    assert log.count("leave") > maps
    # ... and the release of a contact is never reached by one branch: to turn back, the tip must
    # leave its wall, and the corner that it leaves is touched and blocks the turn back at once.
    assert log.count("release") == 0


@pytest.mark.parametrize("half_angle_deg", [0.0, 15.0])
def test_same_end_for_other_head_on_angles(half_angle_deg: float) -> None:
    matches = _matches(_maps(12, "star", 3), _free_pose, 8, half_angle_deg)
    _assert_agree(matches, ties=0.01, least=20)


def test_exact_ties_end_like_one_of_their_neighbours() -> None:
    """On a lattice, headings hit corners exactly; either side of a tie is a right answer."""
    matches = _matches(_maps(13, "lattice", 6), _lattice_pose, per_map=8)
    _assert_agree(matches, ties=0.05, least=40)


@pytest.mark.parametrize("stuck", ["stop", "deploy"])
def test_children_that_start_on_walls_end_like_small_steps(stuck: str) -> None:
    """Every branch of a tree, from where and how its parent ended."""
    levels = tuple(Level(branches=3, length_mm=length, fan_rad=3.0) for length in (35.0, 25.0))
    design = Design(name="tree", trunk_length_mm=40.0, levels=levels, build=Build.standard(3))
    options = GrowthOptions.published(children_of_stuck=stuck)
    matches, on_wall = [], 0
    for rng, world in _maps(14, "star", 5):
        match, pose = Match(world, HALF_ANGLE_DEG), _free_pose(rng, world)
        deployment = grow_on(design, Terrain.of(world), pose, options)
        for branch, (base, heading) in _starts(deployment, pose).items():
            on_wall += match.walls.clearance(base) < 1e-9
            match.compare(deployment, branch, base, heading)
        matches.append(match)
    _assert_agree(matches, ties=0.02, least=25)
    assert on_wall > 8


def _starts(deployment: Deployment, pose: Pose) -> dict[int, tuple[complex, float]]:
    """Return base and launch heading of each branch that deployed."""
    starts: dict[int, tuple[complex, float]] = {}
    final: dict[int, float] = {}
    for branch in np.flatnonzero(deployment.deployed).tolist():
        parent = int(deployment.tree.parent[branch])
        chain = deployment.chain_mm(branch)
        heading = pose.heading_rad
        if parent >= 0:
            heading = final[parent] + float(deployment.tree.offset_rad[branch])
        starts[branch] = complex(*chain[0]), heading
        steps = np.diff(chain, axis=0)
        moves = steps[np.hypot(steps[:, 0], steps[:, 1]) > 1e-9]
        final[branch] = math.atan2(moves[-1, 1], moves[-1, 0]) if len(moves) else heading
        if parent >= 0:
            assert np.allclose(chain[0], deployment.chain_mm(parent)[-1], atol=1e-9)
    return starts


@pytest.mark.parametrize("step_mm", [0.003, 0.05])
def test_small_steps_do_not_depend_on_the_step(step_mm: float) -> None:
    for rng, world in _maps(15, "star", 2):
        walls = smallstep.Walls(world.free_space)
        for _ in range(4):
            pose = _free_pose(rng, world)
            start = (complex(pose.x_mm, pose.y_mm), pose.heading_rad, 150.0, math.radians(1.0))
            usual = smallstep.SmallSteps(walls, *start).run()
            other = smallstep.SmallSteps(walls, *start, step_mm).run()
            assert other.stop == usual.stop
            assert abs(other.tip - usual.tip) <= EXACT_MM
