import math

import pytest

from vinefab.fabrication.outline.ends import (
    Leaf,
    corner_radii_mm,
    least_convex_radius_mm,
    pouch_tip,
    round_tip,
)
from vinefab.model.design import Pouch
from vinefab.model.outline import Part


def rectangle(length_mm, width_mm):
    return Pouch(shape="rectangle", length_mm=length_mm, width_mm=width_mm)


def leaf(half_mm, fillet_mm, lean_rad=0.0):
    return Leaf(half_mm=half_mm, lean_rad=lean_rad, fillet_mm=fillet_mm)


def corners(tip):
    return [tip.run.start_mm, *(piece.end_mm for piece in tip.run.pieces)]


def test_round_tip_is_half_a_circle_around_the_branchs_end():
    tip = round_tip(7.0)
    assert tip.used_mm == 0.0
    assert corners(tip)[0] == (0.0, -7.0)
    assert corners(tip)[-1] == pytest.approx((0.0, 7.0))
    assert sum(4 * math.atan(piece.bulge) for piece in tip.run.pieces) == pytest.approx(math.pi)


@pytest.mark.parametrize("lean_rad", [0.0, 0.04])
@pytest.mark.parametrize("offset_mm", [0.0, 0.55, 12.0, -2.0])
@pytest.mark.parametrize(
    "pouch", [Pouch(shape="round", radius_mm=16.0), rectangle(50.0, 44.0), rectangle(20.0, 27.0)]
)
def test_left_side_mirrors_the_right_side(pouch, offset_mm, lean_rad):
    points = corners(pouch_tip(pouch, leaf(10.0, 5.0, lean_rad), offset_mm))
    for right, left in zip(points, reversed(points), strict=True):
        assert left == pytest.approx((right[0], -right[1]), abs=1e-9)


def test_round_pouch_is_centred_on_the_end_and_its_neck_is_tangent():
    tip = pouch_tip(Pouch(shape="round", radius_mm=16.0), leaf(10.0, 5.0), 0.0)
    for piece in tip.run.pieces:
        if piece.part is Part.POUCH:
            assert math.hypot(*piece.end_mm) == pytest.approx(16.0)
    assert tip.used_mm == pytest.approx(math.sqrt((16 + 5) ** 2 - (10 + 5) ** 2))


def test_rectangle_has_its_size_and_lies_half_beyond_the_end():
    points = corners(pouch_tip(rectangle(50.0, 44.0), leaf(10.0, 5.0), 0.0))
    assert max(x for x, _ in points) == pytest.approx(25.0)
    assert min(y for _, y in points) == pytest.approx(-22.0)
    # The branch's side ends where the neck's fillet begins: one radius before the pouch.
    assert points[0] == pytest.approx((-30.0, -10.0))


@pytest.mark.parametrize(
    ("length", "width", "fillet", "radii"),
    [
        (50.0, 44.0, 5.0, (5.0, 5.0)),
        (50.0, 26.0, 5.0, (1.5, 1.5)),
        (12.0, 44.0, 5.0, (5.0, 3.0)),
        (50.0, 44.0, 0.0, (0.0, 6.0)),
    ],
)
def test_shoulder_is_shared_by_neck_and_corner(length, width, fillet, radii):
    assert corner_radii_mm(rectangle(length, width), leaf(10.0, fillet)) == pytest.approx(radii)


@pytest.mark.parametrize(
    ("pouch", "radii", "straight"),
    [
        # 0.04 mm would be left: the corner takes it, or, at its largest, gives up 0.01 mm.
        (rectangle(50.0, 40.08), (5.0, 5.04), 0.0),
        (rectangle(20.0, 40.08), (5.0, 4.99), 0.05),
        (rectangle(2.4, 22.4), (0.6, 0.6), 0.0),
    ],
)
def test_shoulder_has_no_straight_piece_too_short_to_draw(pouch, radii, straight):
    inner, outer = corner_radii_mm(pouch, leaf(10.0, 5.0))
    assert (inner, outer) == pytest.approx(radii)
    assert pouch.width_mm / 2 - 10.0 - inner - outer == pytest.approx(straight, abs=1e-9)


def test_offset_past_neck_and_shoulder_ends_in_a_corner_on_the_arc():
    # Neck and corner of 1.5 mm share a 3 mm shoulder: 12 mm outside, the side cuts the arc.
    tip = pouch_tip(rectangle(50.0, 26.0), leaf(10.0, 5.0), 12.0)
    assert Part.FILLET not in [piece.part for piece in tip.run.pieces]
    center = (-25.0 + 1.5, -13.0 + 1.5)
    assert math.dist(tip.run.start_mm, center) == pytest.approx(1.5 + 12.0)
    assert tip.run.start_mm[1] == pytest.approx(-22.0)


def test_smallest_convex_radius_is_what_an_inward_offset_uses_up(make_plan):
    assert least_convex_radius_mm(make_plan((40.0,))) == 20.0
    round_pouch = make_plan((40.0,), pouch=Pouch(shape="round", radius_mm=25.0))
    assert least_convex_radius_mm(round_pouch) == 25.0
    assert least_convex_radius_mm(make_plan((40.0,), pouch=rectangle(60.0, 48.0))) == 2.0
