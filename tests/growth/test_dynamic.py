"""The dynamic chain against closed forms, before anything is compared with it."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.growth import against_dynamic, dynamic
from vinefab.model.map import Pose

pytestmark = pytest.mark.thorough


def test_free_growth_is_straight_and_needs_no_push():
    pose = Pose(x_mm=500.0, y_mm=500.0, heading_rad=0.7)
    grown = dynamic.grow_chain(dynamic.Arena(2000.0, ()), pose, 600.0, dynamic.vine_of())
    tip = [500.0 + 600.0 * math.cos(0.7), 500.0 + 600.0 * math.sin(0.7)]
    assert_allclose(grown.points_mm[-1], tip, atol=0.01)
    assert grown.stretched_mm < 1e-6
    assert grown.push_n < 1e-3


def test_a_load_across_the_tip_bends_it_like_a_beam():
    vine = dynamic.vine_of()
    tip = dynamic.bend_under_load(200.0, 1e-3, vine, 2.0)[-1]
    assert tip[1] == pytest.approx(1e-3 * 200.0**3 / (3.0 * vine.bending_n_mm2), rel=0.01)


def test_no_joint_bears_more_than_the_collapse_moment():
    """Across the tip of a span, a load up to M / L holds and one above it folds the span."""
    vine = dynamic.vine_of()
    holds_n = vine.collapse_n_mm / 200.0
    assert dynamic.bend_under_load(200.0, 0.3 * holds_n, vine, 1.0)[-1, 0] > 170.0
    assert dynamic.bend_under_load(200.0, 3.0 * holds_n, vine, 1.0)[-1, 0] < 60.0


@pytest.mark.parametrize(("base_n_mm", "short_mm"), [(0.0, 0.3), (None, 9.0)])
def test_a_tip_slides_along_a_wall_to_the_closed_form_point(base_n_mm, short_mm):
    """Hinged at the base it is the growth model's point; clamped, the body bows and falls short."""
    vine = dynamic.vine_of()
    vine = vine if base_n_mm is None else vine._replace(base_n_mm=base_n_mm)
    high = 700.0 - vine.radius_mm
    pose = Pose(x_mm=100.0, y_mm=high - 200.0, heading_rad=math.radians(40.0))
    grown = dynamic.grow_chain(dynamic.Arena(700.0, ()), pose, 500.0, vine)
    assert grown.points_mm[-1, 1] == pytest.approx(high, abs=0.1)
    reach = 100.0 + math.sqrt(500.0**2 - 200.0**2)
    assert reach - short_mm < grown.points_mm[-1, 0] < reach + 0.1
    assert grown.deepest_mm < 0.1


def test_half_the_link_and_a_quarter_of_the_step_change_little():
    """One turned box in the way: the tip moves by less than 1 % of the length."""
    one = dynamic.Box(x_mm=370.0, y_mm=260.0, half_width_mm=60.0, half_height_mm=40.0, turn_rad=0.5)
    arena, pose = dynamic.Arena(700.0, (one,)), dynamic.start_of(700.0, 85.0)
    coarse, fine = (
        dynamic.grow_chain(arena, pose, 380.0, dynamic.vine_of(link_mm=link_mm))
        for link_mm in (10.0, 5.0)
    )
    assert fine.deepest_mm < coarse.deepest_mm < 1.0
    assert np.hypot(*(fine.points_mm[-1] - coarse.points_mm[-1])) < 5.0
    free = [350.0 + 380.0 * math.cos(pose.heading_rad), 21.0 + 380.0 * math.sin(pose.heading_rad)]
    assert np.hypot(*(coarse.points_mm[-1] - free)) > 50.0


def test_friction_asks_for_more_push():
    """A tip that slides at 50 degrees to the wall's normal: Coulomb's factor, and what it bends."""
    vine = dynamic.vine_of()
    pose = Pose(x_mm=100.0, y_mm=494.0, heading_rad=math.radians(40.0))
    smooth_n, rough_n = (
        dynamic.grow_chain(dynamic.Arena(700.0, ()), pose, 400.0, one).push_n
        for one in (vine, vine._replace(friction=0.3))
    )
    assert rough_n > 1.2 * smooth_n


UP = np.array([[350.0, 21.0], [350.0, 600.0]])


def test_errors_hold_a_shorter_body_at_its_tip():
    short, long = np.array([[0.0, 0.0], [300.0, 0.0]]), np.array([[0.0, 0.0], [1200.0, 0.0]])
    tip_mm, shape = against_dynamic.errors(short, long)
    assert tip_mm == pytest.approx(900.0)
    assert shape == pytest.approx(0.5 * 900.0**2 / 1200.0**2, rel=0.01)


def test_bodies_on_two_sides_of_a_box_take_different_paths():
    one = dynamic.Box(x_mm=400.0, y_mm=300.0, half_width_mm=30.0, half_height_mm=20.0, turn_rad=0.4)
    arena = dynamic.Arena(700.0, (one,))
    beyond = np.array([[350.0, 21.0], [460.0, 300.0], [350.0, 600.0]])
    near = np.array([[350.0, 21.0], [340.0, 300.0], [350.0, 600.0]])
    case = against_dynamic.Case(0, 90.0, None, 0.0, beyond, UP, beyond)
    assert not against_dynamic.follows(arena, case)
    assert against_dynamic.follows(arena, case._replace(dynamic=near))


def test_contacts_are_named_from_base_to_tip():
    one = dynamic.Box(x_mm=380.0, y_mm=300.0, half_width_mm=24.0, half_height_mm=20.0, turn_rad=0.0)
    arena = dynamic.Arena(700.0, (one,))
    body = np.array([*UP, [350.0, 693.2], [693.2, 693.2]])
    assert against_dynamic.contacts(arena, body) == ["0", "N", "E"]
