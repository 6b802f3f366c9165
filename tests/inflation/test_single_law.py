"""The law of single joints against simulations that it was not fitted to."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import vinefab as vf
from vinefab.inflation import compensation, law
from vinefab.inflation.compensation import UnknownJointError, known_joint
from vinefab.inflation.joint import JointShape, inflated_joint
from vinefab.inflation.law import Joints, flat_by_law, gap_fillets, law_of, network
from vinefab.inflation.pattern import pattern_of, quick_pattern
from vinefab.model.files.run_context import ChosenRecipe


def drawn(count: int, children: int, *, seed: int = 1) -> list[JointShape]:
    """Return deployed joints within the law's range, drawn at random."""
    random, found = np.random.default_rng([seed, children]), []
    for _ in range(count):
        gap, outer = 16.0, random.uniform(60.0, 105.0)
        room = 2.0 * outer - gap * (children - 1)
        angles = np.sort(random.uniform(0.0, room, children)) + gap * np.arange(children) - outer
        widths = random.uniform(0.4, 1.0, children)
        own = widths / 4.0
        fillets = [own[0], *np.minimum(own[:-1], own[1:]), own[-1]]
        found.append(
            JointShape(
                angles_deg=tuple(np.round(angles, 2).tolist()),
                widths=tuple(np.round(widths, 3).tolist()),
                fillets=tuple(np.round(fillets, 3).tolist()),
                hoop_strain=round(math.exp(random.uniform(math.log(0.004), math.log(0.28))), 4),
            )
        )
    return found


def bend(angle_deg: float) -> JointShape:
    return JointShape(
        angles_deg=(angle_deg,), widths=(1.0,), fillets=(0.25, 0.25), hoop_strain=0.05, is_bend=True
    )


MIXED = [*itertools.chain.from_iterable(drawn(6, n) for n in (1, 2, 3, 4)), bend(40.0), bend(-70.0)]


def test_the_law_is_of_this_simulation():
    made = "python tests/inflation/make_law.py rows.jsonl --fit makes a new one"
    assert network("flat") is not None, made
    assert network("deployed") is not None, made


def test_a_law_of_another_simulation_is_none(monkeypatch):
    monkeypatch.setattr(law, "simulation_fingerprint", lambda: "another")
    network.cache_clear()
    assert law_of("flat", Joints.of(MIXED)) is None
    network.cache_clear()


@pytest.mark.parametrize(
    ("children", "most_deg"),
    [
        (1, 1.2),
        (2, 3.0),
        pytest.param(3, 4.0, marks=pytest.mark.thorough),
        pytest.param(4, 5.0, marks=pytest.mark.thorough),
    ],
)
def test_flat_joints_by_the_law_deploy_about_as_wanted(children, most_deg):
    """A third of the mean error of designs whose joints are cut as drawn, or less."""
    wanted = drawn(4, children, seed=7)
    told = law_of("flat", Joints.of(wanted))
    off, drawn_off = [], []
    for row, one in enumerate(wanted):
        cut = tuple(told.angles_deg[row, :children].tolist())
        found = inflated_joint(one.with_angles(cut))
        off.append(np.abs(found.angles_deg - one.angles_deg).max())
        backs = np.abs(found.pull_backs - told.pull_backs[row, :children])
        assert backs.max() < 0.08
        assert abs(found.passages.min() - told.passages[row]) < 0.15
        drawn_off.append(np.abs(np.subtract(cut, one.angles_deg)).max())
    assert np.mean(off) < most_deg
    assert np.mean(off) < np.mean(drawn_off) / 2.0


@pytest.mark.thorough
def test_children_of_five_hundred_random_joints_deploy_about_as_wanted():
    off: list[float] = []
    for children in (1, 2, 3, 4):
        wanted = drawn(125, children, seed=11)
        told = law_of("flat", Joints.of(wanted))
        for row, one in enumerate(wanted):
            cut = tuple(told.angles_deg[row, :children].tolist())
            off += np.abs(inflated_joint(one.with_angles(cut)).angles_deg - one.angles_deg).tolist()
    assert len(off) == 1250
    assert np.mean(off) < 1.2
    assert np.percentile(off, 95) < 4.0
    assert np.max(off) < 10.0


@pytest.mark.parametrize("angle_deg", [25.0, 60.0, -90.0])
def test_bends_by_the_law_deploy_as_wanted(angle_deg):
    wanted = bend(angle_deg)
    told = law_of("flat", Joints.of([wanted]))
    found = inflated_joint(wanted.with_angles((float(told.angles_deg[0, 0]),)))
    assert found.angles_deg[0] == pytest.approx(angle_deg, abs=1.5)
    back = law_of("deployed", Joints.of([found.joint]))
    assert back.angles_deg[0, 0] == pytest.approx(found.angles_deg[0], abs=1.5)


def test_a_bend_of_no_degrees_changes_nothing():
    told = law_of("flat", Joints.of([bend(0.0)]))
    for one in (told.angles_deg, told.pull_backs, told.side_offsets):
        assert one[0, 0] == 0.0
    assert told.passages[0] == 1.0


@pytest.mark.parametrize("way", ["flat", "deployed"])
def test_mirrored_joints_are_mirrored(way):
    here = law_of(way, Joints.of(MIXED))
    there = law_of(way, Joints.of([one.mirrored for one in MIXED]))
    for row, one in enumerate(MIXED):
        n = len(one.angles_deg)
        for name, sign in (("angles_deg", -1.0), ("side_offsets", -1.0), ("pull_backs", 1.0)):
            own, other = getattr(here, name)[row, :n], getattr(there, name)[row, :n]
            assert own == pytest.approx(sign * other[::-1], abs=1e-9)
    assert here.passages == pytest.approx(there.passages, abs=1e-9)
    assert (here.is_within == there.is_within).all()


