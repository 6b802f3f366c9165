"""Poses tried in batches, against one growth at a time and places that are known by thought."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.pose_search import (
    FIRST_SEARCH,
    JUDGED_DRAWS,
    BaseRegion,
    PoseErrors,
    PoseTrial,
    search_poses,
)
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.reach import Reach

RANGE = (math.radians(1.0), math.radians(15.0))
OPTIONS = GrowthOptions(pressure_stop=False, head_on_half_angle_rad=RANGE)
ERRORS = PoseErrors(placing_mm=5.0, placing_deg=3.0, half_angle_range_rad=RANGE)
EXACT = PoseErrors(placing_mm=0.0, placing_deg=0.0, half_angle_range_rad=RANGE)

TREE = Design(
    name="tree",
    trunk_length_mm=80.0,
    levels=(Level(branches=2, length_mm=60.0, fan_rad=1.4),),
    build=Build.standard(2, trunk_width_mm=16.0),
)
VINE = Design(name="vine", trunk_length_mm=300.0, build=Build.standard(1, trunk_width_mm=16.0))
ROOM = Map(
    name="room",
    bounds=shapely.box(0.0, 0.0, 300.0, 200.0),
    obstacles=(
        shapely.Polygon([(90.0, 60.0), (150.0, 70.0), (120.0, 120.0)]),
        shapely.box(210.0, 90.0, 240.0, 200.0),
    ),
    starts=(Start(pose=Pose(x_mm=20.0, y_mm=100.0, heading_rad=0.0)),),
)


def trial_on(world, design=TREE, over=map):
    return PoseTrial.of(design, PreparedMap.of(world), OPTIONS, over)


@pytest.mark.parametrize("task", [Reach(), Reach(area="fast"), Coverage(), Coverage(area="fast")])
def test_scores_of_a_batch_are_those_of_one_growth_at_a_time(task):
    trial = trial_on(ROOM)
    poses = np.array([(30.0, 40.0, 0.7), (180.0, 150.0, -2.0), (7.0, 9.0, 1.0)])
    draws = ERRORS.even(5)
    found = trial.scores(task, poses, draws)
    placed = trial.placed(poses, draws).reshape(3, 5, 3)
    for row, column in np.ndindex(found.shape):
        x, y, heading = placed[row, column].tolist()
        angle = float(draws.half_angle_rad[column])
        grown = grow_on(
            TREE,
            trial.prepared.terrain,
            Pose(x_mm=x, y_mm=y, heading_rad=heading),
            OPTIONS.changed(head_on_half_angle_rad=angle),
        )
        score, _ = task.evaluate(grown, trial.prepared.context)
        assert found[row, column] == pytest.approx(score, abs=1e-12)


def test_scores_do_not_depend_on_threads():
    poses, draws = np.array([(30.0, 40.0, 0.7), (180.0, 150.0, -2.0)] * 40), ERRORS.even(8)
    alone = trial_on(ROOM).scores(Coverage(area="fast"), poses, draws)
    with ThreadPoolExecutor(3) as pool:
        together = trial_on(ROOM, over=pool.map).scores(Coverage(area="fast"), poses, draws)
    assert (alone == together).all()


def test_all_poses_meet_the_same_children_that_stay_in():
    """Where every child comes out by chance, a pose's score does not depend on those with it."""
    trial = PoseTrial.of(TREE, PreparedMap.of(ROOM), OPTIONS.changed(emergence=0.5))
    poses, draws = np.array([(30.0, 40.0, 0.7), (180.0, 150.0, -2.0)]), ERRORS.even(16)
    both = trial.scores(Coverage(area="fast"), poses, draws)
    assert (trial.scores(Coverage(area="fast"), poses[1:], draws)[0] == both[1]).all()
    assert (trial.scores(Coverage(area="fast"), poses, draws.part(8, 16)) == both[:, 8:]).all()
    sure = trial_on(ROOM).scores(Coverage(area="fast"), poses, draws)
    assert (both < sure - 0.01).any()
    assert not (both < sure - 0.01).all()


def test_all_poses_meet_the_same_contacts_and_placing_errors():
    draws, trial = ERRORS.even(64), trial_on(ROOM)
    poses = np.array([(60.0, 160.0, 0.0), (180.0, 30.0, 1.0)])
    moved = trial.placed(poses, draws).reshape(2, 64, 3) - poses[:, None]
    assert moved[0] == pytest.approx(moved[1])
    assert np.hypot(*draws.offset_mm.T).max() <= 5.0
    assert np.abs(draws.turn_rad).max() <= math.radians(3.0)
    low, high = np.degrees([draws.half_angle_rad.min(), draws.half_angle_rad.max()])
    assert 1.0 <= low < 1.6
    assert 14.4 < high <= 15.0
    # A longer row of draws begins with the shorter one: rounds of a search go on where they were.
    assert ERRORS.even(8).offset_mm == pytest.approx(draws.part(0, 8).offset_mm)


