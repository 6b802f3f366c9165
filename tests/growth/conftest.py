"""What the tests of the growth room share: engines, small designs, random maps, checks."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box
from shapely.geometry.base import BaseGeometry

from tests.oracles.growth_spans import SHIPPED, Grower
from vinefab.growth.arrays import TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose

SIZE_MM = 500.0


@pytest.fixture(scope="session")
def engine() -> Grower:
    return SHIPPED


@pytest.fixture(scope="session")
def vine() -> Callable[[float], Design]:
    def make(length_mm: float) -> Design:
        return Design(name="vine", trunk_length_mm=length_mm, build=Build.standard(1))

    return make


@pytest.fixture(scope="session")
def tree() -> Callable[..., Design]:
    def make(length_mm: float, *levels: tuple[int, float, float, float]) -> Design:
        """Levels as (branches, length, fan in degrees, growth)."""
        return Design(
            name="tree",
            trunk_length_mm=length_mm,
            levels=tuple(
                Level(branches=n, length_mm=length, fan_rad=math.radians(fan), growth=growth)
                for n, length, fan, growth in levels
            ),
            build=Build.standard(1 + len(levels)),
        )

    return make


def one_branch_tree(length_mm: float) -> TreesArrays:
    """Return a trunk that no pressure stops, as the engines take it."""
    return TreesArrays(
        parent=np.array([-1]),
        turn=np.array([[1.0, 0.0]]),
        length=np.array([length_mm]),
        limit=np.array([np.inf]),
        store=np.zeros(1),
        first=np.array([0, 1]),
    )


@pytest.fixture(scope="session")
def trunk_arrays() -> Callable[[float], TreesArrays]:
    return one_branch_tree


@pytest.fixture(scope="session")
def terrain() -> Callable[..., Terrain]:
    def make(bounds: Polygon, *obstacles: Polygon) -> Terrain:
        return Terrain.of(Map(name="test", bounds=bounds, obstacles=obstacles))

    return make


@pytest.fixture(scope="session")
def launch(engine: Grower) -> Callable[..., Deployment]:
    """Grow from (x, y, degrees) with the engine under test; no head-on stops by default."""

    def run(
        design: Design, ground: Terrain, place: tuple[float, float, float], **choices: object
    ) -> Deployment:
        x, y, heading_deg = place
        pose = Pose(x_mm=x, y_mm=y, heading_rad=math.radians(heading_deg))
        options = GrowthOptions.published(**{"head_on_half_angle_rad": 0.0, **choices})
        return engine.grow(design, ground, pose, options)

    return run


def convex(rng: np.random.Generator, centre: np.ndarray, radius: float) -> Polygon:
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(4, 8)))
    corners = centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return shapely.convex_hull(shapely.multipoints(corners))


def star(rng: np.random.Generator, centre: np.ndarray, radius: float) -> Polygon:
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(5, 14)))
    reach = radius * rng.uniform(0.15, 1.0, len(angle))[:, None]
    return Polygon(centre + reach * np.column_stack([np.cos(angle), np.sin(angle)]))


def needles(rng: np.random.Generator, centre: np.ndarray, radius: float) -> Polygon:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]]) * 10.0 ** rng.uniform(-9.0, 1.0)
    return Polygon(
        [centre - radius * along, centre + radius * along - across, centre + radius * along]
    )


def lattice(rng: np.random.Generator, centre: np.ndarray, radius: float) -> Polygon:
    """Squares and half squares whose corners and sides coincide with those of their neighbours."""
    del radius
    corners = centre + SIZE_MM / 12.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return Polygon(
        np.delete(corners, rng.integers(0, 4), axis=0) if rng.random() < 0.5 else corners
    )


@pytest.fixture(scope="session")
def random_map() -> Callable[[np.random.Generator, str], Map]:
    shapes = {"convex": convex, "star": star, "needles": needles, "lattice": lattice}

    def make(rng: np.random.Generator, kind: str) -> Map:
        count = 6 if kind == "lattice" else int(rng.integers(1, 7))
        pitch = SIZE_MM / count
        overlap = 1.0 if rng.random() < 0.6 else rng.uniform(1.0, 2.5)
        obstacles = []
        for cell in np.ndindex(count, count):
            centre = (np.array(cell) + 0.5) * pitch
            if kind == "lattice" and rng.random() < 0.65:
                continue
            if kind != "lattice":
                centre = centre + rng.uniform(-0.1, 0.1, 2) * pitch
            radius = rng.uniform(0.2, 0.42) * pitch * overlap
            obstacles.append(shapes[kind](rng, centre, radius))
        good = [p for p in obstacles if p.geom_type == "Polygon" and p.is_valid and p.area > 0.0]
        return Map(name=kind, bounds=box(0.0, 0.0, SIZE_MM, SIZE_MM), obstacles=tuple(good))

    return make


@pytest.fixture(scope="session")
def random_pose() -> Callable[[np.random.Generator, Terrain], Pose]:
    """Free poses, many degenerate: on walls, in corners, aimed at vertices or along walls."""

    def make(rng: np.random.Generator, ground: Terrain) -> Pose:
        walls = ground.walls()
        wall, end = walls.wall, walls.end
        while True:
            x, y = rng.uniform(0.0, SIZE_MM, 2)
            heading = rng.uniform(-np.pi, np.pi)
            drawn = rng.integers(0, len(wall), 2)
            one, other = wall[drawn]
            if rng.random() < 0.2:
                share = rng.choice([0.0, 0.5, 1.0, rng.random()])
                x, y = one[:2] * (1.0 - share) + end[drawn[0]] * share
            if rng.random() < 0.2:
                heading = math.atan2(other[1] - y, other[0] - x)
            elif rng.random() < 0.2:
                heading = math.atan2(other[3], other[2])
            pose = Pose(x_mm=float(x), y_mm=float(y), heading_rad=float(heading))
            if ground.is_free(pose):
                return pose

    return make


@pytest.fixture(scope="session")
def random_tree() -> Callable[[np.random.Generator], Design]:
    def make(rng: np.random.Generator) -> Design:
        levels = tuple(
            Level(
                branches=int(rng.integers(1, 4)),
                length_mm=float(rng.uniform(20.0, 250.0)),
                fan_rad=float(rng.choice([np.pi / 2, np.pi, rng.uniform(0.0, 6.0)])),
                growth=float(rng.uniform(0.3, 2.0)),
            )
            for _ in range(rng.integers(0, 3))
        )
        return Design(
            name="random",
            trunk_length_mm=float(rng.uniform(50.0, 1500.0)),
            levels=levels,
            build=Build.standard(1 + len(levels)),
        )

    return make


@pytest.fixture(scope="session")
def depth_in_solid() -> Callable[[Deployment, BaseGeometry], float]:
    """How far any chain is outside a free space, at worst."""

    def measure(deployment: Deployment, free: BaseGeometry) -> float:
        return max((_depth(chain, free) for chain in _chains(deployment)), default=0.0)

    return measure


def _chains(deployment: Deployment) -> Iterator[LineString]:
    for branch in np.flatnonzero(deployment.deployed):
        yield LineString(deployment.chain_mm(int(branch)))


def _depth(chain: LineString, free: BaseGeometry) -> float:
    outside = shapely.difference(chain, free)
    samples = [
        part.interpolate(share, normalized=True)
        for part in shapely.get_parts(outside)
        for share in (0.0, 0.3, 0.6, 1.0)
        if not part.is_empty
    ]
    return max((float(shapely.distance(free, point)) for point in samples), default=0.0)
