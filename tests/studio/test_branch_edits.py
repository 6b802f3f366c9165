"""Single branches by hand: dragged tips and bends, branches more, less and mirrored."""

import json

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.growth.batch import grow_on
from vinefab.model.design import Branch, Build, Design, Pouch, design_content, design_of
from vinefab.studio.branch_edits import edit_answer, tip_answer
from vinefab.studio.live_answers import live_answer, prepared_map
from vinefab.studio.state import StudioState

# A map without anything in the way.
MAP = {"source": {"environment": "grid", "seed": 3}, "edits": [["remove", 0]] * 36}
POSE = {"x_mm": 250.0, "y_mm": 100.0, "heading_deg": 70.0}


def tree(**build):
    """Three branches of the trunk, one with two bends and a child, on a turned robot."""
    branches = [
        Branch(name="left", angle_deg=50.0, length_mm=80.0, width_mm=7.0),
        Branch(name="right", angle_deg=-40.0, length_mm=100.0, bends=((70.0, -25.0), (30.0, 20.0))),
        Branch(name="end", of="right", angle_deg=15.0, length_mm=40.0),
        Branch(name="mid", angle_deg=0.0, length_mm=60.0),
    ]
    made = Build(trunk_width_mm=14.0, pressure_kpa=0.0, **build)
    return Design.of_branches(branches, trunk_length_mm=90.0, build=made, name="tree")


def state_of(design, pose=POSE, **more):
    content = json.loads(json.dumps(design_content(design)))
    return StudioState.of({"design": content, "map": MAP, "pose": pose, **more})


def places(design):
    """Return base, bends and tip of every branch by its name, as the library grows it."""
    state = state_of(design)
    grown = grow_on(state.grown_now, prepared_map(state).terrain, state.start, state.growth)
    return dict(zip(design.names, map(grown.chain_mm, range(len(design.names))), strict=True))


def pulled(design, ask):
    found = tip_answer(state_of(design), ask)
    content = design_content(design)
    table, _, place = found["key"].partition(".")
    (content[table][int(place)] if place else content[table]).update(found["values"])
    return design_of(content, "test")


@pytest.mark.parametrize("branch", ["left", "right", "end", "mid"])
@pytest.mark.parametrize("by", [(9.0, 4.0), (-6.0, 11.0)])
def test_the_tip_comes_to_where_it_is_dragged_and_no_other_branch_moves_but_its_children(
    branch, by
):
    before = places(tree())
    to = before[branch][-1] + by
    after_design = pulled(tree(), {"branch": branch, "to": to.tolist()})
    after = places(after_design)
    assert after[branch][-1] == pytest.approx(to, abs=0.05)
    for name in {"trunk", "left", "right", "mid"} - {branch}:
        assert np.array_equal(after[name], before[name])
    assert after_design == pulled(tree(), {"branch": branch, "by": list(by)})


@pytest.mark.parametrize(
    "design", [tree(), Design.read("three_level_tree")], ids=["free", "levels"]
)
def test_with_a_tip_comes_the_growth_of_the_changed_design(design):
    state, branch = state_of(design), "left" if design.branches else "0.0"
    live = {"have": None, "branch": branch}
    found = tip_answer(state, {"branch": branch, "by": [4.0, -3.0], "live": live})
    content = design_content(design)
    table, _, place = found["key"].partition(".")
    (content[table][int(place)] if place else content[table]).update(found["values"])
    changed = state_of(design_of(content, "test"))
    assert found["live"] == live_answer(changed, live)
    assert "live" not in tip_answer(state, {"branch": branch, "by": [4.0, -3.0]})


def test_a_trunk_keeps_its_heading():
    first, last = places(tree())["trunk"]
    after = pulled(tree(), {"branch": "trunk", "by": [0.0, 10.0]})
    way = places(after)["trunk"][1] - first
    assert way / np.hypot(*way) == pytest.approx((last - first) / np.hypot(*(last - first)))
    assert after.trunk_length_mm > 95.0
    locked = state_of(tree(), locks=["trunk.length"])
    assert tip_answer(locked, {"branch": "trunk", "by": [0.0, 10.0]})["values"] == {}


@pytest.mark.parametrize(("bend", "corner"), [(0, 2), (1, 1)], ids=["second", "first"])
def test_a_dragged_bend_leaves_its_neighbours_and_the_tip(bend, corner):
    before = places(tree())["right"]
    to = before[corner] + [5.0, -7.0]
    ask = {"branch": "right", "bend": bend, "to": to.tolist()}
    after = places(pulled(tree(), ask))["right"]
    wanted = before.copy()
    wanted[corner] = to
    assert after == pytest.approx(wanted, abs=0.05)
    assert tip_answer(state_of(tree()), ask)["bend"] == corner - 1, "they are in their order now"


def test_what_a_drag_would_make_impossible_is_refused_by_name():
    ask = {"branch": "right", "bend": 1, "to": places(tree())["right"][2].tolist()}
    with pytest.raises(BadInputError, match=r"^bends of branch 'right' is .*as wide|tube is wide"):
        tip_answer(state_of(tree()), ask)
    for bad in ({"branch": "up", "by": [1, 1]}, {"branch": "left", "by": [1]}, {"branch": "left"}):
        with pytest.raises(BadInputError):
            tip_answer(state_of(tree()), bad)
    with pytest.raises(BadInputError, match="bend"):
        tip_answer(state_of(tree()), {"branch": "left", "bend": 0, "by": [1, 1]})


def edited(design, do, branch=None, **more):
    found = edit_answer(state_of(design), {"do": do, "branch": branch, **more})
    return design_of(found["design"], "test"), found["branch"]


