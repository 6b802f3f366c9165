"""Placement and nesting on the bed."""

import itertools
import math

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import APART_MM, SheetOptions, nest, place_contours
from vinefab.model.job import Operation
from vinefab.model.outline import Contour


def bar(length_mm, height_mm, angle_deg=0.0):
    corners = np.array(
        [[0, 0], [length_mm, 0], [length_mm, height_mm], [0, height_mm]], dtype=float
    )
    return Contour.polyline(corners, closed=True).moved(math.radians(angle_deg), 3.0, -7.0)


def test_what_fits_is_not_turned_and_lies_in_the_corner():
    assert place_contours([bar(100, 50)], (100.0, 50.0), 0.0).angle_rad == 0.0
    placement = place_contours([bar(90, 40)], (100.0, 50.0), 10.0)
    assert placement.fits
    assert placement.angle_rad == 0.0
    assert placement.moved(bar(90, 40)).box_mm == pytest.approx((10.0, 10.0, 100.0, 50.0))


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


def bodies(job):
    paths = job.along(Operation.WELDCUT)
    return [shapely.Polygon(path.contour.flattened_mm()) for path in paths]


def test_copies_and_other_designs_keep_apart_and_on_the_bed(make_plan, make_fan, profile):
    tree = make_plan((30.0, 14.0), levels=[make_fan(3, 90, 130)], trunk=90.0, tail=80.0)
    vine = make_plan((20.0,), trunk=150.0, tail=50.0).changed(name="vine")
    job = laser_job(tree, profile, SheetOptions(copies=3, beside=(vine,)))
    assert (job.facts["robots_wanted"], job.facts["robots_placed"]) == (4, 4)
    robots = bodies(job)
    assert len(robots) == len(job.along(Operation.CUT)) == 4
    for one, two in itertools.combinations(robots, 2):
        assert one.distance(two) >= APART_MM
    usable = shapely.box(10.0, 10.0, 590.0, 390.0)
    assert all(usable.covers(robot) for robot in robots)
    areas = sorted(robot.area for robot in robots)
    assert areas[1:] == pytest.approx([areas[-1]] * 3)
    labels = [path.label for path in job.along(Operation.WELDCUT)]
    assert labels == [
        *(f"outline of plan, part {number} of 4" for number in (1, 2, 3)),
        "outline of vine, part 4 of 4",
    ]


def test_different_designs_of_one_name_are_refused(make_plan, profile):
    one, two = make_plan((20.0,), trunk=150.0), make_plan((20.0,), trunk=160.0)
    with pytest.raises(BadInputError, match="called plan; rename"):
        laser_job(one, profile, SheetOptions(beside=(two,)))
    again = laser_job(one, profile, SheetOptions(beside=(one,)))
    assert again.facts["robots_placed"] == 2


def test_robots_interlock(make_plan, make_fan, profile):
    fork = make_plan((20.0, 12.0), levels=[make_fan(2, 250, 90)], trunk=60.0, tail=60.0)
    together = bodies(laser_job(fork, profile, SheetOptions(copies=2)))
    assert len(together) == 2
    box = shapely.union_all(together).envelope
    assert box.area < 0.9 * sum(robot.minimum_rotated_rectangle.area for robot in together)


def test_what_finds_no_room_is_left_out_and_counted(make_plan, profile):
    vine = make_plan((100.0,), trunk=350.0, tail=150.0)
    job = laser_job(vine, profile, SheetOptions(copies=5))
    assert job.facts["fits_bed"] is False
    assert job.facts["robots_wanted"] == 5
    assert len(bodies(job)) == job.facts["robots_placed"] == 3


def test_what_is_nearly_as_long_as_the_bed_is_placed_first_where_that_helps():
    """By area a T comes first and lies upright where it takes the least: a slat is in its way."""
    tee = [(0, 0), (120, 0), (120, 20), (70, 20), (70, 140), (50, 140), (50, 20), (0, 20)]
    slat = [(0, 0), (200, 0), (200, 20), (0, 20)]
    robots = [(Contour.polyline(np.array(s, dtype=float), closed=True),) for s in (tee, slat)]
    found = nest(robots, (210.0, 160.0), 5.0)
    assert None not in found
    one, two = (
        shapely.Polygon(place.moved(robot[0]).points_mm)
        for place, robot in zip(found, robots, strict=True)
    )
    assert one.distance(two) >= APART_MM
    assert shapely.box(5.0, 5.0, 215.0, 165.0).covers(shapely.union(one, two))
