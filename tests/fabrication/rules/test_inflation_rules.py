"""Rules about robots under pressure, on simulated joints; limits: `test_rules.py`."""

import math
from dataclasses import replace

import pytest

from vinefab.fabrication.checking import check_design, subject_of
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.pressure_rules import fillet_gain
from vinefab.fabrication.rules.rule import Subject
from vinefab.inflation.compensation import deployed_joint
from vinefab.inflation.joint import JointShape
from vinefab.model.design import Waiver
from vinefab.model.finding import Severity

PAIR = (2, 200.0, 50.0)
OF_INFLATION = {"VF-I01", "VF-I02", "VF-I03", "VF-I04"}


@pytest.fixture(scope="module")
def simulated(make, profile):
    """A pair 50 degrees apart, as the compensation cuts it."""
    return subject_of(make(PAIR, compensation="inflation"), profile)


@pytest.fixture(scope="module")
def collapsed(make, profile):
    """The pair cut as designed, with what it deploys as, which is not what was asked for."""
    subject = subject_of(make(PAIR, compensation="none"), profile)
    asked = make(PAIR, compensation="inflation")
    return replace(subject, pattern=replace(subject.pattern, design=asked))


def checked(subject):
    return run_checks(subject, only=OF_INFLATION)


def found(subject, rule):
    return tuple(one for one in checked(subject).findings if one.rule == rule)


def with_joint(subject, problem="", **figures):
    """A subject whose first joint has other figures; None for the joint of one that has none."""
    (joint, *others), pattern = subject.pattern.joints, subject.pattern
    known = replace(joint.found, **figures) if figures else None
    first = replace(joint, found=known, problem=problem)
    return replace(subject, pattern=replace(pattern, joints=(first, *others)))


def test_a_compensated_pair_deploys_as_designed_and_the_flat_one_does_not(simulated, collapsed):
    assert found(simulated, "VF-I01") == ()
    (finding,) = found(collapsed, "VF-I01")
    assert (finding.severity, finding.branches) == (Severity.ERROR, ("0.0",))
    assert (finding.x_mm, finding.y_mm) == (300.0, 0.0)
    # 25 degrees close by some: three_level_tree's second joint has the same
    assert 3.0 < finding.measured < 10.0
    assert "designed at -25.0, 25.0 degrees" in finding.message
    assert "simulated" in finding.message


def test_angles_are_compared_around_the_circle_and_without_a_recipe_not_at_all(simulated, make):
    wanted = simulated.pattern.joints[0].wanted_deg
    around = (wanted[0], wanted[1] - 360.0)
    assert found(with_joint(simulated, deployed_deg=around), "VF-I01") == ()
    skipped = checked(Subject.of(make(PAIR, compensation="inflation"))).skipped
    assert "recipe" in {skip.rule: skip.reason for skip in skipped}["VF-I01"]


def test_a_joint_that_no_simulation_solves_is_an_error_without_numbers(simulated):
    lost = with_joint(simulated, "level 2: no equilibrium")
    report = checked(lost)
    (finding,) = report.findings
    assert (finding.rule, finding.severity) == ("VF-I01", Severity.ERROR)
    assert (finding.measured, finding.limit) == (None, None)
    assert "level 2: no equilibrium" in finding.message
    assert "fewer" in finding.message


def test_children_turned_on_purpose_deploy_as_designed(make, profile):
    # Wide children of a narrow fan stand aside: turned by 0.8 degrees, their tips come near.
    turned = subject_of(make((2, 150.0, 60.0), (2, 90.0, 26.0), compensation="inflation"), profile)
    joint = turned.pattern.joints[1]
    assert 0.6 < joint.wanted_deg[1] - joint.aimed_deg[1] <= 0.801
    assert joint.found.deployed_deg == pytest.approx(joint.aimed_deg, abs=0.6)
    assert found(turned, "VF-I01") == ()


