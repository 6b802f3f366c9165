"""Outlines against a union of plain shapes, drawn a second time; problems that have names."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon

import vinefab as vf
from tests.fabrication.conftest import fan, plan
from tests.oracles.body_outline import Twin
from tests.outline.property import beyond, compared, random_design
from vinefab.model.design import Build, Collar, Design, Level, Pouch
from vinefab.model.outline import Part
from vinefab.outline.body_outline import ProblemKind, body_outline, flat_layout
from vinefab.outline.ends import tail_of
from vinefab.outline.joint import LEAST_CUT_MM, LEAST_SEGMENT_MM, StrokeRun, arc

FINE_MM = 1e-4
KIND = ProblemKind


def flat(contour):
    return Polygon(contour.flattened_mm(FINE_MM))


def distances_mm(points_mm, line):
    """Return how far points are from a line of many chords, by an index of the chords."""
    ends = shapely.get_coordinates(line)
    chords = shapely.STRtree(shapely.linestrings(np.stack([ends[:-1], ends[1:]], axis=1)))
    points = shapely.points(points_mm)
    return chords.query_nearest(points, return_distance=True, all_matches=False)[1]


def test_the_layout_turns_and_tapers_level_by_level(make_plan, make_fan):
    levels = [make_fan(2, 80, 60, 0.5), make_fan(2, 30, 40)]
    layout = flat_layout(make_plan((40.0, 20.0, 10.0), levels=levels, tail=75.0, taper=(0.9, 1, 1)))
    parents = layout.tree.parent[1:]
    assert layout.start_mm[0].tolist() == [0.0, 0.0]
    assert np.array_equal(layout.start_mm[1:], layout.end_mm[parents])
    assert np.degrees(layout.heading_rad) == pytest.approx([0, -30, 30, -50.0, -10.0, 10.0, 50.0])
    lengths = np.hypot(*(layout.end_mm - layout.start_mm).T)
    assert lengths == pytest.approx([120.0, 80.0, 40.0, 30.0, 30.0, 30.0, 30.0])
    assert layout.width_mm.tolist() == [40.0, 20.0, 20.0, 10.0, 10.0, 10.0, 10.0]
    assert layout.end_width_mm[:2].tolist() == [36.0, 20.0]
    assert layout.tail_mm == 75.0
    with pytest.raises(ValueError, match="read-only"):
        layout.start_mm[0] = 1


def test_an_outline_equals_the_union_of_plain_shapes(sound_design, sound_body):
    outline, union = body_outline(sound_design), sound_body()
    assert outline.problems == ()
    assert union.geom_type == "Polygon"
    assert len(union.interiors) == 0
    word, figures = compared(sound_design, odd=True, union=union)
    assert (word, beyond(figures)) == ("drawn", {})
    # It names the branch that each segment lies on.
    layout, contour = flat_layout(sound_design), outline.contour
    row = {name: number for number, name in enumerate(layout.tree.ids)}
    assert set(contour.branches) == set(row)
    for segment in contour.segments:
        branch = row[segment.branch]
        if segment.part is Part.SIDE:
            axis = layout.start_mm[branch], layout.end_mm[branch]
            away = LineString(axis).distance(LineString([segment.start_mm, segment.end_mm]))
            halves = sorted((layout.width_mm[branch] / 2, layout.end_width_mm[branch] / 2))
            assert halves[0] - 1e-6 <= away <= halves[1] + 1e-6
        if segment.part in (Part.TIP, Part.POUCH) and sound_design.build.pouch is None:
            assert segment.center_mm == pytest.approx(layout.end_mm[branch], abs=1e-6)
        if segment.part is Part.TAIL:
            # The corner of a tapered trunk lies past its base by half the arc that it stands for.
            assert max(segment.start_mm[0], segment.end_mm[0]) <= LEAST_CUT_MM / 2
        if segment.bulge and segment.part is not Part.COLLAR:
            assert (segment.bulge < 0.0) == (segment.part is Part.FILLET)


@pytest.mark.parametrize("offset_mm", [0.55, 6.0, -1.5])
def test_every_point_of_an_offset_is_that_far_from_the_lumen(sound_design, sound_body, offset_mm):
    outline = body_outline(sound_design, offset_mm)
    edge = sound_body(beyond_mm=50.0).exterior
    line = shapely.segmentize(LineString(outline.contour.flattened_mm(FINE_MM)), 1.0)
    distances = distances_mm(shapely.get_coordinates(line), edge)
    assert outline.problems == ()
    assert flat(outline.contour).is_valid
    assert np.abs(distances - abs(offset_mm)).max() < 1e-3
    assert outline.contour.points_mm[[0, -1], 0].tolist() == [-sound_design.build.tail_mm] * 2


# A tail too short for a corner ends at the mouth.
WITHOUT_TAIL = Design(
    name="any",
    trunk_length_mm=121.604,
    levels=(Level(branches=2, length_mm=10.0, fan_rad=math.radians(20), growth=0.86),),
    build=Build(widths_mm=(8.0, 2.0), fillet_mm=(2.0,), taper=(0.62, 0.4), tail_mm=0.0),
)


@pytest.mark.parametrize("odd", [False, True])
def test_random_designs_have_a_right_outline_or_a_named_problem(odd):
    assert beyond(compared(WITHOUT_TAIL, odd=True)[1]) == {}
    words = []
    for number in range(40 if odd else 6):
        word, figures = compared(
            random_design(np.random.default_rng([7, number]), odd=odd), odd=odd
        )
        assert (number, beyond(figures)) == (number, {})
        words.append(word)
    assert {"drawn", "named"} <= set(words) <= {"drawn", "named", "crosses itself"}


def test_offsets_of_odd_designs_are_as_far_as_asked():
    compared_designs = 0
    for number in range(50):
        random = np.random.default_rng([8, number])
        design, offset_mm = random_design(random, odd=True), random.choice([-1.0, 0.55, 3.0, 12.0])
        outline = body_outline(design, offset_mm)
        assert np.isfinite(outline.contour.points_mm).all()
        shape, lumen = flat(outline.contour), flat(body_outline(design).contour)
        if outline.problems or not shape.is_valid or not lumen.is_valid:
            continue
        compared_designs += 1
        edge = Twin(design, FINE_MM).body(beyond_mm=50.0).boundary
        points = shapely.get_coordinates(shapely.segmentize(shape.exterior, 5.0))
        # The mouth's own line is nearer to the lumen drawn out than the offset.
        clear = shapely.points(points[points[:, 0] > -design.build.tail_mm + 1e-6])
        far = shapely.distance(clear, edge)
        assert (number, np.abs(far - abs(offset_mm)).max() <= 0.01) == (number, True)
    assert compared_designs > 8


def test_a_long_fillet_is_split(make_plan, make_fan):
    contour = body_outline(make_plan((40.0, 4.0), (2.0,), [make_fan(2, 400, 4)])).contour
    between = [s for s in contour.segments if s.part is Part.FILLET and s.turn_rad < -1.5]
    assert [math.degrees(s.turn_rad) for s in between] == pytest.approx([-88.0, -88.0])
    assert [s.radius_mm for s in between] == pytest.approx([2.0, 2.0])


def test_branches_are_met_in_the_order_of_a_depth_first_tour(make_plan, make_fan):
    levels = [make_fan(2, 150, 90), make_fan(2, 80, 70)]
    contour = body_outline(make_plan((40.0, 24.0, 12.0), levels=levels)).contour
    tips = [s.branch for s in contour.segments if s.part is Part.TIP]
    assert list(dict.fromkeys(tips)) == ["0.0.0", "0.0.1", "0.1.0", "0.1.1"]


@pytest.mark.parametrize("tail", [0.01, 0.15])
def test_a_tail_too_short_to_cut_joins_the_trunks_side(make_plan, tail):
    parts = [s.part for s in body_outline(make_plan((40.0,), tail=tail)).contour.segments]
    assert parts == [Part.SIDE, Part.TIP, Part.TIP, Part.SIDE]


@pytest.mark.parametrize("offset_mm", [0.0, 0.55])
@pytest.mark.parametrize(
    ("width", "ratio", "trunk", "arcs"),
    [(40.0, 0.95, 120.0, 0), (20.0, 0.8, 120.0, 0), (6.0, 0.5, 40.0, 0), (40.0, 0.85, 120.0, 2)],
)
def test_a_tapered_trunk_has_a_corner_where_an_arc_would_be_too_short_to_cut(
    make_plan, width, ratio, trunk, arcs, offset_mm
):
    design = make_plan((width,), trunk=trunk, taper=(ratio,))
    lean = math.asin(width / 2 * (1 - ratio) / trunk)
    assert (LEAST_SEGMENT_MM < width / 2 * lean < LEAST_CUT_MM) == (arcs == 0)
    outline = body_outline(design, offset_mm)
    assert outline.problems == ()
    assert [segment.part for segment in outline.contour.segments].count(Part.JOINT) == arcs
    assert min(segment.length_mm for segment in outline.contour.segments) >= LEAST_CUT_MM
    body = Twin(design, FINE_MM).body(beyond_mm=50.0).buffer(offset_mm, quad_segs=512)
    body = body.intersection(shapely.box(-design.build.tail_mm, -1e3, 1e3, 1e3))
    edges = (shapely.segmentize(one.exterior, 2.0) for one in (flat(outline.contour), body))
    assert shapely.hausdorff_distance(*edges) <= 0.0025


def pouched(level, pouch):
    return plan((40.0, 24.0), levels=[fan(*level)], pouch=pouch)


# Balls of 5 mm on both sides leave 0.03 mm of the joint's disc between them.
BARELY_DEG = 2 * math.degrees(math.asin(15 / 25)) + 0.1
WIDE_COLLAR = Collar(clamp_diameter_mm=60.0, length_mm=5.0, flare_mm=1.0)
CASES = [
    (plan((40.0, 40.0), levels=[fan(2, 150, 80)]), KIND.CHILD_WIDTH),
    (plan((40.0, 44.0), levels=[fan(2, 150, 80)]), KIND.CHILD_WIDTH),
    (plan((40.0, 24.0), levels=[fan(2, 150, 0)]), KIND.NARROW_CROTCH),
    (plan((40.0, 24.0), levels=[fan(2, 60, 30)]), KIND.NARROW_CROTCH),
    (plan((40.0, 24.0), levels=[fan(2, 150, 360)]), KIND.NARROW_CROTCH),
    (plan((40.0, 24.0), levels=[fan(1, 10, 0)]), KIND.NO_ROOM),
    (pouched((1, 150, 0), Pouch(shape="round", radius_mm=12.0)), KIND.POUCH_WIDTH),
    (
        pouched((1, 150, 0), Pouch(shape="rectangle", length_mm=30.0, width_mm=20.0)),
        KIND.POUCH_WIDTH,
    ),
    (pouched((1, 30, 0), Pouch(shape="round", radius_mm=20.0)), KIND.NO_ROOM),
    (
        plan((30.0,), collar=Collar(clamp_diameter_mm=30.0, length_mm=30.0, flare_mm=30.0)),
        KIND.COLLAR,
    ),
    (plan((30.0,), collar=WIDE_COLLAR), KIND.COLLAR_FLARE),
    # Discs of 20 and 6 mm: nearer than 14 mm / 0.99, the hull has no side to be drawn.
    (plan((40.0,), trunk=13.9, taper=(0.3,)), KIND.NO_ROOM),
    (plan((40.0,), trunk=14.2, taper=(0.3,)), None),
    (plan((40.0, 24.0), (0.015,), [fan(2, 200, 30)]), KIND.SHORT_SEGMENT),
    (plan((40.0, 20.0), (5.0,), [fan(2, 150, BARELY_DEG)]), KIND.SHORT_SEGMENT),
    # The lines of the parent's and the child's side cross 25 mm from the joint, behind its disc.
    (plan((24.0, 12.0), (2.0,), [fan(2, 36, 60)]), None),
]


@pytest.mark.parametrize(("design", "kind"), CASES)
def test_shapes_that_cannot_be_drawn_are_named(design, kind):
    outline = body_outline(design)
    found = {problem.kind for problem in outline.problems}
    assert kind in found if kind else not found
    assert np.isfinite(outline.contour.points_mm).all()
    for problem in outline.problems:
        assert problem.branches[0] in problem.message
        assert math.isfinite(problem.measured_mm)


def test_an_inward_offset_that_leaves_nothing_is_named(make_plan, make_fan):
    (problem,) = body_outline(make_plan((40.0, 10.0), levels=[make_fan(2, 100, 90)]), -5.0).problems
    assert (problem.kind, problem.branches) == (KIND.VANISHED, ("0.0",))


def test_a_problem_of_a_level_is_reported_once_with_its_count(make_plan, make_fan):
    levels = [make_fan(2, 150, 120), make_fan(2, 40, 30)]
    outline = body_outline(make_plan((40.0, 24.0, 12.0), levels=levels))
    crotches = [p for p in outline.problems if p.kind is KIND.NARROW_CROTCH]
    assert [(p.branches, p.count) for p in crotches] == [(("0.0.0", "0.0.1"), 2)]
    # Where the sides would cross: the half width over the sine of half the angle.
    assert crotches[0].measured_mm == pytest.approx(6.0 / math.sin(math.radians(15.0)))
    assert crotches[0].limit_mm == 20.0


def test_a_tail_that_does_not_end_square_is_named_and_not_its_cut(monkeypatch):
    def rounded(build, lean_rad, offset_mm):
        """Return a tail whose end has round corners of 6 mm, as a new key might draw it."""
        square, radius = tail_of(build, lean_rad, offset_mm), 6.0
        (mouth, low), part = square.collar.start_mm, Part.COLLAR
        start, center = (mouth, low + radius), (mouth + radius, low + radius)
        corner = StrokeRun(start, tuple(arc(center, start, math.pi / 2.0, part)))
        return replace(square, collar=corner, even_mm=mouth + radius)

    monkeypatch.setattr("vinefab.outline.body_outline.tail_of", rounded)
    design = vf.Design.read("plain_vine").changed(trunk_length_mm=431.7)
    (problem,) = body_outline(design).problems
    assert (problem.kind, problem.branches) == (KIND.MOUTH, ("0",))
    (finding,) = (one for one in vf.check(design, progress=False).findings if one.rule == "VF-L02")
    assert "cut straight across from corner to corner: let the tail end square" in finding.message


@pytest.mark.parametrize("clamp_mm", [12.0, 25.0, 40.0])
@pytest.mark.parametrize("length_mm", [0.0, 20.0])
def test_every_tail_that_a_design_may_have_ends_square(clamp_mm, length_mm):
    collar = Collar(clamp_diameter_mm=clamp_mm, length_mm=length_mm, flare_mm=40.0)
    assert tail_of(Build(widths_mm=(40.0,), collar=collar), 0.02, 1.5).is_square
