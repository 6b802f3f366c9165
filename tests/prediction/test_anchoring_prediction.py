from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.model.design import Build, Design, Pouch
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.anchoring_prediction import leaf_turns_rad, predict_anchoring
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
)


def test_gap_at_a_tip_is_the_width_of_the_corridor():
    design = Design(name="v", trunk_length_mm=60.0, build=Build.standard(1, trunk_width_mm=20.0))
    walls = (shapely.box(0, 0, 200, 40), shapely.box(0, 65, 200, 100))
    start = Start(pose=Pose(x_mm=10.0, y_mm=52.0, heading_rad=0.0))
    world = Map(name="hall", bounds=shapely.box(0, 0, 200, 100), obstacles=walls, starts=(start,))
    prepared = PreparedFamily.of(MapFamily(label="hall", worlds=(world,)), PredictionPlan(poses=1))
    result = deploy_family(design, prepared, PredictionPlan(poses=1))
    # A pouch of 30 x 50 mm in it: A = 30 (50 - pi 25 / 2), F = 2 P A mu.
    build = replace(
        design.build, pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=50.0),
        pressure_kpa=10.0,
    )  # fmt: skip
    material = read_profile(DEFAULT_RECIPE).material
    held = predict_anchoring(replace(design, build=build), result, material, mass_g=5.0).forces
    area_mm2 = 30.0 * (50.0 - np.pi * 25.0 / 2.0)
    assert held.mean_n == pytest.approx(2.0 * 10.0e-3 * area_mm2 * np.array([0.2, 0.3, 0.8]))
    assert held.engaged_percent == 100.0
    narrow = replace(build, pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=39.0))
    loose = predict_anchoring(replace(design, build=narrow), result, material).forces
    assert loose.engaged_percent == 0.0
    assert loose.mean_n == pytest.approx([0.0, 0.0, 0.0])


def test_anchoring_interval_takes_the_straightest_leaves_first(result, explorer):
    material = read_profile(DEFAULT_RECIPE).material
    holding = predict_anchoring(explorer, result, material)
    turns = [leaf_turns_rad(deployment) for deployment in result.deployments]
    every = np.mean([np.exp(0.3 * found).sum() for found in turns])
    third = np.mean([np.exp(0.8 * found[: -(-len(found) // 3)]).sum() for found in turns])
    assert holding.at(0.3, 100.0) == pytest.approx(every)
    assert holding.at(0.8, 33.3) == pytest.approx(third, rel=0.02)
    assert holding.forces is None
    assert holding.leaves == 18