def test_a_robot_cut_as_designed_is_told_so_and_its_joints_are_looked_at(make, profile):
    design = make(PAIR, compensation="none")
    report = checked(subject_of(design, profile))
    (finding,) = found(subject_of(design, profile), "VF-I01")
    assert (finding.severity, finding.blocks) == (Severity.INFO, False)
    assert report.skipped == ()
    # The same joint as that of a pair that is compensated, but for its angles.
    assert {one.rule for one in report.findings} == {"VF-I01", "VF-I03"}
    waived = design.changed(
        waivers=(Waiver(fingerprint=finding.fingerprint, reason="coated fabric"),)
    )
    (again,) = found(subject_of(waived, profile), "VF-I01")
    assert again.waived


@pytest.mark.parametrize("compensation", ["none", "inflation"])
def test_siblings_that_collapse_into_one_body_do_not_pass(compensation, make, profile):
    # 22 degrees pass VF-C02 on the sheet. Cut so, they deploy at 4; compensated at 22.
    narrow = make((2, 150.0, 22.0), compensation=compensation)
    collapses = compensation == "none"
    siblings = found(subject_of(narrow, profile), "VF-I04")
    assert [one.severity for one in siblings] == ([Severity.ERROR] if collapses else [])
    errors = {one.rule for one in check_design(narrow, profile).blocking}
    assert errors == ({"VF-I04"} if collapses else set())
    wide = make((2, 150.0, 60.0), compensation=compensation)
    assert found(subject_of(wide, profile), "VF-I04") == ()


def test_the_load_of_a_crotch_is_that_of_its_trunk_times_the_simulated_ratio(simulated):
    ratio = simulated.pattern.joints[0].found.crotch_load
    (finding,) = found(simulated, "VF-I03")
    assert finding.severity is Severity.WARNING
    assert finding.measured == pytest.approx(ratio * 20.0 * 40.0 / 1000.0 / math.pi)
    assert finding.limit == pytest.approx(70.0 * 20.0 / 1000.0 / math.pi)
    fillet, pressure, fewer = (
        finding.message.index(words) for words in ("a fillet of 13 mm", "kPa, then", "fewer")
    )
    assert fillet < pressure < fewer
    safe_kpa = 20.0 * finding.limit / finding.measured
    assert f"at most {safe_kpa:.1f} kPa" in finding.message


def test_no_larger_fillet_is_named_where_none_helps(simulated):
    flat = simulated.pattern.joints[0].found.flat
    wide = replace(flat, fillets=(0.15, 0.6, 0.15))
    (finding,) = found(with_joint(simulated, flat=wide, crotch_load=4.0), "VF-I03")
    assert "a fillet" not in finding.message
    assert ": at most" in finding.message


def test_a_larger_fillet_takes_off_about_what_the_message_says():
    loads = [
        deployed_joint(
            JointShape.fan(3, 160.0, width=0.6, fillet=one, hoop_strain=0.01)
        ).crotch_load
        for one in (0.125, 1.0 / 3.0)
    ]
    assert loads[1] / loads[0] == pytest.approx(fillet_gain(0.125, 1.0 / 3.0), abs=0.1)


def test_branches_that_cross_when_inflated_are_one_finding(simulated, make):
    """Two of the grandchildren of each side cross: the deepest pair stands for all."""
    crossing = make((2, 100.0, 60.0), (3, 150.0, 200.0), widths_mm=(40.0, 24.0, 14.0))
    pattern = replace(simulated.pattern, design=crossing, flat=crossing, deployed=crossing)
    subject = replace(Subject.of(crossing, simulated.profile), pattern=pattern)
    report = checked(replace(subject, pattern=replace(pattern, joints=())))
    (finding,) = (one for one in report.findings if one.rule == "VF-I04")
    assert "more pairs" in finding.message
    assert finding.measured < -8.0


def test_siblings_that_close_lie_on_each_other_all_the_way(simulated):
    assert found(simulated, "VF-I04") == ()
    (finding,) = found(with_joint(simulated, deployed_deg=(0.0, 0.0)), "VF-I04")
    length_mm = float(simulated.pattern.deployed.tree.length_mm[1])
    assert finding.measured == pytest.approx(length_mm)
    assert finding.limit == pytest.approx(length_mm)
    assert "siblings of level 2" in finding.message
