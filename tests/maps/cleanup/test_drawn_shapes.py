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
    winding_numbers,
    without_repeats,
)


def repaired(points, sliver_mm2=1e-4, frame=None):
    changes = Changes(frame or SourceFrame())
    return ring_polygons(np.array(points, dtype=float), "ring 7", sliver_mm2, changes), changes


def test_a_bow_tie_becomes_its_two_lobes():
    found, changes = repaired([(0, 0), (4, 4), (4, 0), (0, 4)])
    assert [polygon.area for polygon in found] == [4.0, 4.0]
    assert changes.counts == {"self_crossings_repaired": 1}


def test_a_bridge_to_a_hole_becomes_a_hole():
    found, _ = repaired(
        [(0, 0), (9, 0), (9, 9), (0, 9), (0, 3), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3), (0, 3)]
    )
    assert [(polygon.area, len(polygon.interiors)) for polygon in found] == [(72.0, 1)]


def test_a_spike_vanishes():
    found, changes = repaired([(0, 0), (4, 0), (4, 2), (9, 2), (4, 2), (4, 4), (0, 4)])
    assert [polygon.area for polygon in found] == [16.0]
    assert "self_crossings_repaired" in changes.counts


def test_what_is_enclosed_twice_is_refused_with_its_place_in_the_source():
    loop = [(0, 0), (6, 0), (6, 4), (2, 4), (2, -2), (4, -2), (4, 6), (0, 6)]
    frame = SourceFrame(scale_mm_per_unit=1000.0, x=500_000.0, y=5_250_000.0)
    with pytest.raises(BadInputError, match=r"ring 7 at \(50000.*twice") as caught:
        repaired(np.array(loop) * 1000.0, frame=frame)
    assert "enclose each place once" in caught.value.allowed


def test_a_tiny_double_loop_is_no_reason_to_refuse():
    loop = np.array([(0, 0), (6, 0), (6, 4), (2, 4), (2, -2), (4, -2), (4, 6), (0, 6)])
    found, _ = repaired(loop * 1e-3, sliver_mm2=1e-4)
    assert sum(polygon.area for polygon in found) < 1e-4


def test_slivers_go_and_long_ones_are_refused():
    found, changes = repaired([(0, 0), (0.01, 0), (0, 0.01)])
    assert found == []
    assert changes.counts["slivers_dropped"] == 1
    with pytest.raises(BadInputError, match="without area, 50 mm long"):
        repaired([(0, 0), (50, 0), (0, 0)])


def test_repeated_points_go():
    changes = Changes(SourceFrame())
    points = np.array([(0, 0), (0, 0), (1, 0), (1, 1e-9), (1, 1), (0, 0)], dtype=float)
    assert len(without_repeats(points, changes)) == 4
    assert changes.counts == {"duplicate_points_removed": 2}


@given(st.integers(0, 10**6), st.integers(4, 12))
def test_repair_agrees_with_the_even_odd_rule(seed, corners):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 10, (corners, 2))
    spots = rng.uniform(0, 10, (200, 2))
    try:
        found, _ = repaired(points, sliver_mm2=1e-6)
    except BadInputError as error:
        assert "twice" in str(error)  # noqa: PT017  either outcome is right, neither is silent
        return
    ring = np.vstack([points, points[:1]])
    turns = winding_numbers(shapely.points(spots), ring)
    near = shapely.dwithin(shapely.points(spots), shapely.LinearRing(ring), 1e-3)
    inside = shapely.intersects(shapely.union_all(found or [Polygon()]), shapely.points(spots))
    assert (inside[~near] == (turns % 2 == 1)[~near]).all()
    assert all(polygon.is_valid for polygon in found)
