"""Growth on nasty maps, by the thousand: ``make fuzz``, or ``python tests/growth/fuzz.py 20000``.

Counts are printed for every kind of map. Every growth must end, stay in free space, and be the
same by the compiled kernel and by its readable twin.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import Polygon, box
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from vinefab.growth.batch import Batch, Block, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.simulator import grow
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose

UNIT = 100.0
GROWTHS_PER_MAP = 40
DESIGNS_PER_MAP = 4
MOST_EVENTS = 2_000
EXACT = 2e-9
"""Share of the map's size that chains may differ by, and be outside free space by."""

Shapes = list[Polygon]


def touching(rng: np.random.Generator) -> Shapes:
    """Squares and triangles of a lattice: shared corners, shared sides, closed-off rooms."""
    pitch = UNIT / rng.integers(4, 8)
    shapes = []
    for column, row in np.ndindex(int(UNIT / pitch), int(UNIT / pitch)):
        if rng.random() < 0.4:
            corners = pitch * np.add([[0, 0], [1, 0], [1, 1], [0, 1]], (column, row))
            lost = rng.integers(0, 4)
            shapes.append(
                Polygon(np.delete(corners, lost, axis=0) if rng.random() < 0.5 else corners)
            )
    return shapes


def collinear(rng: np.random.Generator) -> Shapes:
    """Boxes whose sides lie on few lines, some turned by 45 degrees or by 3-4-5."""
    lines = np.sort(rng.choice(np.arange(1, 20), 6, replace=False)) * UNIT / 20.0
    shapes = []
    for _ in range(rng.integers(4, 12)):
        x, y = np.sort(rng.choice(lines, (2, 2)), axis=1)
        if x[0] < x[1] and y[0] < y[1]:
            shapes.append(box(x[0], y[0], x[1], y[1]))
    turn = [(1.0, 0.0), (0.6, 0.8), (math.sqrt(0.5), math.sqrt(0.5))][rng.integers(0, 3)]
    c, s = turn
    middle = UNIT / 2.0
    move = (c, -s, s, c, middle * (1 - c + s), middle * (1 - s - c))
    return [affine_transform(shape, move) for shape in shapes]


def gaps(rng: np.random.Generator) -> Shapes:
    """Walls across the map with gaps from a billionth of it to a tenth, and thin needles."""
    shapes = []
    for x in np.linspace(0.15, 0.85, int(rng.integers(2, 6))) * UNIT:
        thick = UNIT * 10.0 ** rng.uniform(-10.0, -1.3)
        gap = UNIT * 10.0 ** rng.uniform(-9.0, -1.0)
        y = rng.uniform(0.1, 0.8) * UNIT
        lean = rng.uniform(-0.1, 0.1) * UNIT
        for low, high in ((-10.0, y), (y + gap, UNIT + 10.0)):
            shapes.append(
                Polygon([(x, low), (x + thick, low), (x + thick + lean, high), (x + lean, high)])
            )
    return shapes


def stars(rng: np.random.Generator) -> Shapes:
    """Jagged shapes, many of them across each other and across the bounds."""
    shapes = []
    for centre in rng.uniform(0.0, UNIT, (int(rng.integers(3, 14)), 2)):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(5, 12)))
        reach = rng.uniform(0.02, 0.25) * UNIT * rng.uniform(0.1, 1.0, len(angle))
        along = np.column_stack([np.cos(angle), np.sin(angle)])
        shapes.append(Polygon(centre + reach[:, None] * along))
    return shapes


def rounded(rng: np.random.Generator) -> Shapes:
    """Discs of many flat corners, some only just touching each other."""
    shapes, x = [], rng.uniform(0.0, 0.2) * UNIT
    while x < UNIT:
        radius = rng.uniform(0.03, 0.15) * UNIT
        y = rng.uniform(0.1, 0.9) * UNIT
        shapes.append(
            shapely.Point(x + radius, y).buffer(radius, quad_segs=int(rng.integers(2, 16)))
        )
        x += 2.0 * radius + (rng.random() < 0.5) * rng.uniform(0.0, 0.1) * UNIT
    return shapes


KINDS: dict[str, Callable[[np.random.Generator], Shapes]] = {
    "touching": touching,
    "collinear": collinear,
    "gaps": gaps,
    "stars": stars,
    "rounded": rounded,
}


@dataclass
class Counts:
    """What was seen on maps of one kind."""

    growths: int = 0
    branches: int = 0
    events: int = 0
    most_events: int = 0
    endless: int = 0
    outside: int = 0
    deepest: float = 0.0
    disagree: int = 0
    seeds: list[int] = field(default_factory=list)

    @property
    def failures(self) -> int:
        return self.endless + self.outside + self.disagree


def nasty_map(rng: np.random.Generator, kind: str) -> Map:
    """Return a map of some kind between 1e-3 and 1e6 mm large, somewhere in the plane."""
    scale = 10.0 ** rng.uniform(-3.0, 6.0) / UNIT
    offset = rng.choice([0.0, 1.0, -0.5, rng.uniform(-3.0, 3.0)], 2) * scale * UNIT
    move = (scale, 0.0, 0.0, scale, *offset.tolist())
    shapes = [affine_transform(shape, move) for shape in KINDS[kind](rng)]
    good = [s for s in shapes if s.geom_type == "Polygon" and s.is_valid and s.area > 0.0]
    bounds = affine_transform(box(0.0, 0.0, UNIT, UNIT), move)
    return Map(name=kind, bounds=bounds, obstacles=tuple(good))


