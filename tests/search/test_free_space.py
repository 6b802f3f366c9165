"""Free trees as points: the same trees as designs, as batches, and with single branches changed."""

from dataclasses import fields

import numpy as np
import pytest

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.model.design import Design
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.search.free_space import EMPTY, FreeSpace, space_of
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.space import COSTS, Bounds, BuildSettings, Space, SpaceSettings
from vinefab.search.tree_batch import TreeBatch

SETTINGS = SpaceSettings(
    levels=Bounds(low=2, high=4),
    length_mm=Bounds(low=40, high=205),
    angle_deg=Bounds(low=30, high=160),
    growth_percent=Bounds(low=50, high=160),
    tree="free",
)
BUILD = BuildSettings(trunk_width_mm=24.0, width_ratio=0.65)
SPACE = FreeSpace(SETTINGS, BUILD)
BENT = FreeSpace(SETTINGS.changed(bends=Bounds(low=0, high=2)), BUILD)


def level_designs(count):
    """Designs of levels that have room in the free space."""
    levels, rng = SPACE.levels, np.random.default_rng(4)
    found = [levels.design(rng.random(len(levels))) for _ in range(3 * count)]
    return [one for one in found if one.branch_count <= SPACE.slots][:count]


def design_at(space, x):
    """The design at a point; None where bends are closer than the tube is wide, and the like."""
    try:
        return space.design(x)
    except BadInputError:
        return None


def moved(space, x, rng):
    """A point with other angles, lengths and bends of the same tree, siblings apart."""
    cells = x.reshape(space.slots, space.columns).copy()
    cells[:, 1:] = np.clip(cells[:, 1:] + rng.normal(0.0, 0.2, cells[:, 1:].shape), 0.01, 0.99)
    return cells.ravel()


def test_the_space_of_a_run_is_of_levels_or_free():
    assert isinstance(space_of(SETTINGS, BUILD), FreeSpace)
    assert isinstance(space_of(SETTINGS.changed(tree="levels"), BUILD), Space)


@pytest.mark.parametrize("space", [SPACE, BENT], ids=["straight", "bends"])
def test_level_designs_are_points_within_a_hundredth(space):
    for design in level_designs(30):
        tree = space.tree(space.point(design.tree))
        assert tree.parent.tolist() == design.tree.parent.tolist()
        assert np.abs(tree.length_mm - design.tree.length_mm).max() < 0.0051
        assert np.degrees(np.abs(tree.offset_rad - design.tree.offset_rad)).max() < 0.0051
        assert not len(tree.bend_mm)


@pytest.mark.parametrize("space", [SPACE, BENT], ids=["straight", "bends"])
def test_a_point_is_one_tree_as_design_and_in_every_batch(space):
    rng, bends, compared = np.random.default_rng(8), 0, 0
    for design in level_designs(12):
        x = np.array([moved(space, space.point(design.tree), rng) for _ in range(4)])
        batch = space.batch(x)
        alone = TreeBatch.of([space.tree(row) for row in x])
        for name in (one.name for one in fields(TreeBatch)):
            if name != "trees":
                assert np.array_equal(getattr(batch, name), getattr(alone, name)), name
        assert batch.sizes.tolist() == [len(tree) for tree in batch.trees]
        part = batch.part(np.array([2, 0]))
        assert part.length_mm.tolist() == space.batch(x[[2, 0]]).length_mm.tolist()
        for row, tree in zip(x, batch.trees, strict=True):
            bends += len(tree.bend_mm)
            if (made := design_at(space, row)) is None:
                continue
            assert made.tree.key == tree.key
            compared += 1
            again = space.tree(space.vector(made))
            assert again.parent.tolist() == tree.parent.tolist()
            assert np.abs(again.length_mm - tree.length_mm).max() < 1e-9
            assert np.abs(again.offset_rad - tree.offset_rad).max() < 1e-9
    assert (bends > 100) == (space is BENT)
    assert compared >= 10


def test_costs_of_trees_are_those_of_the_same_designs_of_levels():
    designs = level_designs(20)
    for design in designs:
        for cost in COSTS.values():
            found = cost.of(TreeBatch.of_designs([design]), SPACE.build_of)
            wanted = cost.of(SPACE.levels.batch_of(design), SPACE.build_of)
            assert found == pytest.approx(wanted, rel=1e-12)


def test_ranges_are_those_that_branches_of_levels_may_have():
    corners = np.array([np.zeros(len(SPACE)), np.ones(len(SPACE))])
    for corner in corners:
        tree = SPACE.tree(corner)
        assert (tree.length_mm[1:] >= 20.0).all()
        assert (tree.length_mm[1:] <= 328.0).all()
        assert np.degrees(np.abs(tree.offset_rad)).max() <= 80.0
        assert int(tree.level.max()) <= 4
    values = SPACE.values(SPACE.vector(level_designs(1)[0]))
    assert values[0].name == "length_mm of 0"
    assert all(one.low <= one.value <= one.high for one in values)


