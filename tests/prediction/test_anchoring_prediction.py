from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.model.design import Build, Design, Pouch
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.anchoring_prediction import (
    AnchoringPrediction,
    Forces,
    HeldForces,
    anchoring_section,
    leaf_turns_rad,
    predict_anchoring,
)
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
)
from vinefab.prediction.prediction_json import anchoring_content


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


def halls(*gaps_mm):
    """A plain vine deployed once in each of several halls of known width."""
    worlds = []
    for gap_mm in gaps_mm:
        walls = (
            shapely.box(0, 0, 200, 50 - gap_mm / 2),
            shapely.box(0, 50 + gap_mm / 2, 200, 100),
        )
        start = Start(pose=Pose(x_mm=10.0, y_mm=50.0, heading_rad=0.0))
        bounds = shapely.box(0, 0, 200, 100)
        worlds.append(Map(name=f"{gap_mm}", bounds=bounds, obstacles=walls, starts=(start,)))
    pouch = Pouch(shape="rectangle", length_mm=30.0, width_mm=50.0)
    build = replace(Build.standard(1, trunk_width_mm=20.0), pouch=pouch, pressure_kpa=10.0)
    design = Design(name="v", trunk_length_mm=60.0, build=build)
    plan = PredictionPlan(poses=1)
    family = MapFamily(label="halls", worlds=tuple(worlds))
    return design, deploy_family(design, PreparedFamily.of(family, plan), plan)


def held_n(gap_mm, friction, pressure_kpa=10.0):
    """F = 2 P A mu of the pouch of 30 x 50 mm."""
    return 2.0 * pressure_kpa * 1e-3 * 30.0 * (50.0 - np.pi * gap_mm / 2.0) * friction


def test_forces_are_mean_and_percentiles_over_deployments():
    design, result = halls(20.0, 22.0, 24.0, 26.0, 28.0)
    material = read_profile(DEFAULT_RECIPE).material
    forces = predict_anchoring(design, result, material, mass_g=5.0).forces
    frictions = np.array([0.2, 0.3, 0.8])
    # The force falls linearly with the gap; of five values 5 % lie 0.2 steps from either end.
    assert forces.friction.tolist() == frictions.tolist()
    assert forces.mean_n == pytest.approx(held_n(24.0, frictions))
    assert forces.p95_n == pytest.approx(held_n(20.4, frictions))
    assert forces.p05_n == pytest.approx(held_n(27.6, frictions))
    assert (forces.engaged_percent, forces.limited_percent) == (100.0, 0.0)
    assert (forces.pressure_kpa, forces.mass_g) == (10.0, 5.0)


def test_seams_limit_a_known_share_of_the_engaged_leaves():
    design, result = halls(20.0, 22.0, 24.0, 26.0, 45.0)
    material = read_profile(DEFAULT_RECIPE).material
    # A seam of the test balloon, 70 kPa at 20 mm, around the trunk: 2 w P_b w_b / pi.
    limit_n = 2.0 * 20.0 * 70e-3 * 20.0 / np.pi
    pressure_kpa = 10.0 * limit_n / held_n(23.0, 0.8)
    strong = replace(design, build=replace(design.build, pressure_kpa=pressure_kpa))
    forces = predict_anchoring(strong, result, material).forces
    # Inflated, the pouch is 31.8 mm wide: four of five hold, of these two beyond the limit.
    assert (forces.engaged_percent, forces.limited_percent) == (80.0, 50.0)
    free_n = held_n(24.0, 0.8, pressure_kpa) + held_n(26.0, 0.8, pressure_kpa)
    assert forces.mean_n[-1] == pytest.approx((2.0 * limit_n + free_n) / 5.0)


def known_prediction():
    table = tuple(
        HeldForces(friction=friction, engaged_percent=share, amplification=friction * share)
        for friction in (0.2, 0.3, 0.8)
        for share in (100.0, 66.7, 33.3)
    )
    forces = Forces(
        friction=np.array([0.2, 0.8]),
        mean_n=np.array([1.0, 4.0]),
        p05_n=np.array([0.25, 2.0]),
        p95_n=np.array([1.5, 6.0]),
        engaged_percent=62.5,
        limited_percent=12.5,
        pressure_kpa=10.0,
        mass_g=10.0,
    )
    return AnchoringPrediction(label="halls", leaves=6, table=table, forces=forces)


def test_page_and_json_show_known_forces():
    prediction = known_prediction()
    amplification, forces = anchoring_section([prediction]).tables
    assert amplification.rows[0] == ("100 % of the leaves hold", "20.00", "30.00", "80.00")
    assert amplification.rows[2] == ("33.3 % of the leaves hold", "6.66", "9.99", "26.64")
    assert "6 leaves" in amplification.caption
    assert "at 10 kPa: 62.5 % of the leaves" in forces.caption
    assert "12.5 % of them are limited" in forces.caption
    # 1 N over the weight of 10 g.
    assert forces.rows == (
        ("0.2", "1.00", "0.25", "1.50", "10"),
        ("0.8", "4.00", "2.00", "6.00", "41"),
    )
    content = anchoring_content(prediction)
    assert content["forces"]["engaged_percent"] == 62.5
    assert content["forces"]["limited_percent"] == 12.5
    assert content["forces"]["p95_n"].tolist() == [1.5, 6.0]
    assert content["forces"]["p05_n"].tolist() == [0.25, 2.0]
    assert content["table"][2] == {
        "friction": 0.2, "engaged_percent": 33.3, "amplification": 6.66
    }  # fmt: skip
