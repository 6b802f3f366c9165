from itertools import pairwise

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box

from vinefab.rig.part import RigOptions
from vinefab.rig.rig_plan import Edges, TileSeam, cuts_of, polygon_parts, tabs_of


def test_length_of_a_line_in_solids_is_what_shapely_says():
    rng = np.random.default_rng(5)
    shapes = [
        box(x, y, x + w, y + 9).difference(box(x + 2, y + 2, x + 0.5 * w, y + 5))
        for x, y, w in zip(
            rng.uniform(0, 80, 12), np.arange(0, 120, 10), rng.uniform(6, 20, 12), strict=True
        )
    ]
    shapes.append(Polygon([(0, 130), (50, 150), (100, 131), (50, 180)]))
    solids = polygon_parts(*shapes)
    edges = Edges.of(solids)
    lines = rng.uniform(-5, 105, 40)
    union = shapely.union_all(solids)
    wanted = [union.intersection(LineString([(x, -9), (x, 200)])).length for x in lines]
    assert [edges.length_mm(x) for x in lines] == pytest.approx(wanted)
    wanted = [union.intersection(LineString([(-9, y), (200, y)])).length for y in lines]
    assert [edges.turned().length_mm(y) for y in lines] == pytest.approx(wanted)


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