def test_single_branches_come_and_go():
    design = Design.read("grid_explorer_levels")
    x = SPACE.vector(design)
    parents = [parent for parent, _ in SPACE.gaps(x)]
    assert parents  # three children of four that are allowed
    slot = SPACE.free_slot(x, parents[0])
    longer = SPACE.with_child(x, parents[0], slot, 0.9, 0.3)
    assert len(SPACE.tree(longer)) == len(SPACE.tree(x)) + 1
    assert SPACE.changed_slot(x, longer) == slot
    assert (SPACE.without(longer, slot) == x).all()
    assert SPACE.with_slot_of(x, longer, slot).tolist() == longer.tolist()
    assert SPACE.with_slot_of(longer, x, slot).tolist() == x.tolist()
    leaf = SPACE.leaves(x)[0]
    shorter = SPACE.without(x, leaf)
    assert len(SPACE.tree(shorter)) == len(SPACE.tree(x)) - 1
    assert SPACE.parents(shorter)[leaf] == EMPTY
    # What hangs on a branch that has gone does not fit; nor does a parent go before its children.
    parent = int(SPACE.parents(x)[leaf])
    bare = x
    for slot in np.flatnonzero(SPACE.parents(x) == parent).tolist():
        bare = SPACE.without(bare, slot)
    gone = SPACE.without(bare, parent)
    assert SPACE.with_slot_of(gone, x, leaf) is None
    assert SPACE.with_slot_of(x, gone, parent) is None


def test_active_coordinates_are_those_of_the_branches_that_there_are():
    x = SPACE.vector(Design.read("grid_explorer_levels"))
    active, tree = SPACE.active(x), SPACE.tree(x)
    assert len(active) == 31 + 30
    for slot in range(SPACE.slots):
        for column in range(1, SPACE.columns):
            other = x.copy()
            place = slot * SPACE.columns + column
            other[place] = 0.37
            same = SPACE.tree(other).key == tree.key
            assert same == (place not in active)


def test_a_design_with_more_branches_than_slots_is_refused():
    small = FreeSpace(SETTINGS.changed(most_branches=20), BUILD)
    assert small.slots == 20
    with pytest.raises(BadInputError, match="at most 20 branches"):
        small.vector(Design.read("grid_explorer_levels"))


@pytest.mark.parametrize("compensation", ["none", "inflation"])
def test_trees_of_level_designs_have_the_penalties_of_the_designs(compensation):
    profile = read_profile(DEFAULT_RECIPE)
    levels = Space(SETTINGS, BUILD.changed(compensation=compensation))
    designs = levels.batch(np.random.default_rng(3).random((200, len(levels))))
    penalties = ManufacturabilityPenalty(profile=profile).within(levels)
    found = penalties(TreeBatch.of(levels.trees(designs)))
    assert found.tolist() == penalties(designs).tolist()
    assert 20 < (found == 0.0).sum() < 180


def test_bends_nearer_to_each_other_than_the_tube_is_wide_are_none():
    settings = SpaceSettings(
        tree="free",
        levels=Bounds(low=2, high=3),
        length_mm=Bounds(low=40, high=300),
        bends=Bounds(low=0, high=2),
    )
    space = FreeSpace(settings, BuildSettings(trunk_width_mm=40.0))
    shortest = space.design(np.zeros(len(space)))
    assert shortest.trunk_length_mm == 40.0
    assert len(shortest.trunk.bends) == 1
    rng = np.random.default_rng(4)
    for x in rng.random((40, len(space))):
        design = space.design(x)  # what a design refuses is not made
        assert np.array_equal(space.batch(x[None]).length_mm, design.tree.straight.length_mm)


# --- Mirrored trees -------------------------------------------------------------------------------

MIRRORED = FreeSpace(SETTINGS.changed(mirrored=True, bends=Bounds(low=0, high=2)), BUILD)


def sides(tree):
    """Return length, heading, width and bends of each branch with its path of angles, sorted."""
    found, path = [], [()]
    for row in range(1, len(tree)):
        path.append((*path[tree.parent[row]], float(tree.offset_rad[row])))
        bends = [value for bend in tree.bends_of(row) for value in bend]
        found.append((path[row], float(tree.length_mm[row]), bends))
    return sorted(found)


def mirror_image(found):
    """Return the same of the mirror image."""
    mirrored = []
    for path, length_mm, bends in found:
        turned = [-one if place % 2 else one for place, one in enumerate(bends)]
        mirrored.append((tuple(-one for one in path), length_mm, turned))
    return sorted(mirrored)


