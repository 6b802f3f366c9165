import math

import numpy as np
import pytest
import shapely

from vinefab import maps
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose, Start
from vinefab.model.score import MOST_SHOWN, Evaluation, Score
from vinefab.prediction.family_deployments import ScorePlan, score_design_on_task


def test_a_score_shows_every_evaluation_the_parts_and_the_composites():
    pose = Pose(x_mm=1.0, y_mm=2.0, heading_rad=math.radians(30.0))
    evaluations = tuple(
        Evaluation(map_name="m", pose=pose, score=score, terms={})
        for score in [0.25] * MOST_SHOWN + [0.75]
    )
    result = Score(
        task="reach",
        evaluations=evaluations,
        composite={"mean": 0.5, "best": 0.75},
        parts={"area reached": 0.6, "film": -0.1},
        notes=("one thing to know",),
        grown="centerline body",
    )
    lines = result.summary
    assert lines[:2] == ("task: reach", "growth: centerline body")
    assert [line.split() for line in lines].count(["0.2500", "m", "1.00,2.00,30.00"]) == MOST_SHOWN
    assert "  ... and 1 more" in lines
    assert ["area", "reached", "+0.6000"] in [line.split() for line in lines]
    assert lines[-3:] == ("mean: 0.5000 (simulated)", "best: 0.7500 (simulated)", result.notes[0])


def test_a_score_is_that_of_every_map_and_pose():
    design = Design(name="v", trunk_length_mm=100.0, build=Build.standard(1))
    worlds = [
        Map(
            name=f"room {side_mm}",
            bounds=shapely.box(0, 0, side_mm, 200),
            starts=(
                Start(pose=Pose(x_mm=100.0, y_mm=100.0, heading_rad=0.0), spread_heading_rad=1e-9),
            ),
        )
        for side_mm in (400, 800)
    ]
    plan = ScorePlan(task="reach", parameters={"buffer_mm": 40.0}, poses=2)
    score = score_design_on_task(design, worlds, plan)
    assert [e.map_name for e in score.evaluations] == ["room 400"] * 2 + ["room 800"] * 2
    stadium_mm2 = 100.0 * 80.0 + np.pi * 40.0**2
    expected = [stadium_mm2 / (side * 200.0) for side in (400, 400, 800, 800)]
    assert score.scores == pytest.approx(expected, rel=4e-3)
    assert score.composite["mean"] == pytest.approx(np.mean(expected), rel=4e-3)
    with pytest.raises(ValueError, match="--maps"):
        score_design_on_task(design, [], plan)


def test_a_score_says_which_targets_are_touched_by_which_branch():
    world = maps.pegs(seed=1)
    world = world.with_start(world.starts[0].pose)
    grown = Design.read("plain_vine").grow(world)
    x_mm, y_mm = grown.chain_mm(0)[-1].tolist()
    aimed = world.with_targets({"name": "tip", "point_mm": [x_mm, y_mm]})
    plan = ScorePlan(task="reach", poses=1)
    score = score_design_on_task(Design.read("plain_vine"), [aimed], plan)
    assert score.targets is not None
    assert score.targets.headline == "1 of 1 touched"
    assert score.targets.outcomes[0].branch == "0"
    assert score.composite["mean"] == 1.0
    assert "1 of 1 touched; reach 1.000" in score.summary[0]
    assert score_design_on_task(Design.read("plain_vine"), [world], plan).targets is None
