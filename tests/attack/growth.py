"""Growth on nasty maps, by the thousand: ``make fuzz``, or ``python tests/attack/growth.py 20000``.

Counts are printed for every kind of map. Growth options are drawn from their declaration, so that
none is left out. Every growth must end, stay in free space, and be the same by the compiled kernel
and by its readable twin. As many again are grown twice, the second time
after the whole world was mirrored, turned, scaled or shifted, its obstacles reordered, or its walls
refined: lengths and stops must be the same within `SAME`. Growths that starts, obstacles or bounds
moved by `NUDGE` change as well are ties, which rounding may settle either way; they are counted.
"""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
import shapely
from annotated_types import Ge, Le
from shapely import Polygon, box
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.oracles.growth_spans import grow_reference
from vinefab.core.errors import BadInputError
from vinefab.core.table import DeclaredKey, declared_keys
from vinefab.core.validation import SMALLEST
from vinefab.growth.batch import Batch, GrowthBlock, Launches, TerrainSet, grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import WIDEST_BODY_MM, Build, Design, Level
from vinefab.model.map import LARGEST_MM, Map, Pose
from vinefab.physics.growth_pressure import FITTED, FITTED_DIAMETER_MM
from vinefab.physics.tube import inflated_diameter_mm

UNIT = 100.0
GROWTHS_PER_MAP = 40
DESIGNS_PER_MAP = 4
MOST_EVENTS = 2_000
EXACT = 2e-9
"""Share of the map's size that chains may differ by, and be outside free space by."""

SAME = 1e-6
"""Share of the map's size that lengths may differ by after a move of everything."""
NUDGE = 1e-8
"""Share of the map's size, and radians, that things are moved by to see whether one is a tie."""

MOST_KPA = 10_000.0

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


def streets(rng: np.random.Generator) -> Shapes:
    """Boxes of a lattice, apart or side by side: where starts and lengths of a lattice tie."""
    pitch = UNIT / 20.0
    shapes = []
    for x, y in rng.integers(0, 18, (rng.integers(1, 8), 2)):
        wide, high = rng.integers(1, 5, 2)
        shapes.append(box(x * pitch, y * pitch, (x + wide) * pitch, (y + high) * pitch))
    return shapes


