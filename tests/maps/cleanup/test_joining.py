import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from vinefab.maps.cleanup.drawn_shapes import Changes, Line, SourceFrame, chained, join, walls_along


def line(*points, where="line"):
    return Line(points_mm=np.array(points, dtype=np.float64), where=where)


def changes():
    return Changes(SourceFrame())


def soup(polygons, rng, gap_mm):
    """Return the edges of polygons, shuffled, reversed, their ends moved apart."""
    lines = []
    for polygon in polygons:
        points = shapely.get_coordinates(polygon.exterior)
        for a, b in pairwise(points):
            # Half the gap at each end keeps two ends within the gap of each other.
            moved = [p + 0.5 * gap_mm * rng.uniform(-0.7, 0.7, 2) for p in (a, b)]
            lines.append(line(*(moved[::-1] if rng.random() < 0.5 else moved)))
    return [lines[k] for k in rng.permutation(len(lines))]


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 12), st.sampled_from([0.0, 0.05]))
def test_polygons_come_back_from_a_soup_of_lines(seed, count, gap_mm):
    rng = np.random.default_rng(seed)
    polygons = []
    for k in range(count):
        corners = int(rng.integers(3, 15))
        angles = (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) * math.tau / corners
        radii = rng.uniform(5.0, 9.0, corners)[:, None]
        round_mm = radii * np.column_stack([np.cos(angles), np.sin(angles)])
        polygons.append(Polygon(round_mm + np.array([20.0 * k, 0.0])))
    noted = changes()
    joined = join(soup(polygons, rng, gap_mm), 0.1, noted)
    assert joined.open == []
    found = sorted((Polygon(ring.points_mm) for ring in joined.rings), key=lambda p: p.centroid.x)
    assert len(found) == len(polygons)
    for one, other in zip(found, polygons, strict=True):
        assert one.symmetric_difference(other).area <= gap_mm * other.length
    assert noted.counts.get("largest_gap_joined_mm", 0.0) <= 0.1
    if gap_mm == 0.0:
        assert noted.counts == {}


def test_fine_lines_shorter_than_the_gap_are_not_swallowed():
    angles = np.linspace(0.0, math.tau, 2001)
    points = np.column_stack([np.cos(angles), np.sin(angles)])
    points[-1] = points[0]
    pieces = [line(a, b) for a, b in pairwise(points)]
    (ring,) = join(pieces, 0.1, changes()).rings
    assert len(ring.points_mm) == 2001
    assert Polygon(ring.points_mm).area == pytest.approx(math.pi, rel=1e-5)


@given(st.permutations(range(5)), st.lists(st.booleans(), min_size=5, max_size=5))
def test_a_chain_begins_and_runs_as_its_first_line_and_has_its_name(order, turned):
    corners = [(0, 0), (4, 0), (5, 3), (2, 5), (-1, 3)]
    sides = [(corners[k], corners[(k + 1) % 5]) for k in range(5)]
    lines = [line(*(sides[k][::-1] if turned[k] else sides[k]), where=f"side {k}") for k in order]
    (ring,) = join(lines, 0.1, changes()).rings
    assert ring.points_mm[:2].tolist() == lines[0].points_mm.tolist()
    assert ring.where == lines[0].where
    (chain,) = chained([one for one in lines if one.where != "side 4"], 0.1, changes())
    assert sorted(map(tuple, chain.points_mm[[0, -1]].tolist())) == [(-1, 3), (0, 0)]
    assert chain.where in ("side 0", "side 3")


def test_the_nearest_ends_are_joined_and_the_gap_is_noted():
    noted = changes()
    (joined,) = chained([line((0, 0), (1, 0)), line((1.05, 0), (2, 0))], 0.1, noted)
    assert joined.points_mm[[0, -1]].tolist() == [[0, 0], [2, 0]]
    assert noted.counts == {"gaps_joined": 1, "largest_gap_joined_mm": pytest.approx(0.05)}
    assert len(chained([line((0, 0), (1, 0)), line((1.2, 0), (2, 0))], 0.1, changes())) == 2


def test_repeated_lines_count_once():
    square = [line(a, b) for a, b in (((0, 0), (1, 0)), ((1, 0), (1, 1)), ((1, 1), (0, 0)))]
    noted = changes()
    again = [line(*one.points_mm[::-1]) for one in square]
    (ring,) = join(square + again, 0.01, noted).rings
    assert Polygon(ring.points_mm).area == 0.5
    assert noted.counts == {"repeated_lines_removed": 3}


def test_lines_that_overshoot_or_stop_short_make_one_ring():
    noted = changes()
    lines = [
        line((-0.05, 0), (10.05, 0)),
        line((10, -0.05), (10, 5.05)),
        line((9.96, 5), (0.04, 5)),
        line((0, 0.04), (0, 5.05)),
    ]
    joined = join(lines, 0.1, noted)
    assert joined.open == []
    (ring,) = joined.rings
    assert Polygon(ring.points_mm).area == pytest.approx(50.0, abs=1e-3)
    assert noted.counts["largest_gap_joined_mm"] <= 0.1


def test_what_stays_open_is_returned_with_its_name():
    square = line((0, 0), (4, 0), (4, 4), (0, 4), (0, 0))
    joined = join([square, line((6, 0), (9, 0), where="LINE 7")], 0.1, changes())
    assert [ring.closed for ring in joined.rings] == [True]
    assert [left.where for left in joined.open] == ["LINE 7"]


def test_walls_fill_corners_and_end_flat():
    tee = [line((0, 0), (10, 0)), line((10, 0), (10, 10)), line((10, 0), (20, 0))]
    (wall,) = walls_along(tee, 2.0, 0.1, changes())
    assert wall.bounds == (0.0, -1.0, 20.0, 10.0)
    assert wall.area == pytest.approx(20 * 2 + 9 * 2)
    (corner,) = walls_along([line((0, 0), (10, 0)), line((10, 0), (10, 10))], 2.0, 0.1, changes())
    assert corner.area == pytest.approx(11 * 2 + 9 * 2)
    (room,) = walls_along([line((0, 0), (9, 0), (9, 9), (0, 9), (0, 0))], 1.0, 0.1, changes())
    assert room.area == pytest.approx(100 - 64)
