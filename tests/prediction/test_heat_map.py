from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.core.view import document
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose, Start
from vinefab.model.tree import branch_tree
from vinefab.pages.plan import body_cells
from vinefab.prediction.family_deployments import (
    HeatMap,
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    StuckSpot,
    deploy_family,
    heat_blocks,
    heat_map_of,
    stuck_spots,
)
from vinefab.tasks.evaluate import PreparedMap


def test_heat_counts_bodies_as_large_as_they_inflate(straight):
    design, family = straight
    prepared = PreparedFamily.of(family, PredictionPlan(poses=1))
    result = deploy_family(design, prepared, PredictionPlan(poses=1))
    cell_mm = 0.5
    cells = body_cells(result.deployments[0], (20.0,), (0.0, 0.0), cell_mm, (400, 800))
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
