import pytest
import shapely
from shapely import Polygon, box

from vinefab.maps.cleanup.assemble import merged, painted, repeats, solids
from vinefab.maps.cleanup.drawn_shapes import Changes, SourceFrame


def square(middle, half):
    return box(middle[0] - half, middle[1] - half, middle[0] + half, middle[1] + half)


@pytest.fixture
def changes():
    return Changes(SourceFrame())


def test_even_odd_from_the_outside_in(changes):
    rings = [square((0, 0), half) for half in (1, 3, 2, 4)]
    found = solids(rings, changes)
    assert sorted(p.area for p in found) == [16 - 4, 64 - 36]
    assert changes.counts == {"nested_outlines_made_holes": 2}


def test_a_notch_is_not_taken_for_a_hole(changes):
    found = solids([box(0, 0, 10, 10), box(0, 4, 2, 6)], changes)
    assert shapely.union_all(found).area == 100.0
    assert "nested_outlines_made_holes" not in changes.counts


def test_rooms_that_overlap_stay_solid_and_are_counted(changes):
    found = solids([box(0, 0, 20, 10), box(2, 2, 8, 8), box(6, 4, 14, 9)], changes)
    assert [p.area for p in found] == [200.0]
    assert changes.counts == {"nested_outlines_left_solid": 2}


def test_an_outline_in_the_overlap_of_two_stays_solid(changes):
    found = solids([box(0, 0, 10, 10), box(5, 0, 15, 10), box(6, 4, 8, 6)], changes)
    assert shapely.union_all(found).area == 150.0
    assert changes.counts == {"nested_outlines_left_solid": 1}


def test_islands_of_one_fill_that_overlap_count_together():
    area = painted([box(0, 0, 20, 10), box(2, 2, 8, 8), box(6, 4, 14, 9), box(3, 3, 4, 4)])
    assert area.area == 200 - (36 + 40 - 8) + 1


def test_repeats_are_found_turned_shifted_and_reversed():
    one = Polygon([(0, 0), (10, 0), (10, 5), (0, 5)])
    turned = Polygon([(10, 5), (10.05, 0), (0, 0), (0, 2), (0, 5)])
    assert repeats([one, turned, square((0, 0), 1)], 0.1).tolist() == [False, True, False]
    assert not repeats([one, turned], 0.01).any()


def test_overlaps_merge_and_the_rest_is_untouched(changes):
    far = Polygon([(50.1, 0.3), (60, 0), (55, 9)])
    found = merged([box(0, 0, 10, 10), far, box(5, 5, 15, 15), box(15, 5, 20, 15)], 0.1, changes)
    assert sorted(p.area for p in found) == pytest.approx([far.area, 100 + 100 - 25 + 50])
    assert any(p is far for p in found)
    assert changes.counts == {"overlapping_obstacles_merged": 3}


def test_narrow_gaps_close_and_wide_ones_stay(changes):
    found = merged([box(0, 0, 10, 10), box(10.05, 0, 20, 10), box(20.2, 0, 30, 10)], 0.1, changes)
    assert sorted(p.area for p in found) == pytest.approx([98.0, 200.0], abs=1e-9)
    assert changes.counts["gaps_between_obstacles_closed"] == 1


def test_corners_that_touch_stay_apart(changes):
    found = merged([box(0, 0, 1, 1), box(1, 1, 2, 2)], 0.0, changes)
    assert [p.area for p in found] == [1.0, 1.0]
    assert changes.counts == {}
