"""The event-driven simulator against small steps, on random maps and on degenerate ones.

The small-step tip is put back on every wall that it crosses, so its error does not add up: both
simulations end in the same place to rounding, except when two events fall into one step. Hence
two tolerances: two steps for every growth, and a hundred thousandth of a step for nearly all.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pytest
from shapely import LineString, Point, Polygon, box
from shapely.affinity import affine_transform

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


@pytest.mark.parametrize("kind", ["convex", "star", "cave", "overlap"])
def test_same_end_on_random_maps(kind: str) -> None:
    matches = _matches(_maps(11, kind, 12), _free_pose, per_map=8)
    _assert_agree(matches, ties=0.01, least=70)
    log = [entry.split()[0] for match in matches for entry in match.log]
    # Enough happens for the comparison to mean something ...
    assert log.count("wrap") > 15
    assert log.count("leave") > 15
    # ... and the release of a contact is never reached by one branch: to turn back, the tip must
    # leave its wall, and the corner that it leaves is touched and blocks the turn back at once.
    assert log.count("release") == 0


@pytest.mark.parametrize("half_angle_deg", [0.0, 15.0])
def test_same_end_for_other_head_on_angles(half_angle_deg: float) -> None:
    matches = _matches(_maps(12, "star", 6), _free_pose, 8, half_angle_deg)
    _assert_agree(matches, ties=0.01, least=45)


def test_exact_ties_end_like_one_of_their_neighbours() -> None:
    """On a lattice, headings hit corners exactly; either side of a tie is a right answer."""
    matches = _matches(_maps(13, "lattice", 16), _lattice_pose, per_map=8)
    _assert_agree(matches, ties=0.05, least=110)


@pytest.mark.parametrize("stuck", ["stop", "deploy"])
def test_children_that_start_on_walls_end_like_small_steps(stuck: str) -> None:
    """Every branch of a tree, from where and how its parent ended."""
    levels = tuple(Level(branches=3, length_mm=length, fan_rad=3.0) for length in (35.0, 25.0))
    design = Design(name="tree", trunk_length_mm=40.0, levels=levels, build=Build.standard(3))
    options = GrowthOptions.published(children_of_stuck=stuck)
    matches, on_wall = [], 0
    for rng, world in _maps(14, "star", 12):
        match, pose = Match(world, HALF_ANGLE_DEG), _free_pose(rng, world)
        deployment = grow_on(design, Terrain.of(world), pose, options)
        for branch, (base, heading) in _starts(deployment, pose).items():
            on_wall += match.walls.clearance(base) < 1e-9
            match.compare(deployment, branch, base, heading)
        matches.append(match)
    _assert_agree(matches, ties=0.02, least=60)
    assert on_wall > 20


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


# ---- degenerate cases, worked out on paper

ROOM = box(0, 0, 200, 200)
BENT_ROOM = Polygon([(0, 0), (100, 0), (150, 50), (150, 200), (0, 200)])  # two corners of 135 deg
WEDGE_ROOM = Polygon([(0, 0), (200, 0), (190, 10), (190, 150), (0, 150)])  # acute at (200, 0)
LEANING_ROOM = Polygon([(0, 0), (220, 0), (200, 200), (0, 200)])
ROOF_ROOM = Polygon([(0, 20), (100, 20), (200, 0), (200, 200), (0, 200)])
CEILING = box(20, 100, 80, 160)
SHELF = box(50, 60, 100, 100)
TENT = Polygon([(60, 80), (90, 40), (120, 80)])
PILLAR = box(120, 110, 160, 190)
TURNED = [(80.0, 100.0), (120.0, 170.0)]
HALF_DEG = math.radians(0.5)
TO_CORNER_DEG = math.degrees(math.atan2(80, 60))  # from (20, 20) exactly at (80, 100)


class Case(NamedTuple):
    bounds: Polygon
    obstacles: list[Polygon]
    pose: tuple[float, float, float]  # x, y, heading in degrees
    stop: str
    points: list[tuple[float, float]]  # contacts and tip


CASES: dict[str, Case] = {
    "no obstacle": Case(ROOM, [], (50, 50, 30), "full_length", [(50 + 50 * 3**0.5, 100)]),
    "head-on": Case(ROOM, [], (50, 50, 90.5), "head_on", [(50 - 150 * math.tan(HALF_DEG), 200)]),
    "one long wall": Case(ROOM, [], (50, 50, 70), "full_length", [(130, 200)]),
    "right angle drives the tip back": Case(ROOM, [], (20, 30, -30), "corner", [(200, 0)]),
    # The corner's second wall turns the tip away from the first: it slides on, twice.
    "obtuse corners": Case(BENT_ROOM, [], (20, 30, -30), "full_length", [(130, 30)]),
    "obtuse corners, on": Case(BENT_ROOM, [], (20, 30, -30), "full_length", [(150, 100)]),
    # Over a convex corner whose second wall the tip still presses on.
    "over the roof": Case(ROOF_ROOM, [], (20, 80, -60), "full_length", [(150, 10)]),
    # The body wrapped the far end of the second wall and lies flush on it: no pressing, a wedge.
    "wedge, wall not pressed on": Case(
        WEDGE_ROOM, [], (150, 100, -80), "corner", [(190, 10), (200, 0)]
    ),
    "wedge, wall pressed on": Case(WEDGE_ROOM, [], (100, 60, -70), "corner", [(200, 0)]),
    "wedge, flush without wrapping": Case(WEDGE_ROOM, [], (100, 100, -70), "corner", [(200, 0)]),
    "corner reached in free growth": Case(ROOM, [], (50, 50, 45), "corner", [(200, 200)]),
    # The tip slides to the end of the ceiling at (80, 100) and leaves it: not met again.
    "wall just left": Case(ROOM, [CEILING], (20, 20, 60), "full_length", [(95, 120)]),
    "length used up at its end": Case(ROOM, [CEILING], (20, 20, 60), "full_length", [(80, 100)]),
    "corner grazed": Case(ROOM, [CEILING], (20, 20, TO_CORNER_DEG), "full_length", [(95, 120)]),
    # The body touches (80, 100), solid on its left; the top wall turns it to the right: no block.
    "touched vertex on the other side": Case(
        ROOM, [CEILING], (20, 20, 60), "full_length", [(190, 200)]
    ),
    # The pillar turns it to the left: the touched vertex blocks at once.
    "touched vertex on the turning side": Case(
        ROOM, [CEILING, PILLAR], (20, 20, 60), "full_length", TURNED
    ),
    # Wrapped around the tent to the right, then turned back: the tent is not released, because
    # the ceiling's corner, just left, blocks first.
    "turned back": Case(
        ROOM, [CEILING, TENT, PILLAR], (20, 20, 60), "full_length", [(60, 80), *TURNED]
    ),
    # Grown flush along a shelf's top, pushed down by a leaning wall: its far edge blocks at once.
    "flush": Case(LEANING_ROOM, [SHELF], (20, 100, 0), "full_length", [(100, 100), (216, 40)]),
    # A start on a wall, heading into it: a slide from length zero.
    "start on a wall": Case(BENT_ROOM, [], (20, 0, -30), "full_length", [(130, 30)]),
    "start on an obstacle": Case(ROOM, [SHELF], (60, 100, -30), "full_length", [(160, 100)]),
}


def _turned(
    case: Case, turn: float, flip: float, shift: tuple[float, float]
) -> tuple[Map, Pose, list[complex]]:
    """Return a case's map, pose and chain after a mirror image, a turn and a shift."""
    x, y, heading_deg = case.pose
    cos, sin, (dx, dy) = math.cos(turn), math.sin(turn), shift
    matrix = [cos, -flip * sin, sin, flip * cos, dx, dy]
    world = Map(
        name="case",
        bounds=affine_transform(case.bounds, matrix),
        obstacles=tuple(affine_transform(obstacle, matrix) for obstacle in case.obstacles),
    )
    heading = flip * math.radians(heading_deg) + turn
    chain = [
        complex(cos * a - flip * sin * b + dx, sin * a + flip * cos * b + dy)
        for a, b in [(x, y), *case.points]
    ]
    return world, Pose(x_mm=chain[0].real, y_mm=chain[0].imag, heading_rad=heading), chain


