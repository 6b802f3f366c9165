"""Scores of designs over maps and poses, and their composition."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose, Start
from vinefab.tasks import make_task
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import (
    PreparedMap,
    composite,
    composites,
    poses_on,
    score_design,
)
from vinefab.tasks.map_context import MapContext

# --- Evaluations -----------------------------------------------------------------------------

UP = Pose(x_mm=500.0, y_mm=100.0, heading_rad=math.pi / 2)
VINE = Design(name="vine", trunk_length_mm=400.0, build=Build.standard(1))


def test_a_plain_vine_in_the_open_scores_what_its_disc_sees(room: Map) -> None:
    task = Coverage(radius_mm=50.0, most_diagonals=1.0)
    score = score_design(VINE, [PreparedMap.of(room)], ((UP,),), task, GrowthOptions.published())
    (evaluation,) = score.evaluations
    expected = math.pi * 50.0**2 / 1e6 - 0.1 * 400.0 / math.hypot(1000.0, 1000.0)
    assert evaluation.score == pytest.approx(expected, rel=1e-9)
    assert (evaluation.map_name, evaluation.pose) == ("room", UP)
    assert score.composite["mean"] == evaluation.score


def test_evaluations_go_map_by_map_and_pose_by_pose(room: Map, pillar_room: Map) -> None:
    start = Start(pose=Pose(x_mm=50.0, y_mm=50.0, heading_rad=1.0), spread_heading_rad=0.5)
    sites = [PreparedMap.of(replace(world, starts=(start,))) for world in (room, pillar_room)]
    poses = poses_on(sites, 3, (7, 8))
    score = score_design(VINE, sites, poses, make_task("reach"))
    assert [e.map_name for e in score.evaluations] == ["room"] * 3 + ["pillars"] * 3
    assert [e.pose for e in score.evaluations] == [*poses[0], *poses[1]]
    assert score.task == "reach"
    assert score_design(VINE, sites, poses, make_task("reach")) == score


def test_growth_options_are_used(room: Map) -> None:
    # 70 degrees to the ceiling's tangent: 20 degrees off its normal.
    steep = Pose(x_mm=500.0, y_mm=800.0, heading_rad=math.radians(70.0))
    task = make_task("reach")
    slid, stopped = (
        score_design(
            VINE,
            [PreparedMap.of(room)],
            ((steep,),),
            task,
            GrowthOptions.published(head_on_half_angle_rad=math.radians(angle_deg)),
        ).evaluations[0]
        for angle_deg in (1.0, 30.0)
    )
    assert slid.terms["grown_mm"] == pytest.approx(400.0)
    assert stopped.terms["grown_mm"] == pytest.approx(200.0 / math.sin(math.radians(70.0)))


def test_a_map_without_free_space_is_refused(room: Map) -> None:
    with pytest.raises(BadInputError, match="free space"):
        MapContext.of(replace(room, obstacles=(room.bounds,)))


# --- Composition -----------------------------------------------------------------------------

SCORES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20)


def test_the_three_ways_on_numbers_done_by_hand() -> None:
    values = composite([0.2, 0.4, 0.6])
    deviation = (0.08 / 3) ** 0.5
    assert values["mean"] == pytest.approx(0.4)
    assert values["best"] == 0.6
    assert values["min_deviation"] == pytest.approx(0.25 * 0.4 + 0.75 * (1 - deviation / 0.5))


@given(SCORES)
def test_order_does_not_matter_and_bounds_hold(scores: list[float]) -> None:
    values = composite(scores)
    assert values == pytest.approx(composite(scores[::-1]))
    assert min(scores) - 1e-12 <= values["mean"] <= values["best"] + 1e-12
    assert 0.0 <= values["min_deviation"] <= 1.0 + 1e-12


def test_wide_scores_earn_nothing_for_steadiness() -> None:
    assert composite([0.0, 100.0])["min_deviation"] == pytest.approx(0.25 * 50.0)


@given(
    st.lists(SCORES, min_size=1, max_size=5).map(lambda r: [row[: min(map(len, r))] for row in r])
)
def test_many_rows_are_weighed_as_each_alone(rows: list[list[float]]) -> None:
    for kind in ("mean", "best", "min_deviation", "single"):
        alone = [composite(row, 0.3)["mean" if kind == "single" else kind] for row in rows]
        assert composites(np.array(rows), kind, 0.3).tolist() == alone


def test_places_of_a_line_do_not_depend_on_which_obstacles_are_looked_at() -> None:
    for words in ("left side, heading 0+-9", "area 60,60 240,200, clear 5", "250,15,90+-5"):
        world = grid_map(5).with_start(words)
        (poses,) = poses_on([PreparedMap.of(world)], 20, [3])
        exact = draw_poses(world, 20, 3)
        assert len(poses) == 20
        for one, two in zip(poses, exact, strict=True):
            apart_mm = math.hypot(one.x_mm - two.x_mm, one.y_mm - two.y_mm)
            assert apart_mm < 1e-6
            assert one.heading_rad == two.heading_rad
