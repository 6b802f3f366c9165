"""The flag for branches that a real body may not follow: steep slides with a long body behind."""

import math

import pytest
from numpy.testing import assert_allclose
from shapely import box

from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import LONG_WIDTHS
from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose

ROOM = Terrain.of(Map(name="room", bounds=box(0.0, 0.0, 1000.0, 1000.0)))
WIDTH_MM = Build.standard(1).widths_mm[0]


def towards_the_ceiling(body_mm: float, steepness_deg: float, engine: str) -> Deployment:
    """Meet the ceiling with a straight body of some length, and slide 20 mm along it."""
    angle = math.radians(steepness_deg)
    pose = Pose(x_mm=300.0, y_mm=1000.0 - body_mm * math.sin(angle), heading_rad=angle)
    vine = Design(name="vine", trunk_length_mm=body_mm + 20.0, build=Build.standard(1))
    return grow_on(vine, ROOM, pose, GrowthOptions.published(), engine)


@pytest.mark.parametrize(
    ("widths", "steepness_deg", "flagged"),
    [
        (LONG_WIDTHS + 0.1, 70.0, True),
        (LONG_WIDTHS + 0.1, 61.0, True),
        (LONG_WIDTHS + 0.1, 60.0, False),
        (LONG_WIDTHS + 0.2, 60.0, False),
        (LONG_WIDTHS + 0.1, 59.0, False),
        (LONG_WIDTHS - 0.1, 70.0, False),
    ],
)
def test_only_steep_slides_with_long_bodies_are_flagged(engine, widths, steepness_deg, flagged):
    grown = towards_the_ceiling(widths * WIDTH_MM, steepness_deg, engine)
    assert_allclose(grown.points_mm[-1, 1], 1000.0)
    assert grown.tight_exit.tolist() == [flagged]


def test_a_body_that_stops_head_on_is_not_flagged(engine):
    grown = towards_the_ceiling(10.0 * WIDTH_MM, 89.5, engine)
    assert grown.tight_exit.tolist() == [False]


def test_a_deployment_made_without_flags_has_none_set():
    grown = towards_the_ceiling(10.0 * WIDTH_MM, 70.0, "kernel")
    parts = {name: getattr(grown, name) for name in ("tree", "pose", "points_mm", "first_point")}
    parts |= {name: getattr(grown, name) for name in ("stop", "grown_mm", "contact_turn_rad")}
    assert Deployment(**parts).tight_exit.tolist() == [False]
    with pytest.raises(ValueError, match="tight_exit"):
        Deployment(**parts, tight_exit=grown.tight_exit.repeat(2))
