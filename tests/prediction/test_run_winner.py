"""What a run's winner is expected to do elsewhere."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.growth.options import CONTACT_ANGLES_DEG, GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.model.map import Pose, Start, map_text
from vinefab.model.quantity import Standing
from vinefab.prediction import run_winner
from vinefab.prediction.family_deployments import (
    PredictionPlan,
    PreparedFamily,
    ScorePlan,
    deploy_family,
    score_design_on_task,
    unseen_maps,
)
from vinefab.prediction.pressure_window import window_of
from vinefab.prediction.run_winner import predict_winner, window_on
from vinefab.search.manufacturability import run_profile
from vinefab.search.record.result import RunResult
from vinefab.search.record.winner import WinnerPrediction, WinnerPressure
from vinefab.search.run import Search, training_maps
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import score_design

RUN = RunSettings(
    name="few",
    maps=MapSettings(count=2),
    task=PartSettings(name="coverage"),
    search=SearchSettings(population=6, generations=3, seed=4),
    evaluation=EvaluationSettings(fabricable=False, finalists=2, final_poses_per_map=2),
)


def predicted(settings: RunSettings) -> tuple[Search, RunResult, WinnerPrediction]:
    search = Search.of(settings, training_maps(settings))
    result = search.run()
    return search, result, predict_winner(search, result)


pytestmark = pytest.mark.usefixtures("on_few_maps")


@pytest.fixture(scope="module")
def run() -> tuple[Search, RunResult, WinnerPrediction]:
    """A run with its result and what is predicted of its winner."""
    return predicted(RUN)


@pytest.mark.parametrize(
    ("parameters", "start", "words"),
    [
        ({"targets": [[250.0, 380.0]]}, None, "targets are given points"),
        ({}, Start(pose=Pose.of((250, 15, 90)), spread_x_mm=9.0), "start is a place on its own"),
    ],
)
def test_a_run_that_names_places_is_predicted_on_its_own_maps(
    parameters: dict[str, object], start: Start | None, words: str
) -> None:
    settings = RUN.changed(
        maps=MapSettings(count=1, seed=3, start=start),
        task=PartSettings(name="reach", parameters=parameters),
    )
    _, _, found = predicted(settings)
    assert found.unseen.label == "other poses on the 1 training map"
    assert words in found.note


Predicted = tuple[Search, RunResult, WinnerPrediction]


def test_the_score_on_unseen_maps_is_that_of_the_score_command(
    run: Predicted, few_unseen: int
) -> None:
    _, result, found = run
    worlds = unseen_maps("grid", few_unseen, 0).worlds
    plan = ScorePlan(task="coverage", poses=1, seed=0)
    score = score_design_on_task(result.best, worlds, plan, RUN.growth)
    assert found.unseen.deployments == few_unseen
    assert found.unseen.label == f"{few_unseen} unseen grid maps"
    assert found.unseen.score.mean == pytest.approx(score.composite["mean"], abs=1e-3)
    assert found.unseen.score.low < found.unseen.score.mean
    # The first half-angle of the range is the run's own.
    assert found.unseen.over_contacts[0] == found.unseen.score
    assert found.training.score.mean == pytest.approx(result.score.composite["mean"], abs=1e-3)
    growth = GrowthOptions.of({"head_on_half_angle_deg": CONTACT_ANGLES_DEG[-1]})
    score = score_design_on_task(result.best, worlds, plan, growth)
    mean = found.unseen.over_contacts[-1].mean
    assert mean == pytest.approx(score.composite["mean"], abs=1e-3)


def test_what_is_predicted_stands_in_lines_and_in_the_origin(run: Predicted) -> None:
    search, result, found = run
    assert predict_winner(search, result) == found
    low, high = found.unseen.contact_ends
    origin = result.with_prediction(found).best.origin
    assert origin["unseen_score"] == round(found.unseen.score.mean, 4)
    assert origin["unseen_score_over_contacts"][0] == origin["unseen_score"]
    assert min(origin["unseen_score_over_contacts"]) == round(low, 4)
    *_, placed = found.lead_facts
    contacts, branches, emergence = found.width_facts
    assert (contacts.text, placed.text) == (
        f"{low:.3f} to {high:.3f}", "{:.3f} to {:.3f}".format(*found.placed_off_ends)
    )  # fmt: skip
    assert contacts.standing == "simulated, assumed"
    assert [rule.option for rule in found.rules] == ["branch_contact", "emergence"]
    mean = found.unseen.score.mean
    for rule in found.rules:  # the first choice is the run's own
        assert (rule.unseen[0], rule.training[0]) == (found.unseen.score, found.training.score)
    assert branches.text.startswith(f"{mean:.3f} if tips pass, ")
    assert emergence.text.startswith(f"{mean:.3f} at 1, ")
    assert found.rules[1].unseen[-1].mean < mean
    assert placed.detail.endswith("up to 10 mm or 10 deg off")


def test_a_body_placed_off_is_compared_with_itself(run: Predicted, few_unseen: int) -> None:
    search, result, found = run
    steps = [(row.knob, row.step) for row in found.placed_off]
    assert len(steps) == len(set(steps)) == 12
    # Bases turned to the left, from the same poses.
    _, family = run_winner.predicted(search, result)
    means = []
    for turn_deg in (0.0, 10.0):
        turned = [
            [replace(one, heading_rad=one.heading_rad + np.radians(turn_deg)) for one in poses]
            for poses in family.poses
        ]
        score = score_design(result.best, family.maps, turned, Coverage(), RUN.growth.at_one_angle)
        means.append(score.composite["mean"])
    (row,) = [r for r in found.placed_off if (r.knob, r.step) == ("heading", 10.0)]
    assert row.change == pytest.approx(means[1] - means[0], abs=1e-3)
    least, most = found.placed_off_ends
    assert least <= found.unseen.score.mean <= most
    near = [row for row in found.placed_off if abs(row.step) <= 10.0]
    mean = found.unseen.score.mean
    assert least == min(mean, *(mean + row.change for row in near))
    assert {row.deployments <= few_unseen for row in found.placed_off} == {True}
    # Degrees of heading, not radians: a twentieth of a turn changes it less than anything does.
    changes = [abs(row.change) for row in found.placed_off if row.knob == "heading"]
    assert max(changes[2:4]) <= max(changes[0], changes[-1]) + 0.05


def test_a_run_on_files_is_tried_from_other_poses_on_them(tmp_path: Path, few_unseen: int) -> None:
    path = tmp_path / "mine.geojson"
    path.write_text(map_text(grid_map(5)))
    settings = RUN.changed(maps=MapSettings(count=1, files=(path,)))
    search, _, found = predicted(settings)
    assert found.unseen.label == "other poses on the 1 training map"
    assert found.unseen.deployments == few_unseen
    final = search.evaluator.final_conditions(settings.search.seed).poses[0]
    assert len(final) == found.training.deployments == 2
    assert found.note == ""


def test_starts_without_spread_leave_one_deployment_and_no_interval(tmp_path: Path) -> None:
    world = grid_map(5)
    fixed = [replace(start, spread_x_mm=0.0, spread_y_mm=0.0, spread_heading_rad=0.0)
             for start in world.starts]  # fmt: skip
    path = tmp_path / "mine.geojson"
    path.write_text(map_text(replace(world, starts=tuple(fixed))))
    _, _, found = predicted(RUN.changed(maps=MapSettings(count=1, files=(path,))))
    assert found.unseen.deployments == 1
    assert np.isnan(found.unseen.score.low)
    assert found.content["unseen"]["score"]["low"] is None
    assert WinnerPrediction.of_json(found.as_json) == found
    assert np.isfinite(found.placed_off_ends).all()
    assert found.lead_facts[0].detail.startswith("mean over 1 deployment at a half-angle")


def test_unseen_maps_that_cannot_be_made_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> None:
        raise BadInputError("start", "none", "a free place")

    monkeypatch.setattr("vinefab.prediction.run_winner.unseen_maps", none)
    _, result, found = predicted(RUN)
    assert found.unseen.label == "other poses on the 2 training maps"
    assert "one of them cannot be used: start is 'none'" in found.note
    assert found.note in result.with_prediction(found).summary


def test_a_run_from_a_side_is_predicted_from_that_side_of_unseen_maps(few_unseen: int) -> None:
    words = "left side, heading +-10"
    _, result, found = predicted(RUN.changed(maps=MapSettings(count=1, seed=3, start=words)))
    label = f"{few_unseen} unseen grid maps from the left side, heading +-10"
    assert (found.unseen.label, found.note) == (label, "")
    worlds = [world.with_start(words) for world in unseen_maps("grid", few_unseen, 0).worlds]
    plan = ScorePlan(task="coverage", poses=1, seed=0)
    score = score_design_on_task(result.best, worlds, plan, RUN.growth)
    assert found.unseen.score.mean == pytest.approx(score.composite["mean"], abs=1e-3)


def test_the_window_of_a_winner_is_that_of_its_report(run: Predicted) -> None:
    """What pressure growth needs is asked where no pressure stops it."""
    _, result, _ = run
    family = PreparedFamily.of(unseen_maps("grid", 3, 0), PredictionPlan(poses=2))
    options = GrowthOptions(pressure_stop=True)
    profile = run_profile(RUN.evaluation)
    deployed = deploy_family(result.best, family, PredictionPlan(poses=2, options=options))
    of_report = window_of(result.best, profile, [deployed.outcomes])
    stopped = RUN.changed(growth=RUN.growth.changed(pressure_stop=True))
    window = window_on(result.best, family, stopped)
    assert window == of_report
    assert window is not None


@pytest.mark.parametrize(
    ("is_open", "holds", "tone"),
    [(True, True, "plain"), (True, False, "caution"), (False, False, "bad")],
)
def test_a_run_says_at_which_pressures_its_winner_deploys(
    run: Predicted, *, is_open: bool, holds: bool, tone: str
) -> None:
    _, result, found = run
    window = WinnerPressure(
        is_open=is_open, holds_working=holds, words="and so on", standing=Standing.ASSUMED,
        needed_kpa=21.3, allowed_kpa=23.3, working_kpa=20.0, safety_factor=2.0,
    )  # fmt: skip
    known = replace(result, checked=True).with_prediction(replace(found, pressure_window=window))
    assert known.answer.tone == tone
    assert known.answer.text.endswith("manufacturable, and so on")
    assert window.fact.tone == ("caution" if tone == "bad" else tone)
