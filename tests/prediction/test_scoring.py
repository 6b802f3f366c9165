import math

import numpy as np
import pytest
import shapely

from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose, Start
from vinefab.model.score import Evaluation, Score
from vinefab.prediction.scoring import ScorePlan, score_design_on_task, score_lines


def test_lines_show_every_score_and_the_composites():
    pose = Pose(x_mm=1.0, y_mm=2.0, heading_rad=math.radians(30.0))
    evaluations = tuple(
        Evaluation(map_name="m", pose=pose, score=score, terms={}) for score in (0.25, 0.5, 0.75)
    )
    growth = {"body": "centerline", "pressure_stop": False}
    result = Score(
        task="reach",
        evaluations=evaluations,
        composite={"mean": 0.5, "best": 0.75},
        parts={"area reached": 0.6, "film": -0.1},
        growth=growth,
        notes=("one thing to know",),
    )
    vine = Design(name="v", trunk_length_mm=100.0, build=Build.standard(1))
    assert score_lines(result, vine, most=2) == [
        "task reach, 3 evaluations (simulated); centerline body, head-on half-angle 1 deg "
        "(assumed), no pressure stops it",
        "    0.2500  m  1.00,2.00,30.00",
        "    0.5000  m  1.00,2.00,30.00",
        "  ... and 1 more",
        "mean: + 0.6000 area reached - 0.1000 film = 0.5000",
        "composite: mean 0.5000, best 0.7500",
        "one thing to know",
    ]


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