KINDS: dict[str, Callable[[np.random.Generator], Shapes]] = {
    "touching": touching,
    "collinear": collinear,
    "gaps": gaps,
    "stars": stars,
    "rounded": rounded,
    "streets": streets,
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
    inflated: int = 0  # branches whose bodies are
    held: int = 0  # branches that pressure stopped
    stayed_in: int = 0  # children drawn not to come out
    seeds: list[int] = field(default_factory=list)

    @property
    def failures(self) -> int:
        return self.endless + self.outside + self.disagree


def nasty_map(rng: np.random.Generator, kind: str) -> Map:
    """Return a map of some kind between 1e-2 and 1e6 mm large, somewhere in the plane."""
    scale = 10.0 ** rng.uniform(-2.0, 6.0) / UNIT
    offset = rng.choice([0.0, 1.0, -0.5, rng.uniform(-3.0, 3.0)], 2) * scale * UNIT
    if kind == "streets":  # of a size that people draw
        scale, offset = float(rng.choice([5.0, 6.4, 10.0])), np.zeros(2)
    move = (scale, 0.0, 0.0, scale, *offset.tolist())
    shapes = [affine_transform(shape, move) for shape in KINDS[kind](rng)]
    good = [s for s in shapes if s.geom_type == "Polygon" and s.is_valid and s.area > 0.0]
    bounds = affine_transform(box(0.0, 0.0, UNIT, UNIT), move)
    return Map(name=kind, bounds=bounds, obstacles=tuple(good))


def nasty_pose(rng: np.random.Generator, terrain: Terrain) -> Pose:
    """Return a free pose: often on a wall or a corner, aimed at corners or along walls."""
    walls = terrain.walls()
    wall, end = walls.wall, walls.end
    x_min, y_min, x_max, y_max = terrain.world.bounds.bounds
    for _ in range(10_000):
        x, y = rng.uniform((x_min, y_min), (x_max, y_max))
        heading = rng.choice([rng.uniform(-np.pi, np.pi), np.pi / 4 * rng.integers(0, 8)])
        if rng.random() < 0.2:
            pitch = (x_max - x_min) / 20.0
            x, y = x_min + pitch * round((x - x_min) / pitch), y_min + pitch * rng.integers(0, 21)
        drawn = rng.integers(0, len(wall), 2)
        one, other = wall[drawn]
        if rng.random() < 0.4:
            share = rng.choice([0.0, 0.5, 1.0, rng.random()])
            x, y = one[:2] * (1.0 - share) + end[drawn[0]] * share
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
    shares = (0.05, 0.1, 0.3, rng.uniform(0.01, 1.0))
    levels = tuple(
        Level(
            branches=int(rng.integers(1, 4 - number)),
            length_mm=float(size_mm * rng.choice(shares)),
            fan_rad=float(rng.choice([*np.pi / np.array([0.5, 1, 1.5, 2]), rng.uniform(0.0, 6.0)])),
            growth=float(rng.choice([1.0, rng.uniform(0.3, 2.0)])),
        )
        for number in range(rng.integers(0, 3))
    )
    width_mm = max(size_mm * 10.0 ** rng.uniform(-3.5, -1.0), 4.0 * SMALLEST)
    width_mm = min(width_mm, WIDEST_BODY_MM)
    narrowing = rng.choice([1.0, 1.0, 0.7])
    widths_mm = tuple(float(width_mm * narrowing**level) for level in range(1 + len(levels)))
    # Enough for a thousandth of the map's size, or for ten times that size.
    reach_mm = size_mm * 10.0 ** rng.uniform(-3.0, 1.0)
    limit_kpa = FITTED.yield_kpa.value + FITTED.drag_kpa_m.value * reach_mm / 1000.0
    share = inflated_diameter_mm(width_mm) / FITTED_DIAMETER_MM.value
    build = Build.standard(1 + len(levels))
    return Design(
        name="fuzz",
        trunk_length_mm=float(size_mm * rng.choice([0.3, 1.0, 10.0 ** rng.uniform(-1.0, 0.5)])),
        levels=levels,
        build=build.changed(
            widths_mm=widths_mm, pressure_kpa=min(float(limit_kpa / share), MOST_KPA)
        ),
    )


def nasty_options(rng: np.random.Generator) -> GrowthOptions:
    """Return growth options that each have any of their values, as they are declared."""
    return GrowthOptions(
        **{one.field: _nasty_value(rng, one) for one in declared_keys(GrowthOptions)}
    )


def _nasty_value(rng: np.random.Generator, option: DeclaredKey) -> Any:
    if option.field == "head_on_half_angle_rad":
        angle_rad = math.radians(float(rng.choice([0.0, 1.0, 15.0, 30.0, 90.0])))
        return (0.0, angle_rad) if angle_rad and rng.random() < 0.2 else angle_rad
    if option.field in ("contacts", "surface"):  # say where other numbers come from, change nothing
        return None
    if option.limits:
        low, high = (
            one.ge if isinstance(one, Ge) else one.le if isinstance(one, Le) else one.gt + 1e-6
            for one in option.limits
        )
        return float(
            rng.choice([option.default, option.default, low, high, rng.uniform(low, high)])
        )
    if option.annotation is bool:
        return bool(rng.random() < 0.5)
    return rng.choice(get_args(option.annotation)).item()


def agree(fast: Deployment, plain: Deployment, exact_mm: float) -> bool:
    """Tell whether two engines ended in the same way."""
    return (
        fast.stop.tolist() == plain.stop.tolist()
        and fast.first_point.tolist() == plain.first_point.tolist()
        and bool(np.abs(fast.points_mm - plain.points_mm).max(initial=0.0) <= exact_mm)
        and bool(np.abs(fast.grown_mm - plain.grown_mm).max(initial=0.0) <= exact_mm)
        and bool(np.abs(fast.contact_turn_rad - plain.contact_turn_rad).max(initial=0.0) <= 1e-6)
    )


def depth_mm(grown: Deployment, free: Sequence[BaseGeometry]) -> float:
    """Return how far the chains of a deployment are outside the free space of their levels."""
    worst = 0.0
    for branch in np.flatnonzero(grown.deployed).tolist():
        level = free[grown.tree.level[branch] - 1]
        outside = shapely.difference(shapely.LineString(grown.chain_mm(branch)), level)
        if not outside.is_empty:
            samples = shapely.line_interpolate_point(
                shapely.get_parts(outside)[:, None], [0.0, 0.3, 0.6, 1.0], normalized=True
            )
            worst = max(worst, float(shapely.distance(level, samples).max()))
    return worst


def fuzz_map(counts: Counts, kind: str, seed: int) -> None:
    """Grow some trees on one map, and count."""
    rng = np.random.default_rng([71, list(KINDS).index(kind), seed])
    terrain = Terrain.of(nasty_map(rng, kind))
    if len(terrain.walls().wall) == 0:
        return
    size_mm = max(terrain.world.size_mm)
    options = nasty_options(rng)
    designs = [nasty_design(rng, size_mm) for _ in range(DESIGNS_PER_MAP)]
    poses = [nasty_pose(rng, terrain) for _ in range(GROWTHS_PER_MAP // DESIGNS_PER_MAP)]
    batch = Batch(Plans.of(designs, options), Launches.of(TerrainSet([terrain]), [poses]), options)

    def events(block: GrowthBlock) -> tuple[int, int]:
        return int(block.growth.events.sum()), int(block.growth.events.max())

    for total, most in batch.each(events):
        counts.events += total
        counts.most_events = max(counts.most_events, most)
        counts.endless += most >= MOST_EVENTS
    before = counts.failures
    angles_rad = options.half_angles_rad(len(poses)).tolist()
    for number, fast in enumerate(batch.deployments()):
        launch, design = number // len(designs), designs[number % len(designs)]
        alone = options.changed(head_on_half_angle_rad=angles_rad[launch])
        plain = grow_reference(design, terrain, poses[launch], alone, draw_seed=launch)
        free = [terrain.free_space(options.radius_mm(one)) for one in design.build.widths_mm]
        deep = depth_mm(fast, free) / size_mm
        counts.growths += 1
        counts.inflated += int(fast.deployed.sum()) * (options.body == "inflated")
        counts.held += int((fast.stop == Stop.PRESSURE).sum())
        counts.stayed_in += int((fast.stop == Stop.NOT_EVERTED).sum())
        counts.branches += int(fast.deployed.sum())
        counts.deepest = max(counts.deepest, deep)
        counts.outside += deep > EXACT
        counts.disagree += not agree(fast, plain, EXACT * size_mm)
    if counts.failures > before:
        counts.seeds.append(seed)


@dataclass(frozen=True, slots=True)
class Move:
    """A change of the whole world that must change no length and no stop."""

    matrix: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 1.0)  # rows a b, c d
    shift: tuple[float, float] = (0.0, 0.0)  # in sizes of the map
    reorders: bool = False
    refines: bool = False

    @property
    def scale(self) -> float:
        a, b, c, d = self.matrix
        return math.sqrt(abs(a * d - b * c))

    @property
    def mirrors(self) -> bool:
        a, b, c, d = self.matrix
        return a * d - b * c < 0.0

    def pose(self, pose: Pose, size_mm: float) -> Pose:
        a, b, c, d = self.matrix
        x, y = pose.x_mm, pose.y_mm
        u, v = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
        return Pose(
            x_mm=a * x + b * y + self.shift[0] * size_mm,
            y_mm=c * x + d * y + self.shift[1] * size_mm,
            heading_rad=math.atan2(c * u + d * v, a * u + b * v),
        )

    def world(self, world: Map, rng: np.random.Generator) -> Map:
        dx, dy = (one * max(world.size_mm) for one in self.shift)
        obstacles = list(world.obstacles)
        if self.reorders:
            obstacles = [obstacles[n] for n in rng.permutation(len(obstacles))]
        shapes = [affine_transform(one, (*self.matrix, dx, dy)) for one in obstacles]
        if self.refines:
            shapes = [refined(one, rng) for one in shapes]
        bounds = affine_transform(world.bounds, (*self.matrix, dx, dy))
        return Map(name="moved", bounds=bounds, obstacles=tuple(shapes))


def refined(shape: Polygon, rng: np.random.Generator) -> Polygon:
    """Return a polygon with one to three more corners on each side, begun at another corner."""
    ring = np.roll(shapely.get_coordinates(shape.exterior)[:-1], rng.integers(0, 99), axis=0)
    corners: list[tuple[float, float]] = []
    for one, other in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        shares = np.sort(rng.uniform(0.1, 0.9, rng.integers(1, 4)))
        corners += [tuple(one), *(tuple(one + share * (other - one)) for share in shares)]
    return Polygon(corners)


def random_move(rng: np.random.Generator, name: str, world: Map) -> Move:
    """Return a move of one of the `MOVES`."""
    if name == "turn":
        angle = rng.choice([rng.uniform(-np.pi, np.pi), np.pi / 2.0, math.asin(0.6)])
        c, s = math.cos(angle), math.sin(angle)
        return Move(matrix=(c, -s, s, c))
    if name == "scale":
        scale = float(rng.choice([0.013, 0.7, 3.0, 170.0]))
        if scale * max(map(abs, world.bounds.bounds)) > LARGEST_MM / 10.0:
            scale = 1.0 / scale
        return Move(matrix=(scale, 0.0, 0.0, scale))
    if name == "shift":
        return Move(shift=tuple(rng.uniform(-3.0, 3.0, 2).tolist()))
    if name == "mirror":
        return Move(matrix=(-1.0, 0.0, 0.0, 1.0))
    return Move(reorders=name == "reorder", refines=name == "refine")


MOVES = ("mirror", "turn", "scale", "shift", "reorder", "refine")


@dataclass
class MoveCounts:
    """What was seen under one kind of move."""

    growths: int = 0
    branches: int = 0
    stopped: int = 0  # branches that a wall stopped
    ties: int = 0
    differ: int = 0
    worst: float = 0.0  # difference of a length in sizes of the map, ties left out
    seeds: list[tuple[str, int]] = field(default_factory=list)


def mirrored_order(grown: Deployment) -> list[int]:
    """Return for every branch the one that a mirror of the tree puts in its place."""
    parents = grown.tree.parent.tolist()
    children: dict[int, list[int]] = {}
    for branch, parent in enumerate(parents):
        children.setdefault(parent, []).append(branch)
    other = {-1: -1}
    for branch, parent in enumerate(parents):
        siblings = children[parent]
        there = children[other[parent]]
        other[branch] = there[-1 - siblings.index(branch)]
    return [other[branch] for branch in range(len(parents))]


def length_difference(one: Deployment, other: Deployment, move: Move, size_mm: float) -> float:
    """Return how much lengths differ at most, in sizes of the map; infinity if stops do."""
    order = mirrored_order(one) if move.mirrors else list(range(len(one.stop)))
    if other.stop[order].tolist() != one.stop.tolist():
        return math.inf
    return float(
        np.abs(other.grown_mm[order] / move.scale - one.grown_mm).max(initial=0.0) / size_mm
    )


def is_tie(
    grown: Deployment, design: Design, terrain: Terrain, options: GrowthOptions, seed: int
) -> bool:
    """Tell whether a start or obstacles a little beside end it otherwise too, or in a wall."""
    size_mm, rng = max(terrain.world.size_mm), np.random.default_rng(seed)
    for number, nudge in enumerate(NUDGE * rng.normal(size=(24, 3))):
        pose = Pose(
            x_mm=grown.pose.x_mm + nudge[0] * size_mm,
            y_mm=grown.pose.y_mm + nudge[1] * size_mm,
            heading_rad=grown.pose.heading_rad + nudge[2],
        )
        near = Terrain.of(nudged(terrain.world, rng)) if number % 3 == 2 else terrain
        if not near.is_free(pose):
            return True
        beside = grow_on(design, near, pose, options, "kernel")
        if length_difference(grown, beside, Move(), size_mm) > 100.0 * NUDGE:
            return True
    return False


def nudged(world: Map, rng: np.random.Generator) -> Map:
    """Return a map whose obstacles each moved, grew and shrank a little, its bounds sheared."""
    size_mm = max(world.size_mm)
    x, y = world.bounds.centroid.coords[0]
    up, over = NUDGE * rng.normal(size=2)
    bounds = affine_transform(world.bounds, (1.0, up, over, 1.0, -up * y, -over * x))
    shapes = []
    for obstacle in world.obstacles:
        x, y = obstacle.centroid.coords[0]
        wide, high, dx, dy = NUDGE * rng.normal(size=4)
        move = (1 + wide, 0.0, 0.0, 1 + high, dx * size_mm - wide * x, dy * size_mm - high * y)
        shapes.append(affine_transform(obstacle, move))
    return Map(name="nudged", bounds=bounds, obstacles=tuple(shapes))


def move_map(counts: MoveCounts, name: str, kind: str, seed: int) -> None:
    """Grow some trees on one map and on the same map moved, and count."""
    rng = np.random.default_rng([73, MOVES.index(name), list(KINDS).index(kind), seed])
    terrain = Terrain.of(nasty_map(rng, kind))
    if len(terrain.walls().wall) == 0:
        return
    size_mm, move = max(terrain.world.size_mm), random_move(rng, name, terrain.world)
    moved = Terrain.of(move.world(terrain.world, rng))
    options = GrowthOptions.published(
        head_on_half_angle_rad=math.radians(float(rng.choice([0.0, 1.0, 15.0]))),
        children_of_stuck=str(rng.choice(["stop", "deploy"])),
    )
    designs = [nasty_design(rng, size_mm) for _ in range(DESIGNS_PER_MAP)]
    if move.mirrors:  # only fans of equal branches have a mirror image
        designs = [
            one.changed(levels=tuple(level.changed(growth=1.0) for level in one.levels))
            for one in designs
        ]
    scaled = [scaled_design(one, move.scale) for one in designs]
    for _ in range(GROWTHS_PER_MAP // DESIGNS_PER_MAP):
        pose = nasty_pose(rng, terrain)
        there = move.pose(pose, size_mm)
        for design, large in zip(designs, scaled, strict=True):
            before = grow_on(design, terrain, pose, options, "kernel")
            counts.growths += 1
            counts.branches += int(before.deployed.sum())
            counts.stopped += int((before.deployed & (before.stop != Stop.FULL_LENGTH)).sum())
            try:
                after = grow_on(large, moved, there, options, "kernel")
                off = length_difference(before, after, move, size_mm)
            except BadInputError:  # the start is in a wall now
                off = math.inf
            if off <= SAME:
                counts.worst = max(counts.worst, off)
            elif is_tie(before, design, terrain, options, seed):
                counts.ties += 1
            else:
                counts.differ += 1
                counts.seeds.append((kind, seed))


def scaled_design(design: Design, scale: float) -> Design:
    """Return a design whose lengths are multiplied."""
    return design.changed(
        trunk_length_mm=design.trunk_length_mm * scale,
        levels=tuple(one.changed(length_mm=one.length_mm * scale) for one in design.levels),
    )


def moves(growths: int) -> dict[str, MoveCounts]:
    """Return counts for every kind of move after at least so many growths in all."""
    found = {name: MoveCounts() for name in MOVES}
    for name, counts in found.items():
        kinds, seed = list(KINDS), 0
        while counts.growths < growths / len(MOVES):
            move_map(counts, name, kinds[seed % len(kinds)], seed)
            seed += 1
    return found


def move_lines(found: dict[str, MoveCounts]) -> list[str]:
    """Return a table of the counts."""
    heads = ("growths", "branches", "stopped", "ties", "differ", "worst")
    lines = [f"{'move':10s}" + "".join(f"{head:>10s}" for head in heads)]
    for name, one in found.items():
        lines.append(
            f"{name:10s}{one.growths:10d}{one.branches:10d}{one.stopped:10d}{one.ties:10d}"
            f"{one.differ:10d}{one.worst:10.1e}" + (f"  maps {one.seeds[:5]}" if one.seeds else "")
        )
    return lines


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
    heads = ("growths", "branches", "inflated", "held", "stayed_in", "events", "most")
    heads += ("endless", "outside", "deepest", "disagree")
    lines = [f"{'kind':10s}" + "".join(f"{head:>10s}" for head in heads)]
    for kind, one in found.items():
        lines.append(
            f"{kind:10s}{one.growths:10d}{one.branches:10d}{one.inflated:10d}{one.held:10d}{one.stayed_in:10d}"
            f"{one.events:10d}{one.most_events:10d}{one.endless:10d}{one.outside:10d}{one.deepest:10.1e}{one.disagree:10d}"
            + (f"  maps {one.seeds[:5]}" if one.seeds else "")
        )
    moved = moves(growths)
    lines += ["", *move_lines(moved)]
    failures = sum(one.failures for one in found.values())
    failures += sum(one.differ for one in moved.values())
    total = sum(one.growths for one in (*found.values(), *moved.values()))
    lines.append(f"{total} growths, {failures} failures")
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
