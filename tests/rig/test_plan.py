import math

import pytest
from shapely import LineString, Point, box

from vinefab.model.map import Pose, Start
from vinefab.rig.options import RigOptions
from vinefab.rig.plate import build_rig


@pytest.fixture
def rig_of(make_printer, make_map):
    def make(*starts, obstacles=(), **options):
        return build_rig(make_map(*obstacles, starts=starts), make_printer(), RigOptions(**options))

    return make


def _start(x_mm, y_mm, heading_deg):
    return Start(pose=Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=math.radians(heading_deg)))


def test_the_border_is_open_behind_a_start(rig_of, up_start, faces_at):
    rig = rig_of(up_start(100, 35), entry_width_mm=30.0, border_mm=5.0)
    top = faces_at(rig, 30.0)
    below = top.intersection(LineString([(5, 17.5), (195, 17.5)]))
    assert 190.0 - below.length == pytest.approx(30.0)
    assert not top.intersects(box(85.01, 14, 114.99, 21))
    assert faces_at(rig, 0.0).contains(box(85.1, 15.1, 114.9, 30))  # the plate goes on below
    assert rig.notes == ()


def test_the_opening_takes_the_starts_spread(rig_of, up_start, faces_at):
    rig = rig_of(up_start(100, 35, spread_x_mm=10.0), entry_width_mm=30.0)
    gap = LineString([(5, 18), (195, 18)]).difference(faces_at(rig, 30.0))
    assert gap.bounds[0] <= 75.001
    assert gap.length == pytest.approx(50.0 + 2.0, abs=2.1)


@pytest.mark.parametrize(
    ("start", "hole"),
    [
        (_start(25, 95, 0), (8, 95)),
        (_start(175, 95, 180), (192, 95)),
        (_start(100, 155, -90), (100, 172)),
        (_start(100, 20, 90), (100, 18)),  # on the bounds
    ],
)
def test_any_side_may_be_opened(rig_of, faces_at, start, hole):
    top = faces_at(rig_of(start, entry_width_mm=20.0), 30.0)
    assert not top.intersects(Point(hole).buffer(8.0))
    others = [(8, 95), (192, 95), (100, 172), (100, 18)]
    assert sum(top.intersects(Point(other).buffer(1.0)) for other in others) == 3


def test_a_slanted_start_opens_along_its_heading(rig_of, faces_at):
    rig = rig_of(_start(100, 35, 60), entry_width_mm=20.0)
    top = faces_at(rig, 30.0)
    back = LineString([(100, 35), (100 - 40 * math.cos(1.0472), 35 - 40 * math.sin(1.0472))])
    assert not top.intersects(back.buffer(9.9, cap_style="flat"))
    assert not top.intersects(Point(100 - 15 / math.tan(1.0472) - 1, 18))


def test_the_wall_beside_a_start_in_a_corner_stays(rig_of, up_start, faces_at):
    top = faces_at(rig_of(up_start(25, 35), entry_width_mm=20.0), 30.0)
    assert top.contains(box(6.1, 25, 9.9, 160))


def test_the_wall_of_the_next_room_stays(make_map, make_printer, up_start, faces_at):
    hall = box(0, 60, 150, 100).union(box(0, -40, 150, 20)).union(box(110, -40, 150, 100))
    world = make_map(bounds=hall, starts=(up_start(50, 75),))
    rig = build_rig(world, make_printer(), RigOptions(entry_width_mm=30.0))
    top = faces_at(rig, 30.0)
    assert not top.intersects(box(35.1, 55, 64.9, 61))
    assert top.contains(box(10, 20.1, 90, 23.9))


def test_a_start_far_inside_has_a_hole_in_the_plate(rig_of, up_start, faces_at):
    rig = rig_of(up_start(100, 100), entry_width_mm=30.0)
    floor = faces_at(rig, 0.0)
    assert not floor.intersects(Point(100, 100).buffer(14.5))
    assert floor.contains(Point(100, 100).buffer(16).boundary)
    assert faces_at(rig, 30.0).contains(box(6.1, 16.1, 193.9, 19.9))
    assert "hole in the plate" in rig.notes[0]


def test_no_room_for_a_hole_is_said(rig_of, up_start, faces_at):
    rig = rig_of(up_start(100, 100), obstacles=(box(60, 105, 140, 120),), entry_width_mm=30.0)
    assert faces_at(rig, 0.0).contains(Point(100, 100))
    assert "no entry is made" in rig.notes[0]


def test_an_obstacle_in_the_way_is_said(rig_of, up_start):
    rig = rig_of(up_start(100, 45), obstacles=(box(105, 25, 120, 35),), entry_width_mm=30.0)
    assert "narrow the way" in rig.notes[0]


def test_no_width_no_entry(rig_of, up_start, faces_at):
    rig = rig_of(up_start(100, 35), entry_width_mm=0.0)
    assert faces_at(rig, 30.0).contains(box(6.1, 16.1, 193.9, 19.9))


def test_two_starts_two_openings(rig_of, up_start, faces_at):
    rig = rig_of(up_start(60, 35), up_start(140, 35), entry_width_mm=30.0, border_mm=5.0)
    below = faces_at(rig, 30.0).intersection(LineString([(5, 17.5), (195, 17.5)]))
    assert 190.0 - below.length == pytest.approx(60.0)
    assert len(below.geoms) == 3
