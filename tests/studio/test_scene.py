"""The open map made ready: obstacles far from a robot cost nothing, and change nothing."""

import numpy as np
import pytest

from vinefab.growth.simulator import grow_on
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_content
from vinefab.studio.live_answers import grown, prepared_map
from vinefab.studio.state import Frame, StudioState

SOURCE = {
    "environment": "grid",
    "seed": 3,
    "options": {"columns": 23, "rows": 22, "size_mm": 2000.0},
}


def opened(name, pose, edits=()):
    x_mm, y_mm, heading_deg = pose
    return StudioState.of(
        {
            "design": design_content(Design.read(name)),
            "map": {"source": SOURCE, "edits": list(edits)},
            "pose": {"x_mm": x_mm, "y_mm": y_mm, "heading_deg": heading_deg},
        }
    )


@pytest.mark.parametrize("name", ["grid_explorer", "three_level_tree", "plain_vine"])
@pytest.mark.parametrize(
    "pose", [(1000.0, 15.0, 90.0), (18.0, 956.5, 10.0), (1980.0, 1890.0, 220.0)]
)
def test_a_robot_grows_as_on_the_whole_map(name, pose):
    state = opened(name, pose)
    whole = prepared_map(state)
    deployment, terrain = grown(state, state.start)
    wanted = grow_on(state.grown_now, whole.terrain, state.start, state.growth)
    assert np.array_equal(deployment.points_mm, wanted.points_mm)
    assert np.array_equal(deployment.stop, wanted.stop)
    assert len(state.world.obstacles) == 506
    assert len(terrain.world.obstacles) < 300


def test_a_far_obstacle_that_is_moved_costs_no_walls():
    state = opened("grid_explorer", (1000.0, 15.0, 90.0))
    _, terrain = grown(state, state.start)
    moved = opened("grid_explorer", (1000.0, 15.0, 90.0), [["move", 505, 4.0, 3.0]])
    assert moved.world.obstacles[505] != state.world.obstacles[505]
    assert grown(moved, moved.start)[1] is terrain
    near = opened("grid_explorer", (1000.0, 15.0, 90.0), [["move", 11, 4.0, 3.0]])
    assert grown(near, near.start)[1] is not terrain


def test_an_obstacle_is_placed_by_its_frame():
    state = opened("plain_vine", (1000.0, 15.0, 90.0))
    first = state.ground.frame(7)
    placed = Frame(x_mm=300.0, y_mm=400.0, width_mm=50.0, height_mm=20.0, turn_deg=70.0)
    edits = [["place", 7, placed.content], ["move", 7, 10.0, 0.0], ["remove", 3]]
    ground = opened("plain_vine", (1000.0, 15.0, 90.0), edits).ground
    shape, frame = ground.world.obstacles[6], ground.frame(6)
    assert frame == placed.moved(10.0, 0.0)
    share = placed.width_mm * placed.height_mm / (first.width_mm * first.height_mm)
    assert shape.area == pytest.approx(state.world.obstacles[7].area * share)
    assert Frame.around(shape).content == pytest.approx(
        {**frame.content, "width_mm": 20.0, "height_mm": 50.0, "turn_deg": -20.0}
    )
