"""Any design has a right outline or a named problem: never an error, never a wrong shape.

Thousands of designs are tried by `property.py` (``make outlines``); a few of them in every run.
"""

import math

import numpy as np
import pytest
import shapely
from hypothesis import event, example, given, settings
from hypothesis import strategies as st
from shapely import LineString, Polygon

from tests.oracles.body_outline import Twin
from vinefab.fabrication.outline.body_outline import body_outline
from vinefab.fabrication.outline.joint import LEAST_CUT_MM
from vinefab.model.design import Build, Collar, Design, Level, Pouch

FINE_MM = 1e-4
MOST_BRANCHES = 40


def lengths(low, high):
    # Whole micrometres: a length of 1e-300 mm tells nothing about the walk.
    return st.integers(round(low * 1e3), round(high * 1e3)).map(lambda um: um / 1e3)


@st.composite
def levels(draw, fans_deg, branches):
    made, total, last = [], 1, 1
    for _ in range(draw(st.integers(0, 3))):
        count = draw(branches)
        last *= count
        total += last
        if total > MOST_BRANCHES:
            break
        fan = math.radians(draw(fans_deg))
        growth = draw(st.integers(10, 160)) / 100
        made.append(
            Level(branches=count, length_mm=draw(lengths(10, 205)), fan_rad=fan, growth=growth)
        )
    return tuple(made)


@st.composite
def pouches(draw, width_mm):
    shape = draw(st.sampled_from([None, "round", "rectangle"]))
    across = draw(lengths(0.9, 3.0)) * width_mm
    if shape is None:
        return None
    if shape == "round":
        return Pouch(shape="round", radius_mm=across / 2)
    along = draw(lengths(0.3, 3.0)) * width_mm
    return Pouch(shape="rectangle", length_mm=along, width_mm=across)


tapers = st.integers(40, 100).map(lambda percent: percent / 100)
collars = st.builds(
    Collar,
    clamp_diameter_mm=lengths(8, 60),
    length_mm=lengths(0, 40),
    flare_mm=lengths(1, 60),
)


@st.composite
def designs(draw, *, fans_deg, branches, ratios, fillets):
    """Trees within the bounds of the paper's Table 1 and, if wanted, far outside."""
    tree = draw(levels(fans_deg, branches))
    widths = [draw(lengths(8, 30))]
    for _ in tree:
        widths.append(widths[-1] * draw(ratios))
    radii = draw(fillets(len(tree)))
    build = Build(
        widths_mm=tuple(widths),
        fillet_mm=radii or tuple(max(2.0, width / 4) for width in widths[1:]),
        tail_mm=draw(st.sampled_from([0.0, 60.0, 200.0])),
        pouch=draw(pouches(widths[-1])),
        taper=draw(st.just(()) | st.tuples(*[tapers] * len(widths))),
        collar=draw(st.none() | collars),
    )
    return Design(name="any", trunk_length_mm=draw(lengths(10, 205)), levels=tree, build=build)


ORDINARY = designs(
    fans_deg=st.integers(20, 160),
    branches=st.integers(2, 4),
    ratios=lengths(0.25, 0.65),
    fillets=lambda _: st.just(None),
)
ODD = designs(
    fans_deg=st.one_of(st.integers(0, 360), st.sampled_from([0, 90, 180, 270, 360])),
    branches=st.integers(1, 4),
    ratios=lengths(0.25, 1.1),
    fillets=lambda count: st.tuples(*[st.sampled_from([0.0, 0.5, 2.0, 8.0, 300.0])] * count),
)


def bare_corners_mm2(design):
    """What a tapered trunk without a tail loses: its sides begin at the corners of the mouth.

    They touch the base's disc a little farther on, by an arc that is too short to be drawn; with
    a tail there is a corner where both straight sides meet. In 120 mm it is 0.3 um a side.
    """
    build = design.build
    half, length = build.widths_mm[0] / 2, design.trunk_length_mm
    lean = math.asin(min(0.99, (build.widths_mm[0] - build.end_widths_mm[0]) / 2 / length))
    bare = build.tail_mm < half * math.tan(lean / 2)
    return half * (1 / math.cos(lean) - 1) * length if bare and half * lean < LEAST_CUT_MM else 0.0


def check(design):
    """Compare an outline without problems with the union of plain shapes."""
    outline = body_outline(design)
    contour = outline.contour
    assert np.isfinite(contour.points_mm).all()
    event("problems" if outline.problems else "drawn")
    if outline.problems:
        assert all(problem.branches and problem.message for problem in outline.problems)
        return
    segments = list(contour.segments)
    assert min(segment.length_mm for segment in segments) >= 0.05 * (1 - 1e-6)
    assert max(abs(segment.turn_rad) for segment in segments) < math.radians(175)
    union = Twin(design, FINE_MM).body()
    shape = Polygon(contour.flattened_mm(FINE_MM))
    # Chords leave out a little of every arc.
    chords_mm2 = FINE_MM * sum(segment.length_mm for segment in segments if segment.bulge)
    allowed_mm2 = 1e-5 * union.area + chords_mm2 + bare_corners_mm2(design)
    if shape.is_valid:
        assert contour.signed_area_mm2 == pytest.approx(union.area, rel=0, abs=allowed_mm2)
        assert shape.symmetric_difference(union).area <= 2 * allowed_mm2
    else:
        # Where it overlaps itself the walk counts the overlap twice.
        assert contour.signed_area_mm2 > union.area - allowed_mm2
    # With or without overlaps, the edge of the union is part of the walk or of the mouth.
    mouth = LineString([contour.points_mm[-1], contour.points_mm[0]])
    walk = shapely.union(LineString(contour.flattened_mm(FINE_MM)), mouth)
    edge = shapely.points(shapely.get_coordinates(shapely.segmentize(union.boundary, 5.0)))
    shapely.prepare(walk)
    assert shapely.distance(edge, walk).max() <= 0.01


WITHOUT_TAIL = Design(
    name="any",
    trunk_length_mm=121.604,
    levels=(Level(branches=2, length_mm=10.0, fan_rad=math.radians(20), growth=0.86),),
    build=Build(widths_mm=(8.0, 2.0), fillet_mm=(2.0,), taper=(0.62, 0.4), tail_mm=0.0),
)


@settings(max_examples=60)
@given(ORDINARY)
@example(WITHOUT_TAIL)
def test_designs_like_the_papers(design):
    check(design)


@settings(max_examples=150)
@given(ODD)
def test_odd_designs(design):
    check(design)


@settings(max_examples=100)
@given(ODD, st.sampled_from([-1.0, 0.55, 3.0, 12.0]))
def test_offsets_of_odd_designs(design, offset_mm):
    outline = body_outline(design, offset_mm)
    assert np.isfinite(outline.contour.points_mm).all()
    shape = Polygon(outline.contour.flattened_mm(FINE_MM))
    lumen = Polygon(body_outline(design).contour.flattened_mm(FINE_MM))
    if outline.problems or not shape.is_valid or not lumen.is_valid:
        return
    event("compared")
    edge = Twin(design, FINE_MM).body(beyond_mm=50.0).boundary
    points = shapely.points(shapely.get_coordinates(shapely.segmentize(shape.exterior, 5.0)))
    # The mouth's own line is nearer to the lumen drawn out than the offset.
    clear = points[shapely.get_x(points) > -design.build.tail_mm + 1e-6]
    assert np.abs(shapely.distance(clear, edge) - abs(offset_mm)).max() <= 0.01
