"""Targets of maps: names, files, one clear line for what is none, and the headline."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely

from tests.search.conftest import followed
from vinefab import Map
from vinefab.core.errors import BadInputError
from vinefab.core.view import document, lines
from vinefab.model.design import Build, Design
from vinefab.model.target import Target, TargetOutcome, TargetsResult, targets_given
from vinefab.prediction.deploy import deploy
from vinefab.prediction.family_deployments import ScorePlan, score_design_on_task
from vinefab.search.record.result import RunResult
from vinefab.search.run import Search, run_search
from vinefab.search.settings import RunSettings

SQUARE = [[400, 50], [450, 50], [450, 100], [400, 100], [400, 50]]
HOLE = [[410, 60], [420, 60], [420, 70], [410, 60]]
ROOM = Map(
    name="room",
    bounds=shapely.box(0, 0, 600, 400),
    obstacles=(shapely.box(200, 100, 300, 300),),
)


def outcome(name: str, *away_mm: float, branch: str = "0.1") -> TargetOutcome:
    target = Target(name=name, point_mm=(100.0, 50.0))
    branches = tuple(branch if np.isfinite(one) else "" for one in away_mm)
    return TargetOutcome(target=target, away_mm=np.array(away_mm), branches=branches)


def result(*outcomes: TargetOutcome) -> TargetsResult:
    together = np.all([one.touched for one in outcomes], axis=0)
    return TargetsResult.of(outcomes, together.astype(float))


def test_the_headline_says_how_many_are_touched_and_by_how_much_the_others_are_missed():
    found = result(outcome("A", 3.0), outcome("B", 44.2), outcome("C", 20.0))
    assert found.headline == "2 of 3 touched, B missed by 25 mm"
    assert found.tone == "caution"
    assert [row["touched"] for row in found.content] == [True, False, True]
    assert document(found.view())["targets"][1]["missed_mm"] == pytest.approx(24.2)
    assert "missed by 25 mm" in "\n".join(lines(found.view()))


def test_over_several_deployments_a_target_is_touched_in_at_least_half_of_them():
    found = result(outcome("A", 3.0, 90.0), outcome("B", 50.0, 10.0))
    assert found.headline == "2 of 2 touched; all in 0 % of 2 deployments"
    assert found.tone == "caution"
    assert [one.share for one in found.outcomes] == [0.5, 0.5]
    rarely = result(outcome("A", 60.0, 10.0, 70.0))
    assert rarely.headline == "0 of 1 touched, A missed by 40 mm; touched in 33 % of 3 deployments"
    assert rarely.tone == "bad"


def test_where_nothing_comes_out_nothing_is_missed_by_a_number():
    found = result(outcome("A", np.inf), outcome("B", np.inf))
    assert found.headline == "0 of 2 touched, no branch comes out"
    assert found.content[0]["missed_mm"] is None
    assert found.content[0]["branch"] is None


def test_targets_of_a_map_are_written_and_read_again(tmp_path):
    square = [[400, 50], [450, 50], [450, 100], [400, 100]]
    world = ROOM.with_targets((100, 50), {"name": "shelf", "area_mm": square}, "B=500,350+-15")
    assert [(one.name, one.tolerance_mm) for one in world.targets] == [
        ("A", 20.0),
        ("shelf", 0.0),
        ("B", 15.0),
    ]
    again = Map.read(world.write(tmp_path / "room.geojson"))
    assert [one.name for one in again.targets] == ["A", "shelf", "B"]
    for one, other in zip(again.targets, world.targets, strict=True):
        assert one.tolerance_mm == other.tolerance_mm
        assert one.shape.equals(other.shape)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (
            (250, 200),
            "targets[1]: A at (250, 200) mm is inside",
        ),
        ((700, 200), "outside the bounds of map 'room'"),
        ("box=250,200", "box at (250, 200) mm"),
        ("A=here", "[NAME=]X,Y"),
        ("nan,5", "target nan,5: point_mm[1] is nan; allowed: a finite number"),
        ("5,5+-", "target is '5,5+-'; allowed: [NAME=]X,Y"),
        ("5,5+--1", "target 5,5+--1: tolerance_mm is -1.0; allowed: greater than or equal to 0"),
    ],
)
def test_a_target_that_no_robot_can_touch_is_one_clear_line(target, words):
    with pytest.raises(BadInputError) as caught:
        ROOM.with_targets(target)
    assert words in str(caught.value)


def test_two_targets_of_one_name_are_refused():
    with pytest.raises(BadInputError, match="another target is called 'B'") as caught:
        ROOM.with_targets("B=100,50", "B=400,50")
    assert caught.value.key == "targets[1].name"
    named = targets_given([(1, 2), Target(name="A", point_mm=(5, 5))])
    assert [one.name for one in named] == ["B", "A"]


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"geometry": {"type": "Point", "coordinates": [250, 200]}}, ""),
        ({"geometry": {"type": "Polygon", "coordinates": [SQUARE, HOLE]}}, ".geometry"),
        ({"properties": {"role": "target", "radius": 3}}, ".properties.radius"),
    ],
)
def test_a_map_file_names_the_feature_of_a_wrong_target(tmp_path, change, key):
    path = ROOM.with_targets((100, 50)).write(tmp_path / "room.geojson")
    document = json.loads(path.read_text())
    wrong = {**document["features"][-1], **change}
    path.write_text(json.dumps({**document, "features": [*document["features"][:-1], wrong]}))
    with pytest.raises(BadInputError) as caught:
        Map.read(path)
    assert caught.value.key == f"features[3]{key}"


def test_too_many_targets_are_counted():
    with pytest.raises(BadInputError, match=r"targets is '1001 targets'; allowed: .* at most 1000"):
        targets_given([(1, 2)] * 1001, "targets")


def test_a_target_beyond_the_longest_robot_is_one_clear_line(tmp_path):
    world = ROOM.with_start((20, 200, 0)).with_targets((560, 200))
    vine = Design(name="vine", trunk_length_mm=200.0, build=Build.standard(1))
    said = deploy(vine, world).summary
    assert any("out of reach: A, 540 mm from the start; at most 200 mm" in line for line in said)
    settings = RunSettings(
        maps={"files": [world.write(tmp_path / "room.geojson")]},
        task="reach",
        space={"levels": 2, "length_mm": [50.0, 200.0], "growth_percent": [50.0, 150.0]},
        evaluation={"fabricable": False},
    )
    with pytest.raises(BadInputError, match="within 500 mm, the robot's greatest length"):
        Search.of(settings, [world])


def test_maps_with_and_without_targets_are_refused_together():
    aimed = ROOM.with_start((20, 200, 0)).with_targets((100, 200))
    bare = replace(aimed, name="bare", targets=())
    design = Design(name="vine", trunk_length_mm=200.0, build=Build.standard(1))
    plan = ScorePlan(task="reach", poses=1)
    with pytest.raises(BadInputError, match="map 'bare' has no targets"):
        score_design_on_task(design, [aimed, bare], plan)
    assert score_design_on_task(design, [aimed], plan).targets.all_touched


def test_a_run_remembers_which_targets_its_winner_touches(tmp_path):
    world = ROOM.with_start((20, 200, 0)).with_targets((100, 200), (150, 60))
    settings = RunSettings(
        maps={"files": [world.write(tmp_path / "room.geojson")]},
        task="reach",
        space={"levels": 2, "length_mm": [60.0, 120.0], "branches": 2},
        search={"population": 8, "generations": 3},
        evaluation={"fabricable": False},
    )
    shown = []
    with followed(lambda now: shown.append(now.words)):
        result = run_search(settings, tmp_path / "run")
    assert result.targets.outcomes[0].is_touched
    assert "of 2 touched)" in shown[0]
    again = RunResult.read(tmp_path / "run")
    assert again.targets.content == result.targets.content
    assert again.summary[0].startswith(f"{result.targets.headline}: found ")


def test_a_run_says_that_a_task_leaves_targets_out():
    world = ROOM.with_start((20, 200, 0)).with_targets((100, 200))
    made = {"space": {"levels": 2, "branches": 2}, "evaluation": {"fabricable": False}}
    notes = Search.of(RunSettings(**made), [world]).evaluator.notes
    assert any("coverage does not score the maps' targets" in note for note in notes)
    task = {"name": "reach", "parameters": {"targets": [[100, 200]]}}
    notes = Search.of(RunSettings(task=task, **made), [world]).evaluator.notes
    assert not any("target" in note for note in notes)