def test_joints_beyond_the_range_are_said_to_be():
    inside = drawn(1, 3)[0]
    angles = inside.angles_deg
    beyond = [
        inside.with_angles((angles[0], angles[0] + 9.0, angles[2])),
        inside.with_angles((-140.0, *angles[1:])),
        replace(inside, widths=(0.3, *inside.widths[1:])),
        replace(inside, fillets=(0.01, *inside.fillets[1:])),
        replace(inside, hoop_strain=0.5),
    ]
    assert law_of("flat", Joints.of([inside])).is_within.all()
    assert not law_of("flat", Joints.of(beyond)).is_within.any()


def test_with_a_gain_children_turn_as_measured():
    joints, gain = Joints.of(drawn(6, 2)), 1.2
    flat = flat_by_law(joints, gain)
    plain = flat_by_law(joints)
    deployed = flat.angles_deg + gain * (joints.angles_deg - flat.angles_deg)
    assert np.abs(flat.angles_deg - plain.angles_deg)[:, :2].max() > 0.2
    # Where the law's turn is t(aim), aims move until flat + gain t = wanted.
    aim = joints
    for _ in range(30):
        told = law_of("flat", aim)
        turned = told.angles_deg + gain * (aim.angles_deg - told.angles_deg)
        aim = replace(aim, angles_deg=aim.angles_deg + joints.angles_deg - turned)
    assert flat.angles_deg[:, :2] == pytest.approx(told.angles_deg[:, :2], abs=0.1)
    assert deployed.shape == joints.angles_deg.shape


def test_fillets_of_gaps_are_the_smaller_ones():
    own = np.array([[0.1, 0.3, 0.2, 0.0], [0.4, 0.0, 0.0, 0.0]])
    gaps = gap_fillets(own, np.array([3, 1]))
    assert gaps[0, :4].tolist() == [0.1, 0.1, 0.2, 0.2]
    assert gaps[1, :2].tolist() == [0.4, 0.4]


def test_known_joints_name_the_law_as_their_source():
    for one in (drawn(1, 3)[0], bend(40.0)):
        for way in ("flat", "deployed"):
            found = known_joint(way, one)
            assert found.source == "law"
            assert 0.0 < found.within_deg < 10.0
            assert found.crotch_load > 1.0
            assert found.sensitivity > 0.3
    even = JointShape.fan(2, 80.0, width=0.6, fillet=0.15, hoop_strain=0.05)
    assert known_joint("flat", even).source == "table"
    five = JointShape(
        angles_deg=(-80.0, -30.0, 5.0, 40.0, 80.0), widths=(0.6,) * 5, fillets=(0.15,) * 6
    )
    with pytest.raises(UnknownJointError):
        known_joint("flat", five)


def test_simulations_start_from_the_law(monkeypatch):
    counted = []

    def counting(simulate):
        return lambda *given: counted.append(given) or simulate(*given)

    for name in ("inflated_joint", "turned_joint"):
        monkeypatch.setattr(compensation, name, counting(getattr(compensation, name)))
    wanted = drawn(1, 2, seed=3)[0]
    found = compensation.simulated_flat_joint(wanted)
    assert found.source == "simulated"
    assert found.deployed_deg == pytest.approx(wanted.angles_deg, abs=compensation.MESH_DEG)
    begun = counted[0][0].angles_deg
    assert begun == known_joint("flat", wanted).flat.angles_deg
    assert len(counted) <= 4


def branchy() -> vf.Design:
    branches = [
        vf.Branch(name="left", angle_deg=52.0, length_mm=160.0),
        vf.Branch(name="right", angle_deg=-38.0, length_mm=180.0, bends=((70.0, 35.0),)),
        vf.Branch(name="tip", of="left", angle_deg=30.0, length_mm=120.0),
    ]
    return vf.Design.of_branches(branches, trunk_length_mm=200.0)


def test_a_tree_of_branches_is_known_without_a_simulation(monkeypatch):
    monkeypatch.setattr(compensation, "inflated_joint", None)
    design = branchy()
    pattern = pattern_of(design, ChosenRecipe.of(design).profile, known_only=True)
    assert all(joint.is_known for joint in pattern.joints)
    assert {joint.found.source for joint in pattern.joints} == {"law"}


def test_the_quick_pattern_of_a_tree_is_near_the_simulated_one():
    design = branchy()
    profile = ChosenRecipe.of(design).profile
    exact, quick = pattern_of(design, profile).flat.tree, quick_pattern(design, profile.material)
    flat = quick.flat.tree
    assert np.degrees(np.abs(flat.offset_rad - exact.offset_rad)).max() < 2.5
    assert np.degrees(np.abs(flat.offset_rad - design.tree.offset_rad)).max() > 2.0
    assert np.degrees(np.abs(flat.bend_rad - exact.bend_rad)).max() < 1.5
    assert np.abs(flat.length_mm - exact.length_mm).max() < 1.5
    assert all(0.5 < one <= 1.0 for one in quick.passages)


def test_levels_have_the_quick_pattern_of_the_table(monkeypatch):
    design = vf.Design.read("grid_explorer_levels")
    material = ChosenRecipe.of(design).profile.material
    here = quick_pattern(design, material)
    monkeypatch.setattr(law, "law_of", None)
    assert quick_pattern(design, material) == here