@pytest.mark.parametrize("name", ["grid_explorer_levels", "three_level_tree"])
def test_a_freed_design_grows_as_before(name):
    design = Design.read(name)
    free, chosen = edited(design, "free", "0.1")
    assert free == design.by_branches
    assert chosen == free.names[design.tree.ids.index("0.1")]
    assert np.allclose(free.tree.offset_rad, design.tree.offset_rad)


def test_a_child_is_added_and_widths_follow_where_it_makes_a_level_more():
    design, chosen = edited(tree(taper=(0.9, 0.9, 0.9)), "child", "end")
    assert chosen == "end-0"
    child = design.branches[-1]
    assert (child.of, child.angle_deg, child.length_mm) == ("end", 0.0, 28.0)
    assert design.build.widths_mm == (*tree().build.widths_mm, 3.02)
    assert len(design.build.fillet_mm) == 3
    assert design.build.taper[-1] == 1.0
    again, _ = edited(design, "child", "end")
    assert again.branches[-1].angle_deg in (30.0, -30.0)
    back, chosen = edited(again, "remove", "end")
    assert chosen == "right"
    assert [one.name for one in back.branches] == ["left", "right", "mid"]
    assert len(back.build.widths_mm) == len(back.build.taper) == 2


def test_the_mirror_image_takes_the_place_of_what_stands_there():
    once, chosen = edited(tree(), "mirror", "right")
    assert chosen == "right-m0"
    before, after = places(tree()), places(once)
    axis = before["trunk"][1] - before["trunk"][0]
    axis = complex(*axis) / abs(complex(*axis))

    def mirrored(points):
        base = complex(*before["trunk"][1])
        found = [base + axis**2 * (complex(*point) - base).conjugate() for point in points]
        return [(place.real, place.imag) for place in found]

    for name in ("right", "end"):
        assert after[f"{name}-m0"] == pytest.approx(np.array(mirrored(before[name])), abs=1e-6)
        assert np.array_equal(after[name], before[name])
    twice, _ = edited(once, "mirror", "right")
    assert {one.name for one in twice.branches} == {one.name for one in once.branches}
    assert places(twice)["right-m0"] == pytest.approx(after["right-m0"])


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_bend_comes_where_the_branch_was_clicked_and_changes_nothing_yet(share):
    left = places(tree())["left"]
    to = left[0] + share * (left[-1] - left[0])
    design, chosen = edited(tree(), "bend", "left", to=to.tolist())
    assert chosen == "left"
    assert design.branches[0].bends == ((pytest.approx(80.0 * share, abs=0.06), 0.0),)
    assert np.array_equal(places(design)["left"], left)
    middle, _ = edited(tree(), "bend", "right")
    assert middle.branches[1].bends == ((30.0, 20.0), (50.0, 0.0), (70.0, -25.0))


@pytest.mark.parametrize(
    ("do", "branch", "says"),
    [
        ("remove", "trunk", "carries the robot"),
        ("mirror", "mid", "'mid' goes straight on"),
        ("mirror", "trunk", "goes straight on"),
        ("remove", "up", "branch is 'up'"),
        ("paint", "left", "free, child"),
    ],
)
def test_what_cannot_be_edited_is_one_line(do, branch, says):
    with pytest.raises(BadInputError, match=says):
        edited(tree(), do, branch)
    if do != "paint":
        with pytest.raises(BadInputError, match="free it first"):
            edited(Design.read("three_level_tree"), do, branch)


def test_a_bend_too_close_to_another_is_refused_with_the_branch_by_name():
    right = places(tree())["right"]
    to = right[1] + (right[2] - right[1]) / 40.0
    with pytest.raises(BadInputError, match=r"bends of branch 'right' is \[30.0, 31.0\]; allowed"):
        edited(tree(), "bend", "right", to=to.tolist())


def test_a_value_typed_wrong_names_the_branch():
    content = design_content(tree())
    content["branch"][1]["length"] = 50.0
    with pytest.raises(BadInputError) as caught:
        StudioState.of({"design": content})
    assert str(caught.value) == (
        "the page: bends of branch 'right' is 70.0; allowed: bends on the branch, "
        "which is 50 mm long"
    )


def test_the_live_answer_tells_of_the_chosen_branch():
    design = tree(pouch=Pouch(shape="round", radius_mm=6.0))
    found = live_answer(state_of(design), {"branch": "right"})
    assert found["names"] == dict(zip(design.tree.ids, design.names, strict=True))
    branch = found["branch"]
    row = design.names.index("right")
    assert branch["values"] == pytest.approx(
        {
            "angle_deg": -40.0,
            "length": 100.0,
            "width_mm": design.tree.width_mm[row],
            "taper": 1.0,
            "fillet_mm": design.tree.fillet_mm[row],
        }
    )
    first, second = places(design)["right"][1:3]
    assert branch["text"] == "grown in full, 100.0 of 100.0 mm (simulated)"
    for bend, (x, y) in ((1, first), (0, second)):
        handle = f'translate({x:.3f} {-y:.3f})"><g class="sized"><rect class="handle bend" '
        assert f'{handle}data-bend="{bend}"' in branch["svg"].replace("-0.000", "0.000")
    assert live_answer(state_of(design), {"branch": "up"})["branch"] is None
    ofid = live_answer(state_of(Design.read("three_level_tree")), {"branch": "0.1"})
    assert (ofid["names"], ofid["branch"]["level"], ofid["branch"]["svg"]) == ({}, 2, "")