def test_even_draws_have_the_means_of_independent_ones():
    even, drawn = ERRORS.even(512), ERRORS.drawn(200_000, child(1, 2))
    for name in ("offset_mm", "turn_rad", "half_angle_rad"):
        values, others = getattr(even, name), getattr(drawn, name)
        spread = others.std(axis=0).max()
        assert values.mean(axis=0) == pytest.approx(others.mean(axis=0), abs=0.02 * spread)
        assert values.std(axis=0) == pytest.approx(others.std(axis=0), rel=0.03)


def test_a_base_pushed_into_a_wall_stays_beside_it():
    trial = trial_on(ROOM)
    corner = np.array([(trial.radius_mm, trial.radius_mm, 0.5)])
    placed = trial.placed(corner, ERRORS.even(50))
    assert trial.prepared.terrain.have_room(placed[:, :2], trial.radius_mm).all()
    assert np.hypot(*(placed[:, :2] - corner[:, :2]).T).max() <= 5.0 + 1e-9


def mirrored(world):
    def flip(shape):
        return shapely.transform(shape, lambda xy: xy * [-1.0, 1.0])

    return replace(
        world,
        bounds=flip(world.bounds).normalize(),
        obstacles=tuple(flip(shape) for shape in world.obstacles),
        starts=(),
    )


def test_a_mirrored_map_has_the_mirrored_best_pose():
    targets = ((20.0, 180.0), (280.0, 150.0), (150.0, 20.0), (60.0, 30.0))
    found = []
    for world, side in ((ROOM, 1.0), (mirrored(ROOM), -1.0)):
        own = tuple((side * x, y) for x, y in targets)
        task = Reach(targets=own, falloff_mm=200.0)
        trial = trial_on(world)
        region = BaseRegion.of(trial, "anywhere")
        found.append(search_poses(trial, task, region, EXACT, 6000))
    one, other = found
    x, y, heading = other.pose
    assert (-x, y) == pytest.approx(tuple(one.pose[:2]), abs=1e-6)
    turned = (math.pi - heading - one.pose[2]) % (2.0 * math.pi)
    assert min(turned, 2.0 * math.pi - turned) == pytest.approx(0.0, abs=1e-6)
    assert other.estimate == pytest.approx(one.estimate, abs=1e-9)
    assert one.draws == JUDGED_DRAWS
    # The whole landscape is mirrored, not only its top.
    assert np.sort(one.landscape.best_scores) == pytest.approx(
        np.sort(other.landscape.best_scores), abs=1e-9
    )


def test_in_a_corridor_the_base_stands_at_one_end_and_looks_along_it():
    corridor = Map(name="corridor", bounds=shapely.box(0.0, 0.0, 400.0, 24.0))
    trial = trial_on(corridor, VINE)
    region = BaseRegion.of(trial, "border")
    found = search_poses(trial, Reach(buffer_mm=30.0, area="fast"), region, ERRORS, 6000)
    x, _, heading = found.pose
    inward = 0.0 if x < 200.0 else math.pi
    # The body is 300 mm and reaches 30 mm on: from a base 30 to 70 mm inside 360 mm are reached.
    assert 20.0 < min(x, 400.0 - x) < 80.0
    assert abs(math.remainder(heading - inward, 2.0 * math.pi)) < math.radians(20.0)
    assert found.estimate == pytest.approx(360.0 / 400.0, abs=0.02)


def test_border_poses_stand_beside_the_outer_walls_and_look_in():
    trial = trial_on(ROOM)
    region = BaseRegion.of(trial, "border")
    places = region.places_mm(10.0)
    free = trial.prepared.terrain.free_space()
    (outer,) = shapely.get_exterior_ring(shapely.get_parts(free))
    on_border = shapely.distance(outer, shapely.points(places)) < 1.01 * trial.radius_mm
    # All but the map's own start; the triangle stands in the middle, and no base beside it.
    assert np.count_nonzero(~on_border) == 1
    assert (places[~on_border] == [20.0, 100.0]).all()
    left = np.array([(trial.radius_mm, 50.0, angle) for angle in (0.0, 1.2, 2.0, math.pi, -1.2)])
    assert region.allow(left).tolist() == [True, True, False, False, True]
    start = np.array([(20.0, 100.0, math.pi)])
    assert region.allow(start).all()


