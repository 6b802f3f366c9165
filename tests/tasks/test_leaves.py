"""Anchoring for many growths at once, held against one leaf after the other in plain numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.cave import cave_map
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level, Pouch
from vinefab.model.map import Map
from vinefab.physics.anchoring import pouch_contact_mm2
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.leaves import STEP_BACK_MM, gaps_mm
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.wall_cells import TOUCHING_MM

POUCH = Pouch(shape="rectangle", length_mm=30.0, width_mm=45.0)
ROUND = Pouch(shape="round", radius_mm=20.0)


def plain_gap(chain: np.ndarray, ground: MapContext) -> float:
    """The gap at the end of a chain, from every edge of the map."""
    (bx, by), (x, y) = chain[-2:]
    length = math.hypot(x - bx, y - by)
    ux, uy = (x - bx) / length, (y - by) / length
    back = min(STEP_BACK_MM, 0.5 * length)
    x, y, ux, uy = x - back * ux, y - back * uy, -uy, ux
    before, after, turned = math.inf, math.inf, 0
    for (ax, ay), (cx, cy) in (ground.edges_mm - (x, y)).tolist():
        one, two = ux * ay - uy * ax, ux * cy - uy * cx
        if (one > 0.0) == (two > 0.0):
            continue
        share = one / (one - two)
        place = ux * (ax + share * (cx - ax)) + uy * (ay + share * (cy - ay))
        if abs(place) <= TOUCHING_MM:
            turned += 1 if two < one else -1
        elif place > 0.0:
            after = min(after, place)
        else:
            before = min(before, -place)
    return after if turned > 0 else before if turned < 0 else before + after


def plainly(task: Anchoring, end: Deployment, ground: MapContext, build: Build) -> dict[str, float]:
    """Score and terms as the docstrings have them, leaf by leaf."""
    length, width = task.pouch_length_mm, task.pouch_width_mm
    if width == 0.0 and build.pouch:
        side = math.sqrt(math.pi) * (build.pouch.radius_mm or 0.0)
        length, width = build.pouch.length_mm or side, build.pouch.width_mm or side
    known = [load for load in (task.film_n_mm, task.seam_n_mm) if load > 0.0]
    limit = 2.0 * build.widths_mm[-1] * min(known) if known else math.inf
    leaves, found = 0, []
    for leaf in np.flatnonzero(end.tree.is_leaf & end.deployed & (end.grown_mm > 0.0)).tolist():
        if task.only_full_length and end.stop[leaf] != Stop.FULL_LENGTH:
            continue
        leaves += 1
        turn, branch = 0.0, leaf
        while branch >= 0:
            turn += end.contact_turn_rad[branch]
            turn += abs(end.tree.offset_rad[branch]) if task.count_joint_angles else 0.0
            branch = end.tree.parent[branch]
        gap = plain_gap(end.chain_mm(leaf), ground) if width else 0.0
        if width and 2.0 * width / math.pi <= gap:
            continue
        press = 2e-3 * build.pressure_kpa * pouch_contact_mm2(length, width, gap) if width else 0.0
        found.append((turn, press))
    found.sort()

    def held(friction: float) -> list[float]:
        most = [limit / (press * friction) if press else math.inf for _, press in found]
        return [
            min(math.exp(friction * turn), cap) for (turn, _), cap in zip(found, most, strict=True)
        ]

    score = held(task.friction)
    sure = math.ceil(len(found) * 2.0 / 3.0 - 1e-9)
    return {
        "score": sum(score),
        "leaves": leaves,
        "engaged": len(found),
        "mean_turn_rad": sum(t for t, _ in found) / len(found) if found else 0.0,
        "largest_turn_rad": max((t for t, _ in found), default=0.0),
        "low": sum(held(task.friction_low)[:sure]),
        "high": sum(held(task.friction_high)),
        "force_n": task.friction * sum(h * p for h, (_, p) in zip(score, found, strict=True)),
        "capped": sum(
            h < math.exp(task.friction * t) - 1e-12 for h, (t, _) in zip(score, found, strict=True)
        ),
    }


def batch_of(body: str, pouch: Pouch | None) -> tuple[Batch, list[PreparedMap]]:
    """Designs with and without a pouch on two maps."""
    fan = Level(branches=3, length_mm=90.0, fan_rad=2.0, growth=0.7)
    deep, flat, bare = Build.standard(3, 24.0), Build.standard(2, 20.0), Build.standard(1, 20.0)
    designs = [
        Design(
            name="a", trunk_length_mm=120.0, levels=(fan, fan), build=replace(deep, pouch=pouch)
        ),
        Design(name="b", trunk_length_mm=150.0, levels=(fan,), build=replace(flat, pouch=pouch)),
        Design(name="c", trunk_length_mm=300.0, build=bare),
    ]
    options = GrowthOptions(body=body, children_of_stuck="deploy")
    sites = [PreparedMap.of(grid_map(2)), PreparedMap.of(cave_map(1))]
    poses = [draw_poses(site.world, 4, 3, clearance_mm=8.0) for site in sites]
    launches = Launches.of(TerrainSet([site.terrain for site in sites]), poses)
    return Batch(Plans.of(designs, options), launches, options), sites


@pytest.mark.parametrize(
    ("task", "pouch", "body"),
    [
        (Anchoring(), None, "centerline"),
        (Anchoring(), POUCH, "centerline"),
        (Anchoring(), ROUND, "inflated"),
        (Anchoring(pouch_length_mm=20.0, pouch_width_mm=60.0), POUCH, "centerline"),
        (Anchoring(count_joint_angles=True), POUCH, "inflated"),
        (Anchoring(only_full_length=True), POUCH, "centerline"),
        (Anchoring(film_n_mm=0.02, seam_n_mm=0.004), POUCH, "centerline"),
        (Anchoring(seam_n_mm=0.004, count_joint_angles=True), POUCH, "inflated"),
    ],
)
def test_blocks_are_scored_as_leaf_by_leaf(task: Anchoring, pouch: Pouch | None, body: str) -> None:
    batch, sites = batch_of(body, pouch)
    grounds = [site.ground for site in sites]
    seen = dict.fromkeys(("engaged", "leaves", "capped", "force_n"), 0.0)
    for size in (100, 5):
        for score, terms, plain in batch.each(
            lambda block: (
                *task.evaluate_block(block, grounds),
                [
                    plainly(
                        task,
                        block.deployment(index),
                        grounds[block.terrain[index]],
                        block.plans.each[block.plan[index]].build,
                    )
                    for index in range(len(block))
                ],
            ),
            size=size,
        ):
            for index, expected in enumerate(plain):
                found = {"score": score[index], **{n: v[index] for n, v in terms.items()}}
                assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)
            for name in seen:
                seen[name] += float(terms[name].sum())
    assert 0.0 < seen["engaged"] <= seen["leaves"]
    assert (seen["engaged"] < seen["leaves"]) == (pouch is not None)
    assert (seen["force_n"] > 0.0) == (pouch is not None)
    assert (seen["capped"] > 0.0) == (task.seam_n_mm > 0.0)


def test_a_growth_is_worth_the_same_alone_and_among_others() -> None:
    task = Anchoring(pouch_length_mm=20.0, pouch_width_mm=60.0, count_joint_angles=True)
    batch, sites = batch_of("centerline", None)
    grounds = [site.ground for site in sites]

    def work(block):
        alone = [
            task.evaluate(block.deployment(k), grounds[block.terrain[k]]) for k in range(len(block))
        ]
        return task.evaluate_block(block, grounds), alone

    for together, alone in batch.each(work, size=7):
        for index, (score, terms) in enumerate(alone):
            found, found_terms = together.one(index)
            assert found == score
            # What a pouch presses with is the design's pressure, which a deployment lacks.
            assert {**found_terms, "force_n": 0.0} == dict(terms)


def test_gaps_by_cells_are_those_of_all_edges(pillar_room: Map) -> None:
    """Tips inside, on walls and corners, of bodies along walls, across them and anyhow."""
    rng = np.random.default_rng(8)
    for world in (pillar_room, grid_map(1), cave_map(1)):
        ground = MapContext.of(world)
        low, high = ground.edges_mm.min(axis=(0, 1)), ground.edges_mm.max(axis=(0, 1))
        edges = ground.edges_mm[rng.choice(len(ground.edges_mm), 25)]
        on_walls = edges[:, 0] + rng.random((25, 1)) * (edges[:, 1] - edges[:, 0])
        tips = np.concatenate([rng.uniform(low, high, (50, 2)), on_walls, edges[:, 1]])
        along = edges[:, 1] - edges[:, 0]
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        steps = np.concatenate([rng.normal(size=(25, 2)), np.tile([[1.0, 0.0]], (25, 1))])
        bases = tips - np.concatenate([steps, along, normal])
        points = np.stack([bases, tips], axis=1).reshape(-1, 2)
        gaps = gaps_mm(points, np.arange(1, len(points), 2), ground)
        for chain, gap in zip(points.reshape(-1, 2, 2), gaps.tolist(), strict=True):
            assert gap == pytest.approx(plain_gap(chain, ground), abs=1e-9)
