import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon, box

from vinefab.rig.clean import patches_for, pieces_of, snapped_union, thin_parts

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
    pieces = pieces_of(wall)
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
        thick = shapely.union_all([wall, patches_for(pieces_of(wall), 0.8)[1]])
        middle_mm = thick.intersection(box(20, -5, 30, 5)).area / 10.0
        assert 0.8 <= middle_mm <= 1.0 + 1e-6


def test_what_is_thick_enough_stays():
    thin, patches = patches_for(pieces_of(box(0, 0, 10, 0.8), box(0, 5, 10, 15)), 0.8)
    assert len(thin) == 0
    assert patches.is_empty


def test_tips_of_corners_stay_as_they_are():
    tip = Polygon([(0, 0), (40, 0), (40, 12)])
    assert len(thin_parts(pieces_of(tip), 0.8)) == 0
    assert patches_for(pieces_of(tip), 0.8)[1].is_empty
