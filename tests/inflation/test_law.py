"""The law of flat fans against the table that it is made of, and against simulated patterns."""

import math

import numpy as np
import pytest

from vinefab.inflation.pattern import FANS, LEAST_LENGTH, fan_law, pattern_of, quick_pattern
from vinefab.inflation.table import flat_fan
from vinefab.model.design import Build, Design, Level
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile

PROFILE = read_profile(DEFAULT_RECIPE)


def tree(*levels: tuple[int, float, float]) -> Design:
    """Return a compensated design with levels of so many children, fan (deg) and length (mm)."""
    build = Build.standard(1 + len(levels), 24.0).changed(compensation="inflation")
    below = [
        Level.of(branches=branches, length_mm=length_mm, angle_deg=angle_deg, growth_percent=120.0)
        for branches, angle_deg, length_mm in levels
    ]
    return Design(name="t", trunk_length_mm=120.0, levels=tuple(below), build=build)


@pytest.mark.parametrize("children", [1, 2, 3, 4, 5])
def test_its_rows_are_those_of_the_table(children):
    law = fan_law(children, 0.6, 0.15, 0.05, 1.0)
    known = flat_fan(children, np.radians(np.arange(FANS)), 0.6, 0.15, 0.05)
    np.testing.assert_allclose(law.angles_rad, known.angles_rad[:, :children], atol=1e-12)
    np.testing.assert_allclose(law.pull_backs, known.pull_backs[:, :children])
    assert ((law.passages > 0.5) & (law.passages <= 1.0)).all()
    # Fans below the simulated ones are named, and never cut narrower than they deploy.
    assert (law.least_rad > 0.0) == (children > 1)
    assert (np.diff(law.angles_rad, axis=1) > 0.0).all()


def test_more_than_five_children_turn_as_five_that_are_as_far_apart():
    five, seven = (fan_law(n, 0.6, 0.15, 0.05, 1.0) for n in (5, 7))
    outer = five.angles_rad[120, -1] - math.radians(60.0)
    assert seven.angles_rad[180, -1] - math.radians(90.0) == pytest.approx(outer)
    np.testing.assert_allclose(seven.angles_rad, -seven.angles_rad[:, ::-1], atol=1e-12)


def test_a_gain_turns_so_many_times_as_far():
    """What is cut, and turned by the gain's part of the simulated turn, deploys as wanted."""
    law, measured = (fan_law(2, 0.6, 0.15, 0.05, gain) for gain in (1.0, 0.5))
    flat = measured.angles_rad[60, -1]
    simulated = np.interp(flat, law.angles_rad[:, -1], np.radians(np.arange(FANS)) / 2.0)
    assert flat + 0.5 * (simulated - flat) == pytest.approx(math.radians(30.0), abs=1e-3)


@pytest.mark.parametrize(
    "design",
    [
        pytest.param(tree((3, 120.0, 120.0), (2, 60.0, 80.0)), marks=pytest.mark.thorough),
        pytest.param(tree((2, 50.0, 90.0), (4, 150.0, 60.0)), marks=pytest.mark.thorough),
        tree((1, 0.0, 100.0), (2, 100.0, 60.0)),
    ],
    ids=["3-2", "2-4", "1-2"],
)
def test_it_is_near_the_simulated_pattern(design):
    exact, quick = pattern_of(design, PROFILE).flat, quick_pattern(design, PROFILE.material)
    one, two = exact.tree, quick.flat.tree
    assert np.degrees(np.abs(one.offset_rad - two.offset_rad)).max() < 1.5
    np.testing.assert_allclose(one.length_mm, two.length_mm, atol=1.5)
    assert exact.trunk_length_mm == quick.flat.trunk_length_mm
    assert (quick.flat.build, quick.beyond) == (exact.build, 0.0)


def test_designs_without_compensation_are_as_they_are_with_the_passages_of_their_joints():
    design = tree((3, 120.0, 120.0), (2, 80.0, 90.0))
    design = design.changed(build=design.build.changed(compensation="none"))
    quick = quick_pattern(design, PROFILE.material)
    assert quick.flat is design
    exact = [joint.found.passage for joint in pattern_of(design, PROFILE).joints]
    assert quick.passages == pytest.approx(exact, abs=0.05)
    assert max(quick.passages) < 1.0


def test_fans_narrower_than_any_simulated_are_told_and_short_children_keep_a_length():
    narrow = quick_pattern(tree((3, 1.0, 120.0)), PROFILE.material)
    wider = quick_pattern(tree((3, 2.0, 120.0)), PROFILE.material)
    assert narrow.beyond > wider.beyond > 0.0
    short = quick_pattern(tree((4, 300.0, 0.2)), PROFILE.material).flat.tree
    assert short.length_mm[1:].min() > 0.5 * LEAST_LENGTH * 0.2
