"""Anchoring: leaves and their gaps, what each holds, and the amplification of a robot."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import box

from tests.oracles.anchoring import branch_force_n, pouch_contact_mm2, tip_force_n
from vinefab.growth.batch import Batch, Launches, TerrainSet, grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.maps.generators.cave import cave_map
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level, Pouch
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.map import Map, Pose
from vinefab.physics.anchoring import (
    amplification_interval,
    branch_limit_n,
)
from vinefab.physics.tube import seam_load_n_mm
from vinefab.tasks.anchoring_force import (
    FRICTION_STEPS,
    STEP_BACK_MM,
    AnchoredRobots,
    Anchoring,
    GrownBatch,
    Leaves,
    Turns,
    gaps_mm,
)
from vinefab.tasks.areas import TOUCHING_MM
from vinefab.tasks.evaluate import PreparedMap, score_design
from vinefab.tasks.map_context import MapContext


def path_turn_rad(end: Deployment) -> np.ndarray:
    return Turns.of(GrownBatch.of(end)).path_rad


def tip_gaps_mm(end: Deployment, branches: np.ndarray, context: MapContext) -> np.ndarray:
    return gaps_mm(end.points_mm, end.first_point[1:][branches] - 1, context)


# --- The task --------------------------------------------------------------------------------

Ended = Callable[..., Deployment]
LINE = [(0, 0), (10, 10)]
POUCH = Anchoring(pouch_length_mm=30.0, pouch_width_mm=40.0)
"""Inflates to 25.5 mm."""


@pytest.fixture
def corridor() -> MapContext:
    """A corridor of 1000 x 20 mm."""
    return MapContext.of(Map(name="corridor", bounds=box(0, 0, 1000, 20)))


def wrapped(turn_rad: float) -> list[tuple[float, float]]:
    """A chain that is wrapped around contacts, at most 0.9 rad around each."""
    count = max(1, math.ceil(abs(turn_rad) / 0.9))
    headings = 0.3 + np.arange(count + 1) * turn_rad / count
    steps = 5.0 * np.column_stack([np.cos(headings), np.sin(headings)])
    return [(0.0, 0.0), *map(tuple, np.cumsum(steps, axis=0).tolist())]


def test_turns_add_up_along_each_path_and_leaves_add_up(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    end = ended(fork, [wrapped(turn) for turn in (1.0, 0.5, -2.0)])
    score, terms = Anchoring(friction=0.3).evaluate(end, room_context)
    assert score == pytest.approx(math.exp(0.3 * 1.5) + math.exp(0.3 * 3.0))
    assert (terms["leaves"], terms["engaged"], terms["ideal_case"]) == (2, 0, 1)
    assert terms["largest_turn_rad"] == pytest.approx(3.0)


def test_joint_angles_count_on_request(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    end = ended(fork, [wrapped(turn) for turn in (1.0, 0.5, 2.0)])
    assert Anchoring().count_joint_angles is False
    score, _ = Anchoring(friction=0.3, count_joint_angles=True).evaluate(end, room_context)
    assert score == pytest.approx(math.exp(0.3 * (1.5 + 0.5)) + math.exp(0.3 * (3.0 + 0.5)))


def test_hinges_at_bases_wrap_nothing(fork: Design, ended: Ended, room_context: MapContext) -> None:
    """Whatever a body's heading there, forwards or backwards, and however its hinge turned."""
    for chain in (LINE, [(0, 0), (-10, -10)], [(0, 0), (0, 0), (-10, 0)]):
        end = ended(fork, [chain] * 3, turns=[1.0, 0.5, 2.0])
        assert path_turn_rad(end).tolist() == [0.0] * 3
        assert Anchoring().evaluate(end, room_context)[0] == 2.0


