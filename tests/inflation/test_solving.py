"""The joints of a pattern, solved side by side."""

import itertools
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

import vinefab as vf
from vinefab.core.progress import heard_by
from vinefab.inflation import compensation, solving
from vinefab.inflation.compensation import UnknownJointError, cache_folder
from vinefab.inflation.pattern import pattern_of
from vinefab.inflation.solving import JointTask, solved_joints
from vinefab.model.files.run_context import ChosenRecipe
from vinefab.outline.joint import JointPlan, PlannedSide


def task(angle_deg: float, *, compensated: bool = True) -> JointTask:
    parent = PlannedSide(half_mm=12.0, length_mm=200.0, lean_rad=0.0)
    child = PlannedSide(half_mm=9.0, length_mm=150.0, lean_rad=0.0, fillet_mm=4.5)
    plan = JointPlan(parent=parent, children=(child,)).turned([angle_deg])
    return JointTask(plan=plan, away_mm=(150.0,), strain=0.05, gain=1.0, compensated=compensated)


TASKS = [task(angle) for angle in (20.0, 31.0, 44.0, 57.0)]


@pytest.fixture
def caches(monkeypatch, tmp_path):
    """Return a function that begins with an empty cache."""
    number = itertools.count()

    def begin():
        forget()
        monkeypatch.setenv("VINEFAB_CACHE_DIR", str(tmp_path / str(next(number))))

    yield begin
    forget()


def forget():
    compensation.flat_joint.cache_clear()
    compensation.deployed_joint.cache_clear()
    solving._joint.cache_clear()


@pytest.mark.thorough
@pytest.mark.parametrize("compensated", [True, False])
def test_side_by_side_they_are_the_same_to_the_last_bit(caches, monkeypatch, compensated):
    tasks = [task(angle, compensated=compensated) for angle in (20.0, 31.0, 44.0, 57.0)]
    caches()
    monkeypatch.setattr(solving, "processors", lambda: 1)
    alone = solved_joints(tasks)
    caches()
    monkeypatch.setattr(solving, "processors", lambda: 3)
    assert solved_joints(tasks) == alone
    assert all(one.error is None for one in alone)


def test_helpers_leave_joints_in_the_cache_and_their_caller_simulates_the_fewer(
    caches, monkeypatch
):
    own, simulate = [], compensation.simulated_flat_joint
    monkeypatch.setattr(
        compensation, "simulated_flat_joint", lambda one: own.append(one) or simulate(one)
    )
    monkeypatch.setattr(solving, "processors", lambda: 3)
    caches()
    solved_joints(TASKS)
    kept = list(cache_folder().glob("flat-*.json"))
    assert 0 < len(own) < len(kept)


def test_what_is_known_is_not_simulated_again(caches, monkeypatch):
    caches()
    monkeypatch.setattr(solving, "processors", lambda: 1)
    first = solved_joints(TASKS[:1])
    forget()
    monkeypatch.setattr(compensation, "inflated_joint", None)
    assert solved_joints(TASKS[:1]) == first
    unknown = solved_joints([replace(TASKS[0], strain=0.4)], known_only=True)[0]
    assert unknown.found is None
    assert isinstance(unknown.error, UnknownJointError)


def test_progress_counts_joints_up_to_all(caches, monkeypatch):
    caches()
    monkeypatch.setattr(solving, "processors", lambda: 2)
    heard = []
    with heard_by(heard.append):
        solved_joints(TASKS)
    counts = [one.done for one in heard if one.phase == "joints"]
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert {one.total for one in heard if one.phase == "joints"} == {len(TASKS)}


def test_a_joint_that_cannot_be_drawn_fails_alone(caches, monkeypatch):
    caches()
    monkeypatch.setattr(solving, "processors", lambda: 2)
    twins = TASKS[0].plan
    twins = JointPlan(parent=twins.parent, children=twins.children * 2).turned([10.0, 10.0])
    bad = JointTask(plan=twins, away_mm=(150.0,) * 2, strain=0.05, gain=1.0, compensated=True)
    found = solved_joints([TASKS[0], bad, TASKS[1], TASKS[2]])
    assert [one.error is None for one in found] == [True, False, True, True]
    assert "angles_deg" in str(found[1].error)


def test_a_folder_that_cannot_be_written_leaves_all_to_one_process(caches, monkeypatch, tmp_path):
    caches()
    (tmp_path / "file").touch()
    monkeypatch.setenv("VINEFAB_CACHE_DIR", str(tmp_path / "file"))
    monkeypatch.setattr(solving, "processors", lambda: 4)
    asked = []
    helped = solving.helped
    monkeypatch.setattr(solving, "helped", lambda *given: asked.append(given[-1]) or helped(*given))
    found = solved_joints(TASKS[:3])
    assert asked == [0]
    assert all(one.error is None for one in found)


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT to one process")
def test_ctrl_c_ends_a_pattern_and_its_helpers(tmp_path):
    code = (
        "from vinefab.inflation import solving; from tests.inflation.test_solving import task; "
        "solving.processors = lambda: 2; print('begins', flush=True); "
        "solving.solved_joints([task(20.0 + one) for one in range(60)])"
    )
    root = str(Path(__file__).parents[2])
    environment = os.environ | {"VINEFAB_CACHE_DIR": str(tmp_path), "PYTHONPATH": root}
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment, start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "begins\n"
        while not list(tmp_path.glob("joints/*/*.json")):
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(2)
        error = process.communicate(timeout=30)[1]
    assert "KeyboardInterrupt" in error
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


def test_branches_with_joints_of_their_own_have_a_pattern(caches):
    caches()
    branches = [
        vf.Branch(name="left", angle_deg=38.0, length_mm=120.0),
        vf.Branch(name="right", angle_deg=-51.0, length_mm=140.0),
        vf.Branch(name="tip", of="left", angle_deg=20.0, length_mm=90.0),
        vf.Branch(name="end", of="right", angle_deg=-15.0, length_mm=80.0, bends=((40.0, 25.0),)),
    ]
    design = vf.Design.of_branches(branches, trunk_length_mm=150.0)
    pattern = pattern_of(design, ChosenRecipe.of(design).profile)
    assert len(pattern.joints) == 4
    for joint in pattern.joints:
        assert joint.problem == ""
        assert joint.found.deployed_deg == pytest.approx(joint.wanted_deg, abs=1.5)
