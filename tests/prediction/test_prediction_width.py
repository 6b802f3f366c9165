"""How wide a prediction is over contacts and pressure."""

from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.limits import rad
from vinefab.core.rng import child
from vinefab.core.statistics import PAIRED_TAILS, MeanValue, mean_interval
from vinefab.core.view import document
from vinefab.growth.options import CONTACT_ANGLES_DEG, GrowthOptions
from vinefab.model.design import Build, Design
from vinefab.model.map import Pose, Start
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    unseen_maps,
)
from vinefab.prediction.measures import (
    COVERAGE,
    GROWN,
    LOOSE_PRESSURE,
    REACH,
    SEEN,
    STUCK,
)
from vinefab.prediction.prediction_width import (
    ANGLE_TOLERANCE_DEG,
    QUICK_MEASURES,
    ROBOTS,
    Effect,
    PredictionVariant,
    Scatter,
    Tolerance,
    VariantEvaluator,
    contact_range,
    made_tree,
    scaled_tree,
    sensitivity,
    sensitivity_blocks,
    tolerance,
    tolerance_blocks,
    width_blocks,
)
from vinefab.prediction.pressure_window import pressure_range


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
    # Deployments differ from angle to angle: a wider one stops more tips, so that less is grown.
    grown = [value.mean for value in found.values[GROWN.key]]
    assert grown[0] > grown[-1]
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


# --- Sensitivity and tolerances -------------------------------------------------------------------


def test_sensitivity_without_a_wall_in_reach_is_none(straight):
    design, family = straight
    effects = sensitivity(
        VariantEvaluator(
            design, PreparedFamily.of(family, PredictionPlan(poses=1)), PredictionPlan(poses=1)
        )
    )
    for effect in effects:
        changes = [effect.changes[measure.key].mean for measure in QUICK_MEASURES]
        if effect.knob == "lengths":
            scale = 25.0 / (2.0 * 20.0 / np.pi)
            assert changes[-1] == pytest.approx(scale * 0.771 * 0.1 * effect.step / 100.0)
        else:
            assert changes == pytest.approx([0.0] * len(QUICK_MEASURES), abs=0.05)


PLAN = PredictionPlan(poses=2, seed=3)


def test_sensitivity_leaves_out_poses_that_are_not_free(straight):
    design, family = straight
    near = Start(pose=Pose(x_mm=50.0, y_mm=8.0, heading_rad=0.0))
    world = replace(family.worlds[0], starts=(near,))
    prepared = PreparedFamily.of(MapFamily(label="edge", worlds=(world,)), PredictionPlan(poses=1))
    counts = {
        effect.step: effect.count
        for effect in sensitivity(VariantEvaluator(design, prepared, PredictionPlan(poses=1)))
        if effect.knob == "position"
    }
    assert (counts[-20.0], counts[-10.0], counts[-5.0], counts[20.0]) == (0, 0, 1, 1)


def test_more_stops_with_a_wider_head_on_angle(result, explorer):
    effects = sensitivity(VariantEvaluator(explorer, result.prepared, PLAN))
    widest = [effect for effect in effects if effect.knob == "head-on half-angle"][-1]
    assert widest.changes[GROWN.key].mean < 0.0
    assert widest.changes[STUCK.key].mean > 0.0


def test_one_map_is_varied_pose_by_pose(explorer, result):
    prepared = PreparedFamily(
        label="one", maps=result.prepared.maps[:1], poses=result.prepared.poses[:1]
    )
    for effect in sensitivity(VariantEvaluator(explorer, prepared, PLAN)):
        for change in effect.changes.values():
            assert (change.over, effect.count) == ("2 poses", 2)
            assert not change.low > change.mean


def test_made_trees_stay_within_the_tolerances(explorer):
    tree = explorer.tree
    made = made_tree(tree, child(1, 2))
    off = made.length_mm / tree.length_mm - 1.0
    turned_deg = np.degrees(made.offset_rad - tree.offset_rad)
    assert 0.006 < np.abs(off).max() <= 0.01
    assert 1.0 < np.abs(turned_deg).max() <= ANGLE_TOLERANCE_DEG
    assert turned_deg[0] == 0.0


def test_scaled_designs_keep_their_widths(explorer):
    longer = scaled_tree(explorer, 1.1)
    assert longer.tree.length_mm == pytest.approx(1.1 * explorer.tree.length_mm)
    assert longer.build == explorer.build


