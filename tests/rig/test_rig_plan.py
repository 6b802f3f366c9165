import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.model.map import Pose, Start
from vinefab.rig.build import build_rig
from vinefab.rig.part import RigOptions
from vinefab.rig.rig_plan import (
    TileSeam,
    bridged,
    cuts_of,
    patches_for,
    plan_of,
    polygon_parts,
    snapped_union,
    tabs_of,
    thin_parts,
    touching_points,
)


@pytest.fixture
def rig_of(make_printer, make_map):
    def make(*starts, obstacles=(), **options):
        return build_rig(
            make_map(*obstacles, starts=starts), make_printer(), RigOptions(wall_mm=0.0, **options)
        )

    return make


def _start(x_mm, y_mm, heading_deg):
    return Start(pose=Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=math.radians(heading_deg)))


def test_more_corners_than_a_printer_resolves_are_refused_at_once(make_map, make_printer):
    disc = Point(200, 150).buffer(80, quad_segs=6_000)
    with pytest.raises(BadInputError, match="--simplify-mm"):
        build_rig(make_map(disc), make_printer())


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
    rig = build_rig(world, make_printer(), RigOptions(wall_mm=0.0, entry_width_mm=30.0))
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


EVERYWHERE = box(-1000, -1000, 1000, 1000)


def test_touching_points_of_corners_edges_and_holes():
    corner_on_edge = [box(0, 0, 10, 10), Polygon([(10, 5), (20, 0), (20, 10)])]
    assert touching_points(snapped_union(polygon_parts(*corner_on_edge))).tolist() == [[10, 5]]
    hole_on_shell = box(0, 0, 10, 10).difference(Polygon([(0, 5), (5, 3), (5, 7)]))
    assert touching_points(snapped_union(hole_on_shell)).tolist() == [[0, 5]]
    apart = polygon_parts(box(0, 0, 1, 1), box(2, 2, 3, 3))
    assert touching_points(apart).shape == (0, 2)
    assert touching_points(polygon_parts(Polygon())).shape == (0, 2)


def test_bridges_join_what_touches():
    touching = snapped_union(MultiPolygon([box(0, 0, 10, 10), box(10, 10, 20, 20)]))
    joined, count = bridged(touching, EVERYWHERE, 0.4)
    assert count == 1
    assert len(joined) == 1
    # Half of an octagon (2 sqrt 2 r^2) is new, the other half lies in the two squares.
    new_mm2 = joined[0].area - 200.0
    assert new_mm2 == pytest.approx(2.0 * np.sqrt(2.0) * 0.16 / 2.0, rel=0.01)


def test_bridges_stay_within():
    touching = snapped_union(MultiPolygon([box(0, 0, 10, 10), box(10, 10, 20, 20)]))
    joined, _ = bridged(touching, box(0, 0, 10, 20), 0.4)
    assert shapely.union_all(joined).difference(shapely.union_all(touching)).bounds[2] <= 10.0


def test_thin_parts_are_found_and_corners_are_not():
    solid = polygon_parts(
        box(0, 0, 10, 10), box(20, 0, 20.5, 10), Polygon([(40, 0), (60, 0), (40, 9)])
    )
    thin = thin_parts(solid, 0.8)
    assert len(thin) == 1
    assert thin[0].equals(solid[1])
    needle = Polygon([(0, 0), (100, -2), (100, 2)])
    (tip,) = thin_parts(polygon_parts(needle), 0.8)
    # It is 0.8 mm wide at 20 mm; growing back with mitred corners wins 2 mm.
    assert tip.bounds[2] == pytest.approx(18.0, abs=0.1)
    assert len(thin_parts(polygon_parts(Polygon()), 0.8)) == 0


WALLS = {
    "between blocks": shapely.union_all(
        [box(30, 60, 50, 80), box(50, 70, 90, 70.5), box(90, 60, 110, 80)]
    ),
    "alone": box(0, 0, 40, 0.3),
    "bent": LineString([(0, 0), (30, 10), (35, 40)]).buffer(0.2, cap_style="flat"),
    "ring": Point(0, 0).buffer(20.0) - Point(0, 0).buffer(19.6),
    "hair": box(0, 0, 40, 0.06),
    "tapered": Polygon([(0, 0), (40, 0.2), (40, 2), (0, 0.4)]),
}


@pytest.mark.parametrize("wall", WALLS.values(), ids=WALLS)
def test_thin_walls_become_thick_enough_and_not_much_more(wall):
    pieces = polygon_parts(wall)
    thin, patches = patches_for(pieces, 0.8)
    assert len(thin) > 0
    thick = snapped_union(pieces, patches)
    # Wherever a point of the wall was too thin, a disc of nearly the wanted size now fits around
    # it; at its ends corners may be cut.
    opened = shapely.union_all(thick).buffer(-0.395).buffer(0.45)
    assert shapely.difference(shapely.union_all(thin), opened).area < 0.02 * wall.area
    # And nothing is thicker than needed: what was added lies within reach of the thin parts.
    reach = shapely.union_all(thin).buffer(0.62)
    assert reach.buffer(1e-3).covers(patches)
    assert shapely.union_all(thick).buffer(2e-3).covers(wall)


def test_a_straight_wall_gets_the_width_to_within_a_quarter():
    for thin_mm in np.arange(0.1, 0.8, 0.1):
        wall = box(0, 0, 50, thin_mm)
        thick = shapely.union_all([wall, patches_for(polygon_parts(wall), 0.8)[1]])
        middle_mm = thick.intersection(box(20, -5, 30, 5)).area / 10.0
        assert 0.8 <= middle_mm <= 1.0 + 1e-6