def nasty_pose(rng: np.random.Generator, terrain: Terrain) -> Pose:
    """Return a free pose: often on a wall or a corner, aimed at corners or along walls."""
    wall = terrain.walls().wall
    x_min, y_min, x_max, y_max = terrain.world.bounds.bounds
    for _ in range(10_000):
        x, y = rng.uniform((x_min, y_min), (x_max, y_max))
        heading = rng.choice([rng.uniform(-np.pi, np.pi), np.pi / 4 * rng.integers(0, 8)])
        one, other = wall[rng.integers(0, len(wall), 2)]
        if rng.random() < 0.4:
            share = rng.choice([0.0, 0.5, 1.0, rng.random()])
            x, y = one[:2] * (1.0 - share) + one[5:7] * share
        if rng.random() < 0.3:
            heading = math.atan2(other[1] - y, other[0] - x)
        elif rng.random() < 0.3:
            heading = math.atan2(other[3], other[2])
        pose = Pose(x_mm=float(x), y_mm=float(y), heading_rad=float(heading))
        if terrain.is_free(pose):
            return pose
    raise RuntimeError("no free pose found")


def nasty_design(rng: np.random.Generator, size_mm: float) -> Design:
    """Return a tree of at most seven branches, up to three times as long as the map."""
    levels = tuple(
        Level(
            branches=int(rng.integers(1, 4 - number)),
            length_mm=float(size_mm * rng.uniform(0.01, 1.0)),
            fan_rad=float(rng.choice([np.pi / 2, np.pi, rng.uniform(0.0, 6.0)])),
            growth=float(rng.uniform(0.3, 2.0)),
        )
        for number in range(rng.integers(0, 3))
    )
    return Design(
        name="fuzz",
        trunk_length_mm=float(size_mm * 10.0 ** rng.uniform(-1.0, 0.5)),
        levels=levels,
        build=Build.standard(1 + len(levels)),
    )


def agree(fast: Deployment, plain: Deployment, exact_mm: float) -> bool:
    """Tell whether two engines ended in the same way."""
    return (
        fast.stop.tolist() == plain.stop.tolist()
        and fast.first_point.tolist() == plain.first_point.tolist()
        and bool(np.abs(fast.points_mm - plain.points_mm).max(initial=0.0) <= exact_mm)
        and bool(np.abs(fast.grown_mm - plain.grown_mm).max(initial=0.0) <= exact_mm)
        and fast.tight_exit.tolist() == plain.tight_exit.tolist()
    )


def depth_mm(grown: Deployment, free: BaseGeometry) -> float:
    """Return how far the chains of a deployment are outside a free space, at worst."""
    worst = 0.0
    for branch in np.flatnonzero(grown.deployed).tolist():
        outside = shapely.difference(shapely.LineString(grown.chain_mm(branch)), free)
        if not outside.is_empty:
            samples = shapely.line_interpolate_point(
                shapely.get_parts(outside)[:, None], [0.0, 0.3, 0.6, 1.0], normalized=True
            )
            worst = max(worst, float(shapely.distance(free, samples).max()))
    return worst


def fuzz_map(counts: Counts, kind: str, seed: int) -> None:
    """Grow some trees on one map, and count."""
    rng = np.random.default_rng([71, list(KINDS).index(kind), seed])
    terrain = Terrain.of(nasty_map(rng, kind))
    if len(terrain.walls().wall) == 0:
        return
    size_mm = max(terrain.world.size_mm)
    options = GrowthOptions.published(
        head_on_half_angle_rad=math.radians(float(rng.choice([0.0, 1.0, 15.0]))),
        children_of_stuck=str(rng.choice(["stop", "deploy"])),
    )
    designs = [nasty_design(rng, size_mm) for _ in range(DESIGNS_PER_MAP)]
    poses = [nasty_pose(rng, terrain) for _ in range(GROWTHS_PER_MAP // DESIGNS_PER_MAP)]
    batch = Batch(Plans.of(designs, options), Launches.of(TerrainSet([terrain]), [poses]), options)

    def events(block: Block) -> tuple[int, int]:
        return int(block.growth.events.sum()), int(block.growth.events.max())

    for total, most in batch.each(events):
        counts.events += total
        counts.most_events = max(counts.most_events, most)
        counts.endless += most >= MOST_EVENTS
    before = counts.failures
    for number, fast in enumerate(batch.deployments()):
        pose, design = poses[number // len(designs)], designs[number % len(designs)]
        plain = grow(design, terrain, pose, options, "reference")
        deep = depth_mm(fast, terrain.free_space()) / size_mm
        counts.growths += 1
        counts.branches += int(fast.deployed.sum())
        counts.deepest = max(counts.deepest, deep)
        counts.outside += deep > EXACT
        counts.disagree += not agree(fast, plain, EXACT * size_mm)
    if counts.failures > before:
        counts.seeds.append(seed)


def fuzz(growths: int) -> dict[str, Counts]:
    """Return counts for every kind of map after at least so many growths in all."""
    found = {kind: Counts() for kind in KINDS}
    for kind, counts in found.items():
        seed = 0
        while counts.growths < growths / len(KINDS):
            fuzz_map(counts, kind, seed)
            seed += 1
    return found


def main() -> int:
    """Print the counts; return 1 if anything failed."""
    growths = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    found = fuzz(growths)
    heads = ("growths", "branches", "events", "most", "endless", "outside", "deepest", "disagree")
    lines = [f"{'kind':10s}" + "".join(f"{head:>10s}" for head in heads)]
    for kind, one in found.items():
        lines.append(
            f"{kind:10s}{one.growths:10d}{one.branches:10d}{one.events:10d}{one.most_events:10d}"
            f"{one.endless:10d}{one.outside:10d}{one.deepest:10.1e}{one.disagree:10d}"
            + (f"  maps {one.seeds[:5]}" if one.seeds else "")
        )
    failures = sum(one.failures for one in found.values())
    total = sum(one.growths for one in found.values())
    lines.append(f"{total} growths, {failures} failures")
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
