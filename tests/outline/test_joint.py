"""Gaps at a joint, necks and the ends of branches, by hand."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.model.design import Pouch
from vinefab.model.outline import Part
from vinefab.outline.body_outline import DrawnTree
from vinefab.outline.ends import (
    Leaf,
    corner_radii_mm,
    least_convex_radius_mm,
    level_fillets_mm,
    pouch_tip,
)
from vinefab.outline.joint import (
    Core,
    Strip,
    crotch_reach_mm,
    largest_fillet_mm,
    neck,
    solve_gap,
)

CORE = Core(radius_mm=20.0)


def child(angle_deg, half_mm=10.0, owner=1):
    return Strip(angle_rad=math.radians(angle_deg), half_mm=half_mm, length_mm=150.0, owner=owner)


def parent(angle_deg, half_mm=20.0):
    return child(angle_deg, half_mm, owner=0)


def pair(angle_deg, fillet_mm):
    return solve_gap(child(-angle_deg), child(angle_deg, owner=2), CORE, fillet_mm)


@given(st.floats(20, 170), st.floats(1, 40), st.floats(1, 40), st.floats(1, 4))
def test_a_fillet_of_the_capped_radius_reaches_just_as_far_as_allowed(angle_deg, one, two, share):
    angle, reach = math.radians(angle_deg), share * max(one, two)
    radius = largest_fillet_mm(angle, (one, two), reach)
    if radius < 0.0:
        assert crotch_reach_mm(angle, one, two) > reach
    else:
        center = crotch_reach_mm(angle, one + radius, two + radius)
        assert center - radius == pytest.approx(reach, rel=1e-6)
    # Of equal strips the design rule has a formula.
    sin = math.sin(angle / 2)
    wanted = (reach * sin - one) / (1 - sin)
    if wanted >= 0.0:
        equal = largest_fillet_mm(angle, (one, one), reach)
        assert equal == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def test_sides_and_necks_by_hand():
    assert crotch_reach_mm(math.pi / 2, 3.0, 4.0) == pytest.approx(5.0)
    assert crotch_reach_mm(0.0, 3.0, 4.0) == math.inf
    # The ball's centre is 5 mm above the axis and 12 mm from the disc's centre.
    found = neck(3.0, 10.0, 2.0)
    assert found.used_mm == pytest.approx(math.sqrt(119))
    assert found.angle_rad == pytest.approx(math.asin(5 / 12))
    tangent = neck(10.0, 10.0, 2.0)
    assert (tangent.used_mm, tangent.turn_rad) == (0.0, 0.0)


def test_a_narrow_gap_has_one_fillet_and_a_wide_one_shows_the_disc():
    narrow, wide = pair(25, 5.0), pair(60, 5.0)
    assert [piece.part for piece in narrow.run.pieces] == [Part.FILLET]
    assert [piece.part for piece in wide.run.pieces] == [Part.FILLET, Part.JOINT, Part.FILLET]
    assert wide.reach_mm == 20.0
    assert narrow.reach_mm == pytest.approx(15.0 / math.sin(math.radians(25)) - 5.0)


@pytest.mark.parametrize(("fillet_mm", "parts"), [(5.0, [Part.FILLET]), (0.0, [])])
def test_a_disc_that_would_barely_show_is_skipped_with_its_error(fillet_mm, parts):
    # Where a ball rests on side and disc: its angle from the strip's axis.
    angle = math.degrees(math.asin((10 + fillet_mm) / (20 + fillet_mm)))
    barely, clearly = pair(angle + 0.05, fillet_mm), pair(angle + 0.1, fillet_mm)
    assert [piece.part for piece in barely.run.pieces] == parts
    assert 0.01 < barely.error_mm < 0.05
    assert barely.error_mm == pytest.approx(20.0 - barely.reach_mm)
    assert Part.JOINT in [piece.part for piece in clearly.run.pieces]
    assert clearly.error_mm == 0.0


@given(st.floats(-170, -15), st.floats(2, 19), st.sampled_from([0.0, 1.0, 5.0]))
def test_gaps_on_both_sides_of_a_joint_mirror_each_other(angle_deg, half_mm, fillet_mm):
    right = solve_gap(parent(-180), child(angle_deg, half_mm), CORE, fillet_mm)
    left = solve_gap(child(-angle_deg, half_mm), parent(180), CORE, fillet_mm)
    assert right.second_used_mm == pytest.approx(left.first_used_mm)
    assert right.first_used_mm == pytest.approx(left.second_used_mm)
    assert right.run.end_mm == pytest.approx((left.run.start_mm[0], -left.run.start_mm[1]))
    assert right.reach_mm == pytest.approx(left.reach_mm)


def rectangle(length_mm, width_mm):
    return Pouch(shape="rectangle", length_mm=length_mm, width_mm=width_mm)


@pytest.mark.parametrize("lean_rad", [0.0, 0.04])
@pytest.mark.parametrize("offset_mm", [0.0, 0.55, 12.0, -2.0])
@pytest.mark.parametrize(
    "pouch", [Pouch(shape="round", radius_mm=16.0), rectangle(50.0, 44.0), rectangle(20.0, 27.0)]
)
def test_the_left_side_of_a_pouch_mirrors_the_right_side(pouch, offset_mm, lean_rad):
    run = pouch_tip(pouch, Leaf(half_mm=10.0, lean_rad=lean_rad, fillet_mm=5.0), offset_mm).run
    points = [run.start_mm, *(piece.end_mm for piece in run.pieces)]
    for right, left in zip(points, reversed(points), strict=True):
        assert left == pytest.approx((right[0], -right[1]), abs=1e-9)


@pytest.mark.parametrize(
    ("length", "width", "fillet", "radii"),
    [
        (50.0, 44.0, 5.0, (5.0, 5.0)),
        (50.0, 26.0, 5.0, (1.5, 1.5)),
        (12.0, 44.0, 5.0, (5.0, 3.0)),
        (50.0, 44.0, 0.0, (0.0, 6.0)),
        # Of the shoulder 0.04 mm would be left, too short to draw: the corner takes it or, at its
        # largest, gives up 0.01 mm.
        (50.0, 40.08, 5.0, (5.0, 5.04)),
        (20.0, 40.08, 5.0, (5.0, 4.99)),
        (2.4, 22.4, 5.0, (0.6, 0.6)),
    ],
)
def test_the_shoulder_is_shared_by_neck_and_corner(length, width, fillet, radii):
    leaf = Leaf(half_mm=10.0, lean_rad=0.0, fillet_mm=fillet)
    assert corner_radii_mm(rectangle(length, width), leaf) == pytest.approx(radii)


@pytest.mark.parametrize(
    ("pouch", "radius_mm"),
    [(None, 20.0), (Pouch(shape="round", radius_mm=25.0), 25.0), (rectangle(60.0, 48.0), 2.0)],
)
def test_the_smallest_convex_radius_is_what_an_inward_offset_uses_up(make_plan, pouch, radius_mm):
    drawn = DrawnTree.of(make_plan((40.0,), pouch=pouch))
    assert least_convex_radius_mm(drawn.leaf(0), drawn.pouches[0]) == radius_mm


@pytest.mark.parametrize(("width_mm", "fillet_mm"), [(4.0, 2.0), (40.0, 10.0)])
def test_the_trunk_has_the_default_fillet_for_its_pouch(make_plan, width_mm, fillet_mm):
    assert level_fillets_mm(make_plan((width_mm,)).build) == (fillet_mm,)
