"""Designs that are written branch by branch."""

from dataclasses import replace

import numpy as np
import pytest

import vinefab as vf
from vinefab.model.design import design_of, design_text
from vinefab.model.files.toml import toml_content

SCOUT = """
schema = "vinefab/design-1"
name = "scout"
[trunk]
length = 140.0
bends = [[60.0, 25.0]]
[[branch]]
name = "tip"
of = "left"
length = 50.0
width_mm = 9.0
taper = 0.8
fillet_mm = 3.0
pouch = { shape = "round", radius_mm = 12.0 }
[[branch]]
name = "right"
angle_deg = 40.0
length = 90.0
pouch = false
[[branch]]
name = "left"
angle_deg = -62.0
length = 160.0
bends = [[40.0, 20.0], [90.0, -35.0]]
[build]
trunk_width_mm = 24.0
pouch = { shape = "round", radius_mm = 10.0 }
"""


def read(text):
    return design_of(toml_content(text, "scout.toml"), "scout.toml")


def test_branches_stand_in_the_trees_order_with_their_own_values():
    scout = read(SCOUT)
    assert scout.names == ("trunk", "left", "right", "tip")
    assert scout.tree.ids == ("0", "0.0", "0.1", "0.0.0")
    assert scout.tree.level.tolist() == [1, 2, 2, 3]
    assert scout.tree.length_mm.tolist() == [140.0, 160.0, 90.0, 50.0]
    assert np.degrees(scout.tree.offset_rad) == pytest.approx([0.0, -62.0, 40.0, 0.0])
    assert scout.tree.width_mm == pytest.approx([24.0, 14.4, 14.4, 9.0])
    assert scout.tree.end_width_mm == pytest.approx([24.0, 14.4, 14.4, 7.2])
    assert scout.tree.fillet_mm == pytest.approx([0.0, 3.6, 3.6, 3.0])
    assert scout.tree.bend_branch.tolist() == [0, 1, 1]
    assert [pouch and pouch.radius_mm for pouch in scout.pouches] == [None, None, None, 12.0]
    assert (scout.depth, scout.branch_count) == (3, 4)


def test_a_file_of_branches_is_read_as_it_was_written(tmp_path):
    scout = read(SCOUT)
    again = vf.Design.read(scout.write(tmp_path / "scout.toml"))
    assert again == scout
    assert again.tree.key == scout.tree.key


def test_a_scale_multiplies_lengths_and_places_of_bends_alone():
    scaled = read(SCOUT.replace('name = "scout"', 'name = "scout"\nscale_mm_per_unit = 2.0', 1))
    one, two = read(SCOUT).tree, scaled.tree
    assert (two.length_mm == 2.0 * one.length_mm).all()
    assert (two.bend_mm == 2.0 * one.bend_mm).all()
    assert (two.bend_rad == one.bend_rad).all()
    assert (two.width_mm == one.width_mm).all()


@pytest.mark.parametrize(
    "name", ["grid_explorer_levels", "cave_explorer_levels", "three_level_tree", "plain_vine"]
)
def test_a_design_of_levels_is_the_same_branch_by_branch(name):
    design = vf.Design.read(name)
    free = design.by_branches
    assert free.levels == ()
    assert free.tree.key == design.tree.key
    assert read(design_text(free)).tree.key == design.tree.key
    assert free.pouches == design.pouches


def test_bends_of_a_level_are_those_of_each_of_its_branches():
    level = vf.Level(branches=2, length_mm=80.0, angle_deg=90.0, bends=((30.0, 15.0),))
    design = vf.Design(name="two", trunk_length_mm=100.0, levels=(level,))
    assert design.tree.bend_branch.tolist() == [1, 2]
    assert design.by_branches.tree.key == design.tree.key