def test_a_leaf_that_did_not_emerge_holds_nothing(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    end = ended(fork, [LINE, LINE, None], turns=[0.0, 0.0, 0.0])
    assert Anchoring().evaluate(end, room_context)[0] == pytest.approx(1.0)
    nothing = ended(fork, [LINE, None, None])
    assert Anchoring().evaluate(nothing, room_context)[0] == 0.0
    assert POUCH.evaluate(nothing, room_context)[0] == 0.0


def six(ended: Ended, turns: Sequence[float]) -> Deployment:
    levels = tuple(Level(branches=k, length_mm=50.0, fan_rad=1.0) for k in (2, 3))
    design = Design(name="six", trunk_length_mm=100.0, levels=levels, build=Build.standard(3))
    return ended(design, [wrapped(turn) for turn in [0.0] * 3 + list(turns)])


def test_six_branches_without_turns_hold_six_times_one(
    ended: Ended, room_context: MapContext
) -> None:
    assert Anchoring().evaluate(six(ended, [0.0] * 6), room_context)[0] == pytest.approx(6.0)


def test_the_papers_figures_come_out(ended: Ended, room_context: MapContext) -> None:
    """6.86 for six branches alike; 5.72 and 4.57 for five and four of them."""
    turn = math.log(6.86 / 6.0) / 0.3
    score, terms = Anchoring(friction=0.3).evaluate(six(ended, [turn] * 6), room_context)
    assert score == pytest.approx(6.86)
    assert terms["low"] == pytest.approx(4.0 * math.exp(0.2 * turn))
    assert 4.0 < terms["low"] < 4.57 < score < terms["high"]


def test_the_interval_is_that_of_the_physics(ended: Ended, room_context: MapContext) -> None:
    turns = [0.1, 2.0, 0.7, 3.0, 0.0, 1.5]
    _, terms = Anchoring().evaluate(six(ended, turns), room_context)
    interval = amplification_interval(turns, 4)
    assert terms["low"] == pytest.approx(interval.low)
    assert terms["high"] == pytest.approx(interval.high)


def test_turns_reach_the_third_level(ended: Ended) -> None:
    levels = (Level(branches=2, length_mm=50.0, fan_rad=1.0),) * 2
    design = Design(name="deep", trunk_length_mm=100.0, levels=levels, build=Build.standard(3))
    turns = [1.0, 10.0, 20.0, 100.0, 200.0, 300.0, 400.0]
    total = path_turn_rad(ended(design, [wrapped(turn) for turn in turns]))
    assert total == pytest.approx([1.0, 11.0, 21.0, 111.0, 211.0, 321.0, 421.0])


def test_only_pouches_wider_than_their_gap_are_engaged(
    fork: Design, ended: Ended, corridor: MapContext, room_context: MapContext
) -> None:
    chains = [[(10, 10), (100, 10)], [(100, 10), (200, 10)], [(100, 0), (300, 0)]]
    end = ended(fork, chains)
    score, terms = POUCH.evaluate(end, corridor)
    assert (score, terms["leaves"], terms["engaged"]) == (2.0, 2.0, 2.0)
    # Inflated 2 w / pi = 20 mm at w = 31.4: narrower than the corridor below that.
    for width, engaged in ((31.3, 0.0), (31.5, 2.0)):
        task = POUCH.changed(pouch_width_mm=width)
        assert task.evaluate(end, corridor)[0] == engaged
    nothing = {"engaged": 0.0, "low": 0.0, "high": 0.0}
    assert POUCH.evaluate(end, room_context)[1] == terms | nothing
    assert terms["ideal"] == 2.0


def test_the_pouch_of_a_leaf_that_was_stopped_has_not_come_out(
    fork: Design, ended: Ended, corridor: MapContext
) -> None:
    end = ended(fork, [[(10, 10), (100, 10)], [(100, 10), (200, 10)], [(100, 10), (140, 20)]])
    stop = np.array([Stop.FULL_LENGTH, Stop.FULL_LENGTH, Stop.HEAD_ON])
    stuck = replace(end, stop=stop)
    assert POUCH.evaluate(stuck, corridor)[0] == 1.0
    assert POUCH.evaluate(stuck, corridor)[1]["ideal"] == 2.0
    assert POUCH.changed(only_full_length=False).evaluate(stuck, corridor)[0] == 2.0
    # Without pouches every leaf that came out counts, as in the paper.
    assert Anchoring().evaluate(stuck, corridor)[0] == 2.0


def test_a_tip_on_a_wall_has_its_gap_on_the_free_side(
    fork: Design, ended: Ended, pillar_room: Map
) -> None:
    context = MapContext.of(pillar_room)
    # Along the pillar's lower side; towards it; in the open under it; past its lower right corner.
    for chain, gap in (
        ([(100, 100), (200, 100)], 100.0),
        ([(200, 50), (200, 100)], 400.0),
        ([(100, 50), (200, 50)], 100.0),
        ([(200, 100), (250, 100)], 100.0),
        ([(250, 150), (250, 180)], 150.0 - 0.0),
    ):
        end = ended(fork, [chain, None, None])
        assert tip_gaps_mm(end, np.array([0]), context)[0] == pytest.approx(gap, abs=2e-3)


@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_gaps_of_grown_robots_agree_with_polygons(body: str) -> None:
    fan = Level(branches=4, length_mm=90.0, fan_rad=2.0, growth=0.8)
    tree = Design(name="t", trunk_length_mm=150.0, levels=(fan, fan), build=Build.standard(3, 24.0))
    checked = 0
    for world in (grid_map(1), cave_map(1)):
        site = PreparedMap.of(world)
        for pose in draw_poses(world, 3, 1, clearance_mm=8.0):
            end = grow_on(tree, site.terrain, pose, GrowthOptions.published(body=body))
            leaves = np.flatnonzero(end.tree.is_leaf & end.deployed & (end.grown_mm > 1.0))
            gaps = tip_gaps_mm(end, leaves, site.context)
            for leaf, gap in zip(leaves.tolist(), gaps.tolist(), strict=True):
                assert gap == pytest.approx(by_polygons(end, leaf, site.context), abs=1e-5)
                checked += 1
    assert checked > 40


def by_polygons(end: Deployment, leaf: int, context: MapContext) -> float:
    """The same gap from the free space cut by a long line."""
    before, tip = end.chain_mm(leaf)[-2:]
    along = (tip - before) / np.hypot(*(tip - before))
    tip = tip - 1e-3 * along
    across = 5000.0 * np.array([-along[1], along[0]])
    line = shapely.LineString([tip - across, tip + across])
    parts = shapely.get_parts(shapely.intersection(context.free, line))
    near = parts[shapely.distance(parts, shapely.Point(tip)) < 1e-6]
    return float(shapely.length(near).max(initial=0.0))


def test_the_designs_own_pouch_is_used_and_film_and_seam_are_the_limit() -> None:
    pouch = Pouch(shape="rectangle", length_mm=30.0, width_mm=40.0)
    build = Build.standard(1, 20.0).changed(pouch=pouch, pressure_kpa=30.0)
    vine = Design(name="vine", trunk_length_mm=300.0, build=build)
    site = PreparedMap.of(Map(name="corridor", bounds=box(0, 0, 1000, 20)))
    poses = ((Pose(x_mm=10.0, y_mm=10.0, heading_rad=0.0),),)

    def terms(task: Anchoring, design: Design = vine) -> dict[str, float]:
        options = GrowthOptions.published()
        (evaluation,) = score_design(design, [site], poses, task, options).evaluations
        return {"score": evaluation.score, **evaluation.terms}

    contact_mm2 = 30.0 * (40.0 - math.pi * 20.0 / 2.0)
    force_n = tip_force_n(30.0, contact_mm2, 0.3)
    assert terms(Anchoring())["force_n"] == pytest.approx(force_n)
    # A seam that stands 0.01 N/mm on the branch's 40 mm of circumference: 0.4 N.
    limited = terms(Anchoring(seam_n_mm=0.01, film_n_mm=1.0))
    assert limited["force_n"] == pytest.approx(0.4)
    assert limited["score"] == pytest.approx(0.4 / force_n)
    assert limited["capped"] == 1.0
    small = pouch.changed(width_mm=30.0)
    narrow = vine.changed(build=build.changed(pouch=small))
    assert terms(Anchoring(), narrow)["engaged"] == 0.0
    bare = vine.changed(build=build.changed(pouch=None))
    assert terms(Anchoring(), bare)["engaged"] == 0.0
    assert (terms(Anchoring(), bare)["score"] > 0.0) == terms(Anchoring(), bare)["ideal_case"]
    assert terms(Anchoring(), bare)["force_n"] == 0.0


# --- Leaves in blocks and alone --------------------------------------------------------------

RECTANGLE = Pouch(shape="rectangle", length_mm=30.0, width_mm=45.0)
ROUND = Pouch(shape="round", radius_mm=20.0)


def plain_gap(chain: np.ndarray, context: MapContext) -> float:
    """The gap at the end of a chain, from every edge of the map."""
    (bx, by), (x, y) = chain[-2:]
    length = math.hypot(x - bx, y - by)
    ux, uy = (x - bx) / length, (y - by) / length
    back = min(STEP_BACK_MM, 0.5 * length)
    x, y, ux, uy = x - back * ux, y - back * uy, -uy, ux
    before, after, turned = math.inf, math.inf, 0
    for (ax, ay), (cx, cy) in (context.edges_mm - (x, y)).tolist():
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


def plainly(
    task: Anchoring, end: Deployment, context: MapContext, build: Build
) -> dict[str, float]:
    """Score and terms as the docstrings have them, leaf by leaf."""
    length, width = task.pouch_length_mm, task.pouch_width_mm
    if width == 0.0 and build.pouch:
        side = math.sqrt(math.pi) * (build.pouch.radius_mm or 0.0)
        length, width = build.pouch.length_mm or side, build.pouch.width_mm or side
    own = [contact_turn(end, branch) for branch in range(len(end.tree))]
    if task.count_joint_angles:
        own = [turn + abs(joint) for turn, joint in zip(own, end.tree.offset_rad, strict=True)]
    leaves, found, ideal, has_pouch = 0, [], 0.0, width > 0.0
    for leaf in np.flatnonzero(end.tree.is_leaf & end.deployed & (end.grown_mm > 0.0)).tolist():
        leaves += 1
        turn, branch = 0.0, leaf
        while branch >= 0:
            turn += own[branch]
            branch = end.tree.parent[branch]
        ideal += math.exp(task.friction * turn)
        if width and task.only_full_length and end.stop[leaf] != Stop.FULL_LENGTH:
            continue
        gap = plain_gap(end.chain_mm(leaf), context) if width else 0.0
        if width and 2.0 * width / math.pi <= gap:
            continue
        press = 2e-3 * build.pressure_kpa * pouch_contact_mm2(length, width, gap) if width else 0.0
        found.append((turn, press, leaf))
    found.sort()

    known = [load for load in (task.film_n_mm, task.seam_n_mm) if load > 0.0] or [math.inf]
    limits = [branch_limit_n(build.end_widths_mm[k - 1], min(known)) for k in end.tree.level]

    def amplified(friction: float, holding: list) -> float:
        free, _ = pulled(end, own, [math.inf] * len(own), friction, holding)
        held, _ = pulled(end, own, limits, friction, holding)
        whole = sum(math.exp(friction * turn) for turn, *_ in holding)
        return whole * (held / free if free else 1.0)

    count = math.ceil(len(found) * 2.0 / 3.0 - 1e-9)
    frictions = (*np.linspace(task.friction_low, task.friction_high, FRICTION_STEPS), task.friction)
    force, capped = pulled(end, own, limits, task.friction, found)
    return {
        "score": amplified(task.friction, found),
        "leaves": leaves,
        "engaged": len(found) if has_pouch else 0,
        "mean_turn_rad": sum(t for t, *_ in found) / len(found) if found else 0.0,
        "largest_turn_rad": max((t for t, *_ in found), default=0.0),
        "low": min(amplified(mu, some) for mu in frictions for some in (found, found[:count])),
        "high": max(amplified(mu, found) for mu in frictions),
        "ideal": ideal,
        "ideal_case": float(not has_pouch),
        "force_n": force,
        "capped": capped,
    }


def pulled(
    end: Deployment, own: list, limits: list, friction: float, holding: list, branch: int = 0
) -> tuple[float, int]:
    """Pull at a branch's base end, and how many branches are at their limit."""
    carried, count = sum(press * friction for _, press, leaf in holding if leaf == branch), 0
    for child in np.flatnonzero(end.tree.parent == branch).tolist():
        more, limited = pulled(end, own, limits, friction, holding, child)
        carried, count = carried + more, count + limited
    pull = branch_force_n(carried, own[branch], friction, limits[branch])
    return pull, count + (pull < branch_force_n(carried, own[branch], friction, math.inf))


def contact_turn(end: Deployment, branch: int) -> float:
    """Turns of a chain between its base and its tip."""
    runs = np.diff(end.chain_mm(branch), axis=0)
    runs = runs[np.hypot(*runs.T) > 0.0]
    turns = np.diff(np.arctan2(runs[:, 1], runs[:, 0]))
    return float(np.abs(np.remainder(turns + math.pi, math.tau) - math.pi).sum())


def batch_of(body: str, pouch: Pouch | None) -> tuple[Batch, list[PreparedMap]]:
    """Designs with and without a pouch on two maps."""
    fan = Level(branches=3, length_mm=90.0, fan_rad=2.0, growth=0.7)
    deep, flat, bare = Build.standard(3, 24.0), Build.standard(2, 20.0), Build.standard(1, 20.0)
    designs = [
        Design(name="a", trunk_length_mm=120.0, levels=(fan, fan), build=deep.changed(pouch=pouch)),
        Design(name="b", trunk_length_mm=150.0, levels=(fan,), build=flat.changed(pouch=pouch)),
        Design(name="c", trunk_length_mm=300.0, build=bare),
    ]
    options = GrowthOptions.published(body=body, children_of_stuck="deploy")
    sites = [PreparedMap.of(grid_map(2)), PreparedMap.of(cave_map(1))]
    poses = [draw_poses(site.world, 3, 3, clearance_mm=8.0) for site in sites]
    launches = Launches.of(TerrainSet([site.terrain for site in sites]), poses)
    return Batch(Plans.of(designs, options), launches, options), sites


@pytest.mark.parametrize(
    ("task", "pouch", "body"),
    [
        (Anchoring(), None, "centerline"),
        (Anchoring(), RECTANGLE, "centerline"),
        (Anchoring(), ROUND, "inflated"),
        (Anchoring(pouch_length_mm=20.0, pouch_width_mm=60.0), RECTANGLE, "centerline"),
        (Anchoring(count_joint_angles=True), RECTANGLE, "inflated"),
        (Anchoring(only_full_length=False, film_n_mm=0.02), RECTANGLE, "centerline"),
        (Anchoring(seam_n_mm=0.004, count_joint_angles=True), RECTANGLE, "inflated"),
    ],
)
def test_blocks_are_scored_as_leaf_by_leaf(task: Anchoring, pouch: Pouch | None, body: str) -> None:
    batch, sites = batch_of(body, pouch)
    contexts = [site.context for site in sites]
    seen = dict.fromkeys(("engaged", "leaves", "capped", "force_n"), 0.0)
    for size in (100, 5):
        for score, terms, plain in batch.each(
            lambda block: (
                *task.evaluate_block(block, contexts),
                [
                    plainly(
                        task,
                        block.deployment(index),
                        contexts[block.terrain[index]],
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
    assert (0.0 < seen["engaged"] < seen["leaves"]) == (pouch is not None)
    assert (seen["force_n"] > 0.0) == (pouch is not None)
    if pouch is None or task.seam_n_mm < 0.1:
        assert (seen["capped"] > 0.0) == (pouch is not None)


def test_gaps_by_cells_are_those_of_all_edges(pillar_room: Map) -> None:
    """Tips inside, on walls and corners, of bodies along walls, across them and anyhow."""
    rng = np.random.default_rng(8)
    for world in (pillar_room, grid_map(1), cave_map(1)):
        context = MapContext.of(world)
        low, high = context.edges_mm.min(axis=(0, 1)), context.edges_mm.max(axis=(0, 1))
        edges = context.edges_mm[rng.choice(len(context.edges_mm), 25)]
        on_walls = edges[:, 0] + rng.random((25, 1)) * (edges[:, 1] - edges[:, 0])
        tips = np.concatenate([rng.uniform(low, high, (50, 2)), on_walls, edges[:, 1]])
        along = edges[:, 1] - edges[:, 0]
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        steps = np.concatenate([rng.normal(size=(25, 2)), np.tile([[1.0, 0.0]], (25, 1))])
        bases = tips - np.concatenate([steps, along, normal])
        points = np.stack([bases, tips], axis=1).reshape(-1, 2)
        gaps = gaps_mm(points, np.arange(1, len(points), 2), context)
        for chain, gap in zip(points.reshape(-1, 2, 2), gaps.tolist(), strict=True):
            assert gap == pytest.approx(plain_gap(chain, context), abs=1e-9)


# --- Robots that are pulled -----------------------------------------------------------------


def anchored(
    end: Deployment,
    press_n: Sequence[float],
    limit_n: Sequence[float] | None,
    engaged: Sequence[bool],
) -> AnchoredRobots:
    grown = GrownBatch.of(end)
    turns = Turns.of(grown)
    return AnchoredRobots(
        grown=grown,
        turns=turns,
        leaves=Leaves.of(grown, turns),
        engaged=np.array(engaged),
        has_pouches=np.array([True]),
        press_n=np.array(press_n),
        limit_n=None if limit_n is None else np.array(limit_n),
    )


def test_every_branch_the_trunk_included_holds_at_most_what_it_stands(
    fork: Design, ended: Ended
) -> None:
    end = ended(fork, [wrapped(turn) for turn in (0.5, 1.0, 2.0)])
    one, two = 2.0 * 0.3 * math.exp(0.3), 3.0 * 0.3 * math.exp(0.6)
    trunk = math.exp(0.3 * 0.5)
    for limits, held, capped in (
        ((9.0, 9.0, 9.0), (one + two) * trunk, 0),
        ((9.0, 0.5, 9.0), (0.5 + two) * trunk, 1),
        ((1.0, 9.0, 9.0), 1.0, 1),
        ((1.0, 0.5, 0.5), 1.0, 3),
        ((9.0, 0.5, 0.5), 1.0 * trunk, 2),
    ):
        robots = anchored(end, [2.0, 3.0], limits, [True, True])
        free_n, held_n, count = robots.pulls_n(0.3)
        assert free_n[0] == pytest.approx((one + two) * trunk)
        assert (held_n[0], count[0]) == (pytest.approx(held), capped)
        whole = math.exp(0.3 * 1.5) + math.exp(0.3 * 2.5)
        assert robots.amplification(0.3)[0] == pytest.approx(whole * held / free_n[0])
        assert robots.ideal(0.3)[0] == pytest.approx(whole)


def test_where_film_and_seam_are_unknown_nothing_is_limited(fork: Design, ended: Ended) -> None:
    end = ended(fork, [wrapped(turn) for turn in (0.5, 1.0, 2.0)])
    robots = anchored(end, [10.0, 10.0], None, [True, True])
    free_n, held_n, count = robots.pulls_n(0.3)
    assert (held_n[0], count[0]) == (free_n[0], 0.0)
    assert held_n[0] > 0.0
    assert robots.amplification(0.3)[0] == robots.ideal(0.3)[0]


def test_shipped_film_and_seam_are_the_limits_unless_told_otherwise() -> None:
    film = read_profile(DEFAULT_RECIPE).material
    assert Anchoring().film_n_mm == pytest.approx(film.strength_mpa.value * film.ply_mm.value)
    assert Anchoring().seam_n_mm == pytest.approx(seam_load_n_mm(film.seam))


def test_preformed_bends_hold_nothing():
    """No wall need be touched there: their turns are those of joints, not of contacts."""
    world = Map(name="field", bounds=box(0, 0, 1000, 1000))
    bent = Design.of_branches(
        [], trunk_length_mm=300.0, trunk_bends=[(100.0, 50.0), (200.0, -70.0)]
    )
    pose = Pose(x_mm=300.0, y_mm=500.0, heading_rad=0.0)
    launches = Launches.of(TerrainSet([Terrain.of(world)]), [[pose]])
    options = GrowthOptions(head_on_half_angle_rad=0.0)
    turns = Batch(Plans.of([bent], options), launches, options).each(
        lambda block: Turns.of(GrownBatch.of_block(block)).path_rad.copy()
    )
    assert next(iter(turns)).tolist() == [0.0]
    assert path_turn_rad(grow_on(bent, Terrain.of(world), pose, options)).tolist() == [0.0]
