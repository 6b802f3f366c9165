import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.maps.cleanup.drawn_shapes import (
    Changes,
    SourceFrame,
    ring_polygons,
    without_repeats,
)


def repaired(points, sliver_mm2=1e-4, frame=None):
    changes = Changes(frame or SourceFrame())
    return ring_polygons(np.array(points, dtype=float), "ring 7", sliver_mm2, changes), changes


def test_a_bridge_to_a_hole_becomes_a_hole():
    found, _ = repaired(
        [(0, 0), (9, 0), (9, 9), (0, 9), (0, 3), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3), (0, 3)]
    )
    assert [(polygon.area, len(polygon.interiors)) for polygon in found] == [(72.0, 1)]


LOOP = np.array([(0, 0), (6, 0), (6, 4), (2, 4), (2, -2), (4, -2), (4, 6), (0, 6)], dtype=float)
"""Encloses 2 x 4 twice."""


def test_what_is_enclosed_twice_is_inside_and_said():
    found, changes = repaired(LOOP)
    assert sum(polygon.area for polygon in found) == pytest.approx(36.0)
    assert changes.counts == {
        "self_crossings_repaired": 1,
        "enclosed_twice_inside_by_nonzero_mm2": 8.0,
    }


def test_what_is_enclosed_twice_is_outside_where_the_source_says_even_odd():
    changes = Changes(SourceFrame())
    found = ring_polygons(LOOP, "ring 7", 1e-4, changes, even_odd=True)
    assert sum(polygon.area for polygon in found) == pytest.approx(28.0)
    assert changes.counts["enclosed_twice_outside_by_even_odd_mm2"] == 8.0


def test_a_tiny_double_loop_is_not_worth_a_word():
    found, changes = repaired(LOOP * 1e-3, sliver_mm2=1e-4)
    assert sum(polygon.area for polygon in found) < 1e-4
    assert not any("twice" in name for name in changes.counts)


def test_slivers_go_and_long_ones_are_refused():
    found, changes = repaired([(0, 0), (0.01, 0), (0, 0.01)])
    assert found == []
    assert changes.counts["slivers_dropped"] == 1
    with pytest.raises(BadInputError, match="an outline 50 mm long has no area"):
        repaired([(0, 0), (50, 0), (0, 0)])


def test_repeated_points_go():
    changes = Changes(SourceFrame())
    points = np.array([(0, 0), (0, 0), (1, 0), (1, 1e-9), (1, 1), (0, 0)], dtype=float)
    assert len(without_repeats(points, changes)) == 4
    assert changes.counts == {"duplicate_points_removed": 2}


def winding_number(spot, ring):
    """How often a ring turns around a point: the sum of the angles that its sides span."""
    away = (ring - spot) @ (1.0, 1.0j)
    return round(float(np.angle(away[1:] / away[:-1]).sum()) / (2.0 * np.pi))


@pytest.mark.parametrize("even_odd", [False, True])
@given(st.integers(0, 10**6), st.integers(4, 12))
def test_repair_agrees_with_winding_numbers(even_odd, seed, corners):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 10, (corners, 2))
    spots = rng.uniform(0, 10, (100, 2))
    found = ring_polygons(points, "a ring", 1e-6, Changes(SourceFrame()), even_odd=even_odd)
    ring = np.vstack([points, points[:1]])
    turns = np.array([winding_number(spot, ring) for spot in spots])
    near = shapely.dwithin(shapely.points(spots), shapely.LinearRing(ring), 2e-3)
    inside = shapely.intersects(shapely.union_all(found or [Polygon()]), shapely.points(spots))
    wanted = turns % 2 == 1 if even_odd else turns != 0
    assert (inside[~near] == wanted[~near]).all()
    assert all(polygon.is_valid for polygon in found)
