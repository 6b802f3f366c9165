import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage
from shapely import Polygon

from vinefab.core.validation import Floats
from vinefab.maps.cleanup.cell_walls import CORNER_CUT, boundary_loops, corners_between

MASKS = arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def exact(loop: Floats) -> Floats:
    return corners_between(loop, np.roll(loop, -1, axis=0))


def signed_area(ring: Floats) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def test_one_cell_is_walked_counter_clockwise() -> None:
    (loop,) = boundary_loops(np.array([[True]]))
    assert sorted(map(tuple, loop)) == [(0, 0.5), (0.5, 0), (0.5, 1), (1, 0.5)]
    assert signed_area(exact(loop)) == 1.0


def test_a_hole_is_walked_clockwise() -> None:
    mask = np.ones((5, 6), dtype=bool)
    mask[1:3, 2:5] = False
    outer, hole = sorted(boundary_loops(mask), key=len, reverse=True)
    assert signed_area(exact(outer)) == 30.0
    assert signed_area(exact(hole)) == -6.0


def test_free_cells_touching_at_a_corner_are_apart_and_solid_ones_joined() -> None:
    assert len(boundary_loops(np.eye(3, dtype=bool))) == 3
    wall = np.ones((6, 6), dtype=bool)
    wall[range(1, 5), range(1, 5)] = False
    assert len(boundary_loops(wall)) == 2


@settings(max_examples=150, deadline=None)
@given(MASKS)
def test_loops_are_simple_apart_and_enclose_what_the_cells_do(mask: np.ndarray) -> None:
    loops = boundary_loops(mask)
    assert sum(signed_area(exact(loop)) for loop in loops) == pytest.approx(mask.sum())
    lines = np.array([shapely.LinearRing(loop) for loop in loops], dtype=object)
    assert all(line.is_simple for line in lines)
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=0.7)
    assert (one == two).all()
    outer = sum(signed_area(loop) > 0 for loop in loops)
    assert outer == ndimage.label(mask)[1]
    solid = ndimage.label(np.pad(~mask, 1, constant_values=True), np.ones((3, 3)))[1]
    assert len(loops) - outer == solid - 1


@settings(max_examples=50, deadline=None)
@given(MASKS)
def test_midpoints_stay_near_the_exact_boundary(mask: np.ndarray) -> None:
    for loop in boundary_loops(mask):
        corners, line = shapely.points(exact(loop)), Polygon(loop).exterior
        assert shapely.distance(corners, line).max() <= CORNER_CUT + 1e-12


def test_nothing_free_has_no_loops() -> None:
    assert boundary_loops(np.zeros((3, 4), dtype=bool)) == []