def test_one_branch_is_changed_by_its_name_or_its_id():
    design = vf.Design.read("three_level_tree")
    for called in ("0.1", "1"):
        changed = design.with_branch(called, length_mm=33.0)
        assert changed.tree.length_mm[2] == 33.0
        others = np.arange(len(design.tree)) != 2
        assert (changed.tree.length_mm == design.tree.length_mm)[others].all()
    assert design.with_branch("trunk", length_mm=77.0).trunk_length_mm == 77.0
    with pytest.raises(vf.VinefabError, match="branch"):
        design.with_branch("0.9", length_mm=1.0)
    with pytest.raises(vf.BadInputError, match="a trunk has these"):
        design.with_branch("0", angle_deg=1.0)


WRONG = {
    'of = "left"': ('of = "lefd"', "branch[1].of: there is no branch 'lefd'", "'left'"),
    'name = "right"': (
        'name = "left"',
        "branch[3].name: 'left' names two",
        "another branch has it",
    ),
    'name = "tip"': ('name = "trunk"', "branch[1].name: 'trunk' names two", "the trunk has it"),
    'name = "left"': ('name = "l eft"', "branch[3].name is 'l eft'", "letters"),
    "angle_deg = 40.0": ("angle_deg = -62.0", "branch[3].angle_deg: -62 deg", "'right'"),
    "[90.0, -35.0]": ("[50.0, -35.0]", "branch[3].bends is [40.0, 50.0]", "14.4 mm"),
    "[40.0, 20.0], [90": ("[40.0, 20.0], [160", "branch[3].bends is 160", "160 mm long"),
    "[[60.0, 25.0]]": ("[[60.0, 225.0]]", "trunk.bends[1][2] is 225", "175"),
    "[trunk]\nlength": (
        "[[level]]\nbranches = 2\nlength = 9.0\n[trunk]\nlength",
        "branch is given together with level",
        "by one of them",
    ),
}


@pytest.mark.parametrize("given", WRONG)
def test_a_wrong_branch_is_one_line_that_names_it(given):
    wrong, key, words = WRONG[given]
    assert SCOUT.count(given) == 1
    with pytest.raises(vf.BadInputError) as caught:
        read(SCOUT.replace(given, wrong))
    line = str(caught.value)
    assert key in line, line
    assert words in line, line
    assert "\n" not in line


def test_branches_that_lead_nowhere_are_refused():
    text = SCOUT.replace('name = "left"\n', 'name = "left"\nof = "tip"\n')
    with pytest.raises(
        vf.BadInputError, match=r"branch\[1\].of: 'tip' is its own ancestor by 'left'"
    ):
        read(text)


def test_a_long_ring_of_branches_is_refused_too():
    branch = '[[branch]]\nname = "b{}"\nof = "b{}"\nlength = 50.0\n'
    ring = "".join(branch.format(n, (n + 1) % 15) for n in range(15))
    hangs_on = branch.format("first", 3) + "angle_deg = 30.0\n"
    head = SCOUT[: SCOUT.index("[[branch]]")]
    with pytest.raises(vf.BadInputError, match=r"branch\[2\].of: 'b0' is its own ancestor by 'b1'"):
        read(head + hangs_on + ring)


def test_very_many_branches_and_bends_are_refused_at_once():
    branch = '[[branch]]\nname = "b{}"\nangle_deg = {}\nlength = 50.0\n'
    head = SCOUT[: SCOUT.index("[[branch]]")]
    many = "".join(branch.format(n, n / 10.0) for n in range(1001))
    with pytest.raises(vf.BadInputError, match=r"branch is '1001 branches'.*at most 1000"):
        read(head + many)
    bends = ", ".join(f"[{60 + n / 1000}, 1.0]" for n in range(10_000))
    with pytest.raises(vf.BadInputError, match=r"trunk.bends is '10000 bends'"):
        read(SCOUT.replace("[60.0, 25.0]", bends))


def test_the_straight_parts_of_a_tree_are_worked_out_once():
    tree = vf.Design.read("scout").tree
    assert tree.straight is tree.straight
    assert replace(tree).straight is not tree.straight
    assert tree.straight.straight is tree.straight
