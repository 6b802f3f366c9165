"""Needles that overlap, thinner than a micrometre where they cross: the tip slides on.

A needle 0.05 micrometres wide at its base pokes 0.011 mm through a needle 1 micrometre wide. A tip
that slides along the first meets the second in a corner of 131 degrees, presses on it and is led
away from the first: it is not wedged. A simulation with a tolerance of 1e-7 mm sees the first
needle's other flank as a wall there, 2e-8 mm away, and stops.
"""

import math
from fractions import Fraction

import pytest
from numpy.testing import assert_allclose
from shapely import Polygon

from vinefab.model.deployment import Stop

BOUNDS = (
    "15887.252997 -15747.356983, 15887.252997 -15647.356983,"
    " 15787.252997 -15647.356983, 15787.252997 -15747.356983"
)
NEEDLES = """\
15794.129012 -15668.770274, 15810.018256 -15664.844166, 15810.017159 -15664.83973
15846.863112 -15687.999736, 15841.046923 -15689.335972, 15841.046929 -15689.336
15802.486936 -15739.745998, 15799.936027 -15760.752158, 15800.005874 -15760.76064
15796.586259 -15721.23355, 15778.374194 -15703.037308, 15778.37413 -15703.037372
15801.010451 -15698.316721, 15830.140566 -15713.919247, 15830.140684 -15713.919027
15871.863831 -15700.564943, 15900.400497 -15683.961514, 15900.400467 -15683.961462
15827.020207 -15679.705078, 15844.279008 -15700.322555, 15844.280002 -15700.321722
15851.070567 -15718.660209, 15835.244715 -15739.87452, 15835.244872 -15739.874637
15853.138335 -15663.839826, 15818.660545 -15681.956065, 15818.660575 -15681.956123
15843.843395 -15687.33607, 15840.022086 -15692.937223, 15840.022132 -15692.937255
15815.941558 -15719.340932, 15818.524222 -15731.271118, 15818.525791 -15731.270778
15863.380845 -15717.326649, 15854.388921 -15681.162327, 15854.387441 -15681.162695
15817.648922 -15727.189137, 15795.639192 -15756.965252, 15795.639245 -15756.965291
15801.582294 -15741.569981, 15808.020098 -15742.790695, 15808.020573 -15742.788193"""
START = (15806.238497254846, -15736.396779997187, -10.829362890353215)
CROSSING_MM = (11.403948315293404, 9.198881284966154)

Vector = tuple[Fraction, Fraction]


def _points(text: str) -> list[Vector]:
    return [(Fraction(x), Fraction(y)) for x, y in (part.split() for part in text.split(","))]


def _less(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1]


def _cross(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[1] - a[1] * b[0]


def _crossing(one: Vector, two: Vector, three: Vector, four: Vector) -> Vector:
    along, across = _less(two, one), _less(four, three)
    share = _cross(_less(three, one), across) / _cross(along, across)
    assert 0 < share < 1
    return one[0] + share * along[0], one[1] + share * along[1]


def test_exact_fractions_say_that_the_tip_slides_on():
    needles = [_points(row) for row in NEEDLES.splitlines()]
    (first_tip, first_base, _), (second_top, second_base, _) = needles[12], needles[10]
    corner = _crossing(first_base, first_tip, second_top, second_base)
    start = Fraction(START[0]), Fraction(START[1])
    body, slides = _less(corner, start), _less(first_tip, first_base)
    assert_allclose([float(value) for value in body], CROSSING_MM, rtol=1e-12)
    # Free space lies on the left of both walls, as the tip slides up along the first.
    goes_on = _less(second_top, second_base)
    assert _cross(slides, _less(start, first_base)) > 0
    assert _cross(goes_on, _less(start, second_base)) > 0
    # The body presses on the second wall, which leads it on and away from the first.
    assert _cross(goes_on, body) < 0
    assert body[0] * goes_on[0] + body[1] * goes_on[1] > 0
    assert _cross(slides, goes_on) > 0


@pytest.mark.parametrize("shift", [0.0, -15800.0])
def test_a_tip_slides_on_where_needles_cross(launch, vine, terrain, shift):
    bounds, *needles = (
        Polygon([(float(x) + shift, float(y) - shift) for x, y in _points(row)])
        for row in (BOUNDS, *NEEDLES.splitlines())
    )
    place = START[0] + shift, START[1] - shift, START[2]
    grown = launch(
        vine(195.07625760598148),
        terrain(bounds, *needles),
        place,
        head_on_half_angle_rad=math.radians(0.3),
        body="centerline",
    )
    assert grown.stop[0] == Stop.CORNER
    assert_allclose(grown.grown_mm[0], 123.2484377, atol=1e-5)
    assert_allclose(grown.tips_mm[0] - place[:2], [81.01449974, 89.03979699], atol=1e-5)
