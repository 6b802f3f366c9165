import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

from vinefab.rig.clean import bridged, pieces_of, snapped_union, thin_parts, touching_points

EVERYWHERE = box(-1000, -1000, 1000, 1000)


def test_touching_points_of_corners_edges_and_holes():
    corner_on_edge = [box(0, 0, 10, 10), Polygon([(10, 5), (20, 0), (20, 10)])]
    assert touching_points(snapped_union(pieces_of(*corner_on_edge))).tolist() == [[10, 5]]
    hole_on_shell = box(0, 0, 10, 10).difference(Polygon([(0, 5), (5, 3), (5, 7)]))
    assert touching_points(snapped_union(hole_on_shell)).tolist() == [[0, 5]]
    apart = pieces_of(box(0, 0, 1, 1), box(2, 2, 3, 3))
    assert touching_points(apart).shape == (0, 2)
    assert touching_points(pieces_of(Polygon())).shape == (0, 2)


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
    solid = pieces_of(box(0, 0, 10, 10), box(20, 0, 20.5, 10), Polygon([(40, 0), (60, 0), (40, 9)]))
    thin = thin_parts(solid, 0.8)
    assert len(thin) == 1
    assert thin[0].equals(solid[1])
    needle = Polygon([(0, 0), (100, -2), (100, 2)])
    (tip,) = thin_parts(pieces_of(needle), 0.8)
    # It is 0.8 mm wide at 20 mm; growing back with mitred corners wins 2 mm.
    assert tip.bounds[2] == pytest.approx(18.0, abs=0.1)
    assert len(thin_parts(pieces_of(Polygon()), 0.8)) == 0
