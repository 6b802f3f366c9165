"""Deployments that are grown again when asked for."""

import tracemalloc
from dataclasses import replace

import numpy as np

from vinefab.growth.batch import GROWTHS_PER_CALL
from vinefab.model.design import Design
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    unseen_maps,
)


def test_a_family_holds_none_of_its_deployments():
    """Twice as many deployments take little more memory; a block of them is held."""
    tree, few, many = Design.read("three_level_tree"), GROWTHS_PER_CALL, 2 * GROWTHS_PER_CALL
    small = {"columns": 4, "rows": 4, "size_mm": 350.0}
    (world,) = unseen_maps("grid", 1, 0, small).worlds
    plan = PredictionPlan(poses=many, seed=3)
    whole = PreparedFamily.of(MapFamily(label="one map", worlds=(world,)), plan)
    deploy_family(tree, replace(whole, poses=(whole.poses[0][:1],)), plan)  # loads what it needs
    held = []
    for count in (few, many):
        prepared = replace(whole, poses=(whole.poses[0][:count],))
        tracemalloc.start()
        result = deploy_family(tree, prepared, plan)
        held.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    assert len(result.deployments) == many
    # What is measured of a deployment takes 0.3 kB, the deployment itself 1.3 kB.
    assert held[1] - held[0] < (many - few) * 800


def test_a_deployment_is_the_same_whenever_it_is_asked_for(result):
    deployments = result.deployments
    every = list(deployments)
    assert len(every) == len(deployments) == 10
    for index in (0, 4, -1):
        np.testing.assert_array_equal(deployments[index].points_mm, every[index].points_mm)
        assert deployments[index].pose == every[index].pose
    assert [d.pose for d in deployments[2:4]] == [d.pose for d in every[2:4]]