PLACES = {
    "as drawn": (0.0, 1.0, (0.0, 0.0)),
    "mirrored": (0.0, -1.0, (0.0, 0.0)),
    "turned": (2.1, 1.0, (333.3, -77.7)),
    "turned, mirrored": (-0.7, -1.0, (-1234.5, 678.9)),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", CASES)
def test_case(name: str, place: str) -> None:
    world, pose, chain = _turned(CASES[name], *PLACES[place])
    length = _line(chain).length if CASES[name].stop == "full_length" else 300.0
    terrain = Terrain.of(world)
    deployment = grow_on(_vine(length), terrain, pose, _options(HALF_ANGLE_DEG))
    walls = smallstep.Walls(world.free_space)
    half_angle = math.radians(HALF_ANGLE_DEG)
    steps = smallstep.SmallSteps(walls, chain[0], pose.heading_rad, length, half_angle).run()
    for ended, line in (
        (Stop(int(deployment.stop[0])).label, LineString(deployment.chain_mm(0))),
        (steps.stop, _line(steps.chain)),
    ):
        assert ended == CASES[name].stop
        assert line.hausdorff_distance(_line(chain)) <= EXACT_MM


@pytest.mark.parametrize("step_mm", [0.003, 0.05])
def test_small_steps_do_not_depend_on_the_step(step_mm: float) -> None:
    for rng, world in _maps(15, "star", 4):
        walls = smallstep.Walls(world.free_space)
        for _ in range(4):
            pose = _free_pose(rng, world)
            start = (complex(pose.x_mm, pose.y_mm), pose.heading_rad, 150.0, math.radians(1.0))
            usual = smallstep.SmallSteps(walls, *start).run()
            other = smallstep.SmallSteps(walls, *start, step_mm).run()
            assert other.stop == usual.stop
            assert abs(other.tip - usual.tip) <= EXACT_MM
