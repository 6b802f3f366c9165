import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.fabrication.outline.joint import (
    Core,
    Strip,
    crotch_reach_mm,
    largest_fillet_mm,
    neck,
    solve_gap,
)
from vinefab.model.outline import Part


def child(angle_deg, half_mm=10.0, owner=1):
    return Strip(angle_rad=math.radians(angle_deg), half_mm=half_mm, length_mm=150.0, owner=owner)


def parent(angle_deg, half_mm=20.0):
    return child(angle_deg, half_mm, owner=0)


@given(st.floats(5, 175), st.floats(1, 40), st.floats(1, 500))
def test_cap_of_equal_strips_is_the_formula_of_the_design_rule(angle_deg, half_mm, reach_mm):
    sin = math.sin(math.radians(angle_deg) / 2)
    found = largest_fillet_mm(math.radians(angle_deg), (half_mm, half_mm), reach_mm)
    wanted = (reach_mm * sin - half_mm) / (1 - sin)
    if wanted < 0.0:
        assert found < 1e-9 * (half_mm + reach_mm)
    else:
        assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6)


@given(st.floats(20, 170), st.floats(1, 40), st.floats(1, 40), st.floats(1, 4))
def test_fillet_of_the_capped_radius_reaches_just_as_far_as_allowed(angle_deg, one, two, share):
    angle, reach = math.radians(angle_deg), share * max(one, two)
    radius = largest_fillet_mm(angle, (one, two), reach)
    if radius < 0.0:
        assert crotch_reach_mm(angle, one, two) > reach
    else:
        center = crotch_reach_mm(angle, one + radius, two + radius)
        assert center - radius == pytest.approx(reach, rel=1e-6)


def test_sides_at_a_right_angle_cross_at_their_half_widths():
    assert crotch_reach_mm(math.pi / 2, 3.0, 4.0) == pytest.approx(5.0)
    assert crotch_reach_mm(0.0, 3.0, 4.0) == math.inf


def test_neck_ends_where_the_ball_touches_side_and_disc():
    found = neck(3.0, 10.0, 2.0)
    # The ball's centre is 5 mm above the axis and 12 mm from the disc's centre.
    assert found.used_mm == pytest.approx(math.sqrt(119))
    assert found.angle_rad == pytest.approx(math.asin(5 / 12))


def test_side_that_touches_its_disc_needs_no_fillet():
    found = neck(10.0, 10.0, 2.0)
    assert (found.used_mm, found.turn_rad) == (0.0, 0.0)


def test_narrow_gap_has_one_fillet_and_a_wide_one_shows_the_disc():
    narrow = solve_gap(child(-25), child(25, owner=2), Core(radius_mm=20.0), 5.0)
    wide = solve_gap(child(-60), child(60, owner=2), Core(radius_mm=20.0), 5.0)
    assert [piece.part for piece in narrow.run.pieces] == [Part.FILLET]
    assert [piece.part for piece in wide.run.pieces] == [Part.FILLET, Part.JOINT, Part.FILLET]
    assert wide.reach_mm == 20.0
    assert narrow.reach_mm == pytest.approx(15.0 / math.sin(math.radians(25)) - 5.0)


def test_a_disc_that_would_barely_show_is_skipped_with_its_error():
    # Where a ball of 5 mm rests on side and disc: its angle from the strip's axis.
    angle = math.degrees(math.asin(15 / 25))
    barely = solve_gap(
        child(-angle - 0.05), child(angle + 0.05, owner=2), Core(radius_mm=20.0), 5.0
    )
    clearly = solve_gap(child(-angle - 0.1), child(angle + 0.1, owner=2), Core(radius_mm=20.0), 5.0)
    assert [(piece.part, barely.radius_mm) for piece in barely.run.pieces] == [(Part.FILLET, 5.0)]
    assert 0.01 < barely.error_mm < 0.05
    assert barely.error_mm == pytest.approx(20.0 - barely.reach_mm)
    assert Part.JOINT in [piece.part for piece in clearly.run.pieces]
    assert clearly.error_mm == 0.0


def test_a_bare_corner_over_a_disc_that_barely_shows_has_its_error():
    angle = math.degrees(math.asin(10 / 20))
    gap = solve_gap(child(-angle - 0.05), child(angle + 0.05, owner=2), Core(radius_mm=20.0), 0.0)
    assert gap.run.pieces == ()
    assert gap.error_mm == pytest.approx(20.0 - gap.reach_mm)
    assert 0.01 < gap.error_mm < 0.05


@pytest.mark.parametrize("angle_deg", [-100, -120, -150])
def test_fillet_beside_the_parent_is_tangent_to_both(angle_deg):
    gap = solve_gap(parent(-180), child(angle_deg), Core(radius_mm=20.0), 4.0)
    (fillet,) = (piece for piece in gap.run.pieces if piece.part is Part.FILLET)
    turn = 4 * math.atan(fillet.bulge)
    # From the parent's side, along +x, to the child's direction.
    assert turn == pytest.approx(math.radians(angle_deg))
    assert gap.run.start_mm[1] == -20.0


@given(st.floats(-170, -15), st.floats(2, 19), st.sampled_from([0.0, 1.0, 5.0]))
def test_gaps_on_both_sides_of_a_joint_mirror_each_other(angle_deg, half_mm, fillet_mm):
    right = solve_gap(parent(-180), child(angle_deg, half_mm), Core(radius_mm=20.0), fillet_mm)
    left = solve_gap(child(-angle_deg, half_mm), parent(180), Core(radius_mm=20.0), fillet_mm)
    assert right.second_used_mm == pytest.approx(left.first_used_mm)
    assert right.first_used_mm == pytest.approx(left.second_used_mm)
    last = right.run.pieces[-1].end_mm if right.run.pieces else right.run.start_mm
    assert last == pytest.approx((left.run.start_mm[0], -left.run.start_mm[1]))
    assert right.reach_mm == pytest.approx(left.reach_mm)