def test_changes_are_means_over_maps_with_their_interval(straight, monkeypatch):
    design, family = straight
    plan = PredictionPlan(poses=1)
    worlds = family.worlds * 8
    prepared = PreparedFamily.of(MapFamily(label="l", worlds=worlds), plan)
    evaluator = VariantEvaluator(design, prepared, plan)
    differences = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 12.0])
    changed = evaluator.exact + differences[:, None]
    monkeypatch.setattr(evaluator, "grow", lambda *_: changed[None])
    variant = PredictionVariant(
        knob="k", step=1.0, unit="mm", design=design, options=plan.options, poses=prepared.poses
    )
    effect = evaluator.effect(variant)
    change = effect.changes[SEEN.key]
    assert (effect.count, change.over, change.mean) == (8, "8 maps", pytest.approx(5.0))
    assert (change.low, change.high) == mean_interval(differences, tails=PAIRED_TAILS)
    assert change.is_clear


@pytest.mark.parametrize(
    ("low", "high", "clear"), [(0.1, 2.0, True), (-2.0, -0.1, True), (-0.1, 2.0, False)]
)
def test_a_change_is_clear_when_its_interval_leaves_out_0(low, high, clear):
    change = MeanValue(mean=(low + high) / 2, low=low, high=high, over="6 maps")
    assert change.is_clear == clear


def test_scatter_of_fabrication_is_over_robots(straight):
    design, family = straight
    plan = PredictionPlan(poses=1)
    evaluator = VariantEvaluator(design, PreparedFamily.of(family, plan), plan)
    found = tolerance(evaluator, 5)
    tree = design.tree
    lengths_mm = np.array(
        [made_tree(tree, child(5, 1703, robot)).length_mm[0] for robot in range(ROBOTS)]
    )
    # Y + f L of a straight vine, for the 25 mm tube, times its diameter over this one's.
    scale = 25.0 / (2.0 * 20.0 / np.pi)
    pressures_kpa = scale * (1.92 + 0.771e-3 * lengths_mm)
    exact_kpa = scale * (1.92 + 0.771e-3 * 100.0)
    ordered = np.sort(pressures_kpa)
    scatter = found.scatter[-1]
    assert (found.robots, found.launches, scatter.measure) == (40, 1, LOOSE_PRESSURE)
    assert (found.length_percent, found.angle_deg) == (1.0, 2.0)
    assert scatter.exact == pytest.approx(exact_kpa)
    # Of 40 values, 5 % lie 1.95 steps from either end.
    assert scatter.p05 == pytest.approx(ordered[1] + 0.95 * (ordered[2] - ordered[1]))
    assert scatter.p95 == pytest.approx(ordered[-2] - 0.95 * (ordered[-2] - ordered[-3]))
    off = np.sort(np.abs(pressures_kpa - exact_kpa))
    assert scatter.typical == pytest.approx((off[19] + off[20]) / 2.0)


def test_page_and_json_show_known_changes_and_scatter():
    change = MeanValue(mean=1.25, low=0.5, high=2.0, over="6 maps")
    weak = MeanValue(mean=-1.0, low=-3.0, high=1.0, over="6 maps")
    effect = Effect(
        knob="heading", step=-5.0, unit="deg", count=12, changes={SEEN.key: change, REACH.key: weak}
    )
    (section,) = sensitivity_blocks([effect], (SEEN, REACH))
    assert section.tables[0].rows == (
        ("heading", "-5 deg", "1.2 [0.5, 2.0; 6 maps]*", "-1.0 [-3.0, 1.0; 6 maps]", 12),
    )
    assert "the same 12 poses" in section.paragraphs[0]
    (content,) = document([section])["sensitivity"]
    assert (content["knob"], content["step"], content["poses"]) == ("heading", -5.0, 12)
    assert content["changes"][SEEN.key] == {"mean": 1.2, "low": 0.5, "high": 2.0}
    scatter = Scatter(measure=SEEN, exact=50.0, p05=48.0, p95=53.0, typical=1.5)
    made = Tolerance(length_percent=1.0, angle_deg=2.0, robots=40, launches=6, scatter=(scatter,))
    data, section = tolerance_blocks(made)
    title = "free space seen by sensors"
    assert [*map(str, section.tables[0].rows[0])] == [title, "%", "50.0", "48.0", "53.0", "1.5"]
    assert "40 robots" in section.paragraphs[0]
    assert "up to 1 % and its angle by up to 2 degrees" in section.paragraphs[0]
    assert "6 poses" in section.paragraphs[0]
    assert document([data])["tolerance"]["scatter"][SEEN.key] == {
        "exact": 50.0, "p05": 48.0, "p95": 53.0, "typical": 1.5
    }  # fmt: skip
