"""Predictions against closed forms and against other ways to the same numbers."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.core.rng import child
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Pouch
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import Standing
from vinefab.model.map import Map, Pose, Start
from vinefab.model.tree import branch_tree
from vinefab.physics.growth_path import grown_paths, riding_mm
from vinefab.prediction.anchoring_prediction import leaf_turns_rad, predict_anchoring
from vinefab.prediction.family_deployments import (
    FIRST_UNSEEN,
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    map_families,
    typical,
    unseen_maps,
)
from vinefab.prediction.growth_pressures import (
    LOOSE,
    TIGHT,
    constants_by_level,
    growth_pressures_kpa,
)
from vinefab.prediction.heat_map import body_cells, heat_map_of, stuck_spots
from vinefab.prediction.measures import GROWN, LOOSE_PRESSURE, MEASURES, REACH, SEEN, STUCK
from vinefab.prediction.pressure_window import window_of
from vinefab.prediction.sensitivity import (
    ANGLE_TOLERANCE_DEG,
    QUICK,
    VariantBench,
    made_tree,
    scaled_tree,
    sensitivity,
)

SMALL = {"columns": 4, "rows": 4, "size_mm": 350.0}
TRIALS = PredictionPlan(poses=2, seed=3)


@pytest.fixture(scope="module")
def explorer():
    return read_design("grid_explorer")


@pytest.fixture(scope="module")
def trip(explorer):
    return deploy_family(
        explorer, PreparedFamily.of(unseen_maps("grid", 5, 0, SMALL), TRIALS), TRIALS
    )


@pytest.fixture
def straight():
    """A plain vine in an empty room: everything about it has a closed form."""
    design = Design(name="v", trunk_length_mm=100.0, build=Build.standard(1, trunk_width_mm=20.0))
    start = Start(pose=Pose(x_mm=50.0, y_mm=100.0, heading_rad=0.0))
    world = Map(name="room", bounds=shapely.box(0, 0, 400, 200), starts=(start,))
    return design, MapFamily(label="room", worlds=(world,))


def test_unseen_maps_are_their_own_and_repeat(trip):
    again = unseen_maps("grid", 5, 0, SMALL).worlds
    other = unseen_maps("grid", 5, 1, SMALL).worlds
    seeds = [world.seed for world in again]
    assert seeds == list(range(FIRST_UNSEEN, FIRST_UNSEEN + 5))
    assert not {world.seed for world in other} & set(seeds)
    assert again[2].obstacles == trip.place.sites[2].world.obstacles
    assert len(again[0].obstacles) == 16


def test_fields_need_a_map(straight):
    _, field = straight
    assert [found.label for found in map_families(field.worlds, field)] == ["the map given", "room"]
    with pytest.raises(ValueError, match="--environment"):
        map_families([], None)


def test_maps_of_one_name_are_told_apart(straight):
    _, field = straight
    place = PreparedFamily.of(
        MapFamily(label="two", worlds=field.worlds * 2), PredictionPlan(poses=1)
    )
    assert place.names == ("room (1)", "room (2)")


def test_a_straight_vine_in_an_empty_room_gives_what_paper_and_pencil_give(straight):
    design, field = straight
    trip = deploy_family(
        design, PreparedFamily.of(field, PredictionPlan(poses=1)), PredictionPlan(poses=1)
    )
    found = {m.key: float(trip.outcomes.values[m.key][0]) for m in MEASURES}
    room_mm2 = 400.0 * 200.0
    assert found[SEEN.key] == pytest.approx(100 * np.pi * 50.0**2 / room_mm2, rel=1e-3)
    stadium_mm2 = 100.0 * 80.0 + np.pi * 40.0**2
    assert found[REACH.key] == pytest.approx(100 * stadium_mm2 / room_mm2, rel=4e-3)
    assert (found[GROWN.key], found[STUCK.key]) == (100.0, 0.0)
    # Y and f of the 25 mm tube, times its diameter over this one's.
    scale = 25.0 / (2.0 * 20.0 / np.pi)
    assert found[LOOSE_PRESSURE.key] == pytest.approx(scale * (1.92 + 0.771 * 0.1))


def test_pressures_on_arrays_are_those_of_paths_from_the_base(trip, explorer):
    riding = riding_mm(trip.deployments[0].tree, explorer.build.widths_mm)
    turned = 0
    for deployment in trip.deployments:
        rows = growth_pressures_kpa(deployment, explorer)
        assert (np.isfinite(rows) == deployment.deployed).all()
        for fit, row in zip((LOOSE, TIGHT), rows, strict=True):
            levels = constants_by_level(explorer, fit)
            for branch, path in grown_paths(deployment).items():
                own = levels[deployment.tree.level[branch] - 1]
                turned += path.turn_rad > 1.0
                expected = path.pressure_kpa(own, float(riding[branch]))
                assert row[branch] == pytest.approx(expected, rel=1e-12)
    assert turned > 100


def test_outcomes_name_every_deployment(trip):
    assert len(trip.outcomes) == len(trip.deployments) == 10
    assert trip.outcomes.map_count == 5
    assert trip.site(7).world.name == trip.outcomes.maps[7]
    assert trip.deployments[7].pose == trip.outcomes.poses[7]
    least, most = typical(trip.outcomes, SEEN.key, (0.0, 1.0))
    values = trip.outcomes.values[SEEN.key]
    assert (values[least], values[most]) == (values.min(), values.max())


def test_spread_of_means_is_taken_over_maps(trip):
    spread = trip.outcomes.spread(SEEN)
    values = trip.outcomes.values[SEEN.key]
    assert spread.count == 10
    assert spread.mean == pytest.approx(values.mean())
    assert spread.least <= spread.p05 <= spread.median <= spread.p95 <= spread.greatest
    assert spread.low < spread.mean < spread.high


def test_a_robot_without_room_has_no_pressure(straight):
    design, field = straight
    wide = replace(design, build=Build.standard(1, trunk_width_mm=2000.0))
    trip = deploy_family(
        wide, PreparedFamily.of(field, PredictionPlan(poses=1)), PredictionPlan(poses=1)
    )
    assert trip.outcomes.spread(LOOSE_PRESSURE) is None
    assert window_of(wide, read_profile(DEFAULT_RECIPE), [trip.outcomes]) is None


def test_window_is_between_what_growth_takes_and_what_the_trunk_stands(trip, explorer):
    window = window_of(explorer, read_profile(DEFAULT_RECIPE), [trip.outcomes])
    loose = trip.outcomes.values[LOOSE_PRESSURE.key]
    assert window.needed_kpa == pytest.approx(np.percentile(loose, 95))
    # 70 kPa at 20 mm, a trunk of 24 mm, a factor of 1.5.
    assert window.allowed_kpa == pytest.approx(70.0 * 20.0 / 24.0 / 1.5)
    assert window.is_open == (window.needed_kpa < window.allowed_kpa)
    assert window.standing is Standing.ASSUMED
    assert window.loose.enough_percent == 100.0 * np.mean(loose <= window.allowed_kpa)


def test_sensitivity_without_a_wall_in_reach_is_none(straight):
    design, field = straight
    effects = sensitivity(
        VariantBench(
            design, PreparedFamily.of(field, PredictionPlan(poses=1)), PredictionPlan(poses=1)
        )
    )
    for effect in effects:
        changes = [effect.changes[measure.key].mean for measure in QUICK]
        if effect.knob == "lengths":
            scale = 25.0 / (2.0 * 20.0 / np.pi)
            assert changes[-1] == pytest.approx(scale * 0.771 * 0.1 * effect.step / 100.0)
        else:
            assert changes == pytest.approx([0.0] * len(QUICK), abs=0.05)


def test_sensitivity_leaves_out_poses_that_are_not_free(straight):
    design, field = straight
    near = Start(pose=Pose(x_mm=50.0, y_mm=8.0, heading_rad=0.0))
    world = replace(field.worlds[0], starts=(near,))
    place = PreparedFamily.of(MapFamily(label="edge", worlds=(world,)), PredictionPlan(poses=1))
    counts = {
        effect.step: effect.count
        for effect in sensitivity(VariantBench(design, place, PredictionPlan(poses=1)))
        if effect.knob == "position"
    }
    assert (counts[-20.0], counts[-10.0], counts[-5.0], counts[20.0]) == (0, 0, 1, 1)


def test_more_stops_with_a_wider_head_on_angle(trip, explorer):
    effects = sensitivity(VariantBench(explorer, trip.place, TRIALS))
    widest = [effect for effect in effects if effect.knob == "head-on half-angle"][-1]
    assert widest.changes[GROWN.key].mean < 0.0
    assert widest.changes[STUCK.key].mean > 0.0


def test_one_map_is_varied_pose_by_pose_and_few_poses_show_nothing(explorer, trip):
    place = PreparedFamily(label="one", sites=trip.place.sites[:1], poses=trip.place.poses[:1])
    for effect in sensitivity(VariantBench(explorer, place, TRIALS)):
        for change in effect.changes.values():
            assert change.groups == effect.count == 2
            assert change.low <= change.mean <= change.high
            assert not change.is_clear


def test_made_trees_stay_within_the_tolerances(explorer):
    tree = branch_tree(explorer)
    made = made_tree(tree, child(1, 2))
    off = made.length_mm / tree.length_mm - 1.0
    turned_deg = np.degrees(made.offset_rad - tree.offset_rad)
    assert 0.006 < np.abs(off).max() <= 0.01
    assert 1.0 < np.abs(turned_deg).max() <= ANGLE_TOLERANCE_DEG
    assert turned_deg[0] == 0.0


def test_scaled_designs_keep_their_widths(explorer):
    longer = scaled_tree(explorer, 1.1)
    assert branch_tree(longer).length_mm == pytest.approx(1.1 * branch_tree(explorer).length_mm)
    assert longer.build == explorer.build


def test_heat_counts_bodies_as_large_as_they_inflate(straight):
    design, field = straight
    place = PreparedFamily.of(field, PredictionPlan(poses=1))
    trip = deploy_family(design, place, PredictionPlan(poses=1))
    cell_mm = 0.5
    cells = body_cells(trip.deployments[0], (20.0,), (0.0, 0.0), cell_mm, (400, 800))
    across_mm = 2.0 * 20.0 / np.pi
    expected_mm2 = 100.0 * across_mm + np.pi * (across_mm / 2.0) ** 2
    assert cells.sum() * cell_mm**2 == pytest.approx(expected_mm2, rel=0.05)
    rows, columns = np.nonzero(cells)
    assert columns.mean() * cell_mm == pytest.approx(100.0, abs=cell_mm)
    assert rows.mean() * cell_mm == pytest.approx(100.0, abs=cell_mm)


def test_heat_of_varied_poses(explorer, trip):
    heat = heat_map_of(explorer, trip.place.sites[0], TRIALS, poses=30)
    assert heat.deployments == 30
    assert 0.5 < heat.share.max() <= 1.0
    assert 0.0 < heat.percent_passed(0.5) < heat.percent_passed() < 100.0


def test_stuck_tips_are_gathered_by_place():
    tree = branch_tree(
        Design(name="v", trunk_length_mm=10.0, build=Build.standard(1, trunk_width_mm=20.0))
    )

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


def test_gap_at_a_tip_is_the_width_of_the_corridor():
    design = Design(name="v", trunk_length_mm=60.0, build=Build.standard(1, trunk_width_mm=20.0))
    walls = (shapely.box(0, 0, 200, 40), shapely.box(0, 65, 200, 100))
    start = Start(pose=Pose(x_mm=10.0, y_mm=52.0, heading_rad=0.0))
    world = Map(name="hall", bounds=shapely.box(0, 0, 200, 100), obstacles=walls, starts=(start,))
    place = PreparedFamily.of(MapFamily(label="hall", worlds=(world,)), PredictionPlan(poses=1))
    trip = deploy_family(design, place, PredictionPlan(poses=1))
    # A pouch of 30 x 50 mm in it: A = 30 (50 - pi 25 / 2), F = 2 P A mu.
    build = replace(
        design.build, pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=50.0),
        pressure_kpa=10.0,
    )  # fmt: skip
    material = read_profile(DEFAULT_RECIPE).material
    held = predict_anchoring(replace(design, build=build), trip, material, mass_g=5.0).forces
    area_mm2 = 30.0 * (50.0 - np.pi * 25.0 / 2.0)
    assert held.mean_n == pytest.approx(2.0 * 10.0e-3 * area_mm2 * np.array([0.2, 0.3, 0.8]))
    assert held.engaged_percent == 100.0
    narrow = replace(build, pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=39.0))
    loose = predict_anchoring(replace(design, build=narrow), trip, material).forces
    assert loose.engaged_percent == 0.0
    assert loose.mean_n == pytest.approx([0.0, 0.0, 0.0])


def test_anchoring_interval_takes_the_straightest_leaves_first(trip, explorer):
    material = read_profile(DEFAULT_RECIPE).material
    holding = predict_anchoring(explorer, trip, material)
    turns = [leaf_turns_rad(deployment) for deployment in trip.deployments]
    every = np.mean([np.exp(0.3 * found).sum() for found in turns])
    third = np.mean([np.exp(0.8 * found[: -(-len(found) // 3)]).sum() for found in turns])
    assert holding.at(0.3, 100.0) == pytest.approx(every)
    assert holding.at(0.8, 33.3) == pytest.approx(third, rel=0.02)
    assert holding.forces is None
    assert holding.leaves == 18


def test_a_line_and_a_body_predict_different_things(explorer, trip):
    line = PredictionPlan(poses=2, seed=3, options=GrowthOptions(body="centerline"))
    other = deploy_family(explorer, PreparedFamily.of(unseen_maps("grid", 5, 0, SMALL), line), line)
    assert other.outcomes.poses == trip.outcomes.poses
    assert not np.array_equal(other.outcomes.values[SEEN.key], trip.outcomes.values[SEEN.key])


def test_grid_options_reach_the_generator():
    assert unseen_maps("grid", 1, 4).worlds[0].seed == FIRST_UNSEEN + 40_000
    plain = grid_map(FIRST_UNSEEN, GridOptions(columns=4, rows=4, size_mm=350.0))
    assert plain.obstacles == unseen_maps("grid", 1, 0, SMALL).worlds[0].obstacles
    with pytest.raises(ValueError, match=r"grid\.colums"):
        unseen_maps("grid", 1, 0, {"colums": 4})
