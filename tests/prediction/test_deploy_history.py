import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.deployment import Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Pose
from vinefab.prediction.deploy import FrameRecord, deploy

WORLD = grid_map(5, GridOptions(size_mm=300.0, columns=4, rows=4))


def design_of(lengths, growth, width_mm=8.0):
    levels = tuple(
        Level(branches=count, length_mm=length, fan_rad=1.8, growth=growth)
        for count, length in zip((3, 2), lengths[1:], strict=False)
    )
    build = Build.standard(1 + len(levels), width_mm)
    return Design(name="d", trunk_length_mm=lengths[0], levels=levels, build=build)


@st.composite
def grown(draw):
    length = st.floats(5.0, 200.0)
    design = design_of(draw(st.lists(length, min_size=1, max_size=3)), draw(st.floats(0.3, 2.0)))
    pose = Pose(x_mm=150.0, y_mm=draw(st.floats(6.0, 14.0)), heading_rad=draw(st.floats(0.3, 2.8)))
    options = GrowthOptions.published(
        head_on_half_angle_rad=math.radians(5.0),
        body=draw(st.sampled_from(["centerline", "inflated"])),
        children_of_stuck=draw(st.sampled_from(["stop", "deploy"])),
    ).content
    return deploy(design, WORLD, pose, options)


def by_name(frame):
    deployment = frame.deployment
    return {
        name: (deployment.chain_mm(i), bool(frame.is_growing[i]), int(deployment.stop[i]))
        for i, name in enumerate(deployment.tree.ids)
        if deployment.deployed[i]
    }


def length_of(chain):
    return float(np.hypot(*np.diff(chain, axis=0).T).sum())


@settings(max_examples=60, deadline=None)
@given(result=grown(), shares=st.tuples(st.floats(0.01, 1.0), st.floats(0.01, 1.0)))
def test_an_earlier_shape_is_one_that_the_later_one_went_through(result, shares):
    history = result.history
    early, late = sorted(share * history.full_mm for share in shares)
    if early <= 0.0:
        return
    first, second, last = (by_name(history.at(s)) for s in (early, late, history.full_mm))
    assert first.keys() <= second.keys() <= last.keys()
    for name, (chain, grows, stop) in first.items():
        later, _, _ = second[name]
        assert length_of(chain) <= length_of(later) + 1e-9
        np.testing.assert_array_equal(chain[0], later[0])  # bases lie still
        if grows:
            # Nothing stops before its time: what still grows has used its length to the full.
            assert stop == Stop.FULL_LENGTH
        else:
            np.testing.assert_array_equal(chain, later)
            assert stop == last[name][2]


@settings(max_examples=40, deadline=None)
@given(result=grown(), share=st.floats(0.01, 0.999))
def test_branches_reach_exactly_to_the_front_or_have_stopped(result, share):
    history = result.history
    front_mm = share * history.full_mm
    if front_mm <= 0.0:
        return
    frame = history.at(front_mm)
    tree, begin = frame.deployment.tree, {"": 0.0}
    for branch, name in enumerate(tree.ids):
        base_mm = begin[name.rpartition(".")[0]]
        begin[name] = base_mm + float(frame.deployment.grown_mm[branch])
        if frame.is_growing[branch]:
            assert begin[name] == pytest.approx(front_mm, abs=1e-6)
        else:
            assert begin[name] <= front_mm + 1e-6


@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_the_last_shape_is_the_final_one(body):
    result = deploy(
        design_of([120.0, 80.0, 50.0], 0.6), WORLD, None, GrowthOptions.published(body=body).content
    )
    frames = result.history.even_steps(7)
    assert frames[-1].deployment is result.deployment
    assert frames[-1].front_mm == result.history.full_mm
    np.testing.assert_allclose(np.diff([f.front_mm for f in frames]), frames[0].front_mm)
    assert not frames[-1].is_growing.any()
    assert result.history.at(1e6).front_mm == frames[-1].front_mm
    # Just before the end it looks the same.
    before, after = by_name(result.history.at(frames[-1].front_mm - 1e-9)), by_name(frames[-1])
    assert before.keys() == after.keys()
    for name, (chain, _, _) in before.items():
        np.testing.assert_allclose(chain[-1], after[name][0][-1], atol=1e-6)


def test_levels_follow_each_other_and_siblings_grow_together():
    world = grid_map(0, GridOptions(size_mm=1000.0, columns=1, rows=1))
    pose = Pose(x_mm=10.0, y_mm=30.0, heading_rad=math.pi / 2)
    design = design_of([100.0, 40.0], 0.5)
    history = deploy(design, world, pose, GrowthOptions.published().content).history
    assert history.base_mm.tolist() == [0.0, 100.0, 100.0, 100.0]
    assert history.full_mm == pytest.approx(140.0)
    at = {s: history.at(s).deployment.grown_mm.tolist() for s in (60.0, 100.0, 125.0, 135.0)}
    assert at[60.0] == pytest.approx([60.0])
    assert at[100.0] == pytest.approx([100.0])
    assert at[125.0] == pytest.approx([100.0, 25.0, 25.0, 20.0])
    assert at[135.0] == pytest.approx([100.0, 35.0, 30.0, 20.0])


def test_json_names_what_grows_on():
    history = deploy(
        design_of([120.0, 80.0], 0.5), WORLD, None, GrowthOptions.published().content
    ).history
    content = [FrameRecord.of(frame).content for frame in history.frames((60.0, 1e5))]
    assert [entry["front_mm"] for entry in content] == [60.0, history.full_mm]
    assert [branch["id"] for branch in content[0]["branches"]] == ["0"]
    assert content[0]["branches"][0]["stop"] is None
    assert "planned_mm" not in content[0]["branches"][0]
    assert all(branch["stop"] not in (None, "not_deployed") for branch in content[1]["branches"])


@pytest.mark.parametrize("rule", [{"branch_contact": "stop"}, {"branch_contact": "pass"}])
def test_branches_that_others_stop_end_on_their_way_to_the_final_shape(rule):
    design = design_of([60.0, 120.0, 150.0], 1.0, width_mm=16.0)
    pose = Pose(x_mm=150.0, y_mm=14.0, heading_rad=1.4)
    result = deploy(design, WORLD, pose, {"pressure_stop": False, **rule})
    final = result.deployment
    cut = np.flatnonzero(final.stop == Stop.BRANCH).tolist()
    assert bool(cut) == (rule["branch_contact"] == "stop")
    history = result.history
    for front in np.linspace(0.05, 0.999, 40) * history.full_mm:
        frame = history.at(float(front))
        shapes = by_name(frame)
        base_mm, end_mm = final.base_mm, final.base_mm + final.grown_mm
        for branch, name in enumerate(final.tree.ids):
            assert (name in shapes) == bool(base_mm[branch] < front)
            if name not in shapes:
                continue
            chain, is_growing, stop = shapes[name]
            expected_mm = min(float(front), float(end_mm[branch])) - base_mm[branch]
            assert length_of(chain) == pytest.approx(expected_mm, abs=1e-6)
            if not is_growing:
                assert stop == final.stop[branch]
                assert chain == pytest.approx(final.chain_mm(branch), abs=1e-6)