@pytest.mark.parametrize(
    ("where", "named"),
    [
        ("leftt", "border, anywhere, starts"),
        ("area 95,70 110,75", "clear"),
        ("120,90,0", "inside an obstacle"),
        ("2,2,0", "room for the trunk"),
    ],
)
def test_a_region_without_room_is_refused_in_one_line(where, named):
    with pytest.raises(BadInputError, match=r"--where") as refused:
        BaseRegion.of(trial_on(ROOM), where)
    assert named in str(refused.value)


def test_a_map_too_narrow_for_the_trunk_is_refused():
    narrow = Map(name="narrow", bounds=shapely.box(0.0, 0.0, 300.0, 9.0))
    with pytest.raises(BadInputError, match=r"room for the trunk, 10\.2 mm wide"):
        BaseRegion.of(trial_on(narrow), "anywhere")


def test_starts_that_are_lines_areas_or_places_are_searched():
    def region_of(**spread):
        start = Start(pose=Pose(x_mm=60.0, y_mm=150.0, heading_rad=0.0), **spread)
        return BaseRegion.of(trial_on(replace(ROOM, starts=(start,))), "starts")

    assert region_of().places_mm(5.0).tolist() == [[60.0, 150.0]]
    line = region_of(spread_x_mm=10.0).places_mm(5.0)
    assert line[:, 0] == pytest.approx([52.5, 57.5, 62.5, 67.5])
    area = region_of(spread_x_mm=10.0, spread_y_mm=5.0).places_mm(5.0)
    assert len(area) == 8


def test_a_start_area_too_narrow_for_the_trunk_is_left_out():
    slit = shapely.box(0.0, 3.0, 300.0, 4.0)
    start = Start(pose=Pose(x_mm=50.0, y_mm=3.5, heading_rad=0.0), area=slit, clearance_mm=0.0)
    trial = trial_on(replace(ROOM, starts=(start,)))
    region = BaseRegion.of(trial, "border")
    assert region.starts.is_empty
    assert region.areas.is_empty
    with pytest.raises(BadInputError, match="room for the trunk"):
        BaseRegion.of(trial, "starts")


def test_starts_in_words_are_searched_and_keep_their_headings():
    region = BaseRegion.of(trial_on(ROOM), "left side, heading 10+-20")
    places = region.places_mm(10.0)
    assert (places[:, 0] == 15.0).all()
    assert np.degrees(region.headings_rad[[0, -1]]) == pytest.approx([-10.0, 30.0])
    turned = np.array([(15.0, 50.0, math.radians(angle)) for angle in (-12.0, -9.0, 29.0, 389.0)])
    assert region.allow(turned).tolist() == [False, True, True, True]
    found = search_poses(trial_on(ROOM), Reach(area="fast"), region, ERRORS, 1500)
    assert found.pose[0] == pytest.approx(15.0)
    assert math.radians(-10.1) < found.pose[2] < math.radians(30.1)


@pytest.mark.parametrize(("errors", "chosen"), [(1.9, 0.0), (2.1, 1.0)])
def test_a_later_search_must_be_better_by_two_errors_of_the_difference(monkeypatch, errors, chosen):
    """Scores of two poses at the same draws differ by 1 up or down, and by some errors of that."""
    unlike = np.resize([-1.0, 1.0], JUDGED_DRAWS)
    found = {0.0: np.zeros(JUDGED_DRAWS), 1.0: unlike + errors / math.sqrt(JUDGED_DRAWS)}
    trial = SimpleNamespace(scores=lambda _task, poses, *_: np.array([found[poses[0, 0]]]))
    monkeypatch.setattr(
        "vinefab.prediction.pose_search._search_from",
        lambda *given: (None, np.array([float(given[-1]), 0.0, 0.0])),
    )
    region = SimpleNamespace(words="anywhere")
    best = search_poses(trial, Reach(), region, ERRORS, 2 * FIRST_SEARCH)
    assert (best.starts, best.pose[0]) == (2, chosen)


def test_a_longer_search_contains_the_shorter_ones_and_keeps_the_best_of_them():
    """The poses of a search on 1,024 draws are no worse than those of any shorter one."""
    trial, task = trial_on(ROOM), Reach(buffer_mm=30.0, area="fast")
    region = BaseRegion.of(trial, "anywhere")
    draws = ERRORS.even(JUDGED_DRAWS)
    found = [search_poses(trial, task, region, ERRORS, most) for most in (5000, 9999, 20_000)]
    assert [one.starts for one in found] == [1, 1, 3]
    assert found[0].pose.tolist() == found[1].pose.tolist()
    means = [float(trial.scores(task, one.pose[None], draws).mean()) for one in found]
    assert means == sorted(means)
    assert [one.estimate for one in found] == pytest.approx(means)
    # Each search has a grid of its own.
    assert found[2].landscape.spacing_mm < found[0].landscape.spacing_mm
    assert found[2].deployments <= 20_000 * 1.3
