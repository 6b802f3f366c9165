"""Deployments on families of maps: maps, scores, spreads, where robots go."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab import maps
from vinefab.core.view import document
from vinefab.growth.batch import GROWTHS_PER_CALL
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose, Start
from vinefab.model.score import MOST_SHOWN, Evaluation, Score
from vinefab.pages.plan import STOP_WORDS, body_cells
from vinefab.prediction.family_deployments import (
    FIRST_UNSEEN,
    HeatMap,
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    ScorePlan,
    StuckSpot,
    deploy_family,
    deployment_section,
    heat_blocks,
    heat_map_of,
    map_families,
    score_design_on_task,
    spread_blocks,
    spread_chart,
    stuck_spots,
    typical,
    unseen_maps,
)
from vinefab.prediction.measures import MEASURES, SEEN, MeasureTable
from vinefab.tasks.evaluate import PreparedMap


def test_unseen_maps_are_their_own_and_repeat(result):
    again = unseen_maps("grid", 5, 0, SMALL).worlds
    other = unseen_maps("grid", 5, 1, SMALL).worlds
    seeds = [world.seed for world in again]
    assert seeds == list(range(FIRST_UNSEEN, FIRST_UNSEEN + 5))
    assert not {world.seed for world in other} & set(seeds)
    assert again[2].obstacles == result.prepared.maps[2].world.obstacles
    assert len(again[0].obstacles) == 16


SMALL = {"columns": 4, "rows": 4, "size_mm": 350.0}


def test_fields_need_a_map(straight):
    _, family = straight
    assert [found.label for found in map_families(family.worlds, family)] == [
        "the map given",
        "room",
    ]
    with pytest.raises(ValueError, match="--environment"):
        map_families([], None)


def test_maps_of_one_name_are_told_apart(straight):
    _, family = straight
    prepared = PreparedFamily.of(
        MapFamily(label="two", worlds=family.worlds * 2), PredictionPlan(poses=1)
    )
    assert prepared.names == ("room (1)", "room (2)")


def test_outcomes_name_every_deployment(result):
    assert len(result.outcomes) == len(result.deployments) == 10
    assert result.outcomes.map_count == 5
    assert result.prepared_map(7).world.name == result.outcomes.map_names[7]
    assert result.deployments[7].pose == result.outcomes.poses[7]
    least, most = typical(result.outcomes, (0.0, 1.0), SEEN.key)
    values = result.outcomes.values[SEEN.key]
    assert (values[least], values[most]) == (values.min(), values.max())


def test_a_line_and_a_body_predict_different_things(explorer, result):
    line = PredictionPlan(poses=2, seed=3, options=GrowthOptions(body="centerline"))
    other = deploy_family(explorer, PreparedFamily.of(unseen_maps("grid", 5, 0, SMALL), line), line)
    assert other.outcomes.poses == result.outcomes.poses
    assert not np.array_equal(other.outcomes.values[SEEN.key], result.outcomes.values[SEEN.key])


def test_grid_options_reach_the_generator():
    assert unseen_maps("grid", 1, 4).worlds[0].seed == FIRST_UNSEEN + 40_000
    plain = grid_map(FIRST_UNSEEN, GridOptions(columns=4, rows=4, size_mm=350.0))
    assert plain.obstacles == unseen_maps("grid", 1, 0, SMALL).worlds[0].obstacles
    with pytest.raises(ValueError, match=r"grid\.colums"):
        unseen_maps("grid", 1, 0, {"colums": 4})


# --- Scores ---------------------------------------------------------------------------------------


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


# --- Spreads and endings --------------------------------------------------------------------------


POSE = Pose(x_mm=12.345, y_mm=0.0, heading_rad=math.radians(30.0))


def known_table():
    columns = {m.key: np.full(4, np.nan) for m in MEASURES}
    columns[SEEN.key] = np.array([10.0, 20.0, 30.0, 60.0])
    maps = ("a", "a", "a", "b")
    return MeasureTable(label="two maps", map_names=maps, poses=(POSE,) * 4, values=columns)


def test_the_spread_of_known_values_stands_in_the_table():
    _, section = spread_blocks([known_table()])
    numbers, every = section.tables
    # Maps of mean 20 and 60; deviation and percentiles of 10, 20, 30, 60.
    (row,) = numbers.rows
    assert [*map(str, row)] == [
        "free space seen by sensors (%)",
        "40.0 [0.0, 100.0; 2 maps]", "18.7", "11.5", "25.0", "55.5", "10.0", "60.0", "4",
    ]  # fmt: skip
    assert section.paragraphs[0].startswith("Two maps: 4 deployments (simulated).")
    assert [*map(str, every.rows[3])][:6] == ["b", "12.35", "0.00", "30.00", "-", "60.0"]


def test_the_chart_draws_mean_and_percentiles():
    (panel,) = spread_chart(SEEN, {"l": np.array([0.0, 10.0, 20.0, 30.0, 60.0])}).panels
    bar, mean, dots, name = panel.primitives
    assert dots.points[:, 0].tolist() == [0.0, 10.0, 20.0, 30.0, 60.0]
    assert bar.chains[0][:, 0].tolist() == pytest.approx([2.0, 54.0])
    assert mean.chains[0][:, 0].tolist() == [24.0, 24.0]
    assert name.text == "l"


def test_endings_are_counted_level_by_level():
    fan = Level(branches=4, length_mm=40.0, fan_rad=1.0)
    design = Design(name="d", trunk_length_mm=80.0, levels=(fan,), build=Build.standard(2))
    chain = [[0.0, 0.0], [80.0, 0.0]]
    deployment = Deployment(
        tree=design.tree,
        pose=Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0),
        points_mm=np.array(chain + [[80.0, 0.0], [90.0, 0.0]] * 3),
        first_point=np.array([0, 2, 4, 6, 8, 8]),
        stop=np.array(
            [Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.CORNER, Stop.HEAD_ON, Stop.NOT_DEPLOYED]
        ),
        grown_mm=np.array([80.0, 10.0, 20.0, 36.0, 0.0]),
        contact_turn_rad=np.zeros(5),
    )
    world = Map(name="room", bounds=shapely.box(0, -50, 100, 50))
    section = deployment_section(
        design,
        [("one", world, deployment)],
        [("maps", [deployment, deployment])],
        GrowthOptions(),
    )
    assert "as wide as they inflate" in section.paragraphs[0]
    (table,) = section.tables
    assert table.rows == (
        ("1", "100.0 %", *["0.0 %"] * 4, "-"),
        ("2", "0.0 %", "50.0 %", "25.0 %", "25.0 %", "0.0 %", "50 %"),
    )
    assert "how 10 branches of 2 deployments ended" in table.caption
    assert set(STOP_WORDS) == set(Stop)


# --- Where it goes on one map ---------------------------------------------------------------------


def test_heat_counts_bodies_as_large_as_they_inflate(straight):
    design, family = straight
    prepared = PreparedFamily.of(family, PredictionPlan(poses=1))
    result = deploy_family(design, prepared, PredictionPlan(poses=1))
    cell_mm = 0.5
    cells = body_cells(result.deployments[0], np.array([20.0]), (0.0, 0.0), cell_mm, (400, 800))
    across_mm = 2.0 * 20.0 / np.pi
    expected_mm2 = 100.0 * across_mm + np.pi * (across_mm / 2.0) ** 2
    assert cells.sum() * cell_mm**2 == pytest.approx(expected_mm2, rel=0.05)
    rows, columns = np.nonzero(cells)
    assert columns.mean() * cell_mm == pytest.approx(100.0, abs=cell_mm)
    assert rows.mean() * cell_mm == pytest.approx(100.0, abs=cell_mm)


TRIALS = PredictionPlan(poses=2, seed=3)


def test_heat_of_varied_poses(explorer, result):
    heat = heat_map_of(explorer, result.prepared.maps[0], TRIALS, poses=30)
    assert heat.deployments == 30
    assert 0.5 < heat.share.max() <= 1.0
    assert 0.0 < heat.percent_passed(0.5) < heat.percent_passed() < 100.0


def test_stuck_tips_are_gathered_by_place():
    build = Build.standard(1, trunk_width_mm=20.0)
    tree = Design(name="v", trunk_length_mm=10.0, build=build).tree

    def ended(x, y, stop):
        return Deployment(
            tree=tree,
            pose=Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0),
            points_mm=np.array([[0.0, 0.0], [x, y]]),
            first_point=np.array([0, 2]),
            stop=np.array([stop]),
            grown_mm=np.array([5.0]),
            contact_turn_rad=np.zeros(1),
        )

    robots = [
        ended(100.0, 0.0, Stop.HEAD_ON),
        ended(104.0, 0.0, Stop.CORNER),
        ended(300.0, 0.0, Stop.HEAD_ON),
        ended(300.0, 0.0, Stop.FULL_LENGTH),
    ]
    places = stuck_spots(robots, 10.0)
    assert [(spot.x_mm, spot.percent) for spot in places] == [(102.0, 50.0), (300.0, 25.0)]
    assert stuck_spots(robots[3:], 10.0) == ()


def known_heat():
    """A room of 100 x 100 mm in cells of 10 mm: 30 passed at all, 10 by most deployments."""
    share = np.zeros((10, 10))
    share[:3] = 0.4
    share[0] = 0.75
    spot = StuckSpot(x_mm=12.34, y_mm=56.78, percent=12.5)
    return HeatMap(
        world=Map(name="room", bounds=shapely.box(0, 0, 100, 100)),
        low_mm=(0.0, 0.0),
        cell_mm=10.0,
        share=share,
        deployments=8,
        spots=(spot,),
        spread="anywhere",
    )


def test_shares_passed_are_of_the_free_space():
    heat = known_heat()
    assert heat.percent_passed() == pytest.approx(30.0)
    assert heat.percent_passed(0.5) == pytest.approx(10.0)
    half = Map(name="half", bounds=heat.world.bounds, obstacles=(shapely.box(0, 50, 100, 100),))
    assert replace(heat, world=half).percent_passed() == pytest.approx(60.0)
    data, section = heat_blocks(heat)
    assert "8 deployments" in section.paragraphs[0]
    assert "covers 30.0 % of the free space; more than half" in section.paragraphs[0]
    assert "cover 10.0 %. The raster's cells are 10.00 mm" in section.paragraphs[0]
    assert [*map(str, section.tables[0].rows[0])] == ["1", "12.3", "56.8", "12.5"]
    content = document([data, section])["heat"]
    assert (content["ever_passed_percent"], content["mostly_passed_percent"]) == (30.0, 10.0)
    assert content["stuck"] == [{"x_mm": 12.3, "y_mm": 56.8, "percent": 12.5}]


def test_a_robot_that_never_varies_passes_its_cells_always(straight):
    design, family = straight
    # So little spread that every deployment covers the same cells.
    pose = family.worlds[0].starts[0].pose
    world = replace(family.worlds[0], starts=(Start(pose=pose, spread_x_mm=1e-6),))
    prepared = PreparedFamily.of(MapFamily(label="l", worlds=(world,)), PredictionPlan(poses=1))
    heat = heat_map_of(design, prepared.maps[0], PredictionPlan(poses=1), poses=4)
    assert set(np.unique(heat.share)) == {0.0, 1.0}
    across_mm = 2.0 * 20.0 / np.pi
    body_mm2 = 100.0 * across_mm + np.pi * (across_mm / 2.0) ** 2
    assert heat.percent_passed(0.5) == pytest.approx(100.0 * body_mm2 / 8e4, rel=0.1)
    assert (heat.cell_mm, heat.low_mm, heat.spots) == (400.0 / 320, (0.0, 0.0), ())


def test_heat_of_a_start_with_a_line_is_drawn_from_the_line(explorer, result):
    prepared = result.prepared.maps[0]
    world = prepared.world.with_start("left side, heading 0+-5")
    heat = heat_map_of(explorer, PreparedMap.of(world), TRIALS, poses=12)
    assert heat.spread == "from the free part of the start's line and 5 degrees either way"
    near = heat.share[:, : int(40.0 / heat.cell_mm)]
    assert np.count_nonzero(near.any(axis=1)) * heat.cell_mm > 0.15 * world.size_mm[1]


# --- Deployments that are grown again when asked for ----------------------------------------------


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
