"""One design, one number: in `score`, `report`, `compare` and at the end of `optimize`."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from shapely import box

from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.design import Build, Design, Level, PieceSettings
from vinefab.model.laser import read_profile
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.comparison import compare_designs
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    ScorePlan,
    deploy_family,
    deployment_notes,
    origin_of,
    score_design_on_task,
)
from vinefab.prediction.measures import COVERAGE, REACH
from vinefab.prediction.prediction_width import contact_range
from vinefab.search.run import Search
from vinefab.search.settings import EvaluationSettings, RunSettings, SearchSettings
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings
from vinefab.tasks import make_task
from vinefab.tasks.evaluate import PreparedMap

FORK = Level(branches=3, length_mm=60.0, fan_rad=2.0)
TREE = Design(
    name="tree", trunk_length_mm=90.0, levels=(FORK,), build=Build.standard(2, trunk_width_mm=12.0)
)
HEADING = Pose(x_mm=60.0, y_mm=100.0, heading_rad=0.3)
ROOM = Map(
    name="room",
    bounds=box(0.0, 0.0, 400.0, 200.0),
    obstacles=(box(180.0, 60.0, 220.0, 140.0),),
    starts=(Start(pose=HEADING),),
)
WIDE = replace(ROOM, name="wide", starts=(Start(pose=HEADING, spread_heading_rad=1.0),))


def coverage_of(design: Design, worlds: tuple[Map, ...], plan: PredictionPlan) -> float:
    """The mean coverage score that a report has."""
    prepared = PreparedFamily.of(MapFamily(label="maps", worlds=worlds), plan)
    spread = deploy_family(design, prepared, plan).outcomes.spread(COVERAGE)
    assert spread is not None
    return spread.mean


@pytest.mark.parametrize("half_angle_deg", [2.0, (1.0, 15.0)])
def test_all_commands_say_the_same_number(half_angle_deg: float | tuple[float, float]) -> None:
    worlds = tuple(grid_map(seed, GridOptions(columns=3, rows=3)) for seed in (1, 2))
    growth = GrowthOptions.of({"head_on_half_angle_deg": half_angle_deg, "storage_kpa": 0.5})
    settings = RunSettings(
        space=SpaceSettings(levels=Bounds(low=2, high=2)),
        build=BuildSettings(trunk_width_mm=24.0),
        growth=growth,
        search=SearchSettings(population=4, generations=2, seed=5),
        evaluation=EvaluationSettings(fabricable=False, finalists=2, final_poses_per_map=3),
    )
    result = Search.of(settings, worlds).run()
    best, final = result.best, result.score.composite["mean"]
    seed, poses = best.origin["seed_of_score"], best.origin["poses_of_score"]
    assert isinstance(seed, int)
    assert poses == 3
    # Nothing is said about growth: the design carries how it was trained.
    score = score_design_on_task(best, worlds, ScorePlan(poses=3, seed=seed))
    assert score.growth == growth.content
    assert score.composite["mean"] == pytest.approx(final, rel=1e-12)
    plan = PredictionPlan(poses=3, seed=seed, options=growth)
    assert coverage_of(best, worlds, plan) == pytest.approx(final, rel=1e-12)
    both = compare_designs([best, TREE], [MapFamily(label="maps", worlds=worlds)], plan)
    assert dict(both.ranked(COVERAGE))[best.name] == pytest.approx(final, rel=1e-12)


def test_maps_count_alike_where_some_have_one_pose_only() -> None:
    worlds, plan = (ROOM, WIDE), ScorePlan(poses=4)
    score = score_design_on_task(TREE, worlds, plan)
    assert [e.map_name for e in score.evaluations] == ["room"] + ["wide"] * 4
    alone = [score_design_on_task(TREE, [WIDE], ScorePlan(poses=4, seed=1))]
    alone.append(score_design_on_task(TREE, [ROOM], ScorePlan(poses=1)))
    mean = score.composite["mean"]
    assert mean == pytest.approx(np.mean([each.composite["mean"] for each in alone]))
    assert coverage_of(TREE, worlds, PredictionPlan(poses=4)) == pytest.approx(mean)
    assert sum(score.parts.values()) == pytest.approx(mean)


def test_a_start_without_spread_is_one_sample_and_that_is_said() -> None:
    score = score_design_on_task(TREE, [ROOM], ScorePlan(poses=5))
    assert len(score.evaluations) == 1
    assert score.notes[0].startswith(
        "this start has no spread: 1 deployment per map; give spread_heading_deg"
    )
    (first, grown, *_, note) = score.summary
    assert (first, grown) == (
        "task: coverage",
        "growth: inflated body, head-on half-angle 1 deg (assumed), stops at 20 kPa (film stored "
        "loosely, assumed), bodies pass through each other (assumed)",
    )
    assert note == score.notes[0]
    assert score_design_on_task(TREE, [ROOM], ScorePlan(poses=1)).notes == ()
    assert score_design_on_task(TREE, [WIDE], ScorePlan(poses=5)).notes == ()


def test_one_sample_has_no_interval_and_no_p_value() -> None:
    other = TREE.changed(name="other", trunk_length_mm=120.0)
    family = MapFamily(label="the map given", worlds=(ROOM,))
    plan = PredictionPlan(poses=5)
    found = compare_designs([TREE, other], [family], plan, measure=REACH)
    assert not any(difference.is_clear for difference in found.differences)
    lines = "\n".join(found.summary)
    assert "1 deployment of each design" in lines
    assert "this start has no spread" in lines
    assert "tree minus other" in lines
    assert "(1 map: no interval)" in lines
    found = replace(found, origin=origin_of("again", [TREE, other], None, [family]))
    text = found.json_text()
    assert '"p": null' in text
    assert '"low": null' in text


def test_the_bond_of_laps_went_into_reports_of_robots_in_pieces_only() -> None:
    profile = read_profile("co2_60w__stretchlon_200")
    unbonded = replace(profile, recipe=profile.recipe.changed(lap=None))
    cut = TREE.changed(build=TREE.build.changed(pieces=PieceSettings()))
    whole, other = (origin_of("again", [TREE], known, []).inputs for known in (profile, unbonded))
    assert whole == other
    bonded, open_ = (origin_of("again", [cut], known, []).inputs for known in (profile, unbonded))
    assert bonded != open_


def test_over_a_range_of_half_angles_repeats_are_samples_over_contacts() -> None:
    options = GrowthOptions(head_on_half_angle_rad=(0.0, math.radians(40.0)))
    score = score_design_on_task(TREE, [ROOM], ScorePlan(poses=5), options)
    assert len(score.evaluations) == 5
    assert len({e.terms["head_on_half_angle_deg"] for e in score.evaluations}) == 5
    assert "samples over contacts, not over starts" in score.notes[0]
    # At one half-angle they are repeats again.
    plan = PredictionPlan(poses=5, options=options)
    prepared = PreparedFamily.of(MapFamily(label="m", worlds=(ROOM,)), plan)
    assert len(prepared.launches()) == 5
    contacts = contact_range(TREE, prepared, options)
    assert contacts.deployments == 1
    assert math.isnan(contacts.values[COVERAGE.key][0].low)


def test_a_trunk_that_never_leaves_its_start_is_counted_in_score_and_report() -> None:
    walls = (box(0.0, 0.0, 400.0, 92.0), box(0.0, 108.0, 200.0, 200.0))
    # 16 mm of room for a trunk of 7.6 mm: some starts are too close to a wall.
    start = Start(pose=replace(HEADING, x_mm=100.0), spread_x_mm=50.0, spread_y_mm=7.0)
    world = replace(ROOM, obstacles=walls, starts=(start,))
    plan = PredictionPlan(poses=10, seed=2)
    result = deploy_family(
        TREE, PreparedFamily.of(MapFamily(label="m", worlds=(world,)), plan), plan
    )
    stayed = sum(not bool(deployment.deployed[0]) for deployment in result.deployments)
    assert 0 < stayed < 10
    note = (
        f"the trunk never leaves its start in {stayed} of 10 deployments: no room for its "
        "inflated body of 8 mm"
    )
    assert deployment_notes([result.prepared], plan, {"": TREE}) == (note,)
    both = deployment_notes([result.prepared], plan, {"a: ": TREE, "b: ": TREE})
    assert both == (f"a: {note}", f"b: {note}")
    assert score_design_on_task(TREE, [world], ScorePlan(poses=10, seed=2)).notes == (note,)


@pytest.mark.parametrize(
    ("task", "parameters"),
    [
        ("coverage", {"weight_count": 0.7, "weight_length": 0.2, "weight_film": 0.3}),
        ("reach", {}),
        ("anchoring", {"friction": 0.4}),
    ],
)
def test_the_parts_of_a_score_add_up_to_it(task: str, parameters: Mapping[str, object]) -> None:
    plan = ScorePlan(task=task, parameters=parameters, poses=4)
    score = score_design_on_task(TREE, [WIDE], plan)
    for evaluation in score.evaluations:
        assert sum(evaluation.parts.values()) == pytest.approx(evaluation.score, abs=1e-12)
    assert sum(score.parts.values()) == pytest.approx(score.composite["mean"], abs=1e-12)
    assert len(score.parts) == {"coverage": 4, "reach": 1, "anchoring": 2}[task]
    lines = score.summary
    rows = {line.strip().rsplit("  ", 1)[0].strip(): line.split()[-1] for line in lines}
    shown = [float(rows[name]) for name in score.parts]
    assert sum(shown) == pytest.approx(score.composite["mean"], abs=3e-4)
    assert "0.25 mean + 0.75 (1 - std / 0.5);" in "".join(lines)


def test_a_task_that_does_not_say_has_no_parts() -> None:
    class Bare:
        name, lowest = "bare", 0.0

        def evaluate(self, deployment, context):
            return make_task("reach").evaluate(deployment, context)

    score = score_design_on_task(TREE, [WIDE], ScorePlan(task=Bare(), poses=2))
    assert score.parts == {}
    assert not any("made of" in line for line in score.summary)


def test_a_prepared_map_of_two_fixed_starts_gives_each_once() -> None:
    two = replace(ROOM, starts=(Start(pose=HEADING), Start(pose=replace(HEADING, y_mm=20.0))))
    prepared = PreparedFamily.of(MapFamily(label="m", worlds=(two,)), PredictionPlan(poses=5))
    assert [pose.y_mm for pose in prepared.poses[0]] == [100.0, 20.0]
    assert isinstance(prepared.maps[0], PreparedMap)
    assert (
        "at most 2 deployments per map"
        in score_design_on_task(TREE, [two], ScorePlan(poses=5)).notes[0]
    )
