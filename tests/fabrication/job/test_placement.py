import math

import numpy as np
import pytest

from vinefab.fabrication.job.placement import place_contours
from vinefab.model.outline import Contour


def bar(length_mm, height_mm, angle_deg=0.0):
    corners = np.array(
        [[0, 0], [length_mm, 0], [length_mm, height_mm], [0, height_mm]], dtype=float
    )
    return Contour.polyline(corners, closed=True).moved(math.radians(angle_deg), 3.0, -7.0)


def test_what_fits_is_not_turned_and_lies_in_the_corner():
    placement = place_contours([bar(90, 40)], (100.0, 50.0), 10.0)
    assert placement.fits
    assert placement.angle_rad == 0.0
    assert placement.moved(bar(90, 40)).box_mm == pytest.approx((10.0, 10.0, 100.0, 50.0))


def test_what_fits_exactly_is_not_turned():
    assert place_contours([bar(100, 50)], (100.0, 50.0), 0.0).angle_rad == 0.0


def test_long_bar_is_turned_by_the_smallest_step_that_fits():
    placement = place_contours([bar(105, 2)], (100.0, 60.0), 0.0)
    steps = np.radians(np.arange(0, 90, 0.25))
    wide = 105 * np.cos(steps) + 2 * np.sin(steps) <= 100.0
    high = 105 * np.sin(steps) + 2 * np.cos(steps) <= 60.0
    assert placement.fits
    assert abs(placement.angle_rad) == pytest.approx(steps[wide & high].min())
    assert max(placement.width_mm - 100.0, placement.height_mm - 60.0) <= 1e-6


def test_turn_between_steps_is_found_where_only_a_flush_edge_fits():
    placement = place_contours([bar(99.9999, 49.9999, angle_deg=10.1)], (100.0, 50.0), 0.0)
    assert placement.fits
    assert math.degrees(placement.angle_rad) == pytest.approx(-10.1)


def test_what_does_not_fit_is_placed_where_it_overshoots_least():
    placement = place_contours([bar(300, 10)], (100.0, 60.0), 5.0)
    moved = placement.moved(bar(300, 10))
    assert not placement.fits
    assert moved.box_mm[:2] == pytest.approx((5.0, 5.0))
    steps = np.radians(np.arange(0, 90, 0.25))
    overshoot = np.maximum(
        300 * np.cos(steps) + 10 * np.sin(steps) - 100,
        300 * np.sin(steps) + 10 * np.cos(steps) - 60,
    )
    found = max(placement.width_mm - 100.0, placement.height_mm - 60.0)
    assert found == pytest.approx(overshoot.min())


def test_arcs_count_with_their_whole_width():
    points = np.array([[0.0, -5.0], [80.0, -5.0], [80.0, 5.0], [0.0, 5.0]])
    line = Contour.polyline(points, closed=True)
    stadium = Contour(
        points_mm=points,
        bulges=np.array([0.0, 1.0, 0.0, 1.0]),
        parts=line.parts,
        branches=line.branches,
        closed=True,
    )
    placement = place_contours([stadium], (100.0, 20.0), 0.0)
    assert (placement.width_mm, placement.height_mm) == pytest.approx((90.0, 10.0))
