"""A design on unseen maps, and a case with closed forms."""

import pytest
import shapely

from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    unseen_maps,
)

SMALL = {"columns": 4, "rows": 4, "size_mm": 350.0}

PLAN = PredictionPlan(poses=2, seed=3)


@pytest.fixture(scope="session")
def few_unseen():
    """A number of unseen maps, and of other maps to choose on, that takes no long work."""
    return 6


@pytest.fixture(scope="module")
def on_few_maps(few_unseen):
    """The winners of runs are chosen and tried on few maps, not on seventy."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vinefab.prediction.run_winner.UNSEEN_DEPLOYMENTS", few_unseen)
        patch.setattr("vinefab.search.run.FRESH_MAPS", few_unseen)
        patch.setattr("vinefab.prediction.run_winner.FRESH_MAPS", few_unseen)
        yield


@pytest.fixture(scope="session")
def small_maps():
    return SMALL


@pytest.fixture(scope="session")
def few_poses():
    return PLAN


@pytest.fixture(scope="module")
def explorer():
    return Design.read("grid_explorer_levels")


@pytest.fixture(scope="module")
def result(explorer):
    return deploy_family(explorer, PreparedFamily.of(unseen_maps("grid", 5, 0, SMALL), PLAN), PLAN)


@pytest.fixture
def straight():
    """A plain vine in an empty room: everything about it has a closed form."""
    design = Design(name="v", trunk_length_mm=100.0, build=Build.standard(1, trunk_width_mm=20.0))
    start = Start(pose=Pose(x_mm=50.0, y_mm=100.0, heading_rad=0.0))
    world = Map(name="room", bounds=shapely.box(0, 0, 400, 200), starts=(start,))
    return design, MapFamily(label="room", worlds=(world,))
