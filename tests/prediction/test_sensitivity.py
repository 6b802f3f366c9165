from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.rng import child
from vinefab.model.map import Pose, Start
from vinefab.model.tree import branch_tree
from vinefab.prediction.family_deployments import MapFamily, PredictionPlan, PreparedFamily
from vinefab.prediction.measures import GROWN, STUCK
from vinefab.prediction.sensitivity import (
    ANGLE_TOLERANCE_DEG,
    QUICK,
    VariantEvaluator,
    made_tree,
    scaled_tree,
    sensitivity,
)


def test_sensitivity_without_a_wall_in_reach_is_none(straight):
    design, family = straight
    effects = sensitivity(
        VariantEvaluator(
            design, PreparedFamily.of(family, PredictionPlan(poses=1)), PredictionPlan(poses=1)
        )
    )
    for effect in effects:
        changes = [effect.changes[measure.key].mean for measure in QUICK]
        if effect.knob == "lengths":
            scale = 25.0 / (2.0 * 20.0 / np.pi)
            assert changes[-1] == pytest.approx(scale * 0.771 * 0.1 * effect.step / 100.0)
        else:
            assert changes == pytest.approx([0.0] * len(QUICK), abs=0.05)


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


def test_one_map_is_varied_pose_by_pose_and_few_poses_show_nothing(explorer, result):
    prepared = PreparedFamily(
        label="one", maps=result.prepared.maps[:1], poses=result.prepared.poses[:1]
    )
    for effect in sensitivity(VariantEvaluator(explorer, prepared, PLAN)):
        for change in effect.changes.values():
            assert change.groups == effect.count == 2
            assert change.low <= change.mean <= change.high
            assert not change.is_clear


def test_made_trees_stay_within_the_tolerances(explorer):
    tree = branch_tree(explorer)
    made = made_tree(tree, child(1, 2))
    off = made.length_mm / tree.length_mm - 1.0
    turned_deg = np.degrees(made.offset_rad - tree.offset_rad)
    assert 0.006 < np.abs(off).max() <= 0.01
    assert 1.0 < np.abs(turned_deg).max() <= ANGLE_TOLERANCE_DEG
    assert turned_deg[0] == 0.0


def test_scaled_designs_keep_their_widths(explorer):
    longer = scaled_tree(explorer, 1.1)
    assert branch_tree(longer).length_mm == pytest.approx(1.1 * branch_tree(explorer).length_mm)
    assert longer.build == explorer.build