def mirrored_points(count):
    """Points around symmetric designs of levels with two to four children, and with others."""
    levels, rng = MIRRORED.levels, np.random.default_rng(11)
    designs = [levels.design(rng.random(len(levels))) for _ in range(4 * count)]
    designs = [one for one in designs if one.branch_count <= MIRRORED.most_branches][:count]
    for design in designs:
        x = MIRRORED.point(design.tree)
        yield x, design
        cells = MIRRORED.cells(x)
        free = MIRRORED.active(x)
        moved = x.copy()
        moved[free] = np.clip(x[free] + rng.normal(0.0, 0.15, len(free)), 0.01, 0.99)
        yield moved, None
        assert cells.shape == (MIRRORED.slots, MIRRORED.columns)


def test_a_mirrored_tree_is_its_own_mirror_image():
    bent, straight = 0, 0
    for x, design in mirrored_points(12):
        tree = MIRRORED.tree(x)
        own, other = sides(tree), mirror_image(sides(tree))
        assert len(own) == len(other)
        for one, two in zip(own, other, strict=True):
            for a, b in zip(one, two, strict=True):
                assert a == pytest.approx(b, abs=1e-9)
        assert not tree.bends_of(0)
        ahead = [path for path, _, _ in own if not any(path)]
        straight += len(ahead)
        bent += len(tree.bend_mm)
        assert len(ahead) < len(own)
        if design is not None:
            assert np.abs(tree.length_mm - design.tree.length_mm).max() < 0.0051
            assert np.degrees(np.abs(tree.offset_rad - design.tree.offset_rad)).max() < 0.0051
        batch = MIRRORED.batch(np.array([x, x]))
        assert batch.offset_rad[: batch.first[1]].tolist() == tree.straight.offset_rad.tolist()
    assert bent > 50
    assert straight >= 3


def test_mirrored_trees_in_a_batch_are_those_alone():
    space = FreeSpace(SETTINGS.changed(mirrored=True), BUILD)
    rng, levels = np.random.default_rng(2), space.levels
    tree = levels.design(np.full(len(levels), 0.5)).tree
    middle = space.point(tree)
    free = space.active(middle)
    assert len(free) <= len(SPACE.active(SPACE.point(tree))) / 2 + space.deepest
    x = np.tile(middle, (20, 1))
    x[:, free] = np.clip(x[:, free] + rng.normal(0.0, 0.2, (20, len(free))), 0.0, 1.0)
    alone = TreeBatch.of([space.tree(row) for row in x])
    batch = space.batch(x)
    for name in ("first", "parent", "level", "offset_rad", "length_mm", "fillet_mm"):
        assert np.array_equal(getattr(batch, name), getattr(alone, name)), name


def test_branches_of_a_mirrored_tree_come_in_pairs_but_for_the_axis():
    levels = MIRRORED.levels
    x = MIRRORED.point(levels.design(np.full(len(levels), 0.2)).tree)
    before, seen = len(MIRRORED.tree(x)), set()
    for parent, share in MIRRORED.gaps(x):
        slot = MIRRORED.free_slot(x, parent)
        longer = MIRRORED.with_child(x, parent, slot, share, 0.3)
        tree = MIRRORED.tree(longer)
        more = len(tree) - before
        seen.add(more)
        on_axis = share == 0.5 and len(MIRRORED.active(longer)) == len(MIRRORED.active(x)) + 1
        assert more == (1 if on_axis else 2)
        assert sides(tree) == mirror_image(sides(tree))
        assert len(MIRRORED.tree(MIRRORED.without(longer, slot))) == before
    assert seen == {1, 2}


def test_a_design_that_is_no_mirror_image_is_refused():
    with pytest.raises(UnfitInputError, match="mirror image"):
        MIRRORED.vector(Design.read("grid_explorer"))
    with pytest.raises(UnfitInputError, match="tree is 'levels'"):
        SETTINGS.changed(tree="levels", mirrored=True)


# --- Only some branches ---------------------------------------------------------------------------


def test_only_the_branches_named_have_coordinates():
    design = Design.read("grid_explorer")
    x = SPACE.point(design.tree)
    names = design.names
    for name in ("trunk", "1", "1-1"):
        own = SPACE.coordinates_of(x, [design.tree.ids[names.index(name)]])
        moved = x.copy()
        moved[own] += 0.003
        tree, before = SPACE.tree(moved), SPACE.tree(x)
        changed = (tree.length_mm != before.length_mm) | (tree.offset_rad != before.offset_rad)
        assert np.flatnonzero(changed).tolist() == [names.index(name)]
    with pytest.raises(UnfitInputError, match=r"nothing of 0\.9 can change"):
        SPACE.coordinates_of(x, ["0.9"])
