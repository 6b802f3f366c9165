import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.model.outline import Contour, Segment

near = st.floats(-50, 50)


def half_circle() -> Segment:
    return Segment(start_mm=(1.0, 0.0), end_mm=(-1.0, 0.0), bulge=1.0)


def stadium() -> Contour:
    """A 10 x 2 mm capsule, counter-clockwise: two lines and two half circles of radius 1."""
    points = np.array([[0, -1], [8, -1], [8, 1], [0, 1]], dtype=float)
    bulges = np.array([0.0, 1.0, 0.0, 1.0])
    line = Contour.polyline(points, closed=True)
    return Contour(
        points_mm=points, bulges=bulges, parts=line.parts, branches=line.branches, closed=True
    )


def test_half_circle_has_its_centre_radius_and_directions():
    arc = half_circle()
    assert arc.radius_mm == pytest.approx(1.0)
    assert arc.center_mm == pytest.approx((0.0, 0.0))
    assert arc.length_mm == pytest.approx(math.pi)
    assert arc.direction_rad() == pytest.approx(math.pi / 2)
    assert arc.direction_rad(at_end=True) == pytest.approx(-math.pi / 2)


@given(near, near, near, near, st.floats(-3, 3).filter(lambda b: abs(b) > 1e-3))
def test_bulge_radius_and_centre_agree_for_any_arc(x0, y0, x1, y1, bulge):
    if math.dist((x0, y0), (x1, y1)) < 0.1:
        return
    arc = Segment(start_mm=(x0, y0), end_mm=(x1, y1), bulge=bulge)
    for end in (arc.start_mm, arc.end_mm):
        assert math.dist(end, arc.center_mm) == pytest.approx(arc.radius_mm, rel=1e-9)
    turned = arc.direction_rad(at_end=True) - arc.direction_rad() - arc.turn_rad
    assert math.remainder(turned, math.tau) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(0.01, 6.0), st.floats(0.01, 100.0), st.floats(1e-3, 0.1), st.floats(-3, 3))
def test_flattening_keeps_within_the_tolerance(turn, radius, tolerance, first):
    start = (radius * math.cos(first), radius * math.sin(first))
    end = (radius * math.cos(first + turn), radius * math.sin(first + turn))
    if math.dist(start, end) < 1e-3:
        return
    arc = Segment(start_mm=start, end_mm=end, bulge=math.tan(turn / 4))
    points = arc.flattened_mm(tolerance)
    assert np.hypot(*points.T) == pytest.approx(np.full(len(points), radius), rel=1e-6)
    middles = (points[1:] + points[:-1]) / 2
    assert (radius - np.hypot(*middles.T)).max() <= tolerance * (1 + 1e-6) + 1e-9 * radius


def test_capsule_has_the_area_length_and_box_of_the_closed_form():
    body = stadium()
    assert body.signed_area_mm2 == pytest.approx(16 + math.pi)
    assert body.length_mm == pytest.approx(16 + 2 * math.pi)
    assert body.box_mm == pytest.approx((-1.0, -1.0, 9.0, 1.0))
    assert body.arc_count == 2
    flat = shapely.Polygon(body.flattened_mm(1e-4))
    assert flat.area == pytest.approx(16 + math.pi, rel=1e-3)


@pytest.mark.parametrize("bulge", [5e-324, 1e-265, 1e-12, 2.4e-4, 2.6e-4, 0.5, 1.0, -2.0])
def test_cap_of_any_arc_has_the_area_of_the_closed_form(bulge):
    cap = Segment(start_mm=(0.0, 0.0), end_mm=(6.0, 8.0), bulge=bulge).cap_mm2
    turn = 4 * math.atan(bulge)
    # Integral of the arc's height over its chord, by a route that knows no radius: for a flat arc
    # two thirds of chord times sagitta, otherwise sector minus triangle.
    flat = 2 / 3 * 10.0 * (10.0 * bulge / 2)
    radius = 10.0 / (2 * math.sin(abs(turn) / 2)) if abs(bulge) > 0.1 else 0.0
    exact = (
        flat
        if abs(bulge) < 0.1
        else math.copysign(1, turn) * radius**2 / 2 * (abs(turn) - math.sin(abs(turn)))
    )
    assert cap == pytest.approx(exact, rel=1e-6, abs=0.0)


def test_moving_keeps_area_and_turns_the_box():
    moved = stadium().moved(math.pi / 2, 100.0, 0.0)
    assert moved.signed_area_mm2 == pytest.approx(16 + math.pi)
    assert moved.box_mm == pytest.approx((99.0, -1.0, 101.0, 9.0))


def test_open_contour_has_one_segment_less_and_keeps_its_ends():
    path = Contour.polyline(np.array([[0.0, 0], [3, 0], [3, 4]]), closed=False)
    assert len(path) == len(list(path.segments)) == 2
    assert path.length_mm == 7.0
    assert path.flattened_mm().tolist() == [[0, 0], [3, 0], [3, 4]]


def test_contour_refuses_wrong_counts_and_nan():
    with pytest.raises(BadInputError):
        Contour(points_mm=np.zeros((3, 2)), bulges=np.zeros(1), parts=(), branches=(), closed=True)
    with pytest.raises(BadInputError, match="NaN"):
        Contour.polyline(np.array([[0.0, math.nan], [1, 1]]), closed=False)
