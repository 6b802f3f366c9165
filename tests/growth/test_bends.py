"""Preformed bends: each grows as a single child of the same width would."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.oracles.growth_spans import grow_reference
from vinefab.core.errors import BadInputError
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Branch, Build, Design
from vinefab.physics.growth_pressure import FITTED, growth_pressure_kpa, planned_growth_kpa

FREE = GrowthOptions.published(body="centerline", pressure_stop=False)
WIDTH_MM = 6.0


def random_bends(rng, length_mm):
    """Up to two bends, far enough apart."""
    places = np.sort(rng.uniform(0.1, 0.9, rng.integers(0, 3))) * length_mm
    apart = np.diff(places, prepend=-np.inf) > WIDTH_MM
    return tuple((float(at), float(rng.uniform(-80, 80))) for at in places[apart]) or None


def random_bent_tree(rng):
    """A tree of up to eight branches of one width, each with bends of its own."""
    names, branches = ["trunk"], []
    for number in range(int(rng.integers(0, 8))):
        length_mm = float(rng.uniform(30.0, 200.0))
        deep = [one for one in branches if one.of != "trunk"]
        parents = [name for name in names if name not in {one.name for one in deep}]
        branches.append(
            Branch(
                name=f"b{number}",
                of=str(rng.choice(parents)),
                angle_deg=float(rng.uniform(-120.0, 120.0)),
                length_mm=length_mm,
                bends=random_bends(rng, length_mm),
                width_mm=WIDTH_MM,
            )
        )
        names.append(f"b{number}")
    trunk_mm = float(rng.uniform(50.0, 500.0))
    return Design.of_branches(
        branches,
        trunk_length_mm=trunk_mm,
        trunk_bends=random_bends(rng, trunk_mm) or (),
        build=Build(trunk_width_mm=WIDTH_MM, width_ratio=1.0),
    )


def unbent(design):
    """The same robot with a branch for every straight part, and the parts of each branch.

    Written from the file's values alone: it knows nothing of `BranchTree.straight`.
    """
    written = {"trunk": (design.trunk, None)} | {one.name: (one, one.of) for one in design.branches}
    parts, made = {}, []
    for name, (body, _) in written.items():
        ends = [0.0, *(at for at, _ in body.bends or ()), body.length_mm]
        lengths = np.diff(ends).tolist()
        parts[name] = ["trunk" if name == "trunk" else name] + [
            f"{name}-{n}" for n in range(1, len(lengths))
        ]
        for n, length_mm in enumerate(lengths):
            made.append((name, n, parts[name][n], length_mm, body))
    branches, trunk_mm = [], 0.0
    for name, n, part, length_mm, body in made:
        if part == "trunk":
            trunk_mm = length_mm
            continue
        of = parts[name][n - 1] if n else parts[written[name][1]][-1]
        angle = body.bends[n - 1][1] if n else body.angle_deg
        branches.append(
            Branch(name=part, of=of, angle_deg=angle, length_mm=length_mm, width_mm=WIDTH_MM)
        )
    build = Build(trunk_width_mm=WIDTH_MM, width_ratio=1.0)
    return Design.of_branches(branches, trunk_length_mm=trunk_mm, build=build), parts


@pytest.mark.parametrize("trees", [60, pytest.param(2000, marks=pytest.mark.thorough)])
def test_a_bend_is_a_single_child_of_the_same_width(random_map, random_pose, trees):
    """Against the plain reference, which grows every straight part as a branch."""
    bends = met = 0
    for number in range(trees):
        rng = np.random.default_rng([45, number])
        kind = ("convex", "star", "needles", "lattice")[number % 4]
        terrain = Terrain.of(random_map(rng, kind))
        robot, pose = random_bent_tree(rng), random_pose(rng, terrain)
        options = FREE.changed(body=("centerline", "inflated")[number % 2])
        single, parts = unbent(robot)
        grown = grow_on(robot, terrain, pose, options, "kernel")
        plain = grow_reference(single, terrain, pose, options)
        row = {name: n for n, name in enumerate(single.names)}
        for branch, name in enumerate(robot.names):
            own = [row[part] for part in parts[name]]
            out = [n for n in own if plain.stop[n] != Stop.NOT_DEPLOYED] or own[:1]
            assert grown.stop[branch] == plain.stop[out[-1]], (number, name)
            assert_allclose(grown.grown_mm[branch], plain.grown_mm[own].sum(), atol=1e-6)
            assert_allclose(
                grown.contact_turn_rad[branch], plain.contact_turn_rad[own].sum(), atol=1e-6
            )
            chains = [plain.chain_mm(n) for n in out if plain.grown_mm[n] > 0.0 or n == own[0]]
            whole = np.concatenate([chains[0], *(chain[1:] for chain in chains[1:])])
            assert_allclose(grown.chain_mm(branch), whole, atol=1e-6)
            at_bends = [chain[0] for chain in chains[1:]]
            assert_allclose(grown.bends_mm(branch), np.reshape(at_bends, (-1, 2)), atol=1e-6)
            assert len(grown.contacts_mm(branch)) == max(0, len(whole) - 2 - len(at_bends))
            bends += len(at_bends)
            met += bool(at_bends) and len(grown.contacts_mm(branch)) > 0
    assert bends > trees / 2
    assert met >= trees / 20


def bent(*bends, length_mm=200.0, **build):
    return Design.of_branches(
        [], trunk_length_mm=length_mm, trunk_bends=bends, build=Build(trunk_width_mm=10.0, **build)
    )


def test_bends_of_nothing_and_bends_that_are_split_change_nothing(random_map, random_pose):
    rng = np.random.default_rng(3)
    terrain = Terrain.of(random_map(rng, "convex"))
    pose = random_pose(rng, terrain)
    straight = grow_on(bent(), terrain, pose, FREE, "kernel")
    for robot in (bent((50.0, 0.0)), bent((50.0, 0.0), (90.0, 0.0))):
        grown = grow_on(robot, terrain, pose, FREE, "kernel")
        assert grown.points_mm.tobytes() == straight.points_mm.tobytes()
        assert grown.grown_mm.tobytes() == straight.grown_mm.tobytes()
    one, tree = bent((50.0, 40.0)).tree, bent().tree
    split = type(tree).of(
        parent=tree.parent,
        level=tree.level,
        offset_rad=tree.offset_rad,
        length_mm=tree.length_mm,
        build=bent().build,
        bends=[[(50.0, 10.0), (50.0, 30.0)]],
    )
    assert split.key == one.key


def test_the_pressure_of_a_bend_is_that_of_its_turn():
    robot = bent((80.0, 60.0), (150.0, -90.0))
    (found,) = planned_growth_kpa(robot.tree, FITTED, 20.0 / math.pi)
    lengths, turns = [80.0, 70.0, 50.0], [math.radians(60.0), math.radians(90.0)]
    assert found == pytest.approx(growth_pressure_kpa(lengths, turns, FITTED))


def test_bends_come_out_whatever_the_chance_of_children(random_map, random_pose):
    rng = np.random.default_rng(8)
    terrain = Terrain.of(random_map(rng, "convex"))
    options = FREE.changed(emergence=0.01)
    for _ in range(20):
        pose = random_pose(rng, terrain)
        robot = bent((5.0, 30.0), (20.0, -30.0), length_mm=60.0)
        sure, drawn = (grow_on(robot, terrain, pose, one, "kernel") for one in (FREE, options))
        assert drawn.points_mm.tobytes() == sure.points_mm.tobytes()


def test_children_of_stuck_branches_and_bends_do_not_go_together(random_map, random_pose):
    rng = np.random.default_rng(2)
    terrain = Terrain.of(random_map(rng, "convex"))
    with pytest.raises(BadInputError, match=r"children_of_stuck is 'deploy'.*bends"):
        grow_on(
            bent((50.0, 20.0)),
            terrain,
            random_pose(rng, terrain),
            FREE.changed(children_of_stuck="deploy"),
        )


def test_bodies_that_stop_at_others_know_bends(random_map, random_pose):
    """What is cut is the beginning of what grew alone."""
    stopped = 0
    for number in range(40):
        rng = np.random.default_rng([46, number])
        terrain = Terrain.of(random_map(rng, "convex"))
        robot, pose = random_bent_tree(rng), random_pose(rng, terrain)
        options = FREE.changed(body="inflated", branch_contact="stop")
        grown = grow_on(robot, terrain, pose, options, "kernel")
        alone = grow_on(robot, terrain, pose, options.changed(branch_contact="pass"), "kernel")
        for branch in np.flatnonzero(grown.stop == Stop.BRANCH).tolist():
            stopped += 1
            chain, whole = grown.chain_mm(branch), alone.chain_mm(branch)
            assert_allclose(chain[:-1], whole[: len(chain) - 1], atol=1e-9)
            assert grown.grown_mm[branch] <= alone.grown_mm[branch] + 1e-9
            assert len(grown.bends_mm(branch)) <= len(alone.bends_mm(branch))
    assert stopped > 5


def test_a_shape_on_the_way_has_the_bends_that_it_has_reached():
    robot = bent((80.0, 60.0), (150.0, -90.0))
    rows = np.array([0])
    assert robot.tree.taken(rows, np.array([100.0])).bend_mm.tolist() == [80.0]
    assert replace(robot.tree).taken(rows, np.array([80.0])).bend_mm.tolist() == []