def test_what_is_thick_enough_stays():
    thin, patches = patches_for(polygon_parts(box(0, 0, 10, 0.8), box(0, 5, 10, 15)), 0.8)
    assert len(thin) == 0
    assert patches.is_empty


def test_tips_of_corners_stay_as_they_are():
    tip = Polygon([(0, 0), (40, 0), (40, 12)])
    assert len(thin_parts(polygon_parts(tip), 0.8)) == 0
    assert patches_for(polygon_parts(tip), 0.8)[1].is_empty


def _area(shape, heading_deg, x_mm, y_mm):
    pose = Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=math.radians(heading_deg))
    return Start(pose=pose, area=shape, clearance_mm=5.0)


@pytest.fixture
def planned(make_printer, make_map):
    """Plans a rig: what stands at some height, the plate and the notes, in map coordinates."""

    def plan(start, *obstacles, **options):
        world = make_map(*obstacles, starts=(start,))
        made = plan_of(world, make_printer(), RigOptions(style="plate", border_mm=5.0, **options))
        return made.on_map(shapely.union_all(made.solids)), made.on_map(made.plate), made.notes

    return plan


BELOW = LineString([(5, 17.5), (195, 17.5)])
"""Along the lower border."""


def test_a_line_along_the_border_has_an_opening_as_long_as_it_needs(planned):
    line = _area(LineString([(60, 30), (140, 30)]), 90, 100, 30)
    solid, _, notes = planned(line, entry_width_mm=20.0)
    assert 190.0 - solid.intersection(BELOW).length == pytest.approx(80.0 + 20.0, abs=0.01)
    assert notes == ("start 1: the border is open for its line or area: 100 mm",)


def test_each_free_piece_of_a_line_has_an_opening(planned):
    line = _area(LineString([(40, 30), (160, 30)]), 90, 60, 30)
    solid, _, notes = planned(line, box(70, 20, 130, 60), entry_width_mm=10.0)
    assert len(solid.intersection(BELOW).geoms) == 3
    assert "2 openings, 70 mm together" in notes[0]


def test_walls_beside_a_whole_side_stay(planned):
    line = _area(LineString([(25, 20), (25, 170)]), 0, 25, 95)
    solid, _, _ = planned(line, entry_width_mm=20.0)
    assert solid.covers(box(10.01, 15.01, 100, 19.99))
    assert not solid.intersects(box(5, 21, 14, 169))


def test_an_area_far_inside_has_an_entry_at_its_pose_only(planned):
    _, plate, notes = planned(_area(box(90, 90, 130, 110), 90, 100, 100), entry_width_mm=20.0)
    assert not plate.contains(Point(100, 100))
    assert plate.contains(Point(125, 100))
    assert "only its pose has an entry" in notes[0]
    assert "comes up from below" in notes[0]


# --- Cuts and joints


def test_cuts_go_between_obstacles_where_they_can(make_printer):
    # An alley at x = 170..178; the even cut at x = 150 would divide an obstacle.
    solids = polygon_parts(box(100, 10, 170, 90), box(178, 10, 260, 90))
    cuts = cuts_of((0, 0, 300, 100), solids, make_printer(), RigOptions())
    assert len(list(cuts.cells())) == 2
    assert 172 <= cuts.x_mm[1] <= 176
    assert cuts.y_mm == (0, 100)


def test_cuts_keep_away_from_corners(make_printer):
    # Every line divides the long obstacle; the even one would also cut off a thin tip.
    solids = polygon_parts(box(10, 10, 290, 30), box(149, 50, 250, 80))
    cuts = cuts_of((0, 0, 300, 100), solids, make_printer(), RigOptions())
    assert cuts.x_mm[1] < 147


def test_tiles_never_exceed_the_bed(make_printer):
    rng = np.random.default_rng(6)
    solids = polygon_parts(*(box(x, 1, x + 30, 50) for x in rng.uniform(0, 2000, 40)))
    for width in rng.uniform(211, 2000, 40):
        cuts = cuts_of((0, 0, width, 60), solids, make_printer(), RigOptions(bed_margin_mm=5.0))
        sizes = np.diff(cuts.x_mm)
        assert sizes.max() <= 202.0 + 1e-3
        assert len(list(cuts.cells())) == np.ceil(width / 202.0)


def test_tabs_stand_free_and_apart():
    plate = box(0, 0, 400, 300)
    solids = polygon_parts(box(195, 60, 230, 110), box(150, 160, 215, 200))
    seam = TileSeam(upright=True, at_mm=200.0, low_mm=0.0, high_mm=300.0)
    tabs = tabs_of(seam, plate, shapely.STRtree(solids))
    assert len(tabs) == 3
    for tab in tabs:
        assert tab.bounds[0] == 200.0
        assert tab.bounds[2] == 208.0
        assert tab.distance(shapely.union_all(solids)) >= 2.0
        assert tab.is_valid
    gaps = [one.distance(other) for one, other in pairwise(tabs)]
    assert min(gaps) > 4.0


def test_no_tab_where_there_is_no_room():
    seam = TileSeam(upright=False, at_mm=50.0, low_mm=0.0, high_mm=200.0)
    full = shapely.STRtree(polygon_parts(box(0, 40, 200, 60)))
    assert tabs_of(seam, box(0, 0, 200, 100), full) == []
    empty = shapely.STRtree([])
    assert tabs_of(seam, box(0, 0, 200, 52), empty) == []  # the plate ends just behind the seam
    short = TileSeam(upright=False, at_mm=50.0, low_mm=0.0, high_mm=30.0)
    assert tabs_of(short, box(0, 0, 200, 100), empty) == []
