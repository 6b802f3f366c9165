"""Deployments that are grown again when asked for."""

import tracemalloc

import numpy as np

from vinefab.prediction.family_deployments import (
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    unseen_maps,
)


def test_a_family_holds_none_of_its_deployments(explorer):
    """Three times as many deployments take little more memory; a block of them is held."""
    small = {"columns": 4, "rows": 4, "size_mm": 350.0}
    held = []
    for poses in (100, 300):
        plan = PredictionPlan(poses=poses, seed=3)
        prepared = PreparedFamily.of(unseen_maps("grid", 2, 0, small), plan)
        deploy_family(explorer, prepared, plan)  # what is kept of the maps is made now
        tracemalloc.start()
        result = deploy_family(explorer, prepared, plan)
        held.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    assert len(result.deployments) == 600
    assert held[1] - held[0] < 400 * 2000  # one deployment takes about 20 kB


def test_a_deployment_is_the_same_whenever_it_is_asked_for(result):
    deployments = result.deployments
    every = list(deployments)
    assert len(every) == len(deployments) == 10
    for index in (0, 4, -1):
        np.testing.assert_array_equal(deployments[index].points_mm, every[index].points_mm)
        assert deployments[index].pose == every[index].pose
    assert [d.pose for d in deployments[2:4]] == [d.pose for d in every[2:4]]
