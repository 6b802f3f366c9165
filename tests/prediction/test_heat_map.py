import numpy as np
import pytest

from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design
from vinefab.model.map import Pose
from vinefab.model.tree import branch_tree
from vinefab.prediction.family_deployments import PredictionPlan, PreparedFamily, deploy_family
from vinefab.prediction.heat_map import body_cells, heat_map_of, stuck_spots


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
