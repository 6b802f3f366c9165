"""How wide a prediction is over contacts and pressure."""

from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.units import rad
from vinefab.core.view import document
from vinefab.growth.options import CONTACT_ANGLES_DEG, GrowthOptions
from vinefab.model.design import Build, Design
from vinefab.prediction.family_deployments import PreparedFamily, deploy_family, unseen_maps
from vinefab.prediction.measures import COVERAGE, GROWN, REACH, SEEN, STUCK
from vinefab.prediction.prediction_width import (
    contact_range,
    pressure_range,
    width_blocks,
)


@pytest.fixture(scope="module")
def prepared(small_maps, few_poses):
    return PreparedFamily.of(unseen_maps("grid", 5, 0, small_maps), few_poses)


def test_every_half_angle_has_the_measures_of_its_own_deployments(explorer, prepared, few_poses):
    found = contact_range(explorer, prepared, few_poses.options)
    for index in (0, 3):
        angle_rad = rad(CONTACT_ANGLES_DEG[index])
        options = few_poses.options.changed(head_on_half_angle_rad=angle_rad)
        same = deploy_family(explorer, prepared, replace(few_poses, options=options)).outcomes
        for measure, most in ((GROWN, 1e-9), (STUCK, 1e-9), (SEEN, 0.2), (REACH, 0.5)):
            mean = same.spread(measure).mean
            assert found.values[measure.key][index].mean == pytest.approx(mean, abs=most)
    stuck = [value.mean for value in found.values[STUCK.key]]
    # Deployments differ from angle to angle: a wider one stops more tips, but not at each step.
    assert stuck[-1] == max(stuck) > min(stuck)
    assert found.ends(COVERAGE)[0] < found.ends(COVERAGE)[1]


def test_rules_have_the_measures_of_their_own_deployments(explorer, prepared, few_poses):
    found = contact_range(explorer, prepared, few_poses.options)
    contact, emergence = found.rules
    assert (contact.choices, emergence.choices) == (("pass", "stop"), (1.0, 0.95, 0.9))
    for rule in (contact, emergence):
        for index, choice in enumerate(rule.choices):
            options = few_poses.options.changed(**{rule.option: choice})
            plan = replace(few_poses, options=options)
            same = deploy_family(explorer, prepared, plan).outcomes
            for measure, most in ((GROWN, 1e-9), (STUCK, 1e-9), (SEEN, 0.2)):
                mean = same.spread(measure).mean
                assert rule.values[measure.key][index].mean == pytest.approx(mean, abs=most)
        grown = [value.mean for value in rule.values[GROWN.key]]
        assert grown == sorted(grown, reverse=True)
        assert grown[0] > grown[-1]
    data, section = width_blocks(found, None)
    width = document([data, section])["width"]
    assert width["branch_contact"]["choices"] == ["pass", "stop"]
    assert len(width["emergence"]["means"][COVERAGE.key]) == 3
    assert "from bodies that pass through each other" in found.over_rules(COVERAGE)
    assert contact_range(vine(), prepared, few_poses.options).rules == ()


def vine():
    return Design(name="vine", trunk_length_mm=200.0, build=Build.standard(1))


def test_pressure_is_used_up_sooner_off_a_spool_and_by_a_wider_fitted_tube(
    explorer, prepared, few_poses
):
    measured = deploy_family(explorer, prepared, few_poses).outcomes
    found = pressure_range(explorer, prepared, few_poses.options, measured)
    assert found.working_kpa == 20.0
    for rows in (found.reaches[:3], found.reaches[3:]):
        grown = [reach.grown_percent for reach in rows]
        needed = [reach.needed_kpa for reach in rows]
        assert grown == sorted(grown, reverse=True)
        assert needed == sorted(needed)
    loose, tight = found.reaches[1], found.reaches[4]
    assert tight.stopped_percent > loose.stopped_percent
    assert tight.grown_percent < loose.grown_percent
    # With what 95 % need, 95 % of the deployments grow to every tip.
    enough = explorer.changed(build=explorer.build.changed(pressure_kpa=tight.needed_kpa))
    again = pressure_range(enough, prepared, few_poses.options, measured).reaches[4]
    assert again.full_percent == pytest.approx(95.0, abs=10.0)
    none = explorer.changed(build=explorer.build.changed(pressure_kpa=0.0))
    assert pressure_range(none, prepared, few_poses.options, measured) is None


def test_page_and_json_say_the_same(explorer, prepared, few_poses):
    measured = deploy_family(explorer, prepared, few_poses).outcomes
    contacts = contact_range(explorer, prepared, few_poses.options)
    pressure = pressure_range(explorer, prepared, few_poses.options, measured)
    data, section = width_blocks(contacts, pressure)
    content = document([data, section])["width"]
    assert content["contacts"]["means"][COVERAGE.key] == [
        float(str(cell).split(" [")[0]) for cell in section.tables[0].rows[0][1:]
    ]
    reaches = content["pressure"]["reaches"]
    assert [f"{reach['grown_percent']:.1f} %" for reach in reaches] == [
        str(row[2]) for row in section.tables[-1].rows
    ]
    data, section = width_blocks(contacts, None)
    assert len(section.tables) == 3
    assert document([data])["width"]["pressure"] is None


def test_pressures_are_those_of_growth_to_every_tip(explorer, prepared, few_poses):
    """Where pressure stops tips, what they would need is still known."""
    thin = explorer.changed(build=explorer.build.changed(pressure_kpa=8.0))
    pressed = replace(few_poses, options=few_poses.options.changed(pressure_stop=True))
    free = replace(few_poses, options=GrowthOptions(body="inflated", pressure_stop=False))
    stopped = deploy_family(thin, prepared, pressed).outcomes
    whole = deploy_family(thin, prepared, free).outcomes
    key = "growth_pressure_loose_kpa"
    np.testing.assert_array_equal(stopped.values[key], whole.values[key])
    assert stopped.spread(GROWN).mean < whole.spread(GROWN).mean
